//! How well springs from Young's modulus stand for the elastic solid, on a page.

use maud::{Markup, PreEscaped, html};

use crate::cli::page;
use crate::verify::elasticity::{ElasticityError, ElasticityRow, GMSH_CELLS, Quantity, table};

/// Cells along the side of what is looked at.
pub fn cells(is_quick: bool) -> &'static [usize] {
    if is_quick { &GMSH_CELLS[..2] } else { &GMSH_CELLS }
}

/// Every quantity of every mesh.
pub fn compare(cells: &[usize]) -> miette::Result<Vec<ElasticityRow>> {
    table(cells).map_err(|error: ElasticityError| miette::miette!("elasticity of springs: {error}"))
}

fn name(quantity: Quantity) -> &'static str {
    match quantity {
        Quantity::YoungModulus => "E, pulled",
        Quantity::PoissonRatio => "ν, pulled",
        Quantity::Sag => "sag, hanging",
        Quantity::ConfinedModulus => "modulus, confined",
        Quantity::ShearModulus => "G, sheared",
        Quantity::Indentation => "settlement beside a point load",
    }
}

/// Rows of one kind of mesh: in one line of the table, if they are of one size too.
fn of_one_kind(a: &ElasticityRow, b: &ElasticityRow) -> bool {
    (&a.filling, a.identification) == (&b.filling, b.identification)
}

#[cfg(feature = "plots")]
fn figure(rows: &[ElasticityRow]) -> miette::Result<String> {
    use crate::model::material::Identification;
    use crate::output::figures::refinement::{Curve, Panel, refinement};

    const GROUPS: [(&str, &str); 4] =
        [("lattice", "lattice"), ("five", "five tetrahedra"), ("six", "six tetrahedra"), ("Gmsh", "by Gmsh")];
    let panels = Quantity::ALL.map(|quantity| Panel {
        title: name(quantity),
        curves: rows
            .chunk_by(of_one_kind)
            .map(|kind| Curve {
                group: GROUPS.iter().position(|(start, _)| kind[0].filling.starts_with(start)).unwrap_or(0),
                triangle: kind[0].identification == Some(Identification::Lloyd.name()),
                dashed: kind[0].filling.contains("jitter"),
                errors: kind
                    .iter()
                    .filter(|row| row.quantity == quantity)
                    .map(|row| (row.cells as f64, row.relative_error))
                    .collect(),
            })
            .collect(),
    });
    refinement(&GROUPS.map(|(_, name)| name), &panels)
        .map_err(|error| miette::miette!("cannot draw the errors of springs: {error}"))
}

#[cfg(not(feature = "plots"))]
fn figure(_: &[ElasticityRow]) -> miette::Result<String> {
    Ok(String::new())
}

const HEAD: [&str; 10] =
    ["mesh", "springs by", "cells", "nodes", "E", "ν", "sag", "confined modulus", "G", "beside a point load"];

/// A mesh: its names, its size (of the bar, which is the larger) and its errors.
fn row(mesh: &[ElasticityRow]) -> [String; 10] {
    let error = |quantity: Quantity| {
        let row = mesh.iter().find(|row| row.quantity == quantity);
        // No −0.0.
        row.map_or("–".to_owned(), |row| format!("{:+.1} %", (1e3 * row.relative_error).round() / 10.0 + 0.0))
    };
    let [e, nu, sag, confined, g, indentation] = Quantity::ALL.map(error);
    [
        mesh[0].filling.clone(),
        mesh[0].identification.unwrap_or("exact").to_owned(),
        mesh[0].cells.to_string(),
        mesh[0].nodes.to_string(),
        e,
        nu,
        sag,
        confined,
        g,
        indentation,
    ]
}

pub fn section(rows: &[ElasticityRow], is_quick: bool) -> miette::Result<Markup> {
    let meshes = rows.chunk_by(|a, b| of_one_kind(a, b) && a.cells == b.cells);
    Ok(html! {
        h2 #elasticity { "Elasticity" }
        p {
            "What springs from Young's modulus make of blocks and bars, pulled, hanging, confined, sheared, and pushed \
             at a point, against the elastic solid with Poisson's ratio 1/4. A curve that falls to zero (lattices) \
             becomes that solid where the mesh becomes finer; one that stays level does not, and its height is how far "
            code { "young_modulus" } " is off in every mesh of its kind."
        }
        @if is_quick { p { "A quick report leaves out the finest meshes." } }
        figure {
            (PreEscaped(figure(rows)?))
            figcaption {
                "Measured over expected, less one, against the cells along the side. Grey: lattices; blue and orange: \
                 five and six tetrahedra in a cell, dashed with nodes moved at random; green: meshed by Gmsh. Circles: \
                 Van Gelder's springs (lattices need no formula), triangles: Lloyd's."
            }
        }
        details {
            summary { "The numbers" }
            (page::table("", HEAD, meshes.map(row)))
        }
    })
}
