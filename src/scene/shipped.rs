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

/// The expected end of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Expectation {
    /// The run completes its duration.
    Completes,
    /// The run ends with a fault: an extreme that shows the fail-safe at work.
    Faults,
}

macro_rules! shipped {
    ($($name:literal => $expectation:ident),* $(,)?) => {
        /// All shipped scenes, the paper's first.
        pub const SHIPPED: &[Shipped] = &[$(Shipped {
            name: $name,
            text: include_str!(concat!("../../fixtures/scenes/", $name, ".toml")),
            expectation: Expectation::$expectation,
        }),*];
    };
}

shipped! {
    "fig3-sliding" => Completes,
    "fig4-sticking" => Completes,
    "fig4-sticking-unilateral" => Completes,
    "fig5-stick-slip" => Completes,
    "deep-sliding" => Completes,
    "deep-sticking" => Completes,
    "deep-stick-slip" => Completes,
    "deep-stick-slip-faceted" => Faults,
    "fig3-sliding-subdivision" => Completes,
    "fig4-sticking-subdivision" => Completes,
    "fig5-stick-slip-subdivision" => Completes,
    "deep-sliding-subdivision" => Completes,
    "deep-sticking-subdivision" => Completes,
    "deep-stick-slip-subdivision" => Completes,
}
