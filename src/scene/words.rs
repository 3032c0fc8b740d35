//! Words of scene files for choices whose domain type carries more than the word, or has no type of its own.

use serde::{Deserialize, Serialize};

use crate::contact::law::Law;
use crate::contact::rules::Scheme;
use crate::local::condensation::Reach;
use crate::local::model::{ExteriorKind, Linearization};
use crate::local::patch::Extent;
use crate::word::words;

/// Value of `mesh.kind`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum MeshKind {
    /// A generated block.
    #[default]
    Block,
    /// A mesh from a file.
    File,
}

words!(MeshKind { Block = "block", File = "file" });

/// Value of `mesh.fixed` that is one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FixedName {
    /// The lowest nodes.
    Bottom,
    /// No node.
    None,
}

words!(FixedName { Bottom = "bottom", None = "none" });

/// Value of `local.model`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum LocalModelName {
    /// A local model beside the network.
    #[default]
    Patch,
    /// The whole network at the local rate.
    Full,
    /// The renderer of a library.
    External,
}

words!(LocalModelName { Patch = "patch", Full = "full", External = "external" });

/// Value of `local.linearization`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum LinearizationName {
    /// Forces from the tangent, (3)–(4).
    #[default]
    Tangent,
    /// Forces of the nonlinear springs.
    None,
}

words!(LinearizationName { Tangent = "tangent", None = "none" });

impl From<Linearization> for LinearizationName {
    fn from(linearization: Linearization) -> Self {
        match linearization {
            Linearization::Tangent(_) => LinearizationName::Tangent,
            Linearization::None => LinearizationName::None,
        }
    }
}

/// Value of `local.exterior`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum ExteriorName {
    /// The exterior is fixed.
    #[default]
    Fixed,
    /// The exterior drifts at its velocity.
    Drifting,
    /// The exterior is statically condensed.
    Condensed,
}

words!(ExteriorName { Fixed = "fixed", Drifting = "drifting", Condensed = "condensed" });

impl From<ExteriorKind> for ExteriorName {
    fn from(exterior: ExteriorKind) -> Self {
        match exterior {
            ExteriorKind::Fixed => ExteriorName::Fixed,
            ExteriorKind::Drifting => ExteriorName::Drifting,
            ExteriorKind::Condensed(_) => ExteriorName::Condensed,
        }
    }
}

/// Value of `contact.law`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LawName {
    /// No tangential force.
    Sliding,
    /// The tip holds the point it touched.
    Sticking,
    /// Sticking up to the Coulomb bound.
    StickSlip,
}

words!(LawName { Sliding = "sliding", Sticking = "sticking", StickSlip = "stick-slip" });

impl LawName {
    /// Returns the word for a law; `None` for a custom law.
    pub fn of(law: Law) -> Option<Self> {
        match law {
            Law::Sliding => Some(LawName::Sliding),
            Law::Sticking => Some(LawName::Sticking),
            Law::StickSlip { .. } => Some(LawName::StickSlip),
            Law::Own(_) => None,
        }
    }
}

/// Value of `contact.scheme`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum SchemeName {
    /// The mesh is moved to the tip.
    #[default]
    Geometric,
    /// An impulse makes the contact point follow the tip.
    Velocity,
    /// An impulse makes the contact point follow the tip, and the force leaves out the inertia of the contact point.
    Massless,
}

words!(SchemeName { Geometric = "geometric", Velocity = "velocity", Massless = "massless" });

impl From<Scheme> for SchemeName {
    fn from(scheme: Scheme) -> Self {
        match scheme {
            Scheme::Geometric { .. } => SchemeName::Geometric,
            Scheme::Velocity => SchemeName::Velocity,
            Scheme::Massless => SchemeName::Massless,
        }
    }
}

/// Value of `instrument.kind`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum InstrumentName {
    /// The tip follows waypoints.
    #[default]
    Path,
    /// The tip follows a recording.
    Recording,
    /// A modelled device in a hand.
    Phantom,
}

words!(InstrumentName { Path = "path", Recording = "recording", Phantom = "phantom-1.5" });

/// Value of `local.rings` and `local.condense_rings`.
///
/// ```
/// use stickslip::{local::patch::Extent, scene::Rings};
///
/// assert_eq!(Rings::from(Extent::Rings(2)).to_string(), "2 rings");
/// assert_eq!(Rings::from(Extent::All).to_string(), "all rings");
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a whole number of at least 1 or \"all\"")]
pub enum Rings {
    /// A number of rings.
    Count(u32),
    /// All rings.
    All(All),
}

/// The word of [`Rings::All`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum All {
    /// All rings.
    All,
}

words!(All { All = "all" });

impl From<Extent> for Rings {
    fn from(extent: Extent) -> Self {
        match extent {
            Extent::Rings(rings) => Rings::Count(rings),
            Extent::All => Rings::All(All::All),
        }
    }
}

impl From<Reach> for Rings {
    fn from(reach: Reach) -> Self {
        match reach {
            Reach::Rings { rings, .. } => Rings::Count(rings),
            Reach::All => Rings::All(All::All),
        }
    }
}

impl std::fmt::Display for Rings {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Count(1) => f.write_str("1 ring"),
            Self::Count(rings) => write!(f, "{rings} rings"),
            Self::All(all) => write!(f, "{} rings", all.name()),
        }
    }
}
