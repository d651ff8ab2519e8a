//! The functions of `pricing_core._kernels` that solve complementarity problems with a tridiagonal matrix.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::exceptions::{PyValueError, PyZeroDivisionError};
use pyo3::prelude::*;

use super::arguments::numbers;
use super::interrupt::Question;
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

/// Return the basic set (w = 0, z > 0) of 0 <= z, 0 <= M z + q, complementary, for an M-matrix M; else a guess.
#[pyfunction]
#[pyo3(signature = (lower, diagonal, upper, q))]
#[allow(clippy::needless_pass_by_value)]
pub fn growing_basic_set<'py>(
    py: Python<'py>,
    lower: PyReadonlyArray1<'py, f64>,
    diagonal: PyReadonlyArray1<'py, f64>,
    upper: PyReadonlyArray1<'py, f64>,
    q: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray1<bool>>> {
    let (lower, diagonal, upper) = (numbers(&lower), numbers(&diagonal), numbers(&upper));
    let (matrix, q) = (Tridiagonal::new(&lower, &diagonal, &upper)?, numbers(&q));
    let basic_set = py.detach(|| crate::growing_basic_set(matrix, &q))?;
    Ok(PyArray1::from_vec(py, basic_set))
}

/// Return (z, systems) of 0 <= z, 0 <= M z + q, complementary, by Howard's method from a basic set, (n,).
///
/// A row changes sides where its z or w is more negative than `tolerance` times the row's terms; the number of linear
/// systems is `max_systems` + 1 where so many were not enough. `interrupt`, a function or None, is asked every few
/// milliseconds whether the work shall end.
#[pyfunction]
#[pyo3(signature = (lower, diagonal, upper, q, basic_set, tolerance, max_systems, interrupt=None))]
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
    interrupt: Option<Py<PyAny>>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, u64)> {
    let (lower, diagonal, upper) = (numbers(&lower), numbers(&diagonal), numbers(&upper));
    let (matrix, q) = (Tridiagonal::new(&lower, &diagonal, &upper)?, numbers(&q));
    let mut basic_set = numbers(&basic_set).into_owned();
    let mut z = vec![0.0; matrix.size()];
    let settling = Settling {
        tolerance,
        limit: max_systems,
    };
    let question = Question::new(interrupt);
    let systems = py.detach(|| {
        let interrupt = || question.is_ended();
        crate::policy_iteration(matrix, &q, &mut basic_set, &mut z, settling, &interrupt)
    })?;
    question.result()?;
    Ok((PyArray1::from_vec(py, z), systems))
}

/// Return (z, sweeps) of 0 <= z, 0 <= M z + q, complementary, by projected over-relaxation from z, (n,).
///
/// The sweeps end when no entry changes by more than `tolerance`; their number is `max_sweeps` + 1 where so many were not
/// enough. `interrupt`, a function or None, is asked every few milliseconds whether the work shall end.
#[pyfunction]
#[pyo3(signature = (lower, diagonal, upper, q, z, relaxation, tolerance, max_sweeps, interrupt=None))]
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
    interrupt: Option<Py<PyAny>>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, u64)> {
    let (lower, diagonal, upper) = (numbers(&lower), numbers(&diagonal), numbers(&upper));
    let (matrix, q) = (Tridiagonal::new(&lower, &diagonal, &upper)?, numbers(&q));
    let mut z = numbers(&z).into_owned();
    let sweeping = Sweeping {
        relaxation,
        tolerance,
        limit: max_sweeps,
    };
    let question = Question::new(interrupt);
    let sweeps = py.detach(|| {
        let interrupt = || question.is_ended();
        crate::projected_sor(matrix, &q, &mut z, sweeping, &interrupt)
    })?;
    question.result()?;
    Ok((PyArray1::from_vec(py, z), sweeps))
}
