//! The force sweep: four springs at a time, with the vector instructions of the machine.
//!
//! With s = d·d the force on a node is d \[k(ℓ − L)ℓ + c ω·d\]/s, ℓ = √s. Root and division do not wait for each other,
//! and a spring at its rest length has exactly no force, so that a network at rest stays at rest. The code is written
//! in terms of four doubles side by side, [`Quad`]; its implementations do the same operations in the same order,
//! without fused multiply-adds, so that every machine gives the same bits. The bits do not depend either on whether
//! nodes are stored one by one or by axis ([`Ends`]).

use std::ops::Range;

use pulp::Arch;

use super::Spring;
use crate::Vec3;
use crate::model::columns::Axes;

/// Term added to ℓ², m², so that a spring of no length has a direction of zero, hence no force, instead of NaN. It is
/// below half an ulp of ℓ² for every spring longer than 2e-7 m, and there changes no bit.
pub(super) const LENGTH_SQUARED_FLOOR: f64 = 1e-30;

/// Number of lanes of a packet: consecutive lower nodes whose springs are computed side by side.
pub(super) const LANES: usize = 4;

/// Packets with the same four lower nodes.
#[derive(Debug, Clone)]
pub(super) struct Block {
    pub first_node: usize,
    pub packets: Range<usize>,
}

/// Springs of four consecutive lower nodes to the four nodes at one distance in the numbering.
#[derive(Debug, Clone)]
pub(super) struct Packet {
    /// First upper node.
    pub upper: usize,
    pub constants: Constants,
}

/// Constants k, c and L of four springs; zero in lanes without a spring.
#[derive(Debug, Clone, Default)]
pub(super) struct Constants {
    stiffness: [f64; LANES],
    damping: [f64; LANES],
    rest_length: [f64; LANES],
}

impl Constants {
    pub fn set(&mut self, lane: usize, spring: &Spring) {
        self.stiffness[lane] = spring.stiffness;
        self.damping[lane] = spring.damping;
        self.rest_length[lane] = spring.rest_length;
    }
}

/// Up to four springs between any nodes, which are read and written one by one, and computed side by side.
#[derive(Debug, Clone)]
pub(super) struct Quartet {
    count: usize,
    /// Ends of the springs; beyond `count` a node and itself.
    nodes: [[u32; 2]; LANES],
    constants: Constants,
}

/// A section of springs swept at one time: packets, then springs that fill none.
#[derive(Debug, Clone, Default)]
pub(super) struct Section {
    pub blocks: Vec<Block>,
    pub packets: Vec<Packet>,
    pub quartets: Vec<Quartet>,
}

impl Section {
    /// Appends packets with the same lower nodes.
    pub fn add_block(&mut self, first_node: usize, packets: &[Packet]) {
        // Neighbouring distances write overlapping runs, and a load that overlaps a recent store has to wait for it; so
        // packets that follow each other are taken from far apart.
        let first_packet = self.packets.len();
        for start in 0..LANES {
            self.packets.extend(packets.iter().skip(start).step_by(LANES).cloned());
        }
        if !packets.is_empty() {
            self.blocks.push(Block { first_node, packets: first_packet..self.packets.len() });
        }
    }

    /// Appends a spring that is in no packet.
    pub fn add_single(&mut self, spring: &Spring) {
        if self.quartets.last().is_none_or(|last| last.count == LANES) {
            let nodes = [[spring.nodes[0]; 2]; LANES];
            self.quartets.push(Quartet { count: 0, nodes, constants: Constants::default() });
        }
        if let Some(last) = self.quartets.last_mut() {
            last.nodes[last.count] = spring.nodes;
            last.constants.set(last.count, spring);
            last.count += 1;
        }
    }
}

