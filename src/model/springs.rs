//! Damped springs: forces, Jacobians, energy and dissipation.
//!
//! Between nodes i and j with d = x_j − x_i, ℓ = |d|, u = d/ℓ, ω = v_j − v_i:
//! f_i = \[k(ℓ − L) + c(ω·u)\] u and f_j = −f_i.

mod sweep;

use std::ops::Range;

use pulp::Arch;

use super::columns::Columns;
use crate::word::words;
use crate::{Mat3, Vec3};
use sweep::{Constants, LANES, LENGTH_SQUARED_FLOOR, Packet, Rows, Section, sweep};

/// A single spring, as a value.
///
/// ```
/// use stickslip::{Vec3, model::springs::{Spring, Springs, TangentKind}};
///
/// let spring = Spring { nodes: [0, 1], stiffness: 100.0, damping: 0.5, rest_length: 1.0 };
/// let force = |d: Vec3| {
///     let mut f = [Vec3::zeros(); 2];
///     Springs::new(2, &[spring]).add_forces(&[Vec3::zeros(), d], &[Vec3::zeros(); 2], &mut f);
///     f[0]
/// };
/// // The Jacobian is the derivative of the force,
/// let (d, change, h) = (Vec3::new(0.8, 0.3, -0.4), Vec3::new(1.0, 2.0, 3.0), 1e-6);
/// let (by_d, by_rate) = spring.jacobian(d, Vec3::zeros(), TangentKind::Exact);
/// let central = (force(d + change * h) - force(d - change * h)) / (2.0 * h);
/// assert!((by_d * change - central).norm() < 1e-6);
/// // a damper works along the spring only, and a compressed spring pushes sideways unless it is stabilised.
/// assert!((by_rate * d - d * 0.5).norm() < 1e-15);
/// let across = Vec3::new(0.3, -0.8, 0.0);
/// assert!(across.dot(&(by_d * across)) < 0.0);
/// let (stabilised, _) = spring.jacobian(d, Vec3::zeros(), TangentKind::Stabilised);
/// assert!(across.dot(&(stabilised * across)).abs() < 1e-12);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spring {
    /// The two nodes.
    pub nodes: [u32; 2],
    /// Stiffness k, N/m.
    pub stiffness: f64,
    /// Damping c, N·s/m.
    pub damping: f64,
    /// Rest length L, m.
    pub rest_length: f64,
}

/// A packet with fewer lanes in use than this is not worth its idle ones.
const LEAST_LANES: usize = 3;
/// The cut decides the order of sums, so small networks have none: the results of the shipped scenes keep their bits,
/// and at 10,000 springs two threads still need two thirds of the time of one.
const LEAST_SPLIT: usize = 8192;

/// Part of the springs that is swept at one time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Part {
    /// Springs within the lower half of the nodes; all springs if there are no halves.
    Lower,
    /// Springs within the upper half.
    Upper,
    /// Springs from one half to the other.
    Seam,
}

const PARTS: usize = 3;

impl Part {
    pub const ALL: [Part; PARTS] = [Part::Lower, Part::Upper, Part::Seam];
}

/// A cut through a large network. The springs among the nodes below `split` and those among the others are about
/// equally many, and fewer than half of all cross the cut.
///
/// The cut exists whether or not two threads use it, and sums follow it, so that the bits of a result do not depend on
/// threads.
///
/// ```
/// use stickslip::model::{mesh::{Block, Stencil}, springs::{Spring, Springs}};
///
/// let springs = |nodes| {
///     let mesh = Block { nodes, spacing: 0.01, stencil: Stencil::Full }.mesh();
///     let spring = |&nodes: &[u32; 2]| Spring { nodes, stiffness: 100.0, damping: 0.0, rest_length: 0.01 };
///     Springs::new(mesh.nodes.len(), &mesh.edges.iter().map(spring).collect::<Vec<_>>())
/// };
/// assert!(springs([9, 9, 4]).halves().is_none());
/// // 16 layers of 256 nodes: cut in the middle, where one layer of each half meets the other.
/// let springs = springs([16, 16, 16]);
/// let halves = springs.halves().expect("46,620 springs");
/// assert!(halves.split.abs_diff(2048) < 256 && halves.reach.len() < 3 * 256);
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Halves {
    /// First node of the upper half.
    pub split: usize,
    /// Range of the nodes on which springs across the cut end, including all between them.
    pub reach: Range<usize>,
}

impl Halves {
    fn at(split: usize) -> Self {
        Self { split, reach: split..split }
    }
}

