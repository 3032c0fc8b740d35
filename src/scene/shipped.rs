//! The scenes that come with the program, and how each is expected to end.

/// A scene in the program.
#[derive(Debug, Clone, Copy)]
pub struct Shipped {
    /// Its name.
    pub name: &'static str,
    /// Its TOML.
    pub text: &'static str,
    /// How a run of it ends.
    pub expectation: Expectation,
}

/// How a run is expected to end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Expectation {
    /// After its duration.
    Completes,
    /// With a fault: an extreme that shows the fail-safe at work.
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