/// Four doubles side by side.
pub(super) trait Quad: Copy {
    type Lanes: Copy;
    fn lanes(self, values: [f64; LANES]) -> Self::Lanes;
    fn array(self, lanes: Self::Lanes) -> [f64; LANES];
    fn add(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes;
    fn sub(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes;
    fn mul(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes;
    fn div(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes;
    fn sqrt(self, a: Self::Lanes) -> Self::Lanes;
    /// Loads four vectors, axis by axis.
    fn by_axis(self, run: &[Vec3; LANES]) -> [Self::Lanes; 3];
    /// Adds vectors, given axis by axis, to four vectors.
    fn add_to(self, by_axis: [Self::Lanes; 3], run: &mut [Vec3; LANES]);
}

/// Lanes as arrays, compiled for the target's baseline.
#[derive(Clone, Copy)]
struct Baseline;

impl Quad for Baseline {
    type Lanes = [f64; LANES];

    #[inline(always)]
    fn lanes(self, values: [f64; LANES]) -> Self::Lanes {
        values
    }
    #[inline(always)]
    fn array(self, lanes: Self::Lanes) -> [f64; LANES] {
        lanes
    }
    #[inline(always)]
    fn add(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes {
        std::array::from_fn(|l| a[l] + b[l])
    }
    #[inline(always)]
    fn sub(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes {
        std::array::from_fn(|l| a[l] - b[l])
    }
    #[inline(always)]
    fn mul(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes {
        std::array::from_fn(|l| a[l] * b[l])
    }
    #[inline(always)]
    fn div(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes {
        std::array::from_fn(|l| a[l] / b[l])
    }
    #[inline(always)]
    fn sqrt(self, a: Self::Lanes) -> Self::Lanes {
        a.map(f64::sqrt)
    }
    #[inline(always)]
    fn by_axis(self, run: &[Vec3; LANES]) -> [Self::Lanes; 3] {
        std::array::from_fn(|axis| std::array::from_fn(|lane| run[lane][axis]))
    }
    #[inline(always)]
    fn add_to(self, by_axis: [Self::Lanes; 3], run: &mut [Vec3; LANES]) {
        for (lane, vector) in run.iter_mut().enumerate() {
            *vector += Vec3::new(by_axis[0][lane], by_axis[1][lane], by_axis[2][lane]);
        }
    }
}

/// Lanes of 256 bits. Twelve doubles of four vectors are three registers, which eight shuffles turn into axes and back.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy)]
struct Avx2(pulp::x86::V3);

#[cfg(target_arch = "x86_64")]
impl Quad for Avx2 {
    type Lanes = std::arch::x86_64::__m256d;

    #[inline(always)]
    fn lanes(self, values: [f64; LANES]) -> Self::Lanes {
        pulp::cast(values)
    }
    #[inline(always)]
    fn array(self, lanes: Self::Lanes) -> [f64; LANES] {
        pulp::cast(lanes)
    }
    #[inline(always)]
    fn add(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes {
        self.0.avx._mm256_add_pd(a, b)
    }
    #[inline(always)]
    fn sub(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes {
        self.0.avx._mm256_sub_pd(a, b)
    }
    #[inline(always)]
    fn mul(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes {
        self.0.avx._mm256_mul_pd(a, b)
    }
    #[inline(always)]
    fn div(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes {
        self.0.avx._mm256_div_pd(a, b)
    }
    #[inline(always)]
    fn sqrt(self, a: Self::Lanes) -> Self::Lanes {
        self.0.avx._mm256_sqrt_pd(a)
    }
    #[inline(always)]
    fn by_axis(self, run: &[Vec3; LANES]) -> [Self::Lanes; 3] {
        let avx = self.0.avx;
        // x₀y₀z₀x₁ y₁z₁x₂y₂ z₂x₃y₃z₃
        let [a, b, c]: [Self::Lanes; 3] = bytemuck::cast(*run);
        let xy = avx._mm256_blend_pd::<0b1100>(a, b); // x₀y₀x₂y₂
        let zx = avx._mm256_permute2f128_pd::<0x21>(a, c); // z₀x₁z₂x₃
        let yz = avx._mm256_blend_pd::<0b1100>(b, c); // y₁z₁y₃z₃
        [
            avx._mm256_shuffle_pd::<0b1010>(xy, zx),
            avx._mm256_shuffle_pd::<0b0101>(xy, yz),
            avx._mm256_shuffle_pd::<0b1010>(zx, yz),
        ]
    }
    #[inline(always)]
    fn add_to(self, [x, y, z]: [Self::Lanes; 3], run: &mut [Vec3; LANES]) {
        let avx = self.0.avx;
        let xy = avx._mm256_shuffle_pd::<0b0000>(x, y);
        let zx = avx._mm256_shuffle_pd::<0b1010>(z, x);
        let yz = avx._mm256_shuffle_pd::<0b1111>(y, z);
        let [a, b, c]: [Self::Lanes; 3] = bytemuck::cast(*run);
        *run = bytemuck::cast([
            avx._mm256_add_pd(avx._mm256_permute2f128_pd::<0x20>(xy, zx), a),
            avx._mm256_add_pd(avx._mm256_blend_pd::<0b1100>(yz, xy), b),
            avx._mm256_add_pd(avx._mm256_permute2f128_pd::<0x31>(zx, yz), c),
        ]);
    }
}

/// Storage of the ends of springs and of their forces: node by node, or axis by axis.
pub(super) trait Ends {
    fn positions<Q: Quad>(&self, q: Q, first: usize) -> [Q::Lanes; 3];
    fn velocities<Q: Quad>(&self, q: Q, first: usize) -> [Q::Lanes; 3];
    fn push<Q: Quad>(&mut self, q: Q, first: usize, forces: [Q::Lanes; 3]);
    /// Returns the differences (d, ω) from node j to node i.
    fn differences(&self, i: usize, j: usize) -> (Vec3, Vec3);
    fn push_one(&mut self, node: usize, force: Vec3);
}

/// Storage node by node.
pub(super) struct Rows<'a> {
    x: &'a [Vec3],
    v: &'a [Vec3],
    f: &'a mut [Vec3],
}

impl<'a> Rows<'a> {
    pub fn new(x: &'a [Vec3], v: &'a [Vec3], f: &'a mut [Vec3]) -> Self {
        // All three have the same length, so that one check serves them.
        Self { x: &x[..f.len()], v: &v[..f.len()], f }
    }
}

impl Ends for Rows<'_> {
    #[inline(always)]
    fn positions<Q: Quad>(&self, q: Q, first: usize) -> [Q::Lanes; 3] {
        q.by_axis(run(self.x, first))
    }
    #[inline(always)]
    fn velocities<Q: Quad>(&self, q: Q, first: usize) -> [Q::Lanes; 3] {
        q.by_axis(run(self.v, first))
    }
    #[inline(always)]
    fn push<Q: Quad>(&mut self, q: Q, first: usize, forces: [Q::Lanes; 3]) {
        q.add_to(forces, run_mut(self.f, first));
    }
    #[inline(always)]
    fn differences(&self, i: usize, j: usize) -> (Vec3, Vec3) {
        (self.x[i] - self.x[j], self.v[i] - self.v[j])
    }
    #[inline(always)]
    fn push_one(&mut self, node: usize, force: Vec3) {
        self.f[node] += force;
    }
}

impl Ends for Axes<'_> {
    #[inline(always)]
    fn positions<Q: Quad>(&self, q: Q, first: usize) -> [Q::Lanes; 3] {
        std::array::from_fn(|axis| q.lanes(*run(self.x[axis], first)))
    }
    #[inline(always)]
    fn velocities<Q: Quad>(&self, q: Q, first: usize) -> [Q::Lanes; 3] {
        std::array::from_fn(|axis| q.lanes(*run(self.v[axis], first)))
    }
    #[inline(always)]
    fn push<Q: Quad>(&mut self, q: Q, first: usize, forces: [Q::Lanes; 3]) {
        for (f, force) in self.f.iter_mut().zip(forces) {
            let f = run_mut(f, first);
            *f = q.array(q.add(q.lanes(*f), force));
        }
    }
    #[inline(always)]
    fn differences(&self, i: usize, j: usize) -> (Vec3, Vec3) {
        let between = |of: &[&mut [f64]; 3]| Vec3::from_fn(|axis, _| of[axis][i] - of[axis][j]);
        (between(&self.x), between(&self.v))
    }
    #[inline(always)]
    fn push_one(&mut self, node: usize, force: Vec3) {
        self.f.iter_mut().zip(force.iter()).for_each(|(f, force)| f[node] += force);
    }
}

/// Adds the forces of a section's springs to those of their ends, on the widest lanes that `arch` offers.
pub(super) fn sweep<const DAMPED: bool>(arch: Arch, section: &Section, ends: impl Ends) {
    match arch {
        #[cfg(target_arch = "x86_64")]
        Arch::V3(simd) => simd.vectorize(
            #[inline(always)]
            || add_forces::<DAMPED, _>(Avx2(simd), section, ends),
        ),
        _ => add_forces::<DAMPED, _>(Baseline, section, ends),
    }
}

#[inline(always)]
fn add_forces<const DAMPED: bool, Q: Quad>(q: Q, section: &Section, mut ends: impl Ends) {
    let Section { blocks, packets, quartets } = section;
    for block in blocks {
        let (xi, vi) = (ends.positions(q, block.first_node), ends.velocities(q, block.first_node));
        let mut sum = [q.lanes([0.0; LANES]); 3];
        for packet in &packets[block.packets.clone()] {
            // Both differences are reversed: a register minus memory is one instruction.
            let difference = |a: [Q::Lanes; 3], b: [Q::Lanes; 3]| std::array::from_fn(|axis| q.sub(a[axis], b[axis]));
            let d = difference(xi, ends.positions(q, packet.upper));
            let omega = || difference(vi, ends.velocities(q, packet.upper));
            let force = forces::<DAMPED, Q>(q, &packet.constants, d, omega);
            ends.push(q, packet.upper, force);
            sum = std::array::from_fn(|axis| q.sub(sum[axis], force[axis]));
        }
        ends.push(q, block.first_node, sum);
    }
    for Quartet { count, nodes, constants } in quartets {
        let nodes = nodes.map(|nodes| nodes.map(|node| node as usize));
        let (mut d, mut omega) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        for (lane, &[i, j]) in nodes.iter().enumerate() {
            let between = ends.differences(i, j);
            for axis in 0..3 {
                (d[axis][lane], omega[axis][lane]) = (between.0[axis], between.1[axis]);
            }
        }
        let force = forces::<DAMPED, Q>(q, constants, d.map(|d| q.lanes(d)), || omega.map(|omega| q.lanes(omega)));
        let force = force.map(|force| q.array(force));
        for (lane, &[i, j]) in nodes.iter().enumerate().take(*count) {
            let force = Vec3::new(force[0][lane], force[1][lane], force[2][lane]);
            ends.push_one(j, force);
            ends.push_one(i, -force);
        }
    }
}

/// Computes f_j from d = x_i − x_j and ω = v_i − v_j.
#[inline(always)]
fn forces<const DAMPED: bool, Q: Quad>(
    q: Q,
    constants: &Constants,
    d: [Q::Lanes; 3],
    omega: impl FnOnce() -> [Q::Lanes; 3],
) -> [Q::Lanes; 3] {
    let square = q.add(dot(q, d, d), q.lanes([LENGTH_SQUARED_FLOOR; LANES]));
    let length = q.sqrt(square);
    let inverse = q.div(q.lanes([1.0; LANES]), square);
    let stretch = q.sub(length, q.lanes(constants.rest_length));
    let mut tension = q.mul(q.mul(q.lanes(constants.stiffness), stretch), length);
    if DAMPED {
        tension = q.add(tension, q.mul(q.lanes(constants.damping), dot(q, omega(), d)));
    }
    let scale = q.mul(tension, inverse);
    d.map(|d| q.mul(d, scale))
}

#[inline(always)]
fn dot<Q: Quad>(q: Q, a: [Q::Lanes; 3], b: [Q::Lanes; 3]) -> Q::Lanes {
    q.add(q.add(q.mul(a[0], b[0]), q.mul(a[1], b[1])), q.mul(a[2], b[2]))
}

#[inline(always)]
fn run<T>(values: &[T], first: usize) -> &[T; LANES] {
    values[first..].first_chunk().expect("packets end before the nodes do")
}

#[inline(always)]
fn run_mut<T>(values: &mut [T], first: usize) -> &mut [T; LANES] {
    values[first..].first_chunk_mut().expect("packets end before the nodes do")
}
