//! The premium functions of `pricing_core._kernels`.

use std::borrow::Cow;

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::premium::{self, Puts, COLUMNS, STEPS, VALUES};

pub fn slice<'a, T: numpy::Element + Copy>(array: &'a PyReadonlyArray1<'_, T>) -> Cow<'a, [T]> {
    match array.as_slice() {
        Ok(values) => Cow::Borrowed(values),
        Err(_) => Cow::Owned(array.as_array().iter().copied().collect()),
    }
}

/// The level of so many time steps.
fn level(steps: usize) -> PyResult<usize> {
    STEPS
        .iter()
        .position(|&s| s == steps)
        .ok_or_else(|| PyValueError::new_err(format!("steps is {steps}: must be one of {STEPS:?}")))
}

/// Refuse columns of different lengths.
fn check(count: usize, lengths: &[usize]) -> PyResult<()> {
    if lengths.iter().any(|&length| length != count) {
        return Err(PyValueError::new_err("the columns differ in length"));
    }
    Ok(())
}

/// The first spot of each run, and the number of spots.
fn checked_runs(first: &[i64], runs: usize, spots: usize) -> PyResult<Vec<usize>> {
    let wrong = || {
        PyValueError::new_err("first must begin with 0, increase, and end with the number of spots")
    };
    let starts: Vec<usize> = first
        .iter()
        .map(|&f| usize::try_from(f).map_err(|_| wrong()))
        .collect::<PyResult<_>>()?;
    let rises = starts.windows(2).all(|pair| pair[0] < pair[1]);
    if starts.len() == runs + 1 && rises && starts[0] == 0 && starts[runs] == spots {
        Ok(starts)
    } else {
        Err(wrong())
    }
}

/// Return (numbers, exercised, settled, steps); see `premium_twin.solve_puts`.
#[pyfunction]
#[pyo3(signature = (x, rate, dividend, spread, first, tolerance, limits, fewest, most, threads))]
#[allow(
    clippy::needless_pass_by_value,
    clippy::too_many_arguments,
    clippy::type_complexity
)]
pub fn solve_puts<'py>(
    py: Python<'py>,
    x: PyReadonlyArray1<'py, f64>,
    rate: PyReadonlyArray1<'py, f64>,
    dividend: PyReadonlyArray1<'py, f64>,
    spread: PyReadonlyArray1<'py, f64>,
    first: PyReadonlyArray1<'py, i64>,
    tolerance: PyReadonlyArray1<'py, f64>,
    limits: Option<PyReadonlyArray2<'py, f64>>,
    fewest: usize,
    most: usize,
    threads: usize,
) -> PyResult<(
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<i64>>,
)> {
    let (x, rate, dividend, spread) = (slice(&x), slice(&rate), slice(&dividend), slice(&spread));
    let tolerance = slice(&tolerance);
    let limits: Option<Cow<[f64]>> = limits.as_ref().map(|limits| match limits.as_slice() {
        Ok(values) => Cow::Borrowed(values),
        Err(_) => Cow::Owned(limits.as_array().iter().copied().collect()),
    });
    check(rate.len(), &[dividend.len(), spread.len()])?;
    check(x.len(), &[tolerance.len()])?;
    if let Some(limits) = &limits {
        check(VALUES * x.len(), &[limits.len()])?;
    }
    let first = checked_runs(&slice(&first), rate.len(), x.len())?;
    let levels = (level(fewest)?, level(most)?);
    if levels.0 < 2 || levels.0 > levels.1 {
        let told = format!(
            "fewest is {fewest}: must be from {} to most = {most}",
            STEPS[2]
        );
        return Err(PyValueError::new_err(told));
    }
    let puts = Puts {
        rate: &rate,
        dividend: &dividend,
        spread: &spread,
        first: &first,
        x: &x,
        tolerance: &tolerance,
        limits: limits.as_deref(),
        levels,
    };
    let found = py.detach(|| premium::solve_puts(puts, threads));
    Ok((
        PyArray1::from_vec(py, found.numbers).reshape([COLUMNS, x.len()])?,
        PyArray1::from_vec(py, found.exercised),
        PyArray1::from_vec(py, found.settled),
        PyArray1::from_vec(py, found.steps),
    ))
}

/// Return (boundary, settled); see `premium_twin.march_boundaries`.
#[pyfunction]
#[pyo3(signature = (steps, rate, dividend, spread))]
#[allow(clippy::needless_pass_by_value, clippy::type_complexity)]
pub fn march_boundaries<'py>(
    py: Python<'py>,
    steps: usize,
    rate: PyReadonlyArray1<'py, f64>,
    dividend: PyReadonlyArray1<'py, f64>,
    spread: PyReadonlyArray1<'py, f64>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>)> {
    let (rate, dividend, spread) = (slice(&rate), slice(&dividend), slice(&spread));
    check(rate.len(), &[dividend.len(), spread.len()])?;
    let level = level(steps)?;
    let puts = Puts {
        rate: &rate,
        dividend: &dividend,
        spread: &spread,
        first: &[],
        x: &[],
        tolerance: &[],
        limits: None,
        levels: (level, level),
    };
    let (boundary, settled) = py.detach(|| premium::march_boundaries(puts, level));
    Ok((
        PyArray1::from_vec(py, boundary),
        PyArray1::from_vec(py, settled),
    ))
}
