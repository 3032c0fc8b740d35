//! Tangent forces of a patch (3)–(4): f = f₀ + K(x − x₀) + D(v − v₀). A drifting exterior adds (t − t_k) K_LE v_E₀;
//! under a condensed one K becomes K + C.

use nalgebra::{DMatrix, DVector};
use pulp::Arch;

use super::patch::Patch;
use crate::model::simd::vectorize;
use crate::model::springs::{TangentKind, spring_blocks};
use crate::model::state::ExternalForce;
use crate::{Mat3, Vec3};

/// Rows that one pass of the matrix–vector product keeps in registers: eleven of the sixteen that are 256 bits wide.
/// The last panel holds the remaining rows, in whole registers.
const PANEL: usize = 44;
const REGISTER: usize = 4;

/// Rounds `dof` rows up to whole registers.
fn padded(dof: usize) -> usize {
    dof.next_multiple_of(REGISTER)
}

/// Linear forces over a patch of m nodes.
///
/// \[K D\] is stored in panels of up to 44 rows, each column by column, so that the product streams through memory once
/// and the compiler can vectorise over rows. Without dampers and drag there is no D.
///
/// ```
/// use stickslip::{local::linearization::LinearForces, model::springs::TangentKind};
/// use stickslip::{Vec3, pipeline::Simulation, scene::Scene};
///
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program");
/// let local = Simulation::prepare(&scene)?.into_sides().servo.into_local();
/// let (patch, mut x, v) = (&local.model().patch, local.state().x.clone(), local.state().v.clone());
/// let linear = LinearForces::new(patch, &[], &x, &v, None, TangentKind::Exact);
/// let dof = 3 * patch.len();
/// assert_eq!(linear.offset_len(), 2 * dof); // there are dampers, hence a D
/// assert!((0..dof).all(|i| (0..i).all(|j| linear.entry(i, j) == linear.entry(j, i)))); // K is symmetric
///
/// // One evaluation, then the update for one displaced node.
/// let (mut offset, mut f) = (vec![0.0; linear.offset_len()], vec![Vec3::zeros(); x.len()]);
/// linear.evaluate(0.0, &x, &v, &mut offset, &mut f);
/// let delta = Vec3::new(1e-4, 0.0, -2e-4);
/// linear.add_displacements([(3, delta)].into_iter(), &mut f);
/// let mut all = f.clone();
/// x[3] += delta;
/// linear.evaluate(0.0, &x, &v, &mut offset, &mut all);
/// assert!(f.iter().zip(&all).take(patch.len()).all(|(a, b)| (a - b).norm() < 1e-13));
/// # Ok::<(), stickslip::scene::SceneError>(())
/// ```
#[derive(Debug, Clone)]
pub struct LinearForces {
    /// Number of rows, 3m.
    dof: usize,
    /// Number of columns: 3m, or 6m with D.
    columns: usize,
    panels: Vec<f64>,
    /// Forces f₀, N, padded like the panels.
    f0: Vec<f64>,
    x0: Vec<Vec3>,
    v0: Vec<Vec3>,
    /// Force rate K_LE v_E₀, N/s, under a drifting exterior.
    drift: Option<Vec<Vec3>>,
}

impl LinearForces {
    /// Linearises the forces on a patch at (x, v), which hold the patch's slots and then its
    /// boundary's. `exterior_velocity`, one per boundary node, is given under a drifting exterior.
    pub fn new(
        patch: &Patch,
        external: &[ExternalForce],
        x: &[Vec3],
        v: &[Vec3],
        exterior_velocity: Option<&[Vec3]>,
        kind: TangentKind,
    ) -> Self {
        let m = patch.len();
        let drag: f64 = external
            .iter()
            .map(|force| match force {
                ExternalForce::Drag(b) => *b,
                ExternalForce::Gravity(_) => 0.0,
            })
            .sum();
        let dof = 3 * m;
        let columns = if patch.springs.is_damped() || drag != 0.0 { 2 * dof } else { dof };
        let mut forces = Self {
            dof,
            columns,
            panels: vec![0.0; padded(dof) * columns],
            f0: vec![0.0; padded(dof)],
            x0: x[..m].to_vec(),
            v0: v[..m].to_vec(),
            drift: exterior_velocity.map(|_| vec![Vec3::zeros(); m]),
        };

        let mut f = vec![Vec3::zeros(); x.len()];
        patch.springs.add_forces(x, v, &mut f);
        f.truncate(m);
        for force in external {
            force.add(&patch.mass, v, &mut f);
        }
        forces.f0[..dof].copy_from_slice(bytemuck::cast_slice(&f));

        for spring in patch.springs.iter() {
            // The lower slot of a patch spring is always in the patch; the upper may be boundary.
            let [i, j] = spring.nodes.map(|slot| slot as usize);
            let (along_x, along_v) = spring.jacobian(x[j] - x[i], v[j] - v[i], kind);
            for (row, column, sign) in spring_blocks([i, j]) {
                if row < m && column < m {
                    forces.add_block(row, column, &(along_x * -sign), &(along_v * -sign));
                }
            }
            if j >= m
                && let (Some(drift), Some(velocity)) = (&mut forces.drift, exterior_velocity)
            {
                drift[i] += along_x * velocity[j - m];
            }
        }
        if drag != 0.0 {
            for i in 0..m {
                forces.add_block(i, i, &Mat3::zeros(), &(Mat3::identity() * -drag));
            }
        }
        forces
    }

