//! The hidden command that serves a renderer in a shared library to the program that started it.

use std::path::Path;

use super::{PASS, USAGE};
use crate::external::host;

pub fn serve(library: &Path) -> miette::Result<u8> {
    // Nobody reads messages of this process: the program reports what became of it.
    Ok(if host::serve(library).is_ok() { PASS } else { USAGE })
}
