//! The functions of `pricing_core._kernels` that work on sparse matrices.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

use super::arguments::{group_starts, numbers};
use super::interrupt::Question;
use crate::{Bounds, SparseRows, SparseSweeping};

/// Return (z, sweeps) of the box problem of M, q and bounds, by projected Gauss-Seidel sweeps from z, (n,).
///
/// M is sparse by rows: `indptr` (n + 1,), `indices` and `data` (nnz,). The sweeps, every second one backward where
/// `alternating`, end when no entry changes by more than `tolerance`; their number is `max_sweeps` + 1 where so many were
/// not enough. `interrupt`, a function or None, is asked after every sweep whether the work shall end.
#[pyfunction]
#[pyo3(signature = (indptr, indices, data, q, lower, upper, z, relaxation, tolerance, max_sweeps, alternating,
    interrupt=None))]
#[allow(clippy::needless_pass_by_value, clippy::too_many_arguments)]
pub fn sparse_sweeps<'py>(
    py: Python<'py>,
    indptr: PyReadonlyArray1<'py, i64>,
    indices: PyReadonlyArray1<'py, i64>,
    data: PyReadonlyArray1<'py, f64>,
    q: PyReadonlyArray1<'py, f64>,
    lower: PyReadonlyArray1<'py, f64>,
    upper: PyReadonlyArray1<'py, f64>,
    z: PyReadonlyArray1<'py, f64>,
    relaxation: f64,
    tolerance: f64,
    max_sweeps: u32,
    alternating: bool,
    interrupt: Option<Py<PyAny>>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, u64)> {
    let (q, lower, upper) = (numbers(&q), numbers(&lower), numbers(&upper));
    let (indptr, indices, data) = (numbers(&indptr), numbers(&indices), numbers(&data));
    let first = group_starts("indptr", &indptr, q.len(), indices.len())?;
    // A negative index becomes one that is too large, which `SparseRows::new` refuses.
    let columns: Vec<usize> = indices
        .iter()
        .map(|&j| usize::try_from(j).unwrap_or(usize::MAX))
        .collect();
    let matrix = SparseRows::new(&first, &columns, &data)?;
    let bounds = Bounds {
        lower: &lower,
        upper: &upper,
    };
    let sweeping = SparseSweeping {
        relaxation,
        tolerance,
        limit: max_sweeps,
        alternating,
    };
    let mut z = numbers(&z).into_owned();
    let question = Question::new(interrupt);
    let sweeps = py.detach(|| {
        let interrupt = || question.is_ended();
        crate::sparse_sweeps(matrix, &q, bounds, &mut z, sweeping, &interrupt)
    })?;
    question.result()?;
    Ok((PyArray1::from_vec(py, z), sweeps))
}
