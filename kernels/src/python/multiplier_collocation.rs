//! The functions of `pricing_core._kernels` that price options with events.

use numpy::{
    PyArray1, PyArray2, PyArray4, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::{check_lengths, group_starts, nonempty_group_starts, numbers};
use super::interrupt::Question;
use crate::multiplier_collocation::{
    self, Schedules, COLUMNS, FUNCTIONALS, LEVELS, PARAMETERS, RESULTS,
};

/// Solve American, Bermudan and European options with events, each a schedule of segments, at their levels.
///
/// By schedule, each (n,): `sign`, 1 for a put and -1 for a call, `x` = ln(S/K) now, `level` of fineness, `tolerance` of
/// the boundaries' error estimate in strikes, or 0 for the level's own degree, `volatility_step` of all volatilities at which
/// values nearby are wanted, which takes a walk, or 0. `segments`, (m, 9): duration in years, rate, yield, volatility,
/// exercisable, exercise at the end, fraction, amount, escrow, money in strikes, in the order of time;
/// `first`, (n + 1,), has the first segment of each schedule and m. `times`, (t,), are years from now at which boundaries
/// are wanted, increasing for each schedule; `first_time`, (n + 1,), has the first time of each schedule and t.
///
/// Returns numbers, (9, n): value in strikes, its first and second derivative by x, ln(S*/K) now (NaN without one), the
/// largest violation of complementarity seen and the error estimate of the boundaries, both in strikes, and the values at
/// volatilities lower by the step, the same and higher, with boundaries of the same degrees (NaN without a step); ln(S*/K) at the
/// times, (t,); settled, (n,); and the derivatives of value and slope by rate, yield,
/// volatility, amount and escrow of each segment, and what exercise on it contributes, with their changes from one degree of
/// the boundaries to another, (m, 2, 2, 6). With 0 `walks` these are NaN and (0, 2, 2, 6), with 1 the changes are NaN.
/// Nothing of a schedule that is not settled may be used. `interrupt`, a function or None, is asked every few milliseconds
/// whether the work shall end; what is not solved then is not settled.
#[pyfunction]
#[pyo3(signature = (sign, x, first, segments, level, tolerance, volatility_step, times, first_time, walks, threads, interrupt))]
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
    segments: PyReadonlyArray2<'py, f64>,
    level: PyReadonlyArray1<'py, i64>,
    tolerance: PyReadonlyArray1<'py, f64>,
    volatility_step: PyReadonlyArray1<'py, f64>,
    times: PyReadonlyArray1<'py, f64>,
    first_time: PyReadonlyArray1<'py, i64>,
    walks: usize,
    threads: usize,
    interrupt: Option<Py<PyAny>>,
) -> PyResult<(
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray4<f64>>,
)> {
    let (sign, x, times) = (numbers(&sign), numbers(&x), numbers(&times));
    let (tolerance, volatility_step) = (numbers(&tolerance), numbers(&volatility_step));
    let lengths = [
        sign.len(),
        level.len(),
        tolerance.len(),
        volatility_step.len(),
    ];
    check_lengths(x.len(), &lengths)?;
    let [rows, columns] = [segments.shape()[0], segments.shape()[1]];
    if columns != COLUMNS {
        let told = format!("segments has {columns} columns: must be {COLUMNS}");
        return Err(PyValueError::new_err(told));
    }
    let segments = numbers(&segments);
    let first = nonempty_group_starts("first", &numbers(&first), x.len(), rows)?;
    let first_time = group_starts("first_time", &numbers(&first_time), x.len(), times.len())?;
    let level: Vec<usize> = numbers(&level)
        .iter()
        .map(|&l| usize::try_from(l).ok().filter(|&l| l < LEVELS))
        .collect::<Option<_>>()
        .ok_or_else(|| PyValueError::new_err(format!("level must be from 0 to {}", LEVELS - 1)))?;
    let schedules = Schedules {
        sign: &sign,
        x: &x,
        first: &first,
        segments: &segments,
        level: &level,
        tolerance: &tolerance,
        volatility_step: &volatility_step,
        times: &times,
        first_time: &first_time,
        walks,
    };
    let question = Question::new(interrupt);
    let solved = py.detach(|| {
        let interrupt = || question.is_ended();
        multiplier_collocation::solve_schedules(schedules, threads, &interrupt)
    });
    question.result()?;
    let count = solved.gradient.len();
    let gradient = solved.gradient.as_flattened().as_flattened().as_flattened();
    Ok((
        PyArray1::from_vec(py, solved.numbers).reshape([RESULTS, x.len()])?,
        PyArray1::from_vec(py, solved.boundary),
        PyArray1::from_vec(py, solved.settled),
        PyArray1::from_slice(py, gradient).reshape([count, 2, FUNCTIONALS, PARAMETERS])?,
    ))
}