    /// Builds C(x − x₀) alone, which a condensed exterior adds to springs that stay nonlinear.
    ///
    /// ```
    /// use nalgebra::DMatrix;
    /// use stickslip::{Vec3, local::linearization::LinearForces};
    ///
    /// // Two nodes, each held by an exterior of 10 N/m; then another 5 N/m are added.
    /// let x0 = [Vec3::zeros(), Vec3::x()];
    /// let mut forces = LinearForces::following(&x0, &(DMatrix::identity(6, 6) * -10.0));
    /// forces.add_stiffness(&(DMatrix::identity(6, 6) * -5.0));
    /// assert_eq!((forces.entry(3, 3), forces.entry(3, 0)), (-15.0, 0.0));
    /// let (x, v) = ([Vec3::zeros(), Vec3::x() * 1.1], [Vec3::zeros(); 2]);
    /// let (mut offset, mut f) = (vec![0.0; forces.offset_len()], [Vec3::zeros(); 2]);
    /// forces.evaluate(0.0, &x, &v, &mut offset, &mut f);
    /// assert!((f[1].x + 15.0 * 0.1).abs() < 1e-12 && f[0] == Vec3::zeros());
    /// ```
    pub fn following(x0: &[Vec3], c: &DMatrix<f64>) -> Self {
        let dof = c.nrows();
        let mut forces = Self {
            dof,
            columns: dof,
            panels: vec![0.0; padded(dof) * dof],
            f0: vec![0.0; padded(dof)],
            x0: x0.to_vec(),
            v0: Vec::new(),
            drift: None,
        };
        forces.add_stiffness(c);
        forces
    }

    /// Adds C to K.
    pub fn add_stiffness(&mut self, c: &DMatrix<f64>) {
        for column in 0..self.dof {
            for row in 0..self.dof {
                let at = self.position(row, column);
                self.panels[at] += c[(row, column)];
            }
        }
    }

    fn add_block(&mut self, row: usize, column: usize, k: &Mat3, d: &Mat3) {
        for a in 0..3 {
            for b in 0..3 {
                let at = self.position(3 * row + a, 3 * column + b);
                self.panels[at] += k[(a, b)];
                if self.columns > self.dof {
                    let at = self.position(3 * row + a, self.dof + 3 * column + b);
                    self.panels[at] += d[(a, b)];
                }
            }
        }
    }

    fn position(&self, row: usize, column: usize) -> usize {
        let first = row / PANEL * PANEL;
        first * self.columns + column * (self.f0.len() - first).min(PANEL) + row - first
    }

    /// Returns an entry of \[K D\], N/m or N·s/m.
    pub fn entry(&self, row: usize, column: usize) -> f64 {
        if column < self.columns { self.panels[self.position(row, column)] } else { 0.0 }
    }

    /// Returns another affine map of (x, v, t) about this state:
    /// constant + by_x (x − x₀) + by_v (v − v₀) + growth (t − t_k).
    pub(super) fn with_coefficients(
        &self,
        constant: &DVector<f64>,
        [by_x, by_v]: [&DMatrix<f64>; 2],
        growth: &DVector<f64>,
    ) -> Self {
        let columns = 2 * self.dof;
        let mut map = Self {
            columns,
            panels: vec![0.0; self.f0.len() * columns],
            f0: vec![0.0; self.f0.len()],
            drift: self.drift.is_some().then(|| bytemuck::cast_slice(growth.as_slice()).to_vec()),
            ..self.clone()
        };
        map.f0[..self.dof].copy_from_slice(constant.as_slice());
        for row in 0..self.dof {
            for column in 0..self.dof {
                let [on_x, on_v] = [column, self.dof + column].map(|column| map.position(row, column));
                (map.panels[on_x], map.panels[on_v]) = (by_x[(row, column)], by_v[(row, column)]);
            }
        }
        map
    }

    /// Returns x₀, m, and v₀, m/s.
    pub(super) fn start(&self) -> (&[Vec3], &[Vec3]) {
        (&self.x0, &self.v0)
    }

