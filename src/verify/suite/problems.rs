//! The problems of the set: what is touched, how the tip moves, and what is tried.

use super::motion::Motion;
use crate::scene::LawName;

/// Body of a problem.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Body {
    /// The block of the shipped scenes: 9 × 9 × 4 nodes, 12.5 mm apart.
    Block,
    /// The shipped scenes' block in cells of half the size, with their material.
    FineBlock,
    /// A liver-like body of tetrahedra, about 500 nodes.
    Liver,
}

/// Constraint between the tip and the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ContactLaw {
    /// Without friction.
    Sliding,
    /// The point that was touched is held.
    Sticking,
    /// Coulomb friction with these coefficients.
    StickSlip {
        /// Static coefficient.
        static_coefficient: f64,
        /// Kinetic coefficient.
        kinetic_coefficient: f64,
    },
}

impl ContactLaw {
    /// Returns its name in scenes.
    pub fn name(self) -> &'static str {
        match self {
            ContactLaw::Sliding => LawName::Sliding.name(),
            ContactLaw::Sticking => LawName::Sticking.name(),
            ContactLaw::StickSlip { .. } => LawName::StickSlip.name(),
        }
    }
}

/// A problem of the set.
#[derive(Debug, Clone, Copy)]
pub struct ProblemSpec {
    /// Name of the problem and its folder.
    pub name: &'static str,
    /// What it tries.
    pub tries: &'static str,
    /// Body that is touched.
    pub body: Body,
    /// Contact law.
    pub law: ContactLaw,
    /// Contact surface by its name in scenes.
    pub surface: &'static str,
    /// Adhesion, N.
    pub adhesion_n: f64,
    /// Radius of the contact, m; 0 for a point.
    pub radius_m: f64,
    /// Motion of the tip.
    pub motion: Motion,
    /// Duration, s.
    pub duration_s: f64,
}

/// Coulomb friction with one coefficient.
const fn coulomb(coefficient: f64) -> ContactLaw {
    ContactLaw::StickSlip { static_coefficient: coefficient, kinetic_coefficient: coefficient }
}

/// What most problems have in common: a point on the Loop limit surface of the block, without adhesion.
const PLAIN: ProblemSpec = ProblemSpec {
    name: "",
    tries: "",
    body: Body::Block,
    law: coulomb(0.5),
    surface: "subdivision",
    adhesion_n: 0.0,
    radius_m: 0.0,
    motion: Motion::Through(&[]),
    duration_s: 1.0,
};

/// A press and a drag along x over several edges of the mesh.
const DRAG: Motion = Motion::Through(&[
    [0.0, -0.03, 0.0013, 0.002],
    [0.3, -0.03, 0.0013, -0.004],
    [0.4, -0.03, 0.0013, -0.004],
    [1.4, 0.02, 0.0013, -0.004],
]);

/// A press and a drag along x that a held point can follow.
const SHORT_DRAG: Motion = Motion::Through(&[
    [0.0, -0.01, 0.0013, 0.002],
    [0.3, -0.01, 0.0013, -0.004],
    [0.4, -0.01, 0.0013, -0.004],
    [1.2, 0.0, 0.0013, -0.004],
]);

