//! Keys of scenes set from Python: values become TOML, and the rest of the text stays as it was written.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};
use toml_edit::{Array, DocumentMut, InlineTable, Item, Table, TableLike, Value};

/// Sets a key such as `contact.friction`, with the tables on its way. `None` removes it.
///
/// # Errors
/// If a part of the key on its way is a value, or the value has no form in TOML.
pub fn set(document: &mut DocumentMut, key: &str, value: &Bound<'_, PyAny>) -> PyResult<()> {
    let (parents, last) = key.rsplit_once('.').map_or((None, key), |(parents, last)| (Some(parents), last));
    let mut table: &mut dyn TableLike = document.as_table_mut();
    for part in parents.into_iter().flat_map(|parents| parents.split('.')) {
        let found = table.entry(part).or_insert_with(|| Item::Table(Table::new()));
        table = found
            .as_table_like_mut()
            .ok_or_else(|| PyValueError::new_err(format!("`{key}`: `{part}` is a value, not a table")))?;
    }
    if value.is_none() {
        table.remove(last);
        return Ok(());
    }
    let mut item = item(key, value)?;
    // A comment behind the old value stays.
    if let (Some(new), Some(old)) = (item.as_value_mut(), table.get(last).and_then(Item::as_value)) {
        *new.decor_mut() = old.decor().clone();
    }
    table.insert(last, item);
    Ok(())
}

/// Turns a value into an entry of a table: a dictionary becomes a table of its own.
fn item(key: &str, value: &Bound<'_, PyAny>) -> PyResult<Item> {
    let Ok(entries) = value.cast::<PyDict>() else { return Ok(Item::Value(inline(key, value)?)) };
    let mut table = Table::new();
    for (name, value) in entries.iter().filter(|(_, value)| !value.is_none()) {
        let name: String = name.extract()?;
        table.insert(&name, item(&format!("{key}.{name}"), &value)?);
    }
    Ok(Item::Table(table))
}

/// Turns a value into one that stands behind a key or in a list. Scalars and arrays of numpy are accepted.
fn inline(key: &str, value: &Bound<'_, PyAny>) -> PyResult<Value> {
    if value.is_instance_of::<PyBool>() {
        Ok(value.extract::<bool>()?.into())
    } else if value.is_instance_of::<PyInt>() {
        Ok(value.extract::<i64>()?.into())
    } else if value.is_instance_of::<PyFloat>() {
        Ok(value.extract::<f64>()?.into())
    } else if value.is_instance_of::<PyString>() {
        Ok(value.extract::<String>()?.into())
    } else if value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>() {
        let entries = value.try_iter()?.map(|entry| inline(key, &entry?));
        Ok(Value::Array(entries.collect::<PyResult<Array>>()?))
    } else if let Ok(entries) = value.cast::<PyDict>() {
        let entries = entries.iter().map(|(name, value)| Ok((name.extract::<String>()?, inline(key, &value)?)));
        Ok(Value::InlineTable(entries.collect::<PyResult<InlineTable>>()?))
    } else if value.hasattr("tolist")? {
        inline(key, &value.call_method0("tolist")?)
    } else if value.hasattr("__fspath__")? {
        inline(key, &value.call_method0("__fspath__")?)
    } else {
        Err(PyTypeError::new_err(format!("`{key}` cannot be of type {}", value.get_type().name()?)))
    }
}
