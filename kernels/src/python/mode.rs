//! The functions of `pricing_core._kernels` that follow a mode of a complementarity system.

use numpy::{
    PyArray1, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use super::arguments::numbers;
use crate::SignShares;

/// Return (place, crossed, c, sizes, flat, slow, `may_touch`): where the flow c' = R c, C c >= 0 over one step ends.
#[pyfunction]
#[allow(clippy::needless_pass_by_value, clippy::type_complexity)]
pub fn taylor_step<'py>(
    py: Python<'py>,
    rate: PyReadonlyArray2<'py, f64>,
    outputs: PyReadonlyArray2<'py, f64>,
    coordinates: PyReadonlyArray1<'py, f64>,
    sizes: PyReadonlyArray1<'py, f64>,
    reach: f64,
    share: f64,
) -> PyResult<(
    f64,
    Vec<usize>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    bool,
    bool,
    bool,
)> {
    let end = crate::taylor_step(
        &numbers(&rate),
        &numbers(&outputs),
        &numbers(&coordinates),
        &numbers(&sizes),
        reach,
        share,
    )?;
    let (coordinates, sizes) = (
        PyArray1::from_vec(py, end.coordinates),
        PyArray1::from_vec(py, end.sizes),
    );
    let (flat, slow) = end.is_low;
    Ok((
        end.place,
        end.crossed,
        coordinates,
        sizes,
        flat,
        slow,
        end.may_touch,
    ))
}

/// Return W z, zero where that is no more than rounding, and |W| sizes.
#[pyfunction]
#[allow(clippy::needless_pass_by_value, clippy::type_complexity)]
pub fn enter_mode<'py>(
    py: Python<'py>,
    matrix: PyReadonlyArray2<'py, f64>,
    z: PyReadonlyArray1<'py, f64>,
    sizes: PyReadonlyArray1<'py, f64>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>)> {
    let (c, sizes) = crate::enter(&numbers(&matrix), &numbers(&z), &numbers(&sizes))?;
    Ok((PyArray1::from_vec(py, c), PyArray1::from_vec(py, sizes)))
}

/// Return each output's sign just after the coordinates are c, shape (k,).
#[pyfunction]
#[allow(clippy::needless_pass_by_value)]
pub fn initial_signs<'py>(
    py: Python<'py>,
    derivatives: PyReadonlyArray3<'py, f64>,
    rate: PyReadonlyArray2<'py, f64>,
    coordinates: PyReadonlyArray1<'py, f64>,
    sizes: PyReadonlyArray1<'py, f64>,
    value_share: f64,
    derivative_share: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let shares = SignShares {
        value: value_share,
        derivative: derivative_share,
    };
    let signs = crate::initial_signs(
        &numbers(&derivatives),
        &numbers(&rate),
        &numbers(&coordinates),
        &numbers(&sizes),
        derivatives.shape()[1],
        shares,
    )?;
    Ok(PyArray1::from_vec(py, signs))
}

/// Return each output's sign of its leading impulse, 0 without one, shape (k,).
#[pyfunction]
#[allow(clippy::needless_pass_by_value)]
pub fn leading_signs<'py>(
    py: Python<'py>,
    impulses: PyReadonlyArray3<'py, f64>,
    z: PyReadonlyArray1<'py, f64>,
    sizes: PyReadonlyArray1<'py, f64>,
    share: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let pairs = impulses.shape()[1];
    let signs = crate::leading_signs(
        &numbers(&impulses),
        &numbers(&z),
        &numbers(&sizes),
        pairs,
        share,
    )?;
    Ok(PyArray1::from_vec(py, signs))
}
