//! Construction of scenes in Rust.

use super::check::{covering_ticks, positive, ticks_per_cycle, whole_ticks};
use super::{
    DEFAULT_GLOBAL_RATE_HZ, DEFAULT_LOCAL_RATE_HZ, FORCE_MARGIN, GlobalSettings, MeshSource, Problem, Scene,
    SceneError, Schedule, check,
};
use crate::contact::law::Law;
use crate::contact::rules::{ContactRules, Scheme, Wall};
use crate::device::instrument::InstrumentKind;
use crate::device::path::TipPath;
use crate::device::phantom::TipSensing;
use crate::device::phantom::actuation::ActuationSettings;
use crate::dynamics::constraint::Threads;
use crate::external::RendererLibrary;
use crate::local::model::LocalSettings;
use crate::local::step::LocalIntegrator;
use crate::model::network::Material;
use crate::multirate::timeline::{Deadline, OverrunPolicy};
use crate::surface::geometry::ContactSurface;

/// Returns the default of `instrument.force_limit`, N: a hundred times the largest force of a PHANTOM 1.5.
pub(super) fn default_force_limit_n() -> f64 {
    FORCE_MARGIN * ActuationSettings::default().largest_force
}

fn refused(problem: Problem) -> SceneError {
    SceneError::new(problem, None)
}

impl Scene {
    /// Builds a scene with the defaults of scene files: 1 kHz beside 10 Hz, the paper's local model, scheme and
    /// surface, the bottom of the mesh fixed, and as many ticks as the path takes. Settings changed later, by `with_…`
    /// or in public fields, are checked by [`prepare`](crate::pipeline::Simulation::prepare) or
    /// [`check`](Self::check).
    ///
    /// ```
    /// use stickslip::contact::{law::Law, rules::Scheme};
    /// use stickslip::device::path::{TipPath, Waypoint};
    /// use stickslip::model::{mesh::{Block, Stencil}, network::Material};
    /// use stickslip::scene::{Problem, Scene};
    /// use stickslip::{Vec3, pipeline};
    ///
    /// let block = Block { nodes: [5, 5, 3], spacing: 0.02, stencil: Stencil::Shear };
    /// let material = Material::uniform(75, 0.01, 100.0, 0.5);
    /// let at = |time, z| Waypoint { time, position: Vec3::new(0.0, 0.0, z) };
    /// let path = TipPath::new(vec![at(0.0, 0.001), at(0.1, -0.003)])?;
    /// let scene = Scene::new("press", block, material, Law::Sticking, path)?.with_scheme(Scheme::Velocity);
    /// assert_eq!((scene.tick_count(), scene.ticks_per_cycle()), (100, 100));
    /// let mut peak_n = 0.0_f64;
    /// pipeline::run(&scene, |tick| peak_n = peak_n.max(tick.report.normal_force))?;
    /// assert!(peak_n > 0.05, "{peak_n}");
    ///
    /// // A cycle is a whole number of ticks, and friction is not negative.
    /// assert!(scene.clone().with_global_rate_hz(300.0).is_err());
    /// let error = scene.with_law(Law::StickSlip { friction: (-1.0).into() }).check().expect_err("negative friction");
    /// assert!(matches!(error.problem(), Problem::NotAccepted { key: "contact.friction", .. }));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If a value is out of range, a list of the material does not fit the mesh, or the run would not fit into memory.
    pub fn new(
        name: impl Into<String>,
        mesh: impl Into<MeshSource>,
        material: Material,
        law: Law,
        path: TipPath,
    ) -> Result<Self, SceneError> {
        let mesh = mesh.into();
        let local_rate_hz = DEFAULT_LOCAL_RATE_HZ;
        let mut scene = Self {
            name: name.into(),
            fixed: Vec::new(),
            mesh,
            material,
            settle: false,
            global: GlobalSettings::default(),
            integrator: LocalIntegrator::default(),
            surface: ContactSurface::default(),
            contact_radius: 0.0,
            contact: ContactRules { law, scheme: Scheme::default(), adhesion_n: 0.0, wall: Wall::default() },
            instrument: InstrumentKind::Path,
            force_limit_n: default_force_limit_n(),
            smoothing_ticks: 0,
            schedule: Schedule::default(),
            deadline: Deadline { after: 1.0 / local_rate_hz, overrun: OverrunPolicy::default() },
            costs: None,
            local_rate_hz,
            ticks_per_cycle: ticks_per_cycle("global.rate", local_rate_hz, DEFAULT_GLOBAL_RATE_HZ).map_err(refused)?,
            tick_count: covering_ticks(path.end(), local_rate_hz),
            path,
            is_full: false,
            local: LocalSettings::default(),
            renderer: None,
            source: None,
        };
        check::mesh(&scene).map_err(refused)?;
        scene.fixed = scene.mesh.bottom();
        scene.check()?;
        Ok(scene)
    }

    /// Sets the number of ticks.
    pub fn with_ticks(self, tick_count: u64) -> Self {
        Self { tick_count, ..self }
    }

    /// Sets the duration, s.
    ///
    /// # Errors
    /// If the duration is not a whole number of ticks.
    pub fn with_duration_s(self, duration_s: f64) -> Result<Self, SceneError> {
        let key = "duration";
        let tick_count = positive(key, duration_s).and_then(|duration| whole_ticks(key, duration, self.local_rate_hz));
        Ok(self.with_ticks(tick_count.map_err(refused)?))
    }

