//! The functions of `pricing_core._kernels` that solve complementarity problems with a tridiagonal matrix.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::{PyValueError, PyZeroDivisionError};
use pyo3::prelude::*;

use super::arguments::numbers;
use crate::{KernelError, Settling, Sweeping, Tridiagonal};

impl From<KernelError> for PyErr {
    fn from(error: KernelError) -> Self {
        let message = error.to_string();
        match error {
            KernelError::ZeroPivot { .. } => PyZeroDivisionError::new_err(message),
            KernelError::Length { .. } | KernelError::Empty => PyValueError::new_err(message),
        }
    }
}

/// Return z of 0 <= z, 0 <= M z + q, complementary, from one elimination and one projected substitution.
///
/// `lower`, `diagonal`, `upper` are the bands of M, (n - 1,), (n,), (n - 1,); `contact_first` says at which end z = 0.
#[pyfunction]
#[pyo3(signature = (lower, diagonal, upper, q, contact_first))]
#[allow(clippy::needless_pass_by_value)]
pub fn brennan_schwartz<'py>(
    py: Python<'py>,
    lower: PyReadonlyArray1<'py, f64>,
    diagonal: PyReadonlyArray1<'py, f64>,
    upper: PyReadonlyArray1<'py, f64>,
    q: PyReadonlyArray1<'py, f64>,
    contact_first: bool,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (lower, diagonal, upper) = (numbers(&lower), numbers(&diagonal), numbers(&upper));
    let (matrix, q) = (Tridiagonal::new(&lower, &diagonal, &upper)?, numbers(&q));
    let z = py.detach(|| crate::brennan_schwartz(matrix, &q, contact_first))?;
    Ok(PyArray1::from_vec(py, z))
}

/// Return (z, systems) of 0 <= z, 0 <= M z + q, complementary, by Howard's method from a basic set, (n,).
///
/// A row changes sides where its z or w is more negative than `tolerance` times the row's terms; the number of linear
/// systems is `max_systems` + 1 where so many were not enough.
#[pyfunction]
#[pyo3(signature = (lower, diagonal, upper, q, basic_set, tolerance, max_systems))]
#[allow(clippy::needless_pass_by_value, clippy::too_many_arguments)]
pub fn policy_iteration<'py>(
    py: Python<'py>,
    lower: PyReadonlyArray1<'py, f64>,
    diagonal: PyReadonlyArray1<'py, f64>,
    upper: PyReadonlyArray1<'py, f64>,
    q: PyReadonlyArray1<'py, f64>,
    basic_set: PyReadonlyArray1<'py, bool>,
    tolerance: f64,
    max_systems: u32,
) -> PyResult<(Bound<'py, PyArray1<f64>>, u64)> {
    let (lower, diagonal, upper) = (numbers(&lower), numbers(&diagonal), numbers(&upper));
    let (matrix, q) = (Tridiagonal::new(&lower, &diagonal, &upper)?, numbers(&q));
    let mut basic_set = numbers(&basic_set).into_owned();
    let mut z = vec![0.0; matrix.size()];
    let settling = Settling {
        tolerance,
        limit: max_systems,
    };
    let systems =
        py.detach(|| crate::policy_iteration(matrix, &q, &mut basic_set, &mut z, settling))?;
    Ok((PyArray1::from_vec(py, z), systems))
}

/// Return (z, sweeps) of 0 <= z, 0 <= M z + q, complementary, by projected over-relaxation from z, (n,).
///
/// The sweeps end when no entry changes by more than `tolerance`; their number is `max_sweeps` + 1 where so many were not
/// enough.
#[pyfunction]
#[pyo3(signature = (lower, diagonal, upper, q, z, relaxation, tolerance, max_sweeps))]
#[allow(clippy::needless_pass_by_value, clippy::too_many_arguments)]
pub fn projected_sor<'py>(
    py: Python<'py>,
    lower: PyReadonlyArray1<'py, f64>,
    diagonal: PyReadonlyArray1<'py, f64>,
    upper: PyReadonlyArray1<'py, f64>,
    q: PyReadonlyArray1<'py, f64>,
    z: PyReadonlyArray1<'py, f64>,
    relaxation: f64,
    tolerance: f64,
    max_sweeps: u32,
) -> PyResult<(Bound<'py, PyArray1<f64>>, u64)> {
    let (lower, diagonal, upper) = (numbers(&lower), numbers(&diagonal), numbers(&upper));
    let (matrix, q) = (Tridiagonal::new(&lower, &diagonal, &upper)?, numbers(&q));
    let mut z = numbers(&z).into_owned();
    let sweeping = Sweeping {
        relaxation,
        tolerance,
        limit: max_sweeps,
    };
    let sweeps = py.detach(|| crate::projected_sor(matrix, &q, &mut z, sweeping))?;
    Ok((PyArray1::from_vec(py, z), sweeps))
}
