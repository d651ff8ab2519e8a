//! The function of `pricing_core._kernels` that solves schedules, each at one resolution.

use std::borrow::Cow;

use numpy::ndarray::{ArrayView1, ArrayView2, ArrayView3, ArrayView4, Axis};
use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
    PyReadonlyArray4, PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::{group_starts, nonempty_group_starts, numbers};
use super::interrupt::Question;
use crate::error::KernelError;
use crate::segment_march::{self, Direction, Part, Schedule, Scheme, Surface, Sweep, Task, Terms};

/// The number of columns of a segment, and of the first of them, which a parameter may change.
const COLUMNS: usize = 9;
const TERMS: usize = 6;

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

/// Local volatilities on a grid, one or several surfaces with the same times.
struct Surfaces<'a> {
    variances: Cow<'a, [f64]>,
    /// The number of variances of a surface, and of its times.
    whole: usize,
    times: usize,
    weights: Cow<'a, [f64]>,
    /// Where the rows of weights of each segment begin, and the end.
    starts: Vec<usize>,
    reference: f64,
}

impl Surfaces<'_> {
    fn of(&self, surface: f64, segment: usize) -> Option<Surface<'_>> {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let first = surface as usize * self.whole; // a small whole number
        let (start, end) = (self.starts[segment], self.starts[segment + 1]);
        let variances = self.variances.get(first..first + self.whole)?;
        (end > start).then(|| Surface {
            variances,
            times: self.times,
            weights: &self.weights[start * self.times..end * self.times],
            reference: self.reference,
        })
    }
}

fn terms<'a>(row: &ArrayView1<'_, f64>, surfaces: &'a Surfaces<'_>, segment: usize) -> Terms<'a> {
    Terms {
        rate: row[0],
        dividend_yield: row[1],
        volatility: row[2],
        amount: row[3],
        escrow: row[4],
        surface: surfaces.of(row[5], segment),
    }
}

/// What is asked of one sweep: nodes, segments, times, `first_time`, scheme, sign, watched, directions, steps,
/// variances, weights, `first_row`, reference.
type Request<'py> = (
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray1<'py, i64>,
    u8,
    f64,
    PyReadonlyArray1<'py, f64>,
    PyReadonlyArray4<'py, f64>,
    PyReadonlyArray1<'py, f64>,
    Local<'py>,
);

/// The local volatilities of a sweep: variances, weights, `first_row`, reference.
type Local<'py> = (
    PyReadonlyArray3<'py, f64>,
    PyReadonlyArray2<'py, f64>,
    PyReadonlyArray1<'py, i64>,
    f64,
);

fn surfaces_of<'a>(
    local: &'a Local<'_>,
    first_time: &[usize],
    nodes: usize,
) -> PyResult<Surfaces<'a>> {
    let (variances, weights, first_row, reference) = local;
    let ([_, times, size], [rows, columns]) = (variances.shape(), weights.shape()) else {
        return Err(PyValueError::new_err(
            "variances must have three axes, and weights two",
        ));
    };
    let first_row = numbers(first_row);
    let starts = group_starts("first_row", &first_row, first_time.len() - 1, *rows)?;
    let counts = starts.windows(2).zip(first_time.windows(2));
    let fits = |(rows, times): (&[usize], &[usize])| {
        let (rows, steps) = (rows[1] - rows[0], times[1] - times[0] - 1);
        rows <= 1 || rows == steps
    };
    let on_the_grid = *rows == 0 || (size + 2 == nodes && times == columns && *times > 0);
    if !counts.into_iter().all(fits) || !on_the_grid {
        return Err(PyValueError::new_err(
            "weights must have no row, one, or one per step for each segment, of a number per time of the variances, \
             and these one per interior node",
        ));
    }
    Ok(Surfaces {
        variances: numbers(variances),
        whole: times * size,
        times: *times,
        weights: numbers(weights),
        starts,
        reference: *reference,
    })
}

/// A request, checked, its arrays contiguous.
struct Asked<'a> {
    nodes: Cow<'a, [f64]>,
    rows: ArrayView2<'a, f64>,
    times: Cow<'a, [f64]>,
    starts: Vec<usize>,
    scheme: Scheme,
    sign: f64,
    watched: Cow<'a, [f64]>,
    directions: ArrayView4<'a, f64>,
    steps: Cow<'a, [f64]>,
    surfaces: Surfaces<'a>,
}

impl<'a> Asked<'a> {
    fn of(request: &'a Request<'_>) -> PyResult<Self> {
        let (nodes, segments, times, first_time, scheme, sign, watched, ..) = request;
        let (.., directions, steps, local) = request;
        let scheme = match scheme {
            0 => Scheme::ImplicitEuler,
            1 => Scheme::Sdirk2,
            _ => return Err(PyValueError::new_err("scheme must be 0 or 1")),
        };
        let count = segments.shape()[0];
        if count == 0 || segments.shape()[1] != COLUMNS {
            return Err(PyValueError::new_err(
                "segments must have the shape (M, 9), M > 0",
            ));
        }
        let (times, steps) = (numbers(times), numbers(steps));
        if directions.shape() != [steps.len(), count, 2, TERMS] {
            return Err(PyValueError::new_err(
                "directions must have the shape (P, M, 2, 6), and P steps",
            ));
        }
        let starts = nonempty_group_starts("first_time", &numbers(first_time), count, times.len())?;
        let surfaces = surfaces_of(local, &starts, nodes.len())?;
        Ok(Self {
            nodes: numbers(nodes),
            rows: segments.as_array(),
            starts,
            times,
            scheme,
            sign: *sign,
            watched: numbers(watched),
            directions: directions.as_array(),
            steps,
            surfaces,
        })
    }

