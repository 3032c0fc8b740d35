//! Static condensation of the exterior, which follows the patch quasi-statically:
//! x_E − x_E₀ = −K_EE⁻¹K_EL (x_L − x_L₀), so that f gains C(x − x₀), C = −K_LE K_EE⁻¹ K_EL.
//!
//! K is the elastic Jacobian alone, which is symmetric. Here its sign is reversed, so that stable means positive. Far
//! from the contact the exterior may be interpolated from a coarse grid (Galerkin): a *point* of the condensed system
//! is a node of the network or a vertex of that grid.

mod points;

use std::fmt;
use std::sync::Arc;

use nalgebra::{Cholesky, DMatrix};
use serde::Serialize;

use self::points::Points;
use super::coarse::Grid;
use super::elimination::{BlockPlace, Couplings, Elimination, FactorCost, NotDefinite, nested_dissection};
use super::patch::Patch;
use crate::model::network::Network;
use crate::model::springs::{Spring, TangentKind, spring_blocks};
use crate::word::words;
use crate::{Mat3, Vec3};

/// Edge of a cell of the coarse grid, in spring lengths.
const COARSENING: f64 = 4.0;
/// Vertices of the coarse grid that move the same few nodes may be interchangeable; this share of the springs'
/// stiffness decides between them. The resulting change of C is of the same order.
const COARSE_GROUND: f64 = 1e-8;
/// Eigenvalues of K + C up to this far above zero, as a share of the springs' stiffness, count as round-off of a body
/// that can move freely.
const FREE_MOTION: f64 = 1e-9;
/// Largest number of points that one spring depends on: the corners of the cells of its two ends.
const MOST_POINTS: usize = 16;
/// Largest number of unordered pairs of such points, a point with itself included.
const MOST_PAIRS: usize = MOST_POINTS * (MOST_POINTS + 1) / 2;

/// Settings of the static condensation of an exterior.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Condensation {
    /// Kind of the Jacobian that C is built from.
    pub tangent: TangentKind,
    /// Part of the exterior that is condensed.
    pub reach: Reach,
}

/// Part of the exterior that is statically condensed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// The whole exterior.
    All,
    /// The nodes within this many springs of the patch's centre.
    Rings {
        /// Number of rings of springs.
        rings: u32,
        /// Model of the remaining exterior.
        far_field: FarField,
    },
}

/// Model of the exterior beyond [`Reach::Rings`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum FarField {
    /// The far field stays fixed.
    #[default]
    Fixed,
    /// The far field is condensed on a coarse grid whose cells are four springs long.
    Coarse,
}

words!(FarField { Fixed = "fixed", Coarse = "coarse" });

/// Outcome of the condensation for one model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CondensationOutcome {
    /// C is built from the requested Jacobian.
    AsAsked,
    /// With the exact Jacobian the exterior is in no stable equilibrium (it is compressed, or hinged): the model is
    /// built with the stabilised one.
    Stabilised,
    /// Even with the stabilised Jacobian a part of the exterior that is connected to the patch can move without any
    /// force: the exterior stays fixed.
    Held,
}

/// Number of models of a run by condensation outcome.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct CondensationCounts {
    /// Number of models built.
    pub models: u64,
    /// Number of models with the stabilised tangent, because the exact one is not definite over the exterior.
    pub stabilised: u64,
    /// Number of models with a fixed exterior, because it can move without any force.
    pub held: u64,
    /// Number of models whose own tangent K + C is indefinite: they diverge unless the contact holds them.
    pub indefinite: u64,
}

impl fmt::Display for CondensationCounts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { models, stabilised, held, indefinite } = self;
        write!(
            f,
            "condensed exterior: {models} models; {stabilised} with the stabilised tangent because the exact one is \
             indefinite over the exterior, {held} with a fixed exterior because it can move without a force, \
             {indefinite} with an indefinite tangent of their own"
        )
    }
}

