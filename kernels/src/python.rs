//! The module `pricing_core._kernels`: arrays in, arrays out, without the interpreter lock.

use std::borrow::Cow;

use numpy::{Element, PyArray1, PyReadonlyArray1};
use pyo3::exceptions::{PyValueError, PyZeroDivisionError};
use pyo3::prelude::*;

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

/// Borrow the array where it is contiguous, copy it where it is a view with strides.
fn values<'a, T: Element + Copy>(array: &'a PyReadonlyArray1<'_, T>) -> Cow<'a, [T]> {
    match array.as_slice() {
        Ok(slice) => Cow::Borrowed(slice),
        Err(_) => Cow::Owned(array.as_array().to_vec()),
    }
}

/// Return z from one elimination and one projected substitution; see `kernel_twin.brennan_schwartz`.
#[pyfunction]
#[pyo3(signature = (lower, diagonal, upper, q, contact_first))]
#[allow(clippy::needless_pass_by_value)]
fn brennan_schwartz<'py>(
    py: Python<'py>,
    lower: PyReadonlyArray1<'py, f64>,
    diagonal: PyReadonlyArray1<'py, f64>,
    upper: PyReadonlyArray1<'py, f64>,
    q: PyReadonlyArray1<'py, f64>,
    contact_first: bool,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let (lower, diagonal, upper) = (values(&lower), values(&diagonal), values(&upper));
    let (matrix, q) = (Tridiagonal::new(&lower, &diagonal, &upper)?, values(&q));
    let z = py.detach(|| crate::brennan_schwartz(matrix, &q, contact_first))?;
    Ok(PyArray1::from_vec(py, z))
}

/// Return (z, systems) of Howard's method from a basic set; see `kernel_twin.policy_iteration`.
#[pyfunction]
#[pyo3(signature = (lower, diagonal, upper, q, basic_set, tolerance, max_systems))]
#[allow(clippy::needless_pass_by_value, clippy::too_many_arguments)]
fn policy_iteration<'py>(
    py: Python<'py>,
    lower: PyReadonlyArray1<'py, f64>,
    diagonal: PyReadonlyArray1<'py, f64>,
    upper: PyReadonlyArray1<'py, f64>,
    q: PyReadonlyArray1<'py, f64>,
    basic_set: PyReadonlyArray1<'py, bool>,
    tolerance: f64,
    max_systems: u32,
) -> PyResult<(Bound<'py, PyArray1<f64>>, u64)> {
    let (lower, diagonal, upper) = (values(&lower), values(&diagonal), values(&upper));
    let (matrix, q) = (Tridiagonal::new(&lower, &diagonal, &upper)?, values(&q));
    let mut basic_set = values(&basic_set).into_owned();
    let mut z = vec![0.0; matrix.size()];
    let settling = Settling {
        tolerance,
        limit: max_systems,
    };
    let systems =
        py.detach(|| crate::policy_iteration(matrix, &q, &mut basic_set, &mut z, settling))?;
    Ok((PyArray1::from_vec(py, z), systems))
}

/// Return (z, sweeps) of projected over-relaxation from z; see `kernel_twin.projected_sor`.
#[pyfunction]
#[pyo3(signature = (lower, diagonal, upper, q, z, relaxation, tolerance, max_sweeps))]
#[allow(clippy::needless_pass_by_value, clippy::too_many_arguments)]
fn projected_sor<'py>(
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
    let (lower, diagonal, upper) = (values(&lower), values(&diagonal), values(&upper));
    let (matrix, q) = (Tridiagonal::new(&lower, &diagonal, &upper)?, values(&q));
    let mut z = values(&z).into_owned();
    let sweeping = Sweeping {
        relaxation,
        tolerance,
        limit: max_sweeps,
    };
    let sweeps = py.detach(|| crate::projected_sor(matrix, &q, &mut z, sweeping))?;
    Ok((PyArray1::from_vec(py, z), sweeps))
}

/// The inner loops of `pricing_core`, compiled.
#[pymodule]
mod _kernels {
    #[pymodule_export]
    use super::{brennan_schwartz, policy_iteration, projected_sor};
    #[pymodule_export]
    use crate::python_collocation::solve_schedules;
    #[pymodule_export]
    use crate::python_premium::{march_boundaries, solve_puts};

    /// The version of the crate.
    #[pymodule_export]
    #[allow(non_upper_case_globals)]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