/// A set of springs, laid out for the force sweep.
///
/// Four consecutive nodes form a *block*; their springs to the four nodes at one distance in the numbering form a
/// *packet*. A packet reads and writes both ends as contiguous runs, which suits vector instructions; lanes without a
/// spring have k = c = 0. Springs that fill no packet are read and written one by one. The layout fixes the order of
/// summation, and with it the bits of the result.
///
/// ```
/// use stickslip::{Vec3, model::springs::{Spring, Springs}};
///
/// let spring = |i, j| Spring { nodes: [j, i], stiffness: 100.0, damping: 0.5, rest_length: 1.0 };
/// let springs = Springs::new(3, &[spring(1, 2), spring(0, 1)]);
/// assert!(springs.len() == 2 && springs.is_damped() && !springs.is_empty());
/// let nodes: Vec<[u32; 2]> = springs.iter().map(|spring| spring.nodes).collect();
/// assert_eq!(nodes, [[0, 1], [1, 2]]); // in the order of their sums
///
/// // Stretched by 10 %: f = k(ℓ − L), E = ½k(ℓ − L)².
/// let (x, v) = ([0.0, 1.0, 2.1].map(|x| Vec3::x() * x), [0.0, 0.0, 2.0].map(|v| Vec3::x() * v));
/// assert!((springs.elastic_energy(&x) - 0.5).abs() < 1e-12);
/// assert!((springs.damper_power(&x, &v) - 0.5 * 4.0).abs() < 1e-12); // c ω²
/// let mut f = [Vec3::zeros(); 3];
/// springs.add_forces(&x, &v, &mut f);
/// assert!((f[2].x + 10.0 + 1.0).abs() < 1e-12 && f.iter().sum::<Vec3>().norm() < 1e-12);
/// ```
#[derive(Debug, Clone, Default)]
pub struct Springs {
    /// All springs, by their lower and then their upper node.
    all: Vec<Spring>,
    /// Sections that are swept, in the order of [`Part`].
    sections: [Section; PARTS],
    halves: Option<Halves>,
    /// Whether any spring has a damper; if none has, the damping term is not computed.
    damped: bool,
}

/// Treatment of the geometric part of the elastic Jacobian.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum TangentKind {
    /// Unchanged: a compressed spring pushes sideways, and K may be indefinite.
    #[default]
    Exact,
    /// With 1 − L/ℓ clamped at zero, so that the elastic K stays negative semidefinite.
    Stabilised,
}

words!(TangentKind { Exact = "exact", Stabilised = "stabilised" });

/// Returns the node at which both sides have equally many springs; `None` if there are too few springs, or if most
/// would cross the cut, which both threads sweep.
fn cut(springs: &[Spring], node_count: usize) -> Option<usize> {
    if springs.len() < LEAST_SPLIT {
        return None;
    }
    // Numbers of springs whose lower node, and whose upper node, is each node.
    let mut ends = vec![[0_usize; 2]; node_count];
    for spring in springs {
        (0..2).for_each(|end| ends[spring.nodes[end] as usize][end] += 1);
    }
    let (mut below, mut above) = (0, springs.len());
    for (block, ends) in ends.chunks(LANES).enumerate() {
        if below >= above {
            return (springs.len() < 2 * (below + above)).then_some(block * LANES);
        }
        below += ends.iter().map(|[_, upper]| upper).sum::<usize>();
        above -= ends.iter().map(|[lower, _]| lower).sum::<usize>();
    }
    None
}

impl Springs {
    /// Lays out springs over nodes `0..node_count`.
    pub fn new(node_count: usize, springs: &[Spring]) -> Self {
        let mut all: Vec<Spring> = springs
            .iter()
            .map(|spring| {
                let [i, j] = spring.nodes;
                Spring { nodes: [i.min(j), i.max(j)], ..*spring }
            })
            .collect();
        all.sort_by_key(|spring| spring.nodes);
        let damped = all.iter().any(|spring| spring.damping != 0.0);
        let halves = cut(&all, node_count).map(Halves::at);
        let mut layout = Self { damped, halves, ..Self::default() };
        for block in all.chunk_by(|a, b| a.nodes[0] as usize / LANES == b.nodes[0] as usize / LANES) {
            layout.add_block(block, node_count);
        }
        layout.all = all;
        layout
    }

