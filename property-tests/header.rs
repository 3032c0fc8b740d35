//! The C header of renderers is what cbindgen makes of the interface in Rust. To write it anew:
//! `STICKSLIP_WRITE_HEADER=1 cargo test --test cli header`.

use std::path::Path;

use cbindgen::{Builder, Config, DocumentationStyle, ExportConfig, Language, Style};

/// What a reader of the header has to know before the declarations.
const PREFACE: &str = "/*
 * Interface between the testbed `stickslip` and a renderer in a shared library.
 *
 * A renderer turns positions of an instrument's tip into forces, over a body that is a network of masses, springs and
 * dampers. The library defines the functions below with C linkage. `moved` and `message` are optional; a library that
 * lacks another one is refused.
 *
 * Two threads call a renderer. The global thread calls `create`, `build`, `dispose` and `destroy`; the servo thread
 * calls `swap`, `tick` and `moved`; either calls `message`. `build` may run while the servo thread is in `tick`,
 * `moved` or `swap` of the same renderer. `swap` precedes the first `tick`. `destroy` comes after both threads have
 * stopped, and frees the model that is in use; models that were never swapped in, and those that `swap` has returned,
 * are disposed of before it.
 *
 * All quantities are in SI units. Vectors are x, y, z; an array of n vectors is n rows of three numbers. Arrays are
 * valid for the duration of a call, those of `stickslip_body` for the life of the renderer. The library may not write
 * to arrays that it receives as `const`. The caller sets the `size` of every struct.
 *
 * A renderer should refuse, in `create`, a law, surface or radius that it cannot render. A tick should allocate no
 * memory, take no lock and do no I/O: it runs in a loop at 1 kHz.
 */";

fn generated() -> String {
    let renamed = [
        ("CBody", "stickslip_body"),
        ("CSetup", "stickslip_setup"),
        ("CState", "stickslip_state"),
        ("COutput", "stickslip_output"),
    ];
    let constants = [
        "RENDERER_ABI",
        "LAW_SLIDING",
        "LAW_STICKING",
        "LAW_STICK_SLIP",
        "SURFACE_FACETED",
        "SURFACE_SHADED",
        "SURFACE_SUBDIVISION",
        "MODE_FREE",
        "MODE_STICK",
        "MODE_SLIDE",
        "MODE_SLIP",
    ];
    let rename = renamed.map(|(from, to)| (from.to_owned(), to.to_owned())).into_iter();
    let rename = rename.chain(constants.map(|name| (name.to_owned(), format!("STICKSLIP_{name}"))));
    let config = Config {
        language: Language::C,
        header: Some(PREFACE.to_owned()),
        include_guard: Some("STICKSLIP_RENDERER_H".to_owned()),
        cpp_compat: true,
        no_includes: true,
        sys_includes: vec!["stdint.h".to_owned()],
        usize_is_size_t: true,
        style: Style::Both,
        documentation_style: DocumentationStyle::C99,
        line_length: 110,
        export: ExportConfig { rename: rename.collect(), ..ExportConfig::default() },
        ..Config::default()
    };
    let interface = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/external/abi.rs");
    let mut header = Vec::new();
    Builder::new().with_config(config).with_src(interface).generate().expect("C").write(&mut header);
    let header = String::from_utf8(header).expect("text");
    // Rust has no array arguments. With their length, a compiler can check definitions against the declaration.
    header
        .replace("const double *before,", "const double before[3],")
        .replace("const double *tip,", "const double tip[3],")
}

#[test]
fn the_header_is_that_of_the_interface() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("reference/include/stickslip_renderer.h");
    let generated = generated();
    if std::env::var_os("STICKSLIP_WRITE_HEADER").is_some() {
        std::fs::write(&path, &generated).expect("it can be written");
    }
    let kept = std::fs::read_to_string(&path).expect("the header");
    assert_eq!(kept, generated, "write the header anew, as the head of property-tests/header.rs says");
}
