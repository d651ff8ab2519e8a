//! The function of `pricing_core._kernels` that solves a schedule at one resolution.

use numpy::ndarray::{ArrayView1, Axis};
use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray4,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::{nonempty_group_starts, numbers};
use super::interrupt::Question;
use crate::segment_march::{self, Direction, Part, Schedule, Scheme, Terms};

/// The number of columns of a segment, and of the first of them, which a parameter may change.
const COLUMNS: usize = 8;
const TERMS: usize = 5;

type Swept<'py> = (
    Bound<'py, PyArray1<f64>>,
    f64,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
    f64,
    bool,
    Bound<'py, PyArray2<f64>>,
);

fn terms(row: &ArrayView1<'_, f64>) -> Terms {
    Terms {
        rate: row[0],
        dividend_yield: row[1],
        volatility: row[2],
        amount: row[3],
        escrow: row[4],
    }
}

fn directions_of(
    directions: &PyReadonlyArray4<'_, f64>,
    steps: &[f64],
    segments: usize,
) -> PyResult<Vec<Direction>> {
    if directions.shape() != [steps.len(), segments, 2, TERMS] {
        return Err(PyValueError::new_err(
            "directions must have the shape (P, M, 2, 5), and P steps",
        ));
    }
    let rows = directions.as_array();
    let of = |(rows, step): (numpy::ndarray::ArrayView3<'_, f64>, &f64)| Direction {
        terms: rows
            .axis_iter(Axis(0))
            .map(|pair| [0, 1].map(|side| terms(&pair.row(side))))
            .collect(),
        step: *step,
    };
    Ok(rows.axis_iter(Axis(0)).zip(steps).map(of).collect())
}

/// Solve an option with events by the method of lines on a grid, backward from expiry to now.
///
/// Parameters
/// ----------
/// nodes : (N + 2,) float
///     s = S/K, increasing, at least five.
/// segments : (M, 8) float
///     From now to expiry: rate, yield, volatility per year, amount and escrow at the end in units of the strike, the
///     fraction of the spot paid at the end, whether the holder may exercise throughout, and at the end.
/// times : (T,) float
///     Years before a segment's end, from 0 to its length, for one segment after the other.
/// `first_time` : (M + 1,) int
///     Where a segment's times begin.
/// scheme : int
///     0: implicit Euler; 1: SDIRK2.
/// sign : float
///     1 for a put, -1 for a call.
/// watched : (W,) float
///     Places in s.
/// directions : (P, M, 2, 5) float
///     The first five columns of the segments with more and with less of each of P parameters.
/// steps : (P,) float
///     Half of what the parameters differ by.
/// interrupt : callable or None
///     Asked every few milliseconds whether to stop.
///
/// Returns
/// -------
/// None where interrupted, else values (N + 2,) in units of the strike, the value at s = 0, contact (N,), regions (T - M,
/// 2), regions before events (M, 2), residual, raised, derivatives (P, N + 2)
///     The ends of the exercise region in s, infinite where it reaches the grid's end, (inf, -inf) where it is empty, after
///     every step in the order of the times, and just before every event; the largest natural residual at the end of a
///     step; and whether the diffusion was raised at a watched place.
#[pyfunction]
#[pyo3(signature = (nodes, segments, times, first_time, scheme, sign, watched, directions, steps, interrupt))]
#[allow(clippy::needless_pass_by_value, clippy::too_many_arguments)]
pub fn sweep_schedule<'py>(
    py: Python<'py>,
    nodes: PyReadonlyArray1<'py, f64>,
    segments: PyReadonlyArray2<'py, f64>,
    times: PyReadonlyArray1<'py, f64>,
    first_time: PyReadonlyArray1<'py, i64>,
    scheme: u8,
    sign: f64,
    watched: PyReadonlyArray1<'py, f64>,
    directions: PyReadonlyArray4<'py, f64>,
    steps: PyReadonlyArray1<'py, f64>,
    interrupt: Option<Py<PyAny>>,
) -> PyResult<Option<Swept<'py>>> {
    let scheme = match scheme {
        0 => Scheme::ImplicitEuler,
        1 => Scheme::Sdirk2,
        _ => return Err(PyValueError::new_err("scheme must be 0 or 1")),
    };
    let count = segments.shape()[0];
    if count == 0 || segments.shape()[1] != COLUMNS {
        return Err(PyValueError::new_err(
            "segments must have the shape (M, 8), M > 0",
        ));
    }
    let (nodes, times) = (numbers(&nodes), numbers(&times));
    let (watched, steps) = (numbers(&watched), numbers(&steps));
    let starts = nonempty_group_starts("first_time", &numbers(&first_time), count, times.len())?;
    let directions = directions_of(&directions, &steps, count)?;
    let rows = segments.as_array();
    let part = |(row, span): (ArrayView1<'_, f64>, &[usize])| Part {
        terms: terms(&row),
        fraction: row[5],
        exercisable: row[6] > 0.0,
        exercise_at_end: row[7] > 0.0,
        times: &times[span[0]..span[1]],
    };
    let parts: Vec<Part<'_>> = rows.outer_iter().zip(starts.windows(2)).map(part).collect();
    let schedule = Schedule {
        sign,
        parts: &parts,
        directions: &directions,
    };
    let question = Question::new(interrupt);
    let found = py.detach(|| {
        let interrupt = || question.is_ended();
        segment_march::sweep_schedule(&schedule, &nodes, scheme, &watched, &interrupt)
    })?;
    question.result()?;
    let Some(sweep) = found else {
        return Ok(None);
    };
    let pairs = |pairs: Vec<[f64; 2]>| {
        let shape = [pairs.len(), 2];
        PyArray1::from_vec(py, pairs.into_iter().flatten().collect()).reshape(shape)
    };
    let derivatives: Vec<f64> = sweep.derivatives.into_iter().flatten().collect();
    Ok(Some((
        PyArray1::from_vec(py, sweep.values),
        sweep.at_zero,
        PyArray1::from_vec(py, sweep.contact),
        pairs(sweep.regions.into_iter().flatten().collect())?,
        pairs(sweep.before_events)?,
        sweep.residual,
        sweep.raised,
        PyArray1::from_vec(py, derivatives).reshape([steps.len(), nodes.len()])?,
    )))
}