    /// Packs the springs whose lower nodes are in one block.
    fn add_block(&mut self, springs: &[Spring], node_count: usize) {
        let first_node = springs[0].nodes[0] as usize / LANES * LANES;
        let distance = |spring: &Spring| spring.nodes[1] - spring.nodes[0];
        let mut by_distance = springs.to_vec();
        by_distance.sort_by_key(|spring| (distance(spring), spring.nodes[0]));
        let mut packets: [Vec<Packet>; PARTS] = Default::default();
        for packed in by_distance.chunk_by(|a, b| distance(a) == distance(b)) {
            let upper = first_node + distance(&packed[0]) as usize;
            // Two springs between the same nodes do not fit into one lane.
            let distinct = packed.windows(2).all(|pair| pair[0].nodes[0] < pair[1].nodes[0]);
            if packed.len() < LEAST_LANES || upper + LANES > node_count || !distinct {
                for spring in packed {
                    let part = self.part(first_node, spring.nodes[1] as usize..spring.nodes[1] as usize + 1);
                    self.sections[part as usize].add_single(spring);
                }
                continue;
            }
            let mut packet = Packet { upper, constants: Constants::default() };
            for spring in packed {
                packet.constants.set(spring.nodes[0] as usize - first_node, spring);
            }
            packets[self.part(first_node, upper..upper + LANES) as usize].push(packet);
        }
        for (section, packets) in self.sections.iter_mut().zip(packets) {
            section.add_block(first_node, &packets);
        }
    }

    /// Returns the part that springs from a block of lower nodes to a run of upper ones belong to.
    fn part(&mut self, first_node: usize, upper: Range<usize>) -> Part {
        match &mut self.halves {
            Some(halves) if first_node >= halves.split => Part::Upper,
            Some(halves) if upper.end > halves.split => {
                halves.reach.start = halves.reach.start.min(first_node);
                halves.reach.end = halves.reach.end.max(upper.end);
                Part::Seam
            }
            _ => Part::Lower,
        }
    }

    /// Returns how two threads may share the springs; `None` if there are too few.
    pub fn halves(&self) -> Option<&Halves> {
        self.halves.as_ref()
    }

    /// Number of springs.
    pub fn len(&self) -> usize {
        self.all.len()
    }

    /// Whether there is no spring.
    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// Whether any spring has a damper.
    pub fn is_damped(&self) -> bool {
        self.damped
    }

    /// Iterates over all springs, by their lower and then their upper node.
    pub fn iter(&self) -> impl Iterator<Item = Spring> + '_ {
        self.all.iter().copied()
    }

    /// Adds every spring's force on its two nodes, N, with the machine's widest vector instructions. The result does
    /// not depend on them.
    pub fn add_forces(&self, x: &[Vec3], v: &[Vec3], f: &mut [Vec3]) {
        self.add_forces_on(Arch::new(), x, v, f);
    }

    fn add_forces_on(&self, arch: Arch, x: &[Vec3], v: &[Vec3], f: &mut [Vec3]) {
        for section in &self.sections {
            if self.damped {
                sweep::<true>(arch, section, Rows::new(x, v, f));
            } else {
                sweep::<false>(arch, section, Rows::new(x, v, f));
            }
        }
    }

    /// Adds the forces of a part of the springs to nodes in columns.
    pub(crate) fn add_to_columns(&self, arch: Arch, part: Part, columns: &mut Columns) {
        let section = &self.sections[part as usize];
        if self.damped {
            sweep::<true>(arch, section, columns.axes());
        } else {
            sweep::<false>(arch, section, columns.axes());
        }
    }

    /// Elastic energy ½ Σ k(ℓ − L)², J.
    pub fn elastic_energy(&self, x: &[Vec3]) -> f64 {
        self.iter()
            .map(|s| {
                let d = x[s.nodes[1] as usize] - x[s.nodes[0] as usize];
                let stretch = (d.norm_squared() + LENGTH_SQUARED_FLOOR).sqrt() - s.rest_length;
                0.5 * s.stiffness * stretch * stretch
            })
            .sum()
    }

    /// Power dissipated by the dampers, Σ c(ω·u)² ≥ 0, W.
    pub fn damper_power(&self, x: &[Vec3], v: &[Vec3]) -> f64 {
        if !self.damped {
            return 0.0;
        }
        self.iter()
            .map(|s| {
                let [i, j] = s.nodes.map(|node| node as usize);
                let d = x[j] - x[i];
                let rate = (v[j] - v[i]).dot(&d) / (d.norm_squared() + LENGTH_SQUARED_FLOOR).sqrt();
                s.damping * rate * rate
            })
            .sum()
    }
}

