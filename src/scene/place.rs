//! Places of keys in a scene's text.

use std::ops::Range;

use toml::de::{DeTable, DeValue};

/// Returns the bytes of a key's value, or of one entry of it if an index is given. If the key is absent, returns those
/// of the innermost table around it that exists; `None` if there is none.
pub fn place(text: &str, key: &str, index: Option<usize>) -> Option<Range<usize>> {
    let document = DeTable::parse(text).ok()?;
    let (mut table, mut found) = (document.get_ref(), None);
    for part in key.split('.') {
        let Some(value) = table.get(part) else { break };
        found = Some(value.span());
        match value.get_ref() {
            DeValue::Table(inner) => table = inner,
            DeValue::Array(entries) => {
                return index.and_then(|index| entries.get(index)).map_or(found, |entry| Some(entry.span()));
            }
            _ => break,
        }
    }
    found
}

/// Returns the known word that is most similar to an unknown one, if any is similar.
pub fn nearest<'a>(word: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    /// Least similarity, two of three letters in place: a typing error, not another word.
    const LIKE: f64 = 0.66;
    let likeness = |known: &str| strsim::normalized_damerau_levenshtein(word, known);
    let best = known.into_iter().map(|known| (likeness(known), known)).max_by(|(a, _), (b, _)| a.total_cmp(b))?;
    (best.0 >= LIKE).then_some(best.1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slip_of_the_pen_has_a_neighbour_and_another_word_has_none() {
        let known = ["structural", "shear", "full"];
        assert_eq!(nearest("sheer", known), Some("shear"));
        assert_eq!(nearest("stuctural", known), Some("structural"));
        assert_eq!(nearest("tetrahedral", known), None);
        assert_eq!(nearest("", known), None);
    }

    #[test]
    fn a_key_is_found_or_else_the_table_around_it() {
        let text = "a = 1\n[b]\nlist = [10, 20]\n";
        let found = |key, index| place(text, key, index).map(|span| &text[span]);
        assert_eq!(found("a", None), Some("1"));
        assert_eq!(found("b.list", Some(1)), Some("20"));
        assert_eq!(found("b.list", Some(2)), Some("[10, 20]"));
        assert!(found("b.other", None).is_some_and(|table| table.starts_with("[b]")));
        assert_eq!(found("c", None), None);
    }
}
