//! The function of `pricing_core._kernels` that marches options of all strikes side by side.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3};
use pyo3::prelude::*;

use super::arguments::numbers;
use crate::StrikeSteps;

/// Return the values after a march of American and European options, (nodes, columns).
///
/// `factors`, (steps, 2), multiply the values now and those before; `matrices`, (steps, 3, nodes), are the lower, middle
/// and upper diagonal of each step; `values`, (nodes, columns), at the start; `obstacle`, (nodes, american), the payoffs
/// of the first columns, whose exercise region is at the first nodes.
#[pyfunction]
#[pyo3(signature = (factors, matrices, values, obstacle))]
#[allow(clippy::needless_pass_by_value)]
pub fn march_strikes<'py>(
    py: Python<'py>,
    factors: PyReadonlyArray2<'py, f64>,
    matrices: PyReadonlyArray3<'py, f64>,
    values: PyReadonlyArray2<'py, f64>,
    obstacle: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (nodes, columns) = values.as_array().dim();
    let (factors, matrices) = (numbers(&factors), numbers(&matrices));
    let (values, obstacle) = (numbers(&values), numbers(&obstacle));
    let steps = StrikeSteps {
        factors: &factors,
        matrices: &matrices,
        nodes,
    };
    let found = py.detach(|| crate::march_strikes(steps, &values, &obstacle))?;
    PyArray1::from_vec(py, found).reshape([nodes, columns])
}
