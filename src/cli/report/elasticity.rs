//! The section on the elasticity of springs made from Young's modulus, compared with the elastic solid.

use maud::{Markup, PreEscaped, html};

use crate::cli::page;
use crate::verify::elasticity::{ElasticityError, ElasticityRow, GMSH_CELLS, Quantity, table};

/// Returns the numbers of cells along the side of the meshes compared.
pub fn cells(is_quick: bool) -> &'static [usize] {
    if is_quick { &GMSH_CELLS[..2] } else { &GMSH_CELLS }
}

/// Computes every quantity of every mesh.
pub fn compare(cells: &[usize]) -> miette::Result<Vec<ElasticityRow>> {
    table(cells).map_err(|error: ElasticityError| miette::miette!("elasticity of springs: {error}"))
}

fn name(quantity: Quantity) -> &'static str {
    match quantity {
        Quantity::YoungModulus => "Young's modulus E, in tension",
        Quantity::PoissonRatio => "Poisson's ratio ν, in tension",
        Quantity::Sag => "sag under gravity",
        Quantity::ConfinedModulus => "confined modulus",
        Quantity::ShearModulus => "shear modulus G",
        Quantity::Indentation => "settlement beside a point load",
    }
}

/// Returns whether two rows are of the same kind of mesh; rows of the same size too share a line of the table.
fn of_one_kind(a: &ElasticityRow, b: &ElasticityRow) -> bool {
    (&a.filling, a.identification) == (&b.filling, b.identification)
}

#[cfg(feature = "plots")]
fn figure(rows: &[ElasticityRow]) -> miette::Result<String> {
    use crate::model::material::Identification;
    use crate::output::figures::refinement::{Curve, Panel, refinement};

    const GROUPS: [(&str, &str); 4] =
        [("lattice", "lattice"), ("five", "five tetrahedra"), ("six", "six tetrahedra"), ("Gmsh", "Gmsh")];
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
        .map_err(|error| miette::miette!("cannot draw the errors of the springs: {error}"))
}

#[cfg(not(feature = "plots"))]
fn figure(_: &[ElasticityRow]) -> miette::Result<String> {
    Ok(String::new())
}

const HEAD: [&str; 10] =
    ["mesh", "springs by", "cells", "nodes", "E", "ν", "sag", "confined modulus", "G", "beside a point load"];

/// Builds a mesh's row: its names, its size (the bar's, which is the larger mesh) and its errors.
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
            "Blocks and bars of springs made from Young's modulus, in tension, hanging, confined, sheared, and loaded \
             at a point, compared with the elastic solid with Poisson's ratio 1/4. A curve that falls to zero \
             (lattices) converges to that solid under refinement. One that stays level does not: its height is the \
             error of "
            code { "young_modulus" } " in every mesh of its kind."
        }
        @if is_quick { p { "A quick report omits the finest meshes." } }
        figure {
            (PreEscaped(figure(rows)?))
            figcaption {
                "Relative error over the number of cells along the side. Grey: lattices; blue and orange: five and six \
                 tetrahedra per cell, dashed if nodes are moved at random; green: meshes by Gmsh. Circles: springs by \
                 Van Gelder's formula (lattices need none); triangles: by Lloyd's."
            }
        }
        details {
            summary { "Table of all errors" }
            (page::table("", HEAD, meshes.map(row)))
        }
    })
}