/// All problems, the simplest first.
pub const PROBLEMS: [ProblemSpec; 15] = [
    ProblemSpec {
        name: "tap",
        tries: "Contact that begins and ends ten times a second, at up to 0.15 m/s: no force before it, and none after it",
        motion: Motion::Through(&[
            [0.0, -0.01, 0.0013, 0.001],
            [0.05, -0.01, 0.0013, -0.003],
            [0.1, -0.01, 0.0013, 0.001],
            [0.15, -0.01, 0.0013, -0.003],
            [0.2, -0.01, 0.0013, 0.001],
            [0.25, -0.01, 0.0013, -0.003],
            [0.3, -0.01, 0.0013, 0.001],
            [0.35, -0.01, 0.0013, -0.003],
            [0.4, -0.01, 0.0013, 0.001],
        ]),
        duration_s: 0.5,
        ..PLAIN
    },
    ProblemSpec {
        name: "drag-sticking-faceted",
        tries: "A held point on a flat triangle: stiffness along and across the surface, without a model of a smooth surface",
        law: ContactLaw::Sticking,
        surface: "faceted",
        motion: SHORT_DRAG,
        duration_s: 1.4,
        ..PLAIN
    },
    ProblemSpec {
        name: "drag-sticking",
        tries: "A held point on the limit surface: stiffness along and across the surface",
        law: ContactLaw::Sticking,
        motion: SHORT_DRAG,
        duration_s: 1.4,
        ..PLAIN
    },
    ProblemSpec {
        name: "drag-sliding",
        tries: "Contact that moves over the surface without friction: the force stays normal, and smooth from edge to edge",
        law: ContactLaw::Sliding,
        motion: DRAG,
        duration_s: 1.6,
        ..PLAIN
    },
    ProblemSpec {
        name: "drag-stick-slip",
        tries: "The change from sticking to slipping, and slip at the Coulomb bound",
        motion: DRAG,
        duration_s: 1.6,
        ..PLAIN
    },
    ProblemSpec {
        name: "friction-pair",
        tries: "Kinetic friction below static friction: the force drops where slip begins, in the middle of a drag",
        law: ContactLaw::StickSlip { static_coefficient: 0.6, kinetic_coefficient: 0.4 },
        motion: DRAG,
        duration_s: 1.6,
        ..PLAIN
    },
    ProblemSpec {
        name: "slow-stroke",
        tries: "A stroke of 20 mm/s that turns round: friction reverses, and everything but the contact is nearly static",
        motion: Motion::Through(&[
            [0.0, -0.02, 0.0013, 0.002],
            [0.2, -0.02, 0.0013, -0.003],
            [1.2, 0.0, 0.0013, -0.003],
            [2.2, -0.02, 0.0013, -0.003],
        ]),
        duration_s: 2.3,
        ..PLAIN
    },
    ProblemSpec {
        name: "fast-stroke",
        tries: "A stroke of up to 0.3 m/s there and back: inertia and damping of the body",
        motion: Motion::Through(&[
            [0.0, -0.02, 0.0013, 0.002],
            [0.2, -0.02, 0.0013, -0.003],
            [0.45, 0.02, 0.0013, -0.003],
            [0.7, -0.02, 0.0013, -0.003],
        ]),
        duration_s: 0.9,
        ..PLAIN
    },
    ProblemSpec {
        name: "tremor",
        tries: "A hand's tremor of 8 to 12 Hz and 0.5 mm on a held press: small motions about a state of contact",
        motion: Motion::Tremor {
            through: &[[0.0, -0.01, 0.0013, 0.002], [0.3, -0.01, 0.0013, -0.004]],
            from_s: 0.3,
            to_s: 1.5,
            amplitude: [5e-4, 5e-4, 2e-4],
            hz: [9.0, 11.3, 8.2],
        },
        duration_s: 1.6,
        ..PLAIN
    },
    ProblemSpec {
        name: "circle",
        tries: "Two turns of a circle of 10 mm: the direction of slip turns, and the path leaves every symmetry of the mesh",
        motion: Motion::Circle {
            through: &[[0.0, 0.011, 0.0013, 0.002], [0.3, 0.011, 0.0013, -0.003]],
            turning_s: [0.3, 1.9],
            radius: 0.01,
            turns: 2.0,
        },
        duration_s: 2.0,
        ..PLAIN
    },
    ProblemSpec {
        name: "lift-off",
        tries: "Contact that is lost and found elsewhere: the body is free to settle between, and nothing may be remembered",
        motion: Motion::Through(&[
            [0.0, -0.02, 0.0013, 0.002],
            [0.2, -0.02, 0.0013, -0.003],
            [0.5, -0.01, 0.0013, -0.003],
            [0.6, -0.01, 0.0013, 0.004],
            [0.9, 0.015, 0.0043, 0.004],
            [1.1, 0.015, 0.0043, -0.003],
            [1.4, 0.005, 0.0043, -0.003],
        ]),
        duration_s: 1.5,
        ..PLAIN
    },
    ProblemSpec {
        name: "hand-over",
        tries: "A long hold, a step of 2 mm within 40 ms, and a long hold: what updates of a local model change while the tip rests",
        motion: Motion::Through(&[
            [0.0, -0.01, 0.0013, 0.002],
            [0.2, -0.01, 0.0013, -0.003],
            [1.0, -0.01, 0.0013, -0.003],
            [1.04, -0.008, 0.0013, -0.003],
        ]),
        duration_s: 2.0,
        ..PLAIN
    },
    ProblemSpec {
        name: "adhesion",
        tries: "A surface that adheres with up to 0.1 N: the pull before it lets go, and friction that adhesion raises",
        adhesion_n: 0.1,
        motion: Motion::Through(&[
            [0.0, -0.01, 0.0013, 0.002],
            [0.3, -0.01, 0.0013, -0.003],
            [0.7, -0.004, 0.0013, -0.003],
            [1.2, -0.004, 0.0013, 0.006],
        ]),
        duration_s: 1.3,
        ..PLAIN
    },
    ProblemSpec {
        name: "fine-mesh",
        tries: "The block in cells of half the size, touched over a disc of 8 mm: six times the nodes, over more of which a contact is spread",
        body: Body::FineBlock,
        radius_m: 0.008,
        motion: DRAG,
        duration_s: 1.6,
        ..PLAIN
    },
    ProblemSpec {
        name: "organ",
        tries: "A curved body of irregular tetrahedra: no direction of the mesh is that of the motion",
        body: Body::Liver,
        law: coulomb(0.3),
        motion: Motion::Through(&[
            [0.0, -0.045, 0.001, 0.035],
            [0.3, -0.045, 0.001, 0.028],
            [1.3, -0.015, 0.001, 0.028],
        ]),
        duration_s: 1.4,
        ..PLAIN
    },
];