    /// Sets the rate of the local loop, Hz, and keeps the duration. A deadline of one tick stays one tick.
    ///
    /// # Errors
    /// If the duration or a global cycle is not a whole number of ticks, or the deadline is longer than a tick.
    pub fn with_local_rate_hz(self, rate_hz: f64) -> Result<Self, SceneError> {
        let key = "local.rate";
        let at_rate = |scene: &Self| {
            positive(key, rate_hz)?;
            let ticks_per_cycle = ticks_per_cycle(key, rate_hz, scene.global_rate_hz())?;
            Ok((ticks_per_cycle, whole_ticks(key, scene.duration_s(), rate_hz)?))
        };
        let (ticks_per_cycle, tick_count) = at_rate(&self).map_err(refused)?;
        let mut deadline = self.deadline;
        if deadline.after == self.tick_s() {
            deadline.after = 1.0 / rate_hz;
        } else if !(deadline.after <= 1.0 / rate_hz) {
            let (after, tick_s) = (deadline.after, 1.0 / rate_hz);
            let value = format!("{rate_hz} Hz with a deadline of {after} s: a tick lasts {tick_s} s");
            return Err(refused(Problem::NotAccepted { key, value }));
        }
        Ok(Self { local_rate_hz: rate_hz, ticks_per_cycle, tick_count, deadline, ..self })
    }

    /// Sets the rate of global cycles, Hz. The number of steps in a cycle stays.
    ///
    /// # Errors
    /// If a cycle is not a whole number of ticks.
    pub fn with_global_rate_hz(self, rate_hz: f64) -> Result<Self, SceneError> {
        let key = "global.rate";
        let ticks = positive(key, rate_hz).and_then(|rate| ticks_per_cycle(key, self.local_rate_hz, rate));
        Ok(Self { ticks_per_cycle: ticks.map_err(refused)?, ..self })
    }

    /// Sets the length of a global cycle, in ticks of the local loop. The number of steps in a cycle stays.
    pub fn with_ticks_per_cycle(self, ticks_per_cycle: u32) -> Self {
        Self { ticks_per_cycle, ..self }
    }

    /// Slows time down: ticks, deadline and path take `factor` times as long. The numbers of ticks stay.
    pub fn with_slower_time(self, factor: f64) -> Self {
        let deadline = Deadline { after: self.deadline.after * factor, ..self.deadline };
        let path = self.path.transformed(factor, |position| position);
        Self { local_rate_hz: self.local_rate_hz / factor, deadline, path, ..self }
    }

    /// Sets the local model beside the network.
    pub fn with_local_model(self, local: LocalSettings) -> Self {
        Self { local, is_full: false, renderer: None, ..self }
    }

    /// Sets the reference: the whole network at the local rate. This disables what it has no use for: a solver of the
    /// linear model, smoothing at hand-overs, a second thread.
    pub fn with_full_model(mut self) -> Self {
        self.global.threads = Threads::One;
        let integrator = LocalIntegrator::SemiImplicitEuler;
        Self { local: LocalSettings::FULL, is_full: true, renderer: None, integrator, smoothing_ticks: 0, ..self }
    }

    /// Sets the renderer of a library in place of the local model, the contact scheme and the contact law, which are
    /// then not used.
    pub fn with_renderer(self, renderer: RendererLibrary) -> Self {
        let local = if self.is_full { LocalSettings::default() } else { self.local };
        Self { renderer: Some(renderer), is_full: false, local, ..self }
    }

    /// Runs the renderer of a library in this process, if the scene has one: real time has no use for a process beside it.
    pub fn with_renderer_in_process(self) -> Self {
        Self { renderer: self.renderer.map(RendererLibrary::in_process), ..self }
    }

    /// Sets the integrator of the local model. All but semi-implicit Euler need a tangent, and contact by
    /// [`Scheme::Velocity`].
    pub fn with_local_integrator(self, integrator: LocalIntegrator) -> Self {
        Self { integrator, ..self }
    }

    /// Sets the contact law.
    pub fn with_law(mut self, law: Law) -> Self {
        self.contact.law = law;
        self
    }

    /// Sets the scheme that constrains the mesh at the contact.
    pub fn with_scheme(mut self, scheme: Scheme) -> Self {
        self.contact.scheme = scheme;
        self
    }

    /// Sets the contact surface of the mesh.
    pub fn with_surface(self, surface: ContactSurface) -> Self {
        Self { surface, ..self }
    }

    /// Sets the radius of the disc over which a contact is spread, m; 0 for a point.
    pub fn with_contact_radius(self, radius: f64) -> Self {
        Self { contact_radius: radius, ..self }
    }

    /// Returns the instrument, with the tip that contact sees: where the device's settings leave it open, the observed one
    /// under the massless scheme, whose dampers would feel every encoder count, and the quantised one under the others.
    pub(crate) fn instrument_in_use(&self) -> InstrumentKind {
        let mut kind = self.instrument.clone();
        if let InstrumentKind::Phantom(settings) = &mut kind {
            settings.phantom.sensing.get_or_insert(match self.contact.scheme {
                Scheme::Geometric { .. } | Scheme::Velocity => TipSensing::Quantised,
                Scheme::Massless => TipSensing::Observed,
            });
        }
        kind
    }

    /// Sets the instrument and its path. The number of ticks stays.
    pub fn with_instrument(self, instrument: InstrumentKind, path: TipPath) -> Self {
        Self { instrument, path, ..self }
    }

    /// Sets which nodes are fixed.
    pub fn with_fixed(self, fixed: Vec<bool>) -> Self {
        Self { fixed, ..self }
    }
}