    fn directions(&self) -> Vec<Direction<'_>> {
        let of = |(rows, step): (ArrayView3<'_, f64>, &f64)| Direction {
            terms: rows
                .axis_iter(Axis(0))
                .enumerate()
                .map(|(segment, pair)| {
                    [0, 1].map(|side| terms(&pair.row(side), &self.surfaces, segment))
                })
                .collect(),
            step: *step,
        };
        let rows = self.directions.axis_iter(Axis(0));
        rows.zip(self.steps.iter()).map(of).collect()
    }

    fn parts(&self) -> Vec<Part<'_>> {
        let part = |(segment, (row, span)): (usize, (ArrayView1<'_, f64>, &[usize]))| Part {
            terms: terms(&row, &self.surfaces, segment),
            fraction: row[6],
            exercisable: row[7] > 0.0,
            exercise_at_end: row[8] > 0.0,
            times: &self.times[span[0]..span[1]],
        };
        let rows = self.rows.outer_iter();
        rows.zip(self.starts.windows(2))
            .enumerate()
            .map(part)
            .collect()
    }
}

fn swept(py: Python<'_>, sweep: Sweep) -> PyResult<Swept<'_>> {
    let pairs = |pairs: Vec<[f64; 2]>| {
        let shape = [pairs.len(), 2];
        PyArray1::from_vec(py, pairs.into_iter().flatten().collect()).reshape(shape)
    };
    let shape = [sweep.derivatives.len(), sweep.values.len()];
    let derivatives: Vec<f64> = sweep.derivatives.into_iter().flatten().collect();
    Ok((
        PyArray1::from_vec(py, sweep.values),
        sweep.at_zero,
        PyArray1::from_vec(py, sweep.contact),
        pairs(sweep.regions.into_iter().flatten().collect())?,
        pairs(sweep.before_events)?,
        sweep.residual,
        sweep.raised,
        PyArray1::from_vec(py, derivatives).reshape(shape)?,
    ))
}

/// Solve options with events by the method of lines, each on a grid, backward from expiry to now, many side by side.
///
/// Parameters
/// ----------
/// requests : list of tuple
///     For each option:
///     nodes (N + 2,) float, s = S/K, increasing, at least five;
///     segments (M, 9) float, from now to expiry: rate, yield, volatility per year, amount and escrow at the end in units
///     of the strike, the number of a surface, the fraction of the spot paid at the end, whether the holder may exercise throughout, and at the
///     end;
///     times (T,) float, years before a segment's end, from 0 to its length, for one segment after the other;
///     `first_time` (M + 1,) int, where a segment's times begin;
///     scheme, 0: implicit Euler, 1: SDIRK2;
///     sign, 1 for a put, -1 for a call;
///     watched (W,) float, places in s;
///     directions (P, M, 2, 6) float, the first six columns of the segments with more and with less of each of P
///     parameters;
///     steps (P,) float, half of what the parameters differ by;
///     variances (S, m, N) float, weights (R, m) float, `first_row` (M + 1,) int, reference, a tuple of these: the local
///     variances at the interior nodes and at the m times of each of S surfaces; what each time counts for, no row for a
///     segment, one, or one for each of its steps; where a segment's rows begin; the volatility exceeds the segment's by
///     the root of the weighted variance less the reference.
/// interrupt : callable or None
///     Asked every few milliseconds whether to stop.
///
/// Returns
/// -------
/// None where interrupted, else a list with one entry for each option: None where a pivot is zero, else values (N + 2,) in
/// units of the strike, the value at s = 0, contact (N,), regions (T - M, 2), regions before events (M, 2), residual,
/// raised, derivatives (P, N + 2)
///     The ends of the exercise region in s, infinite where it reaches the grid's end, (inf, -inf) where it is empty, after
///     every step in the order of the times, and just before every event; the largest natural residual at the end of a
///     step; and whether the diffusion was raised at a watched place. An option's numbers do not depend on the others.
#[pyfunction]
#[pyo3(signature = (requests, interrupt))]
#[allow(clippy::needless_pass_by_value)]
pub fn sweep_schedules<'py>(
    py: Python<'py>,
    requests: Vec<Request<'py>>,
    interrupt: Option<Py<PyAny>>,
) -> PyResult<Option<Vec<Option<Swept<'py>>>>> {
    let asked: Vec<Asked<'_>> = requests.iter().map(Asked::of).collect::<PyResult<_>>()?;
    let parts: Vec<Vec<Part<'_>>> = asked.iter().map(Asked::parts).collect();
    let directions: Vec<Vec<Direction<'_>>> = asked.iter().map(Asked::directions).collect();
    let schedules: Vec<Schedule<'_>> = asked
        .iter()
        .zip(&parts)
        .zip(&directions)
        .map(|((asked, parts), directions)| Schedule {
            sign: asked.sign,
            parts,
            directions,
        })
        .collect();
    let task = |(asked, schedule)| {
        let (asked, schedule): (&Asked<'_>, _) = (asked, schedule);
        Task {
            schedule,
            nodes: &asked.nodes,
            scheme: asked.scheme,
            watched: &asked.watched,
        }
    };
    let tasks: Vec<Task<'_>> = asked.iter().zip(&schedules).map(task).collect();
    let question = Question::new(interrupt);
    let found = py.detach(|| segment_march::sweep_schedules(&tasks, &|| question.is_ended()));
    question.result()?;
    let Some(found) = found else {
        return Ok(None);
    };
    let one = |solved: Result<Sweep, KernelError>| match solved {
        Ok(sweep) => swept(py, sweep).map(Some),
        Err(KernelError::ZeroPivot { .. }) => Ok(None),
        Err(error) => Err(error.into()),
    };
    found
        .into_iter()
        .map(one)
        .collect::<PyResult<_>>()
        .map(Some)
}