    /// Returns f₀, N, as 3m values.
    pub(super) fn constant(&self) -> &[f64] {
        &self.f0[..self.dof]
    }

    /// Returns K_LE v_E₀, N/s, under a drifting exterior.
    pub(super) fn drift(&self) -> Option<&[Vec3]> {
        self.drift.as_deref()
    }

    /// Whether every coefficient is a finite number.
    pub(super) fn is_finite(&self) -> bool {
        let drift = self.drift.iter().flatten().flat_map(|drift| drift.iter());
        self.panels.iter().chain(&self.f0).chain(drift).all(|entry| entry.is_finite())
    }

    /// Length of the argument `offset` of [`evaluate`](Self::evaluate): 3m, or 6m with D.
    pub fn offset_len(&self) -> usize {
        self.columns
    }

    /// Evaluates the forces at (x, v), N, `elapsed` seconds after the state the model was built from. `offset` is a
    /// workspace of length [`offset_len`](Self::offset_len).
    pub fn evaluate(&self, elapsed: f64, x: &[Vec3], v: &[Vec3], offset: &mut [f64], f: &mut [Vec3]) {
        let m = self.dof / 3;
        let (dx, dv) = offset.split_at_mut(self.dof);
        subtract(&x[..m], &self.x0, dx);
        if !dv.is_empty() {
            subtract(&v[..m], &self.v0, dv);
        }
        self.multiply_add(offset, bytemuck::cast_slice_mut(&mut f[..m]));
        if let Some(drift) = &self.drift {
            f.iter_mut().zip(drift).for_each(|(f, drift)| *f += drift * elapsed);
        }
    }

    /// Computes f = f₀ + \[K D\] z with the machine's widest vector instructions. The result does not depend on them.
    fn multiply_add(&self, z: &[f64], f: &mut [f64]) {
        vectorize(
            Arch::new(),
            #[inline(always)]
            || {
                for ((panel, f0), f) in self.panels().zip(f.chunks_mut(PANEL)) {
                    multiply_panel(panel, f0, z, f);
                }
            },
        );
    }

    /// Returns the panels of \[K D\] with the matching rows of f₀.
    #[inline(always)]
    fn panels(&self) -> impl Iterator<Item = (&[f64], &[f64])> {
        // Without rows there are no columns, and nothing to divide.
        self.panels.chunks((PANEL * self.columns).max(1)).zip(self.f0.chunks(PANEL))
    }

    /// Adds the effect of displaced nodes, each given as its slot and δ, m: f += Σ K_(·,slot) δ.
    pub fn add_displacements(&self, moved: impl Iterator<Item = (usize, Vec3)>, f: &mut [Vec3]) {
        let f: &mut [f64] = bytemuck::cast_slice_mut(&mut f[..self.dof / 3]);
        vectorize(
            Arch::new(),
            #[inline(always)]
            || {
                for (slot, delta) in moved {
                    for ((panel, f0), f) in self.panels().zip(f.chunks_mut(PANEL)) {
                        let mut columns = panel.chunks_exact(f0.len()).skip(3 * slot);
                        if let (Some(x), Some(y), Some(z)) = (columns.next(), columns.next(), columns.next()) {
                            for (((f, x), y), z) in f.iter_mut().zip(x).zip(y).zip(z) {
                                *f += x * delta.x + y * delta.y + z * delta.z;
                            }
                        }
                    }
                }
            },
        );
    }
}

/// Computes f = f₀ + panel z, in registers for every width that a panel may have.
#[inline(always)]
fn multiply_panel(panel: &[f64], f0: &[f64], z: &[f64], f: &mut [f64]) {
    macro_rules! by_width {
        ($($rows:literal)*) => {
            match f0.len() {
                $($rows => multiply_rows::<$rows>(panel, f0, z, f),)*
                _ => multiply_rows::<PANEL>(panel, f0, z, f),
            }
        };
    }
    by_width!(4 8 12 16 20 24 28 32 36 40);
}

#[inline(always)]
fn multiply_rows<const ROWS: usize>(panel: &[f64], f0: &[f64], z: &[f64], f: &mut [f64]) {
    let mut sum = [0.0; ROWS];
    sum.copy_from_slice(f0);
    for (column, &z) in panel.chunks_exact(ROWS).zip(z) {
        for (sum, entry) in sum.iter_mut().zip(column) {
            *sum += entry * z;
        }
    }
    f.copy_from_slice(&sum[..f.len()]);
}

fn subtract(a: &[Vec3], b: &[Vec3], difference: &mut [f64]) {
    let (a, b): (&[f64], &[f64]) = (bytemuck::cast_slice(a), bytemuck::cast_slice(b));
    for ((difference, a), b) in difference.iter_mut().zip(a).zip(b) {
        *difference = a - b;
    }
}