impl Spring {
    /// Returns (∂f_i/∂d, ∂f_i/∂ω) of (4), with Π = I − uuᵀ: k\[uuᵀ + (1 − L/ℓ)Π\] + c\[u(Πω)ᵀ + (ω·u)Π\]/ℓ and c uuᵀ.
    ///
    /// The damping part of the first is not symmetric. By the chain rule ∂f_i/∂x_j is the first block itself, ∂f_i/∂x_i
    /// its negative, and the blocks of f_j are the negatives of those of f_i.
    pub fn jacobian(&self, d: Vec3, omega: Vec3, kind: TangentKind) -> (Mat3, Mat3) {
        let length = (d.norm_squared() + LENGTH_SQUARED_FLOOR).sqrt();
        let u = d * (1.0 / length);
        let uu = u * u.transpose();
        let across = Mat3::identity() - uu;
        let stretch = 1.0 - self.rest_length / length;
        let geometric = match kind {
            TangentKind::Exact => stretch,
            TangentKind::Stabilised => stretch.max(0.0),
        };
        let elastic = (uu + across * geometric) * self.stiffness;
        let damping = (u * (across * omega).transpose() + across * omega.dot(&u)) * (self.damping / length);
        (elastic + damping, uu * self.damping)
    }
}

/// Returns where a spring's Jacobian stands in the matrix −∂f/∂x or −∂f/∂v of a network, in which the ends have these places:
/// row, column and sign of each block.
pub(crate) fn spring_blocks<Place: Copy>([i, j]: [Place; 2]) -> [(Place, Place, f64); 4] {
    [(i, i, 1.0), (i, j, -1.0), (j, j, 1.0), (j, i, -1.0)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::mesh::{Block, Stencil};
    use crate::model::state::State;

    /// All levels of vector instructions that this machine has give the same bits.
    #[test]
    fn bits_do_not_depend_on_vector_instructions() {
        // Sizes below and above the smallest one with halves.
        [[7, 6, 5], [11, 10, 9]].into_iter().for_each(bits_agree);
    }

    fn bits_agree(nodes: [usize; 3]) {
        let mesh = Block { nodes, spacing: 0.0125, stencil: Stencil::Full }.mesh();
        let wave = |k: f64, i: usize| (k * i as f64).sin();
        let springs: Vec<Spring> = mesh
            .edges
            .iter()
            .enumerate()
            .map(|(i, &nodes)| Spring {
                nodes,
                stiffness: 100.0 + 30.0 * wave(0.3, i),
                damping: 0.5 + 0.2 * wave(0.9, i),
                rest_length: 0.0125 * (1.0 + 0.3 * wave(1.7, i)),
            })
            .collect();
        let springs = Springs::new(mesh.nodes.len(), &springs);
        let moved = |scale: f64| {
            (0..mesh.nodes.len()).map(move |i| Vec3::new(wave(1.1, i), wave(2.3, i), wave(3.7, i)) * scale)
        };
        let x: Vec<Vec3> = mesh.nodes.iter().zip(moved(2e-3)).map(|(x, d)| x + d).collect();
        let v: Vec<Vec3> = moved(0.3).collect();
        let bits = |of: &mut dyn Iterator<Item = Vec3>| -> Vec<u64> {
            of.flat_map(|f| f.iter().map(|f| f.to_bits()).collect::<Vec<_>>()).collect()
        };
        let forces = |arch: Arch| {
            let mut f = vec![Vec3::zeros(); x.len()];
            springs.add_forces_on(arch, &x, &v, &mut f);
            bits(&mut f.into_iter())
        };
        let in_columns = |arch: Arch| {
            let mut columns = Columns::new(x.len());
            columns.load(&State { x: x.clone(), v: v.clone() });
            Part::ALL.into_iter().for_each(|part| springs.add_to_columns(arch, part, &mut columns));
            bits(&mut (0..x.len()).map(|node| columns.force(node)))
        };
        assert!(springs.sections[0].packets.len() > 100 && !springs.sections[0].quartets.is_empty());
        assert!(
            springs.halves().is_some() == (nodes[0] == 11)
                && springs.sections[Part::Seam as usize].packets.is_empty() == (nodes[0] < 11)
        );
        let best = Arch::new();
        let rows = forces(best);
        assert!(in_columns(best) == rows && in_columns(Arch::Scalar) == rows, "columns give other bits than rows");
        #[cfg(target_arch = "x86_64")]
        assert!(forces(Arch::Scalar) == rows, "{best:?} gives other bits than the baseline");
        println!("RESIDUAL | the baseline's instructions | forces with the machine's best, bits that differ | 0 | 0");
    }
}
