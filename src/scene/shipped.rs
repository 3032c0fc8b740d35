//! The scenes that are shipped with the program, and how each is expected to end.

/// A shipped scene.
#[derive(Debug, Clone, Copy)]
pub struct Shipped {
    /// Name of the scene.
    pub name: &'static str,
    /// TOML of the scene.
    pub text: &'static str,
    /// Expected end of a run.
    pub expectation: Expectation,
}

impl Shipped {
    /// Returns what the scene shows: the comment that its text begins with.
    ///
    /// ```
    /// use stickslip::scene::SHIPPED;
    ///
    /// assert!(SHIPPED.iter().all(|shipped| shipped.description().ends_with('.')));
    /// ```
    pub fn description(&self) -> String {
        let lines: Vec<&str> = self.text.lines().map_while(|line| line.strip_prefix('#')).map(str::trim).collect();
        lines.join(" ")
    }
}

/// The expected end of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Expectation {
    /// The run completes its duration.
    Completes {
        /// Bound on the energy residual, as a share of the instrument's work Σ|f·Δq|: a tenth above the measured one.
        energy_residual: f64,
    },
    /// The run ends with a fault: an extreme that shows the fail-safe at work.
    Faults,
}

/// Builds the expectation of a scene that completes.
const fn completes(energy_residual: f64) -> Expectation {
    Expectation::Completes { energy_residual }
}

macro_rules! shipped {
    ($($name:literal => $expectation:expr),* $(,)?) => {
        /// All shipped scenes, the paper's first.
        pub const SHIPPED: &[Shipped] = &[$(Shipped {
            name: $name,
            text: include_str!(concat!("../../fixtures/scenes/", $name, ".toml")),
            expectation: $expectation,
        }),*];
    };
}

shipped! {
    "fig3-sliding" => completes(0.003),
    "fig4-sticking" => completes(0.017),
    "fig4-sticking-unilateral" => completes(0.27),
    "fig5-stick-slip" => completes(0.33),
    "deep-sliding" => completes(0.43),
    "deep-sticking" => completes(0.011),
    "deep-stick-slip" => completes(0.18),
    "deep-stick-slip-faceted" => Expectation::Faults,
    "fig3-sliding-subdivision" => completes(0.041),
    "fig4-sticking-subdivision" => completes(0.010),
    "fig5-stick-slip-subdivision" => completes(0.003),
    "deep-sliding-subdivision" => completes(0.041),
    "deep-sticking-subdivision" => completes(0.005),
    "deep-stick-slip-subdivision" => completes(0.025),
}
