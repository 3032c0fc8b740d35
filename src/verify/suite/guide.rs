//! The page that explains how to take part.

use std::fmt::Write as _;

use super::{ProblemFile, VERSION};

/// Builds `README.md` of the set.
pub fn guide(problems: &[ProblemFile]) -> String {
    let mut rows = String::new();
    for problem in problems {
        let ProblemFile { name, tries, contact, body, reference, .. } = problem;
        let friction = contact.friction.map_or(String::new(), |friction| {
            let (fixed, moving) = (friction.static_coefficient, friction.kinetic_coefficient);
            if fixed == moving { format!(", μ = {fixed}") } else { format!(", μ_s = {fixed}, μ_k = {moving}") }
        });
        let _ = writeln!(
            rows,
            "| [`{name}`]({name}/problem.json) | {tries} | {}{friction} | {} | {} | {:.2} | {:.2} % |",
            contact.law,
            contact.surface,
            body.nodes,
            reference.force_max_n,
            100.0 * reference.floor_rms_rel
        );
    }
    format!("# Problems for haptic renderers, version {VERSION}\n\n{GUIDE}\n## Problems\n\n{HEAD}{rows}")
}

const HEAD: &str =
    "| problem | what it tries | law | surface | nodes | largest force (N) | floor |\n|---|---|---|---|---|---|---|\n";

const GUIDE: &str = "\
A haptic renderer turns the positions of a tip into forces over a deformable body. In each problem the body and the motion of the
tip are given, and the force is known. Compute the force with your own program, from the files alone, and have it compared.

## How to take part

1. Read the body from `network.json` and the motion from `tip.csv`.
2. Compute the force on the instrument at every tick, and write a CSV file with the columns `t,fx,fy,fz`. You may add `mode` (`free`,
   `stick`, `slide` or `slip`), and `px,py,pz`, the point in contact as a point of the surface *at rest*.
3. Compare it:

       stickslip judge NAME/problem.toml --trace mine.csv --out NAME-mine

   The exit code is 0 if the root mean square of the force error is at most 10 % of the force, a difference that a hand cannot tell.
   An error below the floor of a problem has no meaning. The command names what does not fit first: another rate, a lag, another
   unit, another sign.

`reference.csv` has the result, so that you can also compare by yourself. All quantities are SI. `example.py`, sixty lines of Python, solves
`drag-sticking-faceted` from its files alone.

## Files of a problem

| file | contents |
|---|---|
| `problem.json` | Rates, contact, floor, tolerances with their reasons, and the SHA-256 of every other file |
| `network.json` | The body as masses and springs: `nodes` [x, y, z] at rest, `mass`, `fixed` (nodes that never move), `springs` [i, j, k, c, L], and `triangles` of the surface, anticlockwise from outside |
| `body.vtu` | The body for viewers and finite elements: its tetrahedra (`organ`), or else the triangles of the surface and the springs as lines |
| `tip.csv` | `t,x,y,z`: the tip at 0 s and at the end of every tick; straight between |
| `reference.csv` | At the end of every tick: the tip `qx,qy,qz`, the force `fx,fy,fz` on the instrument, the contact point `px,py,pz` on the surface at rest, the outward normal `nx,ny,nz`, and `mode`; point and normal are empty without contact |
| `problem.toml` | The same problem as a scene, for `stickslip` |

## What is to be solved

The body is at rest at 0 s. Its free nodes move by

    m a = Σ [k (l − L) + c (dl/dt)] u

over the springs of a node, with u the unit vector to the other end and l the distance. There is no gravity. The tip is a point, and
above the surface it exerts no force. When it passes through the surface, contact begins:

- *sticking*: the point of the surface that was touched is held at the tip;
- *sliding*: the surface is held at the tip along its normal alone, and the force is normal;
- *stick-slip*: the point is held while the tangential force is at most μ_s (F_N + A), and otherwise slips with μ_k (F_N + A).

F_N is the force on the instrument along the outward normal and A the adhesion. The contact ends where F_N is below −A; without
adhesion it never pulls. A point of the surface is p = Σ w x over nodes, and the nodes of a contact share minus the force on the
instrument by the weights w. With a surface `faceted`, w are barycentric coordinates in a triangle, and normals those of triangles.
With `subdivision` the surface is the Loop limit surface of the triangles. A `radius_m` above 0 spreads the force over a disc around the
contact point with Hertz's pressure, and the tip meets the mean of the surface with these weights.

The reference solves this with all springs at every tick. Its contact is *massless*: the force has no part from the inertia of the
contact point, a mass that comes from lumping. With f the sum of spring forces on a node and m its mass (1/m = 0 where it is fixed),

    F = M Σ w f/m,    M = 1 / Σ (w²/m),

along the directions that the contact holds: all of them where it sticks, the normal where it slides or slips. The multiplier of the
constraint, which most programs compute, is F − M a with the acceleration a of the tip: add M a to it. M is some tens of grams. M a
is about a fifth of the force in `tap`, a few hundredths of it in `fast-stroke` and `tremor`, and less in the others.

The **floor** is the difference of the reference from itself at an eighth of the tick. Differences of method that are no errors, such as
another integration in time, are about that large.
";
