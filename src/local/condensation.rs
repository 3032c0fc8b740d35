//! An exterior that follows the patch quasi-statically: x_E − x_E₀ = −K_EE⁻¹K_EL (x_L − x_L₀), so that
//! f gains C(x − x₀), C = −K_LE K_EE⁻¹ K_EL.
//!
//! K is the elastic Jacobian alone, which is symmetric; here it is taken with the opposite sign, so that
//! what is stable is positive. Far from the contact the exterior may be interpolated from a coarse
//! grid (Galerkin): a *point* of the condensed system is a node of the network or a vertex of that
//! grid.

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
use crate::model::springs::{Spring, TangentKind};
use crate::word::words;
use crate::{Mat3, Vec3};

/// Edge of a cell of the coarse grid, in lengths of a spring.
const COARSENING: f64 = 4.0;
/// Vertices of the coarse grid that move the same few nodes may be interchangeable; this share of the
/// springs' stiffness decides between them. What it changes of C is of the same order.
const COARSE_GROUND: f64 = 1e-8;
/// Eigenvalues of K + C this far above zero, as a share of the springs' stiffness, are round-off of a
/// body that can move freely.
const FREE_MOTION: f64 = 1e-9;
/// Most points that one spring depends on: the corners of the cells of its two ends.
const MOST_POINTS: usize = 16;
/// Unordered pairs of these, a point with itself included.
const MOST_PAIRS: usize = MOST_POINTS * (MOST_POINTS + 1) / 2;

/// How an exterior is condensed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Condensation {
    /// Of the Jacobian that C is made from.
    pub tangent: TangentKind,
    /// How much of the exterior follows.
    pub reach: Reach,
}

/// How much of the exterior follows the patch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reach {
    /// All of it.
    All,
    /// What lies within so many springs of the patch's centre.
    Rings {
        /// Springs.
        rings: u32,
        /// What the rest does.
        far_field: FarField,
    },
}

/// What the exterior beyond [`Reach::Rings`] does.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum FarField {
    /// It stays where it is.
    #[default]
    Fixed,
    /// It follows as a coarse grid does whose cells are four springs long.
    Coarse,
}

words!(FarField { Fixed = "fixed", Coarse = "coarse" });

/// What became of the exterior of one model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CondensationOutcome {
    /// C is made from the Jacobian that was asked for.
    AsAsked,
    /// With the exact Jacobian the exterior is in no stable equilibrium (it is compressed, or hinged):
    /// the model is built with the stabilised one.
    Stabilised,
    /// Also with the stabilised Jacobian a part of the exterior that hangs on the patch can move
    /// without any force: the exterior stays fixed.
    Held,
}

/// What became of all models of a run.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct CondensationCounts {
    /// Models built.
    pub models: u64,
    /// With the stabilised tangent because the exact one is not definite over the exterior.
    pub stabilised: u64,
    /// With a fixed exterior because it can move without any force.
    pub held: u64,
    /// Whose own tangent K + C is indefinite: they diverge unless the contact holds them.
    pub indefinite: u64,
}

impl fmt::Display for CondensationCounts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { models, stabilised, held, indefinite } = self;
        write!(
            f,
            "condensed exterior: {models} models; {stabilised} with the stabilised tangent because the exact one is \
             indefinite over the exterior, {held} with a fixed exterior because it can move without a force, \
             {indefinite} indefinite themselves"
        )
    }
}

/// C of one model, and what it took.
#[derive(Debug, Clone)]
pub struct Condensed {
    /// C, N/m; none where the exterior is held.
    pub stiffness: Option<DMatrix<f64>>,
    /// What became of the exterior.
    pub outcome: CondensationOutcome,
    /// The tangent that this model is built with.
    pub tangent: TangentKind,
    /// Size of the system.
    pub size: CondensedSize,
}

/// How large a condensed system is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct CondensedSize {
    /// Exterior nodes that follow, each for itself.
    pub nodes: usize,
    /// Vertices of the coarse grid.
    pub vertices: usize,
    /// Its factor.
    pub factor: FactorCost,
}

/// Condenses the exterior of one patch after the other.
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
/// // An exterior that follows takes load off the patch, and never more than it carried: C is positive semidefinite.
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
    /// For one network.
    pub fn new(network: &Network, settings: Condensation) -> Self {
        let grid = match settings.reach {
            Reach::Rings { far_field: FarField::Coarse, .. } => {
                Some(Arc::new(Grid::new(&network.rest, COARSENING * mean_shortest_spring(network))))
            }
            Reach::Rings { far_field: FarField::Fixed, .. } | Reach::All => None,
        };
        Self { settings, grid, plan: None, values: Vec::new(), factor: Vec::new(), counts: Default::default() }
    }

    /// C of a patch in a network at `x`. What depends on the patch alone (who is condensed, in which
    /// order, the pattern of the factor) is kept until another patch comes; then it is made anew.
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

    /// What became of the models so far.
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
            for (row, column, sign) in [(i, i, 1.0), (j, j, 1.0), (j, i, -1.0), (i, j, -1.0)] {
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

/// All of the condensation that depends on the patch but not on positions.
#[derive(Debug, Clone)]
struct Plan {
    patch: Vec<u32>,
    centre: Option<u32>,
    nodes: usize,
    vertices: usize,
    elimination: Elimination,
    /// Springs with an exterior end, group after group.
    springs: Vec<Spring>,
    groups: Vec<Group>,
    /// For each spring of a group, how much each of the group's points moves its end j less its end i.
    weights: Vec<f64>,
    /// For each pair of a group's points, where its block goes; none between points of the patch.
    places: Vec<Option<BlockPlace>>,
    /// Blocks of the coarse vertices on the diagonal.
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

    /// The stiffness of the springs with an exterior end, without its part within the patch.
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
                    // The weights first: when they end, no sum of the next row has been taken.
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

/// Springs whose ends have the same roles: those that are sorted by them, cut apart.
fn grouped<'a>(points: &'a Points, springs: &'a [Spring]) -> impl Iterator<Item = &'a [Spring]> {
    springs.chunk_by(|a, b| points.roles(a.nodes) == points.roles(b.nodes))
}

/// The points of each group.
fn lists<'a>(points: &'a Points, springs: &'a [Spring]) -> impl Iterator<Item = Vec<u32>> {
    grouped(points, springs).map(|group| points.of(group[0].nodes))
}

/// Every pair of a list, a point with itself included, in the order of the list.
fn pairs(list: Vec<u32>) -> impl Iterator<Item = [u32; 2]> {
    let count = list.len();
    (0..count).flat_map(move |a| (a..count).map(move |b| (a, b))).map(move |(a, b)| [list[a], list[b]])
}

/// The mean, over the nodes, of the length of their shortest spring, m: the spacing of a block.
fn mean_shortest_spring(network: &Network) -> f64 {
    let shortest = |node: u32| network.links(node).iter().map(|link| link.spring.rest_length).reduce(f64::min);
    let lengths: Vec<f64> = (0..network.node_count() as u32).filter_map(shortest).collect();
    lengths.iter().sum::<f64>() / lengths.len() as f64
}
