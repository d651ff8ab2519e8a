//! The functions of `pricing_core._kernels` that solve complementarity problems with a dense matrix.

use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use super::arguments::numbers;
use super::interrupt::Question;
use crate::PathEnd;

/// Return the diagonals of R and C, powers of two, for which R M C has its largest entries near one, (n,) and (n,).
#[pyfunction]
#[pyo3(signature = (matrix))]
#[allow(clippy::needless_pass_by_value, clippy::type_complexity)]
pub fn equilibrate<'py>(
    py: Python<'py>,
    matrix: PyReadonlyArray2<'py, f64>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<f64>>)> {
    let (size, entries) = (matrix.as_array().nrows(), numbers(&matrix));
    let (row, column) = py.detach(|| crate::equilibrate(&entries, size))?;
    Ok((PyArray1::from_vec(py, row), PyArray1::from_vec(py, column)))
}

/// Return (end, z, `basic_set`, pivots) of Lemke's path of w - M z - d z0 = q, d = `covering`.
///
/// `end` is "solved", "ray", "limit" after `max_pivots` or "interrupted"; z and the basic set are those of the last basis.
/// `interrupt`, a function or None, is asked every few milliseconds whether the work shall end.
#[pyfunction]
#[pyo3(signature = (matrix, q, covering, max_pivots, interrupt=None))]
#[allow(clippy::needless_pass_by_value, clippy::type_complexity)]
pub fn lemke<'py>(
    py: Python<'py>,
    matrix: PyReadonlyArray2<'py, f64>,
    q: PyReadonlyArray1<'py, f64>,
    covering: PyReadonlyArray1<'py, f64>,
    max_pivots: u64,
    interrupt: Option<Py<PyAny>>,
) -> PyResult<(
    &'static str,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    u64,
)> {
    let (entries, q, covering) = (numbers(&matrix), numbers(&q), numbers(&covering));
    let question = Question::new(interrupt);
    let path = py.detach(|| {
        let interrupt = || question.is_ended();
        crate::lemke(&entries, &q, &covering, max_pivots, &interrupt)
    })?;
    question.result()?;
    let end = match path.end {
        PathEnd::Solved => "solved",
        PathEnd::Ray => "ray",
        PathEnd::Limit => "limit",
        PathEnd::Interrupted => "interrupted",
    };
    Ok((
        end,
        PyArray1::from_vec(py, path.z),
        PyArray1::from_vec(py, path.basic_set),
        path.pivots,
    ))
}
