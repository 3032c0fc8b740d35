//! `trace.csv`: one row per tick with the state at its end.

use serde::Serialize;

use crate::contact::rules::Scheme;
use crate::pipeline::TickView;
use crate::surface::geometry::ContactPoint;

/// A row of the trace. Floats are written in the shortest form that reads back to the same bits. The contact columns
/// describe the located contact and are empty in free ticks. The device columns are empty without a modelled device, the
/// last two under other schemes than the massless one.
///
/// ```
/// use stickslip::{output::trace::TraceRow, pipeline, scene::Scene};
///
/// // The tip meets the block after 80 ticks.
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(150);
/// let mut trace = csv::Writer::from_writer(Vec::new());
/// pipeline::run(&scene, |tick| trace.serialize(TraceRow::new(tick)).expect("a row fits the header"))?;
/// let text = String::from_utf8(trace.into_inner()?)?;
/// let rows: Vec<Vec<&str>> = text.lines().map(|line| line.split(',').collect()).collect();
/// let column = rows[0].iter().position(|name| *name == "triangle").expect("a column of it");
/// // A contact has a triangle, a free tip has none.
/// assert_eq!(rows.len(), 151);
/// assert!(rows[1..=80].iter().all(|row| row[column].is_empty()));
/// assert!(rows[81..].iter().all(|row| !row[column].is_empty()));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TraceRow {
    tick: u64,
    t: f64,
    qx: f64,
    qy: f64,
    qz: f64,
    fx: f64,
    fy: f64,
    fz: f64,
    #[serde(rename = "fn")]
    normal_force: f64,
    ft: f64,
    mode: &'static str,
    triangle: Option<u32>,
    alpha: Option<f64>,
    beta: Option<f64>,
    gamma: Option<f64>,
    nx: Option<f64>,
    ny: Option<f64>,
    nz: Option<f64>,
    kinetic: f64,
    elastic: f64,
    gravitational: f64,
    work: f64,
    model_age: u64,
    damping_loss: f64,
    friction_loss: f64,
    impact_loss: f64,
    timing: Option<&'static str>,
    device_x: Option<f64>,
    device_y: Option<f64>,
    device_z: Option<f64>,
    contact_fx: Option<f64>,
    contact_fy: Option<f64>,
    contact_fz: Option<f64>,
    hand_energy: Option<f64>,
    contact_kinetic: Option<f64>,
    contact_exchange: Option<f64>,
}

impl TraceRow {
    /// Builds the row of a tick.
    pub fn new(view: &TickView) -> Self {
        let report = view.report;
        let weight = |i: usize| report.touch.map(|touch| touch.point.weights[i]);
        let device = |i: usize| view.device.map(|device| device.tip[i]);
        let contact = |i: usize| view.device.map(|_| report.force[i]);
        let is_massless = view.local.scheme() == Scheme::Massless;
        let held = |energy: f64| is_massless.then_some(energy);
        let normal = |i: usize| report.touch.map(|touch| touch.normal[i]);
        Self {
            tick: view.tick,
            t: view.time,
            qx: view.tip.x,
            qy: view.tip.y,
            qz: view.tip.z,
            fx: view.force.x,
            fy: view.force.y,
            fz: view.force.z,
            normal_force: view.normal_force(),
            ft: view.tangential_force(),
            mode: report.mode.name(),
            triangle: report.touch.map(|touch| {
                let ContactPoint { triangle, .. } = touch.point;
                triangle
            }),
            alpha: weight(0),
            beta: weight(1),
            gamma: weight(2),
            nx: normal(0),
            ny: normal(1),
            nz: normal(2),
            kinetic: view.energy.kinetic,
            elastic: view.energy.elastic,
            gravitational: view.energy.gravitational,
            work: view.energy.work,
            model_age: view.model_age,
            damping_loss: view.energy.damping_loss,
            friction_loss: view.energy.friction_loss,
            impact_loss: view.energy.impact_loss,
            timing: view.has_deadlines.then(|| view.deadline_outcome.name()),
            device_x: device(0),
            device_y: device(1),
            device_z: device(2),
            contact_fx: contact(0),
            contact_fy: contact(1),
            contact_fz: contact(2),
            hand_energy: view.device.map(|device| device.energy_to_hand_j),
            contact_kinetic: held(view.energy.contact.kinetic),
            contact_exchange: held(view.energy.contact.exchanged),
        }
    }
}
