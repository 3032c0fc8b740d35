//! Contents of a scene's text apart from its layout, and the files that the scene names.

use std::path::{Path, PathBuf};

use toml::{Table, Value};

use super::Scene;

/// Keys whose values are paths of files, relative to the scene's folder.
const FILES: [[&str; 2]; 3] = [["mesh", "path"], ["instrument", "file"], ["local", "library"]];

/// Magnitude up to which every whole number is exactly a float.
const WHOLE: f64 = 9_007_199_254_740_992.0;

impl Scene {
    /// Returns the scene's settings in a canonical form: without comments, in the order of their keys, and with numbers as
    /// they are read. A scene that was built in Rust has no text, so its `Debug` output stands for it.
    pub(crate) fn meaning(&self) -> String {
        match self.table() {
            Some(table) => write_table(&table),
            None => format!("{self:?}"),
        }
    }

    /// Returns the paths of the files that the scene names, as it writes them.
    pub(crate) fn named_files(&self) -> Vec<PathBuf> {
        let table = self.table().unwrap_or_default();
        FILES.iter().filter_map(|[section, key]| Some(table.get(*section)?.get(*key)?.as_str()?.into())).collect()
    }

    /// Returns the folder that these paths are relative to.
    pub(crate) fn folder(&self) -> &Path {
        self.path_name().parent().unwrap_or(Path::new(""))
    }

    fn table(&self) -> Option<Table> {
        self.text()?.parse().ok()
    }
}

fn write_table(table: &Table) -> String {
    let mut entries: Vec<_> = table.iter().collect();
    entries.sort_by_key(|(key, _)| *key);
    let entries: Vec<String> = entries.iter().map(|(key, value)| format!("{key:?}:{}", write(value))).collect();
    format!("{{{}}}", entries.join(","))
}

fn write(value: &Value) -> String {
    match value {
        Value::String(text) => format!("{text:?}"),
        Value::Integer(number) => number.to_string(),
        // 1.0 and 1 are one value.
        Value::Float(number) if number.fract() == 0.0 && number.abs() < WHOLE => format!("{number:.0}"),
        Value::Float(number) => format!("{number:?}"),
        Value::Boolean(value) => value.to_string(),
        Value::Datetime(time) => time.to_string(),
        Value::Array(values) => format!("[{}]", values.iter().map(write).collect::<Vec<_>>().join(",")),
        Value::Table(table) => write_table(table),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layout_means_nothing_and_every_value_does() {
        let text = Scene::shipped("fig5-stick-slip").expect("shipped").text().expect("it was read").to_owned();
        let meaning = |text: &str| Scene::parse(text, Path::new("a/b.toml")).expect("a scene").meaning();
        let same =
            text.replace("# The paper's", "# Another comment on the").replace("duration = 1.2 ", "duration=1.20");
        assert!(same != text && meaning(&same) == meaning(&text));
        assert_eq!(meaning(&text.replace("friction = 1.0", "friction = 1")), meaning(&text));
        assert_ne!(meaning(&text.replace("friction = 1.0", "friction = 1.0000000000000002")), meaning(&text));
        assert_ne!(meaning(&text.replace("rings = 1", "rings = 2")), meaning(&text));
        assert_eq!(write(&Value::Float(-0.0)), "-0");
    }
}