/// C of one model, with its outcome and cost.
#[derive(Debug, Clone)]
pub struct Condensed {
    /// Stiffness C, N/m; `None` if the exterior is held fixed.
    pub stiffness: Option<DMatrix<f64>>,
    /// Outcome of the condensation.
    pub outcome: CondensationOutcome,
    /// Kind of tangent that this model is built with.
    pub tangent: TangentKind,
    /// Size of the condensed system.
    pub size: CondensedSize,
}

/// Size of a condensed system.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct CondensedSize {
    /// Number of exterior nodes that are points of their own.
    pub nodes: usize,
    /// Number of vertices of the coarse grid.
    pub vertices: usize,
    /// Cost of the factorisation.
    pub factor: FactorCost,
}

/// Condenses the exterior of one patch after another.
///
/// ```
/// use stickslip::local::condensation::{Condensation, Condenser, CondensationOutcome, Reach};
/// use stickslip::model::springs::TangentKind;
/// use stickslip::{pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
/// let simulation = Simulation::prepare(&scene)?;
/// let (network, patch) = (simulation.network(), &simulation.local().model().patch);
/// let mut condenser = Condenser::new(network, Condensation { tangent: TangentKind::Exact, reach: Reach::All });
/// let condensed = condenser.condense(network, patch, &network.rest);
/// assert_eq!((condensed.outcome, condenser.counts().models), (CondensationOutcome::AsAsked, 1));
///
/// // A condensed exterior takes load off the patch, and never more than it carried: C is positive semidefinite.
/// let c = condensed.stiffness.expect("it is as asked");
/// assert_eq!(c.nrows(), 3 * patch.len());
/// assert!((&c - c.transpose()).amax() < 1e-9);
/// assert!(c.symmetric_eigenvalues().min() > -1e-9);
/// let free = network.fixed.iter().filter(|&&fixed| !fixed).count();
/// assert_eq!(condensed.size.nodes, free - patch.len());
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Condenser {
    settings: Condensation,
    grid: Option<Arc<Grid>>,
    plan: Option<Plan>,
    values: Vec<f64>,
    factor: Vec<f64>,
    counts: CondensationCounts,
}

impl Condenser {
    /// Builds a condenser for one network.
    pub fn new(network: &Network, settings: Condensation) -> Self {
        let grid = match settings.reach {
            Reach::Rings { far_field: FarField::Coarse, .. } => {
                Some(Arc::new(Grid::new(&network.rest, COARSENING * mean_shortest_spring(network))))
            }
            Reach::Rings { far_field: FarField::Fixed, .. } | Reach::All => None,
        };
        Self { settings, grid, plan: None, values: Vec::new(), factor: Vec::new(), counts: Default::default() }
    }

    /// Computes C of a patch in a network at `x`. The parts that depend on the patch alone (the condensed nodes, their
    /// order, the pattern of the factor) are kept until the patch changes.
    pub fn condense(&mut self, network: &Network, patch: &Patch, x: &[Vec3]) -> Condensed {
        let plan = match self.plan.take() {
            Some(plan) if plan.is_for(patch) => plan,
            _ => Plan::new(network, patch, self.settings.reach, self.grid.as_deref()),
        };
        let mut with = |kind| plan.condense(x, kind, &mut self.values, &mut self.factor);
        let asked = self.settings.tangent;
        let (stiffness, outcome, tangent) = match (with(asked), asked) {
            (Ok(c), _) => (Some(c), CondensationOutcome::AsAsked, asked),
            (Err(NotDefinite), TangentKind::Stabilised) => (None, CondensationOutcome::Held, asked),
            (Err(NotDefinite), TangentKind::Exact) => match with(TangentKind::Stabilised) {
                Ok(c) => (Some(c), CondensationOutcome::Stabilised, TangentKind::Stabilised),
                Err(NotDefinite) => (None, CondensationOutcome::Held, asked),
            },
        };
        let condensed = Condensed { stiffness, outcome, tangent, size: plan.size() };
        self.counts.models += 1;
        match outcome {
            CondensationOutcome::AsAsked => {}
            CondensationOutcome::Stabilised => self.counts.stabilised += 1,
            CondensationOutcome::Held => self.counts.held += 1,
        }
        self.counts.indefinite += u64::from(condensed.is_indefinite(patch, x));
        self.plan = Some(plan);
        condensed
    }

