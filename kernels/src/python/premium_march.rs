//! The functions of `pricing_core._kernels` that price flat puts.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::arguments::{check_lengths, nonempty_group_starts, numbers};
use super::interrupt::Question;
use crate::premium_march::{self, Greeks, Options, Puts, STEPS, VALUES};

/// The place of a number of time steps in `STEPS`.
fn level(steps: usize) -> PyResult<usize> {
    STEPS
        .iter()
        .position(|&s| s == steps)
        .ok_or_else(|| PyValueError::new_err(format!("steps is {steps}: must be one of {STEPS:?}")))
}

/// Refine American puts until the error estimate of each meets its tolerance, or to the finest mesh.
///
/// Runs of spots with the same parameters share a march: `rate` r T, `dividend` q T, `spread` sigma sqrt(T), each
/// (runs,), and `first`, (runs + 1,), the first spot of each run and n. By spot: `x` = ln(S/K), `tolerance` of V/K, each
/// (n,), and `limits`, (n, 7), the errors allowed in each of the values, or None to leave out the derivatives by the
/// parameters. `fewest` and `most` bound the number of time steps of the finest march.
///
/// Returns numbers, (n, 10): V/K, its first and second derivative by x, the European V/K, the derivatives of V/K by rate,
/// dividend and spread at fixed x, the error estimate of V/K, ln(S*/K) and its error estimate. With limits, (n, 15): how far
/// the five derivatives are apart in the last two marches as well. With limits and `spread_step`, a share of the spread, (n, 23):
/// the derivatives by x and each of rate, dividend and spread, and by spread twice, and how far these four are apart, NaN
/// where exercised. Then exercised, settled and
/// steps, each (n,). Nothing of a spot that is not settled may be used. `interrupt`, a function or None, is asked every few
/// milliseconds whether the work shall end; what has not been marched then is not settled, and what has been keeps its
/// error estimate.
#[pyfunction]
#[pyo3(signature = (x, rate, dividend, spread, first, tolerance, limits, spread_step, fewest, most, threads, interrupt))]
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
    spread_step: Option<f64>,
    fewest: usize,
    most: usize,
    threads: usize,
    interrupt: Option<Py<PyAny>>,
) -> PyResult<(
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<i64>>,
)> {
    let (x, rate, dividend, spread) = (
        numbers(&x),
        numbers(&rate),
        numbers(&dividend),
        numbers(&spread),
    );
    let tolerance = numbers(&tolerance);
    let limits = limits.as_ref().map(numbers);
    check_lengths(rate.len(), &[dividend.len(), spread.len()])?;
    check_lengths(x.len(), &[tolerance.len()])?;
    if let Some(limits) = &limits {
        check_lengths(VALUES * x.len(), &[limits.len()])?;
    }
    let first = nonempty_group_starts("first", &numbers(&first), rate.len(), x.len())?;
    let levels = (level(fewest)?, level(most)?);
    if levels.0 < 2 || levels.0 > levels.1 {
        let told = format!(
            "fewest is {fewest}: must be from {} to most = {most}",
            STEPS[2]
        );
        return Err(PyValueError::new_err(told));
    }
    let question = Question::new(interrupt);
    let puts = Puts {
        rate: &rate,
        dividend: &dividend,
        spread: &spread,
        first: &first,
        x: &x,
        tolerance: &tolerance,
        limits: limits.as_deref(),
        spread_step,
        levels,
        interrupt: &|| question.is_ended(),
    };
    let found = py.detach(|| premium_march::solve_puts(puts, threads));
    question.result()?;
    Ok((
        PyArray1::from_vec(py, found.numbers).reshape([x.len(), found.per_spot])?,
        PyArray1::from_vec(py, found.exercised),
        PyArray1::from_vec(py, found.settled),
        PyArray1::from_vec(py, found.steps),
    ))
}

