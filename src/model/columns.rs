//! Positions, velocities and forces of a network's nodes by axis, the layout of its explicit steps.

use std::ops::Range;

use pulp::Arch;

use super::simd::vectorize;
use super::state::{ExternalForce, REST_SPEED, State};
use crate::Vec3;

/// Numbers per cache line on common processors.
const LINE: usize = 8;

/// Nine columns (x, v, f along three axes) of one number per node, in one allocation.
///
/// Four nodes side by side are four numbers side by side, as vector instructions load them. Every column begins at
/// another set of the cache: with a power of two of nodes the columns would otherwise evict each other, and steps take
/// 1.5 to 2.6 times as long (4,096 and 32,768 nodes).
///
/// ```
/// use stickslip::{Vec3, model::columns::Columns, model::state::State};
///
/// let state = State { x: vec![Vec3::x(), Vec3::y(), Vec3::z()], v: vec![Vec3::zeros(); 3] };
/// let mut columns = Columns::new(3);
/// columns.load(&state);
/// columns.place(1, &Vec3::y(), &Vec3::new(0.0, 2.0, 0.0));
/// let mut end = state.clone();
/// columns.store(1..3, &mut end);
/// assert_eq!(end.x, state.x);
/// assert_eq!(end.v[1], Vec3::y() * 2.0);
/// assert_eq!(columns.node(2), (Vec3::z(), Vec3::zeros()));
/// ```
#[derive(Debug, Clone)]
pub struct Columns {
    values: Vec<f64>,
    stride: usize,
}

