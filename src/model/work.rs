//! Counts of the work of a run, which show a change of cost without a clock.

use std::ops::Add;

use serde::Serialize;

/// Counts that depend only on the scene and the program, never on the machine.
///
/// ```
/// use stickslip::model::work::WorkCounts;
///
/// let tick = WorkCounts { tick_springs: 1000, triangles_tested: 8, ..WorkCounts::default() };
/// let cycle = WorkCounts { models_built: 1, ..WorkCounts::default() };
/// let both = tick + cycle;
/// assert_eq!((both.tick_springs, both.models_built), (1000, 1));
/// assert_eq!(both.named()[0], ("tick_springs", 1000));
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct WorkCounts {
    /// Number of springs evaluated by ticks.
    pub tick_springs: u64,
    /// Number of products \[K D\] z by ticks.
    pub matrix_products: u64,
    /// Number of nodes whose displacement was added to the linear forces: three columns of K each.
    pub displaced_nodes: u64,
    /// Number of triangles tested by collision detection.
    pub triangles_tested: u64,
    /// Number of springs evaluated by global cycles.
    pub cycle_springs: u64,
    /// Number of local models built.
    pub models_built: u64,
}

impl WorkCounts {
    /// Returns every count with its name.
    pub fn named(&self) -> [(&'static str, u64); 6] {
        [
            ("tick_springs", self.tick_springs),
            ("matrix_products", self.matrix_products),
            ("displaced_nodes", self.displaced_nodes),
            ("triangles_tested", self.triangles_tested),
            ("cycle_springs", self.cycle_springs),
            ("models_built", self.models_built),
        ]
    }
}

impl Add for WorkCounts {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            tick_springs: self.tick_springs + other.tick_springs,
            matrix_products: self.matrix_products + other.matrix_products,
            displaced_nodes: self.displaced_nodes + other.displaced_nodes,
            triangles_tested: self.triangles_tested + other.triangles_tested,
            cycle_springs: self.cycle_springs + other.cycle_springs,
            models_built: self.models_built + other.models_built,
        }
    }
}
