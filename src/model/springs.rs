//! Damped springs: forces, Jacobians, energy, dissipation.
//!
//! Between nodes i and j with d = x_j − x_i, ℓ = |d|, u = d/ℓ, ω = v_j − v_i:
//! f_i = \[k(ℓ − L) + c(ω·u)\] u and f_j = −f_i.

use std::ops::Range;

use crate::{Mat3, Vec3};

/// Added to ℓ² so that a spring of no length has a direction of zero, hence no force, instead of
/// NaN. Below half an ulp of ℓ² for every spring longer than 2e-7 m: there it changes no bit.
const LENGTH_SQUARED_FLOOR: f64 = 1e-30;

/// One spring, as a value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spring {
    /// The two nodes.
    pub nodes: [u32; 2],
    /// k, N/m.
    pub stiffness: f64,
    /// c, N·s/m.
    pub damping: f64,
    /// L, m.
    pub rest_length: f64,
}

/// Lanes of a packet: consecutive lower nodes whose springs are computed side by side.
const LANES: usize = 4;
/// A packet with fewer lanes in use costs more than its springs one by one.
const LEAST_LANES: usize = 3;

/// Many springs, laid out for the force sweep.
///
/// Four consecutive nodes form a *block*; their springs to the four nodes at one distance in the
/// numbering form a *packet*. A packet reads and writes both ends as contiguous runs, which the
/// compiler can turn into vector instructions; lanes without a spring have k = c = 0. Springs that
/// fill no packet are done one by one. The layout fixes the order of summation, and with it the
/// bits of the result.
#[derive(Debug, Clone, Default)]
pub struct Springs {
    /// Every spring, by its lower and then its upper node.
    all: Vec<Spring>,
    blocks: Vec<Block>,
    packets: Vec<Packet>,
    singles: Vec<Spring>,
    /// Whether any spring has a damper; without, the damping term is not computed.
    damped: bool,
}

#[derive(Debug, Clone)]
struct Block {
    first_node: usize,
    packets: Range<usize>,
}

#[derive(Debug, Clone)]
struct Packet {
    /// First of the upper nodes.
    upper: usize,
    stiffness: [f64; LANES],
    damping: [f64; LANES],
    rest_length: [f64; LANES],
}

/// How the geometric part of the elastic Jacobian is taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TangentKind {
    /// As it is: a compressed spring pushes sideways, and K may be indefinite.
    Exact,
    /// With 1 − L/ℓ clamped at zero, so that the elastic K stays negative semidefinite.
    Stabilised,
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
        let mut layout = Self { damped, ..Self::default() };
        for block in all.chunk_by(|a, b| a.nodes[0] as usize / LANES == b.nodes[0] as usize / LANES) {
            layout.add_block(block, node_count);
        }
        layout.all = all;
        layout
    }

    /// Packs the springs whose lower nodes are in one block.
    fn add_block(&mut self, springs: &[Spring], node_count: usize) {
        let first_node = springs[0].nodes[0] as usize / LANES * LANES;
        let first_packet = self.packets.len();
        let distance = |spring: &Spring| spring.nodes[1] - spring.nodes[0];
        let mut by_distance = springs.to_vec();
        by_distance.sort_by_key(|spring| (distance(spring), spring.nodes[0]));
        for packed in by_distance.chunk_by(|a, b| distance(a) == distance(b)) {
            let upper = first_node + distance(&packed[0]) as usize;
            // Two springs between the same nodes do not fit into one lane.
            let distinct = packed.windows(2).all(|pair| pair[0].nodes[0] < pair[1].nodes[0]);
            if packed.len() < LEAST_LANES || upper + LANES > node_count || !distinct {
                self.singles.extend_from_slice(packed);
                continue;
            }
            let mut packet =
                Packet { upper, stiffness: [0.0; LANES], damping: [0.0; LANES], rest_length: [0.0; LANES] };
            for spring in packed {
                let lane = spring.nodes[0] as usize - first_node;
                packet.stiffness[lane] = spring.stiffness;
                packet.damping[lane] = spring.damping;
                packet.rest_length[lane] = spring.rest_length;
            }
            self.packets.push(packet);
        }
        // Neighbouring distances write overlapping runs; a load that overlaps a store just done has
        // to wait for it, so packets that follow each other are taken from far apart.
        let mut ordered: Vec<Packet> = Vec::with_capacity(self.packets.len() - first_packet);
        for start in 0..LANES {
            ordered.extend(self.packets[first_packet..].iter().skip(start).step_by(LANES).cloned());
        }
        self.packets.truncate(first_packet);
        self.packets.append(&mut ordered);
        if self.packets.len() > first_packet {
            self.blocks.push(Block { first_node, packets: first_packet..self.packets.len() });
        }
    }

    /// Number of springs.
    pub fn len(&self) -> usize {
        self.all.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// Whether any spring has a damper.
    pub fn is_damped(&self) -> bool {
        self.damped
    }

    /// Every spring, by its lower and then its upper node.
    pub fn iter(&self) -> impl Iterator<Item = Spring> + '_ {
        self.all.iter().copied()
    }

    /// Adds every spring's force on its two nodes, N.
    pub fn add_forces(&self, x: &[Vec3], v: &[Vec3], f: &mut [Vec3]) {
        if self.damped { self.sweep::<true>(x, v, f) } else { self.sweep::<false>(x, v, f) }
    }

    fn sweep<const DAMPED: bool>(&self, x: &[Vec3], v: &[Vec3], f: &mut [Vec3]) {
        for block in &self.blocks {
            let lower = block.first_node..block.first_node + LANES;
            let (xi, vi) = (by_axis(x, block.first_node), by_axis(v, block.first_node));
            let mut sum = [[0.0; LANES]; 3];
            for packet in &self.packets[block.packets.clone()] {
                let force = packet.forces::<DAMPED>(&xi, &vi, &by_axis(x, packet.upper), &by_axis(v, packet.upper));
                for (lane, f) in f[packet.upper..packet.upper + LANES].iter_mut().enumerate() {
                    *f -= Vec3::new(force[0][lane], force[1][lane], force[2][lane]);
                }
                for axis in 0..3 {
                    for lane in 0..LANES {
                        sum[axis][lane] += force[axis][lane];
                    }
                }
            }
            for (lane, f) in f[lower].iter_mut().enumerate() {
                *f += Vec3::new(sum[0][lane], sum[1][lane], sum[2][lane]);
            }
        }
        for spring in &self.singles {
            let [i, j] = spring.nodes.map(|node| node as usize);
            let force = spring.force::<DAMPED>(x[j] - x[i], v[j] - v[i]);
            f[i] += force;
            f[j] -= force;
        }
    }

    /// ½ Σ k(ℓ − L)², J.
    pub fn elastic_energy(&self, x: &[Vec3]) -> f64 {
        self.iter()
            .map(|s| {
                let d = x[s.nodes[1] as usize] - x[s.nodes[0] as usize];
                let stretch = (d.norm_squared() + LENGTH_SQUARED_FLOOR).sqrt() - s.rest_length;
                0.5 * s.stiffness * stretch * stretch
            })
            .sum()
    }

    /// Power the dampers take out, Σ c(ω·u)² ≥ 0, W.
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