/// Price American options without events to their tolerances, in money and years: those whose exercise region has one
/// boundary.
///
/// Each column is (n,): `is_put`, `spot`, `strike`, `expiry`, `rate`, `dividend_yield`, `volatility`, and `tolerance`, the
/// error allowed in strikes. `greeks` is 0 for none, 1 for the standard ones, 2 for the extended ones. With `shared` rows
/// that differ in spot and strike alone share their marches.
///
/// Returns the numbers by name, NaN where a row is not settled, and exercised, settled and steps, each (n,). `interrupt` is
/// that of `solve_puts`.
#[pyfunction]
#[pyo3(signature = (is_put, spot, strike, expiry, rate, dividend_yield, volatility, tolerance, greeks, shared, threads, interrupt))]
#[allow(
    clippy::needless_pass_by_value,
    clippy::too_many_arguments,
    clippy::type_complexity
)]
pub fn price_options<'py>(
    py: Python<'py>,
    is_put: PyReadonlyArray1<'py, bool>,
    spot: PyReadonlyArray1<'py, f64>,
    strike: PyReadonlyArray1<'py, f64>,
    expiry: PyReadonlyArray1<'py, f64>,
    rate: PyReadonlyArray1<'py, f64>,
    dividend_yield: PyReadonlyArray1<'py, f64>,
    volatility: PyReadonlyArray1<'py, f64>,
    tolerance: PyReadonlyArray1<'py, f64>,
    greeks: u8,
    shared: bool,
    threads: usize,
    interrupt: Option<Py<PyAny>>,
) -> PyResult<(
    Bound<'py, PyDict>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<i64>>,
)> {
    let is_put = numbers(&is_put);
    let columns = [
        &spot,
        &strike,
        &expiry,
        &rate,
        &dividend_yield,
        &volatility,
        &tolerance,
    ]
    .map(numbers);
    check_lengths(is_put.len(), &columns.each_ref().map(|column| column.len()))?;
    let [spot, strike, expiry, rate, dividend_yield, volatility, tolerance] = &columns;
    let greeks = match greeks {
        0 => Greeks::None,
        1 => Greeks::Standard,
        2 => Greeks::Extended,
        _ => return Err(PyValueError::new_err("greeks must be 0, 1 or 2")),
    };
    let options = Options {
        is_put: &is_put,
        spot,
        strike,
        expiry,
        rate,
        dividend_yield,
        volatility,
        tolerance,
    };
    let question = Question::new(interrupt);
    let found = py.detach(|| {
        premium_march::price_options(options, greeks, shared, threads, &|| question.is_ended())
    });
    question.result()?;
    let by_name = PyDict::new(py);
    for (name, column) in found.columns {
        by_name.set_item(name, PyArray1::from_vec(py, column))?;
    }
    Ok((
        by_name,
        PyArray1::from_vec(py, found.exercised),
        PyArray1::from_vec(py, found.settled),
        PyArray1::from_vec(py, found.steps),
    ))
}

/// Return ln(S*/K) now and whether it was found, each (n,), of American puts from one march with `steps` time steps each.
///
/// `rate` is r T, `dividend` q T, `spread` sigma sqrt(T), each (n,). `interrupt` is that of `solve_puts`.
#[pyfunction]
#[pyo3(signature = (steps, rate, dividend, spread, interrupt))]
#[allow(clippy::needless_pass_by_value, clippy::type_complexity)]
pub fn march_boundaries<'py>(
    py: Python<'py>,
    steps: usize,
    rate: PyReadonlyArray1<'py, f64>,
    dividend: PyReadonlyArray1<'py, f64>,
    spread: PyReadonlyArray1<'py, f64>,
    interrupt: Option<Py<PyAny>>,
) -> PyResult<(Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>)> {
    let (rate, dividend, spread) = (numbers(&rate), numbers(&dividend), numbers(&spread));
    check_lengths(rate.len(), &[dividend.len(), spread.len()])?;
    let level = level(steps)?;
    let question = Question::new(interrupt);
    let puts = Puts {
        rate: &rate,
        dividend: &dividend,
        spread: &spread,
        first: &[],
        x: &[],
        tolerance: &[],
        limits: None,
        spread_step: None,
        levels: (level, level),
        interrupt: &|| question.is_ended(),
    };
    let (boundary, settled) = py.detach(|| premium_march::march_boundaries(puts, level));
    question.result()?;
    Ok((
        PyArray1::from_vec(py, boundary),
        PyArray1::from_vec(py, settled),
    ))
}