    /// Returns the counts of outcomes so far.
    pub fn counts(&self) -> CondensationCounts {
        self.counts
    }
}

impl Condensed {
    /// Whether K + C of the patch has a direction in which it pushes outwards.
    fn is_indefinite(&self, patch: &Patch, x: &[Vec3]) -> bool {
        let m = patch.len();
        let mut stiffness = DMatrix::zeros(3 * m, 3 * m);
        let mut scale = 0.0_f64;
        let place = |slot: usize| x[patch.node(slot) as usize];
        for spring in patch.springs.iter() {
            let [i, j] = spring.nodes.map(|slot| slot as usize);
            let (block, _) = spring.jacobian(place(j) - place(i), Vec3::zeros(), self.tangent);
            scale = scale.max(spring.stiffness);
            for (row, column, sign) in spring_blocks([i, j]) {
                if row < m && column < m {
                    let mut entry = stiffness.fixed_view_mut::<3, 3>(3 * row, 3 * column);
                    entry += block * sign;
                }
            }
        }
        if let Some(c) = &self.stiffness {
            stiffness -= c;
        }
        for i in 0..3 * m {
            stiffness[(i, i)] += FREE_MOTION * scale;
        }
        Cholesky::new(stiffness).is_none()
    }
}

/// The parts of the condensation that depend on the patch but not on positions.
#[derive(Debug, Clone)]
struct Plan {
    patch: Vec<u32>,
    centre: Option<u32>,
    nodes: usize,
    vertices: usize,
    elimination: Elimination,
    /// Springs with an exterior end, group by group.
    springs: Vec<Spring>,
    groups: Vec<Group>,
    /// For each spring of a group, the motion of its end j minus that of its end i, per motion of each of the group's
    /// points.
    weights: Vec<f64>,
    /// For each pair of a group's points, the place of its block; `None` between points of the patch.
    places: Vec<Option<BlockPlace>>,
    /// Diagonal blocks of the coarse vertices.
    grounds: Vec<BlockPlace>,
    /// Largest stiffness of a spring, N/m.
    scale: f64,
}

/// Springs that depend on the same points.
#[derive(Debug, Clone, Copy)]
struct Group {
    points: usize,
    springs: usize,
}

impl Plan {
    fn new(network: &Network, patch: &Patch, reach: Reach, grid: Option<&Grid>) -> Self {
        let mut points = Points::new(network, patch, reach, grid);
        let exterior = points.exterior;
        let mut springs: Vec<Spring> =
            network.springs.iter().filter(|spring| points.are_exterior(spring.nodes)).collect();
        springs.sort_by_cached_key(|spring| points.roles(spring.nodes));

        let within_exterior = lists(&points, &springs).map(|mut list| {
            list.retain(|&point| (point as usize) < exterior);
            list
        });
        let couplings = Couplings::new(exterior, within_exterior.flat_map(pairs));
        let order = nested_dissection(&points.positions, &couplings);
        points.renumber(&order);

        let elimination = Elimination::new(exterior, patch.len(), lists(&points, &springs).flat_map(pairs));
        let (mut groups, mut weights, mut places) = (Vec::new(), Vec::new(), Vec::new());
        for (group, list) in grouped(&points, &springs).zip(lists(&points, &springs)) {
            groups.push(Group { points: list.len(), springs: group.len() });
            let roles = points.roles(group[0].nodes);
            let columns = roles.map(|role| points.columns(role, &list));
            for spring in group {
                let first = weights.len();
                weights.resize(first + list.len(), 0.0);
                for (node, sign) in spring.nodes.into_iter().zip([-1.0, 1.0]) {
                    let columns = &columns[usize::from(points.role[node as usize] != roles[0])];
                    for (column, share) in columns.iter().zip(points.shares(node)) {
                        column.iter().for_each(|at| weights[first + at] += sign * share);
                    }
                }
            }
            let in_patch = |point: u32| point as usize >= exterior;
            places.extend(pairs(list).map(|[column, row]| (!in_patch(column)).then(|| elimination.place(row, column))));
        }
        let grounds = points.vertex_point.iter().flatten().map(|&point| elimination.place(point, point)).collect();
        Self {
            patch: patch.nodes.clone(),
            centre: patch.centre,
            nodes: points.nodes,
            vertices: exterior - points.nodes,
            scale: springs.iter().map(|spring| spring.stiffness).fold(f64::MIN_POSITIVE, f64::max),
            springs,
            elimination,
            groups,
            weights,
            places,
            grounds,
        }
    }

