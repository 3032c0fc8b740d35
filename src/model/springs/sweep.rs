//! The force sweep: four springs at a time, with what vector instructions the machine has.
//!
//! With s = d·d the force on a node is d \[k(ℓ − L)ℓ + c ω·d\]/s, ℓ = √s: root and division do not wait for each other,
//! and a spring at its rest length has exactly no force, so that what rests stays where it is. Everything is written in terms of four doubles side by side, [`Quad`]; its implementations do the same
//! operations in the same order, without fused multiply-adds, so that every machine gives the same bits.

use std::ops::Range;

use pulp::Arch;
#[cfg(target_arch = "x86_64")]
use pulp::NullaryFnOnce;

use super::Spring;
use crate::Vec3;

/// Added to ℓ² so that a spring of no length has a direction of zero, hence no force, instead of
/// NaN. Below half an ulp of ℓ² for every spring longer than 2e-7 m: there it changes no bit.
pub(super) const LENGTH_SQUARED_FLOOR: f64 = 1e-30;

/// Lanes of a packet: consecutive lower nodes whose springs are computed side by side.
pub(super) const LANES: usize = 4;

/// Packets whose lower nodes are the same four.
#[derive(Debug, Clone)]
pub(super) struct Block {
    pub first_node: usize,
    pub packets: Range<usize>,
}

/// Springs of four consecutive lower nodes to the four nodes at one distance in the numbering.
#[derive(Debug, Clone)]
pub(super) struct Packet {
    /// First of the upper nodes.
    pub upper: usize,
    pub stiffness: [f64; LANES],
    pub damping: [f64; LANES],
    pub rest_length: [f64; LANES],
}

/// Four doubles side by side.
trait Quad: Copy {
    type Lanes: Copy;
    fn lanes(self, values: [f64; LANES]) -> Self::Lanes;
    fn add(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes;
    fn sub(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes;
    fn mul(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes;
    fn div(self, a: Self::Lanes, b: Self::Lanes) -> Self::Lanes;
    fn sqrt(self, a: Self::Lanes) -> Self::Lanes;
    /// Four vectors, axis by axis.
    fn by_axis(self, run: &[Vec3; LANES]) -> [Self::Lanes; 3];
    /// Adds them, given axis by axis, to four vectors.
    fn add_to(self, by_axis: [Self::Lanes; 3], run: &mut [Vec3; LANES]);
}

/// Whatever the compiler makes of arrays for the target's baseline.
#[derive(Clone, Copy)]
struct Baseline;

impl Quad for Baseline {
    type Lanes = [f64; LANES];

    #[inline(always)]
    fn lanes(self, values: [f64; LANES]) -> Self::Lanes {
        values
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

/// 256 bits wide. Twelve doubles of four vectors are three registers, which eight shuffles turn to axes and back.
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

/// What a sweep reads and writes.
pub(super) struct Sweep<'a, const DAMPED: bool> {
    pub blocks: &'a [Block],
    pub packets: &'a [Packet],
    pub singles: &'a [Spring],
    pub x: &'a [Vec3],
    pub v: &'a [Vec3],
    pub f: &'a mut [Vec3],
}

impl<const DAMPED: bool> Sweep<'_, DAMPED> {
    /// Adds every force, on the widest lanes that `arch` offers.
    pub fn on(self, arch: Arch) {
        match arch {
            #[cfg(target_arch = "x86_64")]
            Arch::V3(simd) => simd.vectorize(OnQuads(Avx2(simd), self)),
            _ => self.by(Baseline),
        }
    }

    #[inline(always)]
    fn by<Q: Quad>(self, q: Q) {
        let Self { blocks, packets, singles, x, v, f } = self;
        // One length for all three, so that one check serves them.
        let (x, v) = (&x[..f.len()], &v[..f.len()]);
        let floor = q.lanes([LENGTH_SQUARED_FLOOR; LANES]);
        let one = q.lanes([1.0; LANES]);
        for block in blocks {
            let (xi, vi) = (q.by_axis(run(x, block.first_node)), q.by_axis(run(v, block.first_node)));
            let mut sum = [q.lanes([0.0; LANES]); 3];
            for packet in &packets[block.packets.clone()] {
                let xj = q.by_axis(run(x, packet.upper));
                // Both differences the other way round: a register minus memory is one instruction.
                let d: [Q::Lanes; 3] = std::array::from_fn(|axis| q.sub(xi[axis], xj[axis]));
                let square = q.add(dot(q, d, d), floor);
                let length = q.sqrt(square);
                let inverse = q.div(one, square);
                let stretch = q.sub(length, q.lanes(packet.rest_length));
                let mut tension = q.mul(q.mul(q.lanes(packet.stiffness), stretch), length);
                if DAMPED {
                    let vj = q.by_axis(run(v, packet.upper));
                    let omega: [Q::Lanes; 3] = std::array::from_fn(|axis| q.sub(vi[axis], vj[axis]));
                    tension = q.add(tension, q.mul(q.lanes(packet.damping), dot(q, omega, d)));
                }
                let scale = q.mul(tension, inverse);
                let force = d.map(|d| q.mul(d, scale));
                q.add_to(force, run_mut(f, packet.upper));
                sum = std::array::from_fn(|axis| q.sub(sum[axis], force[axis]));
            }
            q.add_to(sum, run_mut(f, block.first_node));
        }
        for spring in singles {
            let [i, j] = spring.nodes.map(|node| node as usize);
            let force = spring.force::<DAMPED>(x[i] - x[j], v[i] - v[j]);
            f[j] += force;
            f[i] -= force;
        }
    }
}

#[inline(always)]
fn dot<Q: Quad>(q: Q, a: [Q::Lanes; 3], b: [Q::Lanes; 3]) -> Q::Lanes {
    q.add(q.add(q.mul(a[0], b[0]), q.mul(a[1], b[1])), q.mul(a[2], b[2]))
}

#[inline(always)]
fn run(vectors: &[Vec3], first: usize) -> &[Vec3; LANES] {
    vectors[first..].first_chunk().expect("packets end before the nodes do")
}

#[inline(always)]
fn run_mut(vectors: &mut [Vec3], first: usize) -> &mut [Vec3; LANES] {
    vectors[first..].first_chunk_mut().expect("packets end before the nodes do")
}

#[cfg(target_arch = "x86_64")]
struct OnQuads<'a, const DAMPED: bool>(Avx2, Sweep<'a, DAMPED>);

#[cfg(target_arch = "x86_64")]
impl<const DAMPED: bool> NullaryFnOnce for OnQuads<'_, DAMPED> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self(quad, sweep) = self;
        sweep.by(quad);
    }
}

impl Spring {
    /// f_j from d = x_i − x_j and ω = v_i − v_j, in the operations of a packet's lanes.
    #[inline(always)]
    fn force<const DAMPED: bool>(&self, d: Vec3, omega: Vec3) -> Vec3 {
        let dot = |a: Vec3, b: Vec3| a.x * b.x + a.y * b.y + a.z * b.z;
        let square = dot(d, d) + LENGTH_SQUARED_FLOOR;
        let inverse = 1.0 / square;
        let length = square.sqrt();
        let mut tension = self.stiffness * (length - self.rest_length) * length;
        if DAMPED {
            tension += self.damping * dot(omega, d);
        }
        d * (tension * inverse)
    }
}
