//! Keys of scenes set from Python: values become TOML, and changes as the command line has them.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString, PyTuple};
use stickslip::Change;
use toml_edit::{Array, DocumentMut, InlineTable, Item, Value};

/// Collects what setting a key means: a change for a value, one for each key of a dictionary, and for `None` a key that is
/// removed.
///
/// # Errors
/// If the key is none, or the value has no form in TOML.
pub fn collect(
    key: &str,
    value: &Bound<'_, PyAny>,
    changes: &mut Vec<Change>,
    removed: &mut Vec<String>,
) -> PyResult<()> {
    if let Ok(entries) = value.cast::<PyDict>() {
        let mut entries = entries.iter();
        return entries.try_for_each(|(name, value)| {
            collect(&format!("{key}.{}", name.extract::<String>()?), &value, changes, removed)
        });
    }
    if value.is_none() {
        removed.push(key.to_owned());
        return Ok(());
    }
    let change = format!("{key}={}", toml(key, value)?);
    changes.push(change.parse().map_err(|error: stickslip::ChangeError| PyValueError::new_err(error.to_string()))?);
    Ok(())
}

/// Removes a dotted key, if there is one.
pub fn remove(document: &mut DocumentMut, key: &str) {
    let mut names: Vec<&str> = key.split('.').collect();
    let last = names.pop().unwrap_or_default();
    let table = names.into_iter().try_fold(document.as_item_mut(), |outer: &mut Item, name| outer.get_mut(name));
    if let Some(table) = table.and_then(Item::as_table_like_mut) {
        table.remove(last);
    }
}

/// Turns a value into TOML. Scalars and arrays of numpy are accepted.
fn toml(key: &str, value: &Bound<'_, PyAny>) -> PyResult<Value> {
    if value.is_instance_of::<PyBool>() {
        Ok(value.extract::<bool>()?.into())
    } else if value.is_instance_of::<PyInt>() {
        Ok(value.extract::<i64>()?.into())
    } else if value.is_instance_of::<PyFloat>() {
        Ok(value.extract::<f64>()?.into())
    } else if value.is_instance_of::<PyString>() {
        Ok(value.extract::<String>()?.into())
    } else if value.is_instance_of::<PyList>() || value.is_instance_of::<PyTuple>() {
        let entries = value.try_iter()?.map(|entry| toml(key, &entry?));
        Ok(Value::Array(entries.collect::<PyResult<Array>>()?))
    } else if let Ok(entries) = value.cast::<PyDict>() {
        let entries = entries.iter().map(|(name, value)| Ok((name.extract::<String>()?, toml(key, &value)?)));
        Ok(Value::InlineTable(entries.collect::<PyResult<InlineTable>>()?))
    } else if value.hasattr("tolist")? {
        toml(key, &value.call_method0("tolist")?)
    } else if value.hasattr("__fspath__")? {
        toml(key, &value.call_method0("__fspath__")?)
    } else {
        Err(PyTypeError::new_err(format!("`{key}` cannot be of type {}", value.get_type().name()?)))
    }
}
