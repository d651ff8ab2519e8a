//! The classes and the function of `pricing_core._kernels` that march options with whatever happens to them.

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::{check_lengths, nonempty_group_starts, numbers};
use super::interrupt::Question;
use crate::obstacle_march::{solve, Contract, Found, Segment, Settings};

/// Contracts, n of them with m segments in all, money in strikes.
///
/// Parameters
/// ----------
/// sign, x : (n,) float
///     1 for a put and -1 for a call; ln(S/K) of the spot that diffuses.
/// first : (n + 1,) int
///     Where the segments of each contract begin, from now to expiry, and m.
/// duration, rate, `dividend_yield`, volatility : (m,) float
///     Years; per year; per square root of a year, above 0.
/// exercisable, `exercise_at_end` : (m,) bool
///     Whether the holder may exercise throughout, and at the end before the dividends there.
/// fraction, amount : (m,) float
///     By how much the spot drops at the end.
/// escrow : (m,) float
///     What escrowed dividends still due are worth at the end, before those paid there.
#[pyclass(frozen, module = "pricing_core._kernels")]
pub struct SegmentTable {
    sign: Vec<f64>,
    x: Vec<f64>,
    first: Vec<usize>,
    segments: Vec<Segment>,
}

#[pymethods]
impl SegmentTable {
    #[new]
    #[pyo3(signature = (*, sign, x, first, duration, rate, dividend_yield, volatility, exercisable, exercise_at_end, fraction, amount, escrow))]
    #[allow(clippy::too_many_arguments, clippy::needless_pass_by_value)]
    fn new(
        sign: PyReadonlyArray1<'_, f64>,
        x: PyReadonlyArray1<'_, f64>,
        first: PyReadonlyArray1<'_, i64>,
        duration: PyReadonlyArray1<'_, f64>,
        rate: PyReadonlyArray1<'_, f64>,
        dividend_yield: PyReadonlyArray1<'_, f64>,
        volatility: PyReadonlyArray1<'_, f64>,
        exercisable: PyReadonlyArray1<'_, bool>,
        exercise_at_end: PyReadonlyArray1<'_, bool>,
        fraction: PyReadonlyArray1<'_, f64>,
        amount: PyReadonlyArray1<'_, f64>,
        escrow: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let (sign, x) = (numbers(&sign).into_owned(), numbers(&x).into_owned());
        check_lengths(x.len(), &[sign.len()])?;
        let columns = [
            numbers(&duration),
            numbers(&rate),
            numbers(&dividend_yield),
            numbers(&volatility),
            numbers(&fraction),
            numbers(&amount),
            numbers(&escrow),
        ];
        let (exercisable, at_end) = (numbers(&exercisable), numbers(&exercise_at_end));
        let rows = columns[0].len();
        let lengths: Vec<usize> = columns.iter().map(|column| column.len()).collect();
        check_lengths(
            rows,
            &[&lengths[..], &[exercisable.len(), at_end.len()]].concat(),
        )?;
        let first = nonempty_group_starts("first", &numbers(&first), x.len(), rows)?;
        let segments: Vec<Segment> = (0..rows)
            .map(|k| Segment {
                duration: columns[0][k],
                rate: columns[1][k],
                dividend_yield: columns[2][k],
                volatility: columns[3][k],
                exercisable: exercisable[k],
                exercise_at_end: at_end[k],
                fraction: columns[4][k],
                amount: columns[5][k],
                escrow: columns[6][k],
            })
            .collect();
        if !segments
            .iter()
            .all(|one| one.volatility > 0.0 && one.duration > 0.0)
        {
            return Err(PyValueError::new_err(
                "volatility and duration must be above 0",
            ));
        }
        if !x.iter().all(|x| x.is_finite()) {
            return Err(PyValueError::new_err("x must be finite"));
        }
        Ok(Self {
            sign,
            x,
            first,
            segments,
        })
    }
}

/// The numbers of the march.
///
/// Parameters
/// ----------
/// cells : int
///     The number of the coarsest grid's cells, over its width.
/// width : float
///     Half the width in standard deviations.
/// steps, rounded : float
///     Steps for each standard deviation of a segment and cell; by which they may be more when their number is rounded.
#[pyclass(frozen, module = "pricing_core._kernels")]
pub struct MarchSettings(Settings);

#[pymethods]
impl MarchSettings {
    #[new]
    #[pyo3(signature = (*, cells, width, steps, rounded))]
    fn new(cells: usize, width: f64, steps: f64, rounded: f64) -> Self {
        Self(Settings {
            cells,
            width,
            steps,
            rounded,
        })
    }
}

type Numbers<'py> = (
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<bool>>,
    Bound<'py, PyArray2<i64>>,
);

/// March every contract until the error estimate of its value meets its tolerance, (n,), in strikes.
///
/// Returns numbers (5, n): the value, its first two derivatives by x, its error estimate, and the spot at which exercise
/// begins, not a number without one; flags (3, n): whether the spot is in the exercise region, whether the tolerance is
/// met, and whether all stages were solved; counts (2, n): the cells and the steps of the finest grid. `interrupt`, a
/// function or None, is asked every few milliseconds whether the work shall end; what is not solved then is not a number.
#[pyfunction]
#[pyo3(signature = (table, tolerance, settings, threads, interrupt))]
#[allow(clippy::needless_pass_by_value, clippy::cast_possible_wrap)]
pub fn march_segments<'py>(
    py: Python<'py>,
    table: &SegmentTable,
    tolerance: PyReadonlyArray1<'py, f64>,
    settings: &MarchSettings,
    threads: usize,
    interrupt: Option<Py<PyAny>>,
) -> PyResult<Numbers<'py>> {
    let tolerance = numbers(&tolerance).into_owned();
    check_lengths(table.x.len(), &[tolerance.len()])?;
    let contracts: Vec<Contract> = (0..table.x.len())
        .map(|k| Contract {
            sign: table.sign[k],
            x: table.x[k],
            segments: &table.segments[table.first[k]..table.first[k + 1]],
        })
        .collect();
    let question = Question::new(interrupt);
    let found = py.detach(|| {
        let interrupt = || question.is_ended();
        solve(&contracts, &tolerance, settings.0, threads, &interrupt)
    });
    question.result()?;
    let column = |of: fn(&Found) -> f64| found.iter().map(of).collect::<Vec<f64>>();
    let values = [
        column(|one| one.value),
        column(|one| one.slope),
        column(|one| one.bend),
        column(|one| one.error),
        column(|one| one.boundary),
    ]
    .concat();
    let flag = |of: fn(&Found) -> bool| found.iter().map(of).collect::<Vec<bool>>();
    let flags = [
        flag(|one| one.exercised),
        flag(|one| one.met),
        flag(|one| one.settled),
    ]
    .concat();
    let count = |of: fn(&Found) -> usize| found.iter().map(|one| of(one) as i64).collect();
    let counts: [Vec<i64>; 2] = [count(|one| one.cells), count(|one| one.steps)];
    let n = found.len();
    Ok((
        PyArray1::from_vec(py, values).reshape([5, n])?,
        PyArray1::from_vec(py, flags).reshape([3, n])?,
        PyArray1::from_vec(py, counts.concat()).reshape([2, n])?,
    ))
}
