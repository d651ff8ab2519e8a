//! The function of `pricing_core._kernels` that marches over a segment.

use numpy::ndarray::s;
use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadonlyArray3,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::numbers;
use crate::segment_march::{self, Scheme, Segment, Tangent};

type Marched<'py> = (
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
    Bound<'py, PyArray1<f64>>,
    f64,
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray2<f64>>,
);

/// The parameters' derivatives at the segment's end.
fn tangents_of(
    values: &PyReadonlyArray2<'_, f64>,
    operators: &PyReadonlyArray3<'_, f64>,
    changes: &PyReadonlyArray2<'_, f64>,
    lines: &PyReadonlyArray3<'_, f64>,
) -> PyResult<Vec<Tangent>> {
    let (values, operators) = (values.as_array(), operators.as_array());
    let (changes, lines) = (changes.as_array(), lines.as_array());
    let count = values.shape()[0];
    let shapes = [
        (&operators.shape()[..2], [count, 3]),
        (changes.shape(), [count, 3]),
        (&lines.shape()[..2], [count, 2]),
        (&lines.shape()[1..], [2, 2]),
    ];
    if shapes.iter().any(|(found, wanted)| found != wanted) {
        return Err(PyValueError::new_err(
            "the tangents' arrays do not belong together",
        ));
    }
    let tangent = |p: usize| Tangent {
        values: values.row(p).to_vec(),
        lower: operators.slice(s![p, 0, ..]).to_vec(),
        diagonal: operators.slice(s![p, 1, ..]).to_vec(),
        upper: operators.slice(s![p, 2, ..]).to_vec(),
        rate: changes[[p, 0]],
        dividend_yield: changes[[p, 1]],
        escrow: changes[[p, 2]],
        lines: [0, 1].map(|end| [0, 1].map(|k| lines[[p, end, k]])),
    };
    Ok((0..count).map(tangent).collect())
}

/// (a, b) of the lines at the two ends.
fn ends(lines: &PyReadonlyArray2<'_, f64>) -> PyResult<[[f64; 2]; 2]> {
    let lines = lines.as_array();
    if lines.shape() != [2, 2] {
        return Err(PyValueError::new_err("lines must have the shape (2, 2)"));
    }
    Ok([
        [lines[[0, 0]], lines[[0, 1]]],
        [lines[[1, 0]], lines[[1, 1]]],
    ])
}

/// March the value of an option backward in time over one segment of a schedule.
///
/// Parameters
/// ----------
/// nodes : (N + 2,) float
///     s = S/K, increasing.
/// lower, diagonal, upper : (N,) float
///     L at the interior nodes, per year; the first row reads the lower end node, the last the upper one.
/// values : (N + 2,) float
///     v, in units of the strike, at the first of the times.
/// contact : (N,) bool
///     A guess of the contact set after the first stage.
/// times : (M + 1,) float
///     Years before the segment's end, increasing; a step leads from each to the next.
/// scheme : int
///     0: implicit Euler; 1: SDIRK2.
/// sign : float
///     1 for a put, -1 for a call.
/// escrow : float
///     A at the segment's end, in units of the strike.
/// rate, `dividend_yield` : float
///     Continuously compounded, per year.
/// exercisable : bool
/// lines : (2, 2) float
///     (a, b) of the line a + b s at the lower and the upper end, at the segment's end.
/// `contact_at_left`, `contact_at_right` : bool
///     Whether the end of the grid lies in the exercise region.
/// tangents : (P, N + 2) float
///     v's derivatives by P parameters, at the first of the times.
/// `tangent_operators` : (P, 3, N) float
///     Those of lower, diagonal and upper.
/// `tangent_changes` : (P, 3) float
///     Those of rate, `dividend_yield` and escrow.
/// `tangent_lines` : (P, 2, 2) float
///     Those of lines.
///
/// Returns
/// -------
/// values (N + 2,), slack (N,), contact (N,), multiplier (N,) per year, residual, regions (M, 2), tangents (P, N + 2)
///     The state at the last of the times (slack and multiplier are 0 where not exercisable), the largest
///     natural residual at the end of a step, and the ends of the exercise region in s after each step,
///     infinite where it reaches the grid's end, (inf, -inf) where it is empty.
#[pyfunction]
#[pyo3(signature = (nodes, lower, diagonal, upper, values, contact, times, scheme, sign, escrow, rate, dividend_yield, exercisable, lines, contact_at_left, contact_at_right, tangents, tangent_operators, tangent_changes, tangent_lines))]
#[allow(
    clippy::fn_params_excessive_bools,
    clippy::needless_pass_by_value,
    clippy::too_many_arguments
)]
pub fn march_segment<'py>(
    py: Python<'py>,
    nodes: PyReadonlyArray1<'py, f64>,
    lower: PyReadonlyArray1<'py, f64>,
    diagonal: PyReadonlyArray1<'py, f64>,
    upper: PyReadonlyArray1<'py, f64>,
    values: PyReadonlyArray1<'py, f64>,
    contact: PyReadonlyArray1<'py, bool>,
    times: PyReadonlyArray1<'py, f64>,
    scheme: u8,
    sign: f64,
    escrow: f64,
    rate: f64,
    dividend_yield: f64,
    exercisable: bool,
    lines: PyReadonlyArray2<'py, f64>,
    contact_at_left: bool,
    contact_at_right: bool,
    tangents: PyReadonlyArray2<'py, f64>,
    tangent_operators: PyReadonlyArray3<'py, f64>,
    tangent_changes: PyReadonlyArray2<'py, f64>,
    tangent_lines: PyReadonlyArray3<'py, f64>,
) -> PyResult<Marched<'py>> {
    let scheme = match scheme {
        0 => Scheme::ImplicitEuler,
        1 => Scheme::Sdirk2,
        _ => return Err(PyValueError::new_err("scheme must be 0 or 1")),
    };
    let (nodes, diagonal) = (numbers(&nodes), numbers(&diagonal));
    let (lower, upper) = (numbers(&lower), numbers(&upper));
    let (values, contact, times) = (numbers(&values), numbers(&contact), numbers(&times));
    let segment = Segment {
        nodes: &nodes,
        lower: &lower,
        diagonal: &diagonal,
        upper: &upper,
        sign,
        escrow,
        rate,
        dividend_yield,
        exercisable,
        lines: ends(&lines)?,
        contact_at: [contact_at_left, contact_at_right],
    };
    let tangents = tangents_of(
        &tangents,
        &tangent_operators,
        &tangent_changes,
        &tangent_lines,
    )?;
    let found = py.detach(|| {
        segment_march::march_segment(&segment, &times, scheme, &values, &contact, &tangents)
    })?;
    let following = (found.tangents.len(), nodes.len());
    let tangents = found.tangents.into_iter().flatten().collect();
    let steps = found.regions.len();
    let regions = found.regions.into_iter().flatten().collect();
    Ok((
        PyArray1::from_vec(py, found.values),
        PyArray1::from_vec(py, found.slack),
        PyArray1::from_vec(py, found.contact),
        PyArray1::from_vec(py, found.multiplier),
        found.residual,
        PyArray1::from_vec(py, regions).reshape([steps, 2])?,
        PyArray1::from_vec(py, tangents).reshape(following)?,
    ))
}
