//! Arguments that are read and checked in the same way by every function.

use std::borrow::Cow;

use numpy::ndarray::Dimension;
use numpy::{Element, PyReadonlyArray, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// The numbers of an array in row-major order: borrowed where they lie so in memory, copied where they do not.
pub fn numbers<'a, T: Element + Copy, D: Dimension>(
    array: &'a PyReadonlyArray<'_, T, D>,
) -> Cow<'a, [T]> {
    match array.as_slice() {
        Ok(numbers) if array.is_c_contiguous() => Cow::Borrowed(numbers),
        _ => Cow::Owned(array.as_array().iter().copied().collect()),
    }
}

/// Refuse columns that do not all have `count` entries.
pub fn check_lengths(count: usize, lengths: &[usize]) -> PyResult<()> {
    if lengths.iter().any(|&length| length != count) {
        return Err(PyValueError::new_err("the columns differ in length"));
    }
    Ok(())
}

/// The first item of each of `groups` groups, and the number of items: `name` must begin with 0, not fall, and end with
/// `items`.
pub fn group_starts(
    name: &str,
    first: &[i64],
    groups: usize,
    items: usize,
) -> PyResult<Vec<usize>> {
    let wrong = || {
        let told = format!(
            "{name} must have {} entries, begin with 0, not fall, and end with {items}: it has {} entries",
            groups + 1,
            first.len()
        );
        PyValueError::new_err(told)
    };
    let starts: Vec<usize> = first
        .iter()
        .map(|&f| usize::try_from(f).map_err(|_| wrong()))
        .collect::<PyResult<_>>()?;
    let is_sorted = starts.windows(2).all(|pair| pair[0] <= pair[1]);
    if starts.len() == groups + 1 && is_sorted && starts[0] == 0 && starts[groups] == items {
        Ok(starts)
    } else {
        Err(wrong())
    }
}

/// The same where every group has an item.
pub fn nonempty_group_starts(
    name: &str,
    first: &[i64],
    groups: usize,
    items: usize,
) -> PyResult<Vec<usize>> {
    let starts = group_starts(name, first, groups, items)?;
    match starts.windows(2).position(|pair| pair[0] == pair[1]) {
        None => Ok(starts),
        Some(group) => Err(PyValueError::new_err(format!(
            "{name} must increase: group {group} is empty"
        ))),
    }
}
