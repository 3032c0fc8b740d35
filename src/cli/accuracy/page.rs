//! `index.html` of an accuracy report.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::{AccuracyFile, sentences, table};

const STYLE: &str = "
:root { color-scheme: light dark; font: 16px/1.5 system-ui, sans-serif; }
body { max-width: 76rem; margin: 0 auto; padding: 1rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .7rem; border-bottom: 1px solid #8886; text-align: right; }
td { white-space: nowrap; }
th:nth-child(-n+3), td:nth-child(-n+3) { text-align: left; }
.diverged { color: #c22; }
.unresolved, .overrun { opacity: .7; }
.special { font-weight: bold; }
";

pub fn page(file: &AccuracyFile) -> miette::Result<Markup> {
    let title = format!("{}: accuracy of local models", file.scene);
    Ok(html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { (title) }
                @for sentence in sentences(file) { p { (sentence) } }
                @for (k, reference) in file.references.iter().enumerate() {
                    h2 { (reference.contact) }
                    div.wide {
                        table {
                            thead { tr { @for head in table::HEAD { th { (head) } } } }
                            tbody {
                                @for i in rows(file, k) {
                                    @let cells = table::row(file, i);
                                    @let special = if cells[1].is_empty() { "" } else { " special" };
                                    tr class={ (file.points[i].status.name()) (special) } {
                                        @for cell in cells { td { (cell) } }
                                    }
                                }
                            }
                        }
                    }
                }
            }
        }
    })
}

/// Points of a reference, by their error; those that diverged last.
fn rows(file: &AccuracyFile, reference: usize) -> Vec<usize> {
    let mut rows: Vec<usize> = (0..file.points.len()).filter(|&i| file.points[i].reference == reference).collect();
    let error = |i: usize| {
        let point = &file.points[i];
        let failed = if point.status == super::Status::Diverged { f64::INFINITY } else { 0.0 };
        failed + point.errors.force_error_rms_rel
    };
    rows.sort_by(|&a, &b| error(a).total_cmp(&error(b)));
    rows
}
