//! Vertices as sparse linear combinations of other vertices, applied to basis functions.

/// Largest number of vertices around one triangle that its limit surface may depend on.
pub const LARGEST_SUPPORT: usize = 32;

/// Number of values kept of a function of (β, γ): the value, ∂β, ∂γ, ∂ββ, ∂βγ, ∂γγ.
pub const DERIVATIVES: usize = 6;

/// Basis functions of some vertices at one point, with their derivatives by β and γ, the weights of the second and
/// third corner.
///
/// ```
/// use stickslip::surface::subdivision::Jet;
///
/// // β² with its derivatives at β = 3, for β = 2b.
/// let mut jet = Jet::zero(1);
/// jet.entries_mut()[0] = [9.0, 6.0, 0.0, 2.0, 0.0, 0.0];
/// jet.scale(2.0);
/// assert_eq!(jet.entries(), [[9.0, 12.0, 0.0, 8.0, 0.0, 0.0]]); // (2b)², 8b, 8 at b = 1.5
/// ```
#[derive(Debug, Clone)]
pub struct Jet {
    entries: [[f64; DERIVATIVES]; LARGEST_SUPPORT],
    len: usize,
}

impl Jet {
    /// Returns zeros for this many vertices.
    pub fn zero(len: usize) -> Self {
        Self { entries: [[0.0; DERIVATIVES]; LARGEST_SUPPORT], len }
    }

    /// Returns the entries, one per vertex.
    pub fn entries(&self) -> &[[f64; DERIVATIVES]] {
        &self.entries[..self.len]
    }

    /// Returns the entries for changes, one per vertex.
    pub fn entries_mut(&mut self) -> &mut [[f64; DERIVATIVES]] {
        &mut self.entries[..self.len]
    }

    /// Applies the chain rule for weights that grow by this factor from parent to child.
    pub fn scale(&mut self, factor: f64) {
        for [_, b, g, bb, bg, gg] in self.entries_mut() {
            *b *= factor;
            *g *= factor;
            *bb *= factor * factor;
            *bg *= factor * factor;
            *gg *= factor * factor;
        }
    }
}

/// Vertices y as combinations y = R x of other vertices x.
#[derive(Debug, Clone)]
pub struct Combination {
    columns: usize,
    /// End of the row of each y in `entries`.
    ends: Vec<u16>,
    entries: Vec<(u8, f64)>,
}

impl Combination {
    /// Builds a combination from the entries of each row.
    pub fn new(columns: usize, rows: Vec<Vec<(u8, f64)>>) -> Self {
        let mut ends = Vec::with_capacity(rows.len());
        let mut entries = Vec::new();
        for row in rows {
            entries.extend(row);
            ends.push(entries.len() as u16);
        }
        Self { columns, ends, entries }
    }

    /// Returns the rows, each as its entries (column, factor).
    pub fn rows(&self) -> impl Iterator<Item = &[(u8, f64)]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, &end)| &self.entries[start as usize..end as usize])
    }

    /// Whether every y equals the x of the same index.
    pub fn is_identity(&self) -> bool {
        self.ends.len() == self.columns && self.rows().zip(0..).all(|(row, i)| row == [(i, 1.0)])
    }

    /// Returns the basis functions of the x from those of the y: Rᵀ.
    pub fn pull(&self, jet: &Jet) -> Jet {
        let mut pulled = Jet::zero(self.columns);
        for (row, from) in self.rows().zip(jet.entries()) {
            for &(column, factor) in row {
                let to = &mut pulled.entries[column as usize];
                to.iter_mut().zip(from).for_each(|(to, from)| *to += factor * from);
            }
        }
        pulled
    }
}