/// A vector for each lane, axis by axis: loops over lanes are what vector instructions are made of.
type Lanes = [[f64; LANES]; 3];

#[inline(always)]
fn by_axis(vectors: &[Vec3], first: usize) -> Lanes {
    let run = &vectors[first..first + LANES];
    let mut lanes = [[0.0; LANES]; 3];
    for lane in 0..LANES {
        for axis in 0..3 {
            lanes[axis][lane] = run[lane][axis];
        }
    }
    lanes
}

impl Packet {
    /// f_i of every lane, for ends at (xi, vi) and (xj, vj). Every line is a loop over lanes, which
    /// becomes a vector instruction.
    #[inline(always)]
    fn forces<const DAMPED: bool>(&self, xi: &Lanes, vi: &Lanes, xj: &Lanes, vj: &Lanes) -> Lanes {
        let mut force = [[0.0; LANES]; 3];
        let mut d = [[0.0; LANES]; 3];
        for axis in 0..3 {
            for l in 0..LANES {
                d[axis][l] = xj[axis][l] - xi[axis][l];
            }
        }
        let mut inverse = [0.0; LANES];
        let mut tension = [0.0; LANES];
        for l in 0..LANES {
            let square = d[0][l] * d[0][l] + d[1][l] * d[1][l] + d[2][l] * d[2][l];
            let length = (square + LENGTH_SQUARED_FLOOR).sqrt();
            inverse[l] = 1.0 / length;
            tension[l] = self.stiffness[l] * (length - self.rest_length[l]);
        }
        if DAMPED {
            for l in 0..LANES {
                let approach =
                    (vj[0][l] - vi[0][l]) * d[0][l] + (vj[1][l] - vi[1][l]) * d[1][l] + (vj[2][l] - vi[2][l]) * d[2][l];
                tension[l] += self.damping[l] * (approach * inverse[l]);
            }
        }
        for axis in 0..3 {
            for l in 0..LANES {
                force[axis][l] = d[axis][l] * (tension[l] * inverse[l]);
            }
        }
        force
    }
}

impl Spring {
    /// f_i, in the same operations as a packet's lanes.
    #[inline(always)]
    fn force<const DAMPED: bool>(&self, d: Vec3, omega: Vec3) -> Vec3 {
        let length = (d.norm_squared() + LENGTH_SQUARED_FLOOR).sqrt();
        let inverse = 1.0 / length;
        let mut tension = self.stiffness * (length - self.rest_length);
        if DAMPED {
            tension += self.damping * (omega.dot(&d) * inverse);
        }
        d * (tension * inverse)
    }

    /// (∂f_i/∂d, ∂f_i/∂ω) of (4), with Π = I − uuᵀ:
    /// k\[uuᵀ + (1 − L/ℓ)Π\] + c\[u(Πω)ᵀ + (ω·u)Π\]/ℓ and c uuᵀ.
    ///
    /// The damping part of the first is not symmetric. By the chain rule ∂f_i/∂x_j is the first
    /// block itself, ∂f_i/∂x_i its negative, and f_j's are the negatives of f_i's.
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