    fn is_for(&self, patch: &Patch) -> bool {
        self.patch == patch.nodes && self.centre == patch.centre
    }

    fn size(&self) -> CondensedSize {
        CondensedSize { nodes: self.nodes, vertices: self.vertices, factor: self.elimination.cost() }
    }

    fn condense(
        &self,
        x: &[Vec3],
        kind: TangentKind,
        values: &mut Vec<f64>,
        factor: &mut Vec<f64>,
    ) -> Result<DMatrix<f64>, NotDefinite> {
        values.clear();
        values.resize(self.elimination.values_len(), 0.0);
        self.assemble(x, kind, values);
        self.elimination.schur(values, self.scale, factor)
    }

    /// Assembles the stiffness of the springs with an exterior end, without its part within the patch.
    fn assemble(&self, x: &[Vec3], kind: TangentKind, values: &mut [f64]) {
        let (mut springs, mut weights, mut places) = (self.springs.iter(), &self.weights[..], &self.places[..]);
        let mut sums = [Mat3::zeros(); MOST_PAIRS];
        for group in &self.groups {
            let sums = &mut sums[..group.points * (group.points + 1) / 2];
            sums.fill(Mat3::zeros());
            for spring in springs.by_ref().take(group.springs) {
                let [i, j] = spring.nodes.map(|node| node as usize);
                let (block, _) = spring.jacobian(x[j] - x[i], Vec3::zeros(), kind);
                let (own, rest) = weights.split_at(group.points);
                weights = rest;
                let mut sum = sums.iter_mut();
                for (a, weight) in own.iter().enumerate() {
                    let block = block * *weight;
                    // The weights come first in the zip: when they end, no sum of the next row has been consumed.
                    own[a..].iter().zip(sum.by_ref()).for_each(|(weight, sum)| *sum += block * *weight);
                }
            }
            let (own, rest) = places.split_at(sums.len());
            places = rest;
            for (sum, place) in sums.iter().zip(own) {
                if let Some(place) = place {
                    place.add(sum, values);
                }
            }
        }
        for ground in &self.grounds {
            ground.add(&(Mat3::identity() * (COARSE_GROUND * self.scale)), values);
        }
    }
}

/// Splits the springs, sorted by the roles of their ends, into groups of equal roles.
fn grouped<'a>(points: &'a Points, springs: &'a [Spring]) -> impl Iterator<Item = &'a [Spring]> {
    springs.chunk_by(|a, b| points.roles(a.nodes) == points.roles(b.nodes))
}

/// Returns the points of each group.
fn lists<'a>(points: &'a Points, springs: &'a [Spring]) -> impl Iterator<Item = Vec<u32>> {
    grouped(points, springs).map(|group| points.of(group[0].nodes))
}

/// Returns every pair of a list, a point with itself included, in the order of the list.
fn pairs(list: Vec<u32>) -> impl Iterator<Item = [u32; 2]> {
    let count = list.len();
    (0..count).flat_map(move |a| (a..count).map(move |b| (a, b))).map(move |(a, b)| [list[a], list[b]])
}

/// Mean over the nodes of the length of their shortest spring, m: the spacing of a block.
fn mean_shortest_spring(network: &Network) -> f64 {
    let shortest = |node: u32| network.links(node).iter().map(|link| link.spring.rest_length).reduce(f64::min);
    let lengths: Vec<f64> = (0..network.node_count() as u32).filter_map(shortest).collect();
    lengths.iter().sum::<f64>() / lengths.len() as f64
}
