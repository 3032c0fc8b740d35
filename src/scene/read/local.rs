//! The `[local]` table: size of the local model, its forces, and its exterior.

use std::path::Path;

use super::{Read, no_effect};
use crate::external::RendererLibrary;
use crate::local::condensation::{Condensation, Reach};
use crate::local::model::{ExteriorKind, Linearization, LocalSettings};
use crate::local::patch::Extent;
use crate::scene::error::Problem;
use crate::scene::file::LocalTable;
use crate::scene::words::{ExteriorName, LinearizationName, LocalModelName, Rings};

/// Reads the library of an external renderer.
pub(super) fn renderer(table: &LocalTable, folder: &Path) -> Read<Option<RendererLibrary>> {
    let LocalTable { model, library, options, .. } = table;
    match (model, library) {
        (LocalModelName::External, None) => Err(Problem::Missing("local.library")),
        (LocalModelName::External, Some(library)) => {
            let renderer = RendererLibrary::new(folder.join(library));
            Ok(Some(renderer.with_options(options.clone().unwrap_or_default())))
        }
        (LocalModelName::Patch | LocalModelName::Full, _) => {
            let because = "a `local.model` that is not \"external\"";
            no_effect("local.library", library.is_some(), because)?;
            no_effect("local.options", options.is_some(), because)?;
            Ok(None)
        }
    }
}

pub(super) fn local(table: &LocalTable) -> Read<LocalSettings> {
    let LocalTable { rings, linearization, exterior, tangent, condense_rings, far_field, .. } = table;
    if table.model == LocalModelName::Full {
        let because = "`local.model = \"full\"`";
        no_effect("local.rings", rings.is_some(), because)?;
        no_effect("local.linearization", linearization.is_some(), because)?;
        no_effect("local.exterior", exterior.is_some(), because)?;
        no_effect("local.tangent", tangent.is_some(), because)?;
        no_effect("local.condense_rings", condense_rings.is_some(), because)?;
        no_effect("local.far_field", far_field.is_some(), because)?;
        return Ok(LocalSettings::FULL);
    }
    if table.model == LocalModelName::External {
        // The keys of a local model are kept in the scene, so that its own model and another renderer take turns; `explain`
        // lists them as omitted.
        return Ok(LocalSettings::default());
    }
    let extent = match rings {
        None => LocalSettings::default().extent,
        Some(Rings::Count(rings)) => Extent::Rings(*rings),
        Some(Rings::All(_)) => Extent::All,
    };
    if extent == Extent::All {
        no_effect("local.exterior", exterior.is_some(), "`local.rings = \"all\"`")?;
    }
    let exterior = exterior.unwrap_or_default();
    let is_condensed = exterior == ExteriorName::Condensed;
    let linearization = match linearization.unwrap_or_default() {
        LinearizationName::Tangent => Linearization::Tangent(tangent.unwrap_or_default()),
        LinearizationName::None => {
            no_effect("local.tangent", tangent.is_some() && !is_condensed, "`local.linearization = \"none\"`")?;
            Linearization::None
        }
    };
    if !is_condensed {
        let because = "a `local.exterior` that is not \"condensed\"";
        no_effect("local.condense_rings", condense_rings.is_some(), because)?;
        no_effect("local.far_field", far_field.is_some(), because)?;
    }
    let exterior = match exterior {
        ExteriorName::Fixed => ExteriorKind::Fixed,
        ExteriorName::Drifting => ExteriorKind::Drifting,
        ExteriorName::Condensed => {
            let tangent = tangent.unwrap_or_default();
            ExteriorKind::Condensed(Condensation { tangent, reach: reach(table)? })
        }
    };
    Ok(LocalSettings { extent, linearization, exterior })
}

/// Reads the reach of a condensed exterior.
fn reach(table: &LocalTable) -> Read<Reach> {
    match table.condense_rings {
        None | Some(Rings::All(_)) => {
            no_effect("local.far_field", table.far_field.is_some(), "`local.condense_rings = \"all\"`")?;
            Ok(Reach::All)
        }
        Some(Rings::Count(rings)) => Ok(Reach::Rings { rings, far_field: table.far_field.unwrap_or_default() }),
    }
}
