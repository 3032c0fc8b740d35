//! Common parts of all pages: frame, style and tables.

use maud::{DOCTYPE, Markup, PreEscaped, html};

const STYLE: &str = "
:root { color-scheme: light dark; font: 16px/1.5 system-ui, sans-serif; }
body { max-width: 76rem; margin: 0 auto; padding: 1rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .7rem; border-bottom: 1px solid #8886; text-align: right; }
td { white-space: nowrap; }
th:nth-child(-n+2), td:nth-child(-n+2) { text-align: left; }
.methods :is(th, td):nth-child(3) { text-align: left; }
.words :is(th, td) { white-space: normal; text-align: left; }
.unexpected { color: #c22; font-weight: bold; }
.diverged { color: #c22; }
.unresolved, .overrun { opacity: .7; }
.special { font-weight: bold; }
figure { margin: 2rem 0; }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(30rem, 100%), 1fr)); gap: 1rem; }
figure svg { width: 100%; height: auto; background: #fff; border-radius: 6px; }
section { margin-top: 2.5rem; }
@media (max-width: 40rem) { figure { overflow-x: auto; } figure svg { min-width: 34rem; } }
code, pre { overflow-wrap: anywhere; }
pre { white-space: pre-wrap; }
.verdicts { list-style: none; padding: 0; }
.verdicts li { margin: .4rem 0; padding: .4rem .8rem; border-left: .35rem solid; border-radius: 4px; background: #8881; overflow-wrap: anywhere; }
.verdicts .fail { border-color: #c22; }
.verdicts .inconclusive { border-color: #c80; }
.verdicts .pass { border-color: #2a4; }
.verdicts a { color: inherit; }
@media (prefers-color-scheme: dark) {
  .unexpected, .diverged { color: #f77; }
  /* White becomes nearly black, and every colour keeps its hue. */
  figure svg { filter: invert(.91) hue-rotate(180deg); }
}
";

const POLICY: &str = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'";

/// Builds a whole page with a title.
pub fn page(title: &str, body: &Markup) -> Markup {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                // The browser itself refuses whatever is not in the page.
                meta http-equiv="Content-Security-Policy" content=(POLICY);
                meta name="viewport" content="width=device-width, initial-scale=1";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body { h1 { (title) } (body) }
        }
    }
}

/// A table row and its CSS class.
pub struct Row<const N: usize> {
    pub class: Option<String>,
    pub cells: [String; N],
}

impl<const N: usize> From<[String; N]> for Row<N> {
    fn from(cells: [String; N]) -> Self {
        Self { class: None, cells }
    }
}

/// Builds a table that may be wider than the page; `class` is the CSS class of the whole table.
pub fn table<const N: usize>(
    class: &str,
    head: [&str; N],
    rows: impl IntoIterator<Item = impl Into<Row<N>>>,
) -> Markup {
    html! {
        div class={ "wide " (class) } {
            table {
                thead { tr { @for head in head { th { (head) } } } }
                tbody {
                    @for row in rows {
                        @let Row { class, cells } = row.into();
                        tr class=[class] { @for cell in cells { td { (cell) } } }
                    }
                }
            }
        }
    }
}
