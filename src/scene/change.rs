//! Changes of single keys of a scene, asked for beside its file.

use std::fmt;
use std::str::FromStr;

use thiserror::Error;
use toml_edit::{DocumentMut, InlineTable, Item, Table, Value};

/// A change of one key of a scene, made in the scene's text before it is read.
///
/// It is written `key=value`, with a dotted key and a TOML value. A value that is not TOML and does not begin like a list,
/// a table or a string in quotes is taken as a string. A table replaces the whole table of that key.
///
/// ```
/// use stickslip::{Change, Scene};
///
/// let scene = Scene::shipped("fig5-stick-slip").expect("shipped with the program");
/// let text = scene.text().expect("it was read");
/// let changes = ["contact.friction=0.5".parse()?, "name=half-the-friction".parse()?];
/// let changed = Scene::parse_with(text, "fig5.toml".as_ref(), &changes)?;
/// assert_eq!(changed.name, "half-the-friction");
/// assert_eq!(changed.changes(), ["contact.friction=0.5", "name=half-the-friction"]);
/// assert!(changed.text().is_some_and(|text| text.contains("friction = 0.5\n")));
///
/// let error = Scene::parse_with(text, "fig5.toml".as_ref(), &["contact.frictoin=1".parse()?]).unwrap_err();
/// assert_eq!(error.change().map(ToString::to_string).as_deref(), Some("contact.frictoin=1"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone)]
pub struct Change {
    /// The change as it was asked for.
    text: String,
    key: String,
    value: Value,
}

/// A reason why a text is no change of a scene.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum ChangeError {
    /// The text has no `=`, or nothing behind it.
    #[error("give KEY=VALUE, such as `contact.friction=0.5`")]
    NoValue,
    /// What stands before the `=` is no key.
    #[error(
        "`{0}` is no key: give names of letters, digits, `-` and `_` with dots between them, such as `contact.friction`"
    )]
    Key(String),
    /// The value is not TOML; the parser's message.
    #[error("`{value}` is no TOML value: {message}")]
    Value {
        /// The value given.
        value: String,
        /// The parser's message.
        message: String,
    },
}

impl FromStr for Change {
    type Err = ChangeError;

    fn from_str(text: &str) -> Result<Self, ChangeError> {
        let (key, given) = text.split_once('=').ok_or(ChangeError::NoValue)?;
        let (key, given) = (key.trim(), given.trim());
        let is_bare = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
        if !key.split('.').all(|name| !name.is_empty() && name.chars().all(is_bare)) {
            return Err(ChangeError::Key(key.to_owned()));
        }
        let value = match given.parse::<Value>() {
            _ if given.is_empty() => return Err(ChangeError::NoValue),
            Ok(value) => value,
            Err(_) if !given.starts_with(['[', '{', '"', '\'']) => given.into(),
            Err(error) => {
                let message = error.message().to_owned();
                return Err(ChangeError::Value { value: given.to_owned(), message });
            }
        };
        Ok(Self { text: text.trim().to_owned(), key: key.to_owned(), value })
    }
}

/// The change as it was asked for.
impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl Change {
    /// Returns the dotted key.
    pub fn key(&self) -> &str {
        &self.key
    }

    /// Sets the key in a document, and makes the tables that it needs. What a key beside the changed one says stays as it is
    /// written; so do comments.
    pub(super) fn apply(&self, document: &mut DocumentMut) {
        let mut names: Vec<&str> = self.key.split('.').collect();
        let last = names.pop().unwrap_or_default();
        let table = names.into_iter().fold(document.as_item_mut(), table_in);
        let Some(table) = table.as_table_like_mut() else { return };
        let item = table.entry(last).or_insert(Item::None);
        match (&mut *item, self.value.clone()) {
            (Item::Table(old), Value::InlineTable(new)) => {
                let mut table = new.into_table();
                table.fmt();
                table.set_position(old.position());
                *table.decor_mut() = old.decor().clone();
                *old = table;
            }
            (Item::Value(old), mut new) => {
                *new.decor_mut() = old.decor().clone();
                *old = new;
            }
            (_, new) => *item = Item::Value(new),
        }
    }
}

/// Returns the table of a name in another table, and makes it if it is absent. What is no table becomes one: the reader finds
/// out whether the key takes it.
fn table_in<'a>(outer: &'a mut Item, name: &str) -> &'a mut Item {
    let new = if outer.is_table() { Item::Table(Table::new()) } else { Item::Value(InlineTable::new().into()) };
    let inner = &mut outer[name];
    match inner {
        Item::Value(value) if !value.is_inline_table() => {
            let mut table = Value::from(InlineTable::new());
            *table.decor_mut() = value.decor().clone();
            *value = table;
        }
        Item::None => *inner = new,
        _ => {}
    }
    inner
}

#[cfg(test)]
mod tests {
    use super::*;

    fn changed(text: &str, changes: &[&str]) -> String {
        let mut document: DocumentMut = text.parse().expect("TOML");
        changes.iter().for_each(|change| change.parse::<Change>().expect("a change").apply(&mut document));
        document.to_string()
    }

    #[test]
    fn one_key_changes_and_the_rest_stays_as_it_is_written() {
        let text = "name = 'a' # name\n\n[contact]\n# of steel\nfriction = 1.0  # μ\n\n[sync]\nmode = \"replay\"\n";
        let cases: [(&[&str], &str, &str); 8] = [
            (&["name=b"], "'a'", "\"b\""),
            (&["contact.friction=0.5"], "1.0", "0.5"),
            (&["contact.friction={static=2,kinetic=1}"], "1.0", "{static=2,kinetic=1}"),
            (&["contact.friction.static=2", "contact.friction.kinetic=1"], "1.0", "{ static = 2, kinetic = 1 }"),
            (&["contact.law=stick-slip"], "# μ\n", "# μ\nlaw = \"stick-slip\"\n"),
            (&["sync={latency_ticks=3}"], "mode = \"replay\"", "latency_ticks = 3"),
            (&["settle = true"], "# name\n", "# name\nsettle = true\n"),
            (&["timing.seed=1"], "\"replay\"\n", "\"replay\"\n\n[timing]\nseed = 1\n"),
        ];
        for (changes, old, new) in cases {
            assert_eq!(changed(text, changes), text.replace(old, new), "{changes:?}");
        }
    }

    #[test]
    fn a_bare_word_is_a_string_and_what_is_neither_is_refused() {
        let value = |text: &str| text.parse::<Change>().map(|change| change.value.to_string());
        for (text, expected) in [
            ("mesh.nodes=[9,9,4]", "[9,9,4]"),
            ("contact.adhesion=inf", "inf"),
            ("name=a=b", "\"a=b\""),
            ("mesh.path=../liver.msh", "\"../liver.msh\""),
            (" run.schedule = threads ", "\"threads\""),
            ("name='1'", "'1'"),
        ] {
            assert_eq!(value(text).as_deref(), Ok(expected), "{text}");
        }
        for text in ["contact.friction", "name=", "=1", "contact..law=1", "a b=1", "mesh.nodes=[9,9", "name=\"x"] {
            assert!(value(text).is_err(), "{text}");
        }
    }
}
