//! The collocation of `pricing_core._kernels`.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::collocation::{self, Schedules, COLUMNS, LEVELS, RESULTS};
use crate::python_premium::slice;

/// Where each of `rows` parts of `size` begins, and the end.
fn checked_parts(first: &[i64], rows: usize, size: usize) -> PyResult<Vec<usize>> {
    let wrong =
        || PyValueError::new_err("first must begin with 0, not fall, and end with the size");
    let starts: Vec<usize> = first
        .iter()
        .map(|&f| usize::try_from(f).map_err(|_| wrong()))
        .collect::<PyResult<_>>()?;
    let rises = starts.windows(2).all(|pair| pair[0] <= pair[1]);
    if starts.len() == rows + 1 && rises && starts[0] == 0 && starts[rows] == size {
        Ok(starts)
    } else {
        Err(wrong())
    }
}

/// Return (numbers, boundary, settled); see `collocation_twin.solve_schedules`.
#[pyfunction]
#[pyo3(signature = (sign, x, first, stretches, level, tolerance, times, first_time, threads))]
#[allow(
    clippy::needless_pass_by_value,
    clippy::too_many_arguments,
    clippy::type_complexity
)]
pub fn solve_schedules<'py>(
    py: Python<'py>,
    sign: PyReadonlyArray1<'py, f64>,
    x: PyReadonlyArray1<'py, f64>,
    first: PyReadonlyArray1<'py, i64>,
    stretches: PyReadonlyArray2<'py, f64>,
    level: PyReadonlyArray1<'py, i64>,
    tolerance: PyReadonlyArray1<'py, f64>,
    times: PyReadonlyArray1<'py, f64>,
    first_time: PyReadonlyArray1<'py, i64>,
    threads: usize,
) -> PyResult<(
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
)> {
    let (sign, x, times) = (slice(&sign), slice(&x), slice(&times));
    let tolerance = slice(&tolerance);
    let stretches: Vec<f64> = stretches.as_array().iter().copied().collect();
    let lengths = [sign.len(), level.len()?, tolerance.len()];
    if !stretches.len().is_multiple_of(COLUMNS) || lengths != [x.len(); 3] {
        return Err(PyValueError::new_err("the columns differ in length"));
    }
    let first = checked_parts(&slice(&first), x.len(), stretches.len() / COLUMNS)?;
    if first.windows(2).any(|pair| pair[0] == pair[1]) {
        return Err(PyValueError::new_err("a schedule needs a stretch"));
    }
    let first_time = checked_parts(&slice(&first_time), x.len(), times.len())?;
    let level: Vec<usize> = slice(&level)
        .iter()
        .map(|&l| usize::try_from(l).ok().filter(|&l| l < LEVELS))
        .collect::<Option<_>>()
        .ok_or_else(|| PyValueError::new_err(format!("level must be from 0 to {}", LEVELS - 1)))?;
    let schedules = Schedules {
        sign: &sign,
        x: &x,
        first: &first,
        stretches: &stretches,
        level: &level,
        tolerance: &tolerance,
        times: &times,
        first_time: &first_time,
    };
    let solved = py.detach(|| collocation::solve_schedules(schedules, threads));
    Ok((
        PyArray1::from_vec(py, solved.numbers).reshape([RESULTS, x.len()])?,
        PyArray1::from_vec(py, solved.boundary),
        PyArray1::from_vec(py, solved.settled),
    ))
}