/// The separate columns, all of the same length.
pub(crate) struct Axes<'a> {
    pub x: [&'a mut [f64]; 3],
    pub v: [&'a mut [f64]; 3],
    pub f: [&'a mut [f64]; 3],
}

impl Columns {
    /// Allocates zeros for this many nodes.
    pub fn new(nodes: usize) -> Self {
        // Caches have a power of two of sets, so multiples of an odd number of lines begin at different sets.
        let stride = (nodes.div_ceil(LINE) | 1) * LINE;
        Self { values: vec![0.0; 9 * stride], stride }
    }

    #[inline(always)]
    pub(crate) fn axes(&mut self) -> Axes<'_> {
        let mut columns = self.values.chunks_exact_mut(self.stride);
        let mut three = || std::array::from_fn(|_| columns.next().unwrap_or_default());
        Axes { x: three(), v: three(), f: three() }
    }

    fn at(&self, quantity: usize, node: usize) -> Vec3 {
        Vec3::from_fn(|axis, _| self.values[(3 * quantity + axis) * self.stride + node])
    }

    fn put(&mut self, quantity: usize, node: usize, value: &Vec3) {
        (0..3).for_each(|axis| self.values[(3 * quantity + axis) * self.stride + node] = value[axis]);
    }

    /// Copies in the positions and velocities of all nodes.
    pub fn load(&mut self, state: &State) {
        let Axes { x, v, .. } = self.axes();
        for (columns, rows) in [(x, &state.x), (v, &state.v)] {
            for (axis, column) in columns.into_iter().enumerate() {
                column.iter_mut().zip(rows).for_each(|(number, row)| *number = row[axis]);
            }
        }
    }

    /// Copies the positions and velocities of some nodes into the state.
    pub fn store(&self, nodes: Range<usize>, state: &mut State) {
        let mut columns = self.values.chunks_exact(self.stride);
        for rows in [&mut state.x[nodes.clone()], &mut state.v[nodes.clone()]] {
            for (axis, column) in columns.by_ref().take(3).enumerate() {
                rows.iter_mut().zip(&column[nodes.clone()]).for_each(|(row, number)| row[axis] = *number);
            }
        }
    }

    /// Returns the position, m, and velocity, m/s, of one node.
    pub fn node(&self, node: usize) -> (Vec3, Vec3) {
        (self.at(0, node), self.at(1, node))
    }

    /// Sets the position, m, and velocity, m/s, of one node.
    pub fn place(&mut self, node: usize, x: &Vec3, v: &Vec3) {
        self.put(0, node, x);
        self.put(1, node, v);
    }

    /// Returns the last three columns of a node: a force, N, or after `accelerate` an acceleration, m/s².
    pub(crate) fn force(&self, node: usize) -> Vec3 {
        self.at(2, node)
    }

    /// Sets the force on a node, N.
    pub(crate) fn set_force(&mut self, node: usize, f: &Vec3) {
        self.put(2, node, f);
    }

    /// Copies positions and velocities of some nodes into a message, column by column.
    pub(crate) fn copy_to(&self, nodes: Range<usize>, message: &mut Vec<f64>) {
        message.clear();
        let columns = self.values.chunks_exact(self.stride).take(6);
        columns.for_each(|column| message.extend_from_slice(&column[nodes.clone()]));
    }

    /// Copies positions and velocities back from a message. A message of another length is ignored.
    pub(crate) fn copy_from(&mut self, nodes: Range<usize>, message: &[f64]) {
        if nodes.is_empty() || message.len() != 6 * nodes.len() {
            return;
        }
        let columns = self.values.chunks_exact_mut(self.stride).zip(message.chunks_exact(nodes.len()));
        columns.for_each(|(column, message)| column[nodes.clone()].copy_from_slice(message));
    }

    /// Sets the forces on some nodes to zero.
    pub(crate) fn clear_forces(&mut self, nodes: Range<usize>) {
        self.axes().f.into_iter().for_each(|f| f[nodes.clone()].fill(0.0));
    }

    /// Turns the springs' forces on some nodes into accelerations, a = M⁻¹(f + gravity and drag). Masses, kg, and inverse
    /// masses, 1/kg, are those of all nodes.
    pub(crate) fn accelerate(
        &mut self,
        arch: Arch,
        mass: &[f64],
        inverse_mass: &[f64],
        external: &[ExternalForce],
        nodes: Range<usize>,
    ) {
        let (mass, inverse_mass) = (&mass[nodes.clone()], &inverse_mass[nodes.clone()]);
        let Axes { v, f, .. } = self.axes();
        vectorize(arch, || {
            for (axis, (f, v)) in f.into_iter().zip(v).enumerate() {
                let (f, v) = (&mut f[nodes.clone()], &v[nodes.clone()]);
                for force in external {
                    match force {
                        ExternalForce::Gravity(g) => f.iter_mut().zip(mass).for_each(|(f, m)| *f += g[axis] * m),
                        ExternalForce::Drag(b) => f.iter_mut().zip(v).for_each(|(f, v)| *f -= v * b),
                    }
                }
                f.iter_mut().zip(inverse_mass).for_each(|(f, w)| *f *= w);
            }
        });
    }

    /// Advances some nodes by (11), v ← v + ha, x ← x + hv, and clears their forces.
    pub(crate) fn advance(&mut self, arch: Arch, h: f64, nodes: Range<usize>) {
        let Axes { x, v, f } = self.axes();
        vectorize(arch, || {
            for ((x, v), a) in x.into_iter().zip(v).zip(f) {
                let (x, v, a) = (&mut x[nodes.clone()], &mut v[nodes.clone()], &mut a[nodes.clone()]);
                for ((x, v), a) in x.iter_mut().zip(v).zip(a) {
                    *v += *a * h;
                    *x += *v * h;
                    *a = 0.0;
                }
            }
        });
    }

    /// Applies [`snap_to_rest`](super::state::snap_to_rest) to some nodes.
    pub(crate) fn snap_to_rest(&mut self, arch: Arch, nodes: Range<usize>) {
        let v = self.axes().v;
        vectorize(arch, || {
            for v in v {
                v[nodes.clone()].iter_mut().for_each(|v| *v = if v.abs() < REST_SPEED { 0.0 } else { *v });
            }
        });
    }
}
