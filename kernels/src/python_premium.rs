//! The premium functions of `pricing_core._kernels`.

use std::borrow::Cow;

use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray3, PyUntypedArrayMethods};
use numpy::{PyArray2, PyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::premium::{self, Library, Mesh, Rows, STENCIL, VALUES};

fn slice<'a, T: numpy::Element + Copy>(array: &'a PyReadonlyArray1<'_, T>) -> Cow<'a, [T]> {
    match array.as_slice() {
        Ok(values) => Cow::Borrowed(values),
        Err(_) => Cow::Owned(array.as_array().iter().copied().collect()),
    }
}

/// Refuse what would be read or written out of place.
fn check(mesh: Mesh, rows: Rows, others: &[usize]) -> PyResult<()> {
    let count = rows.rate.len();
    let lengths = [
        rows.dividend.len(),
        rows.spread.len(),
        rows.nodes.len(),
        rows.halvings.len(),
    ];
    if lengths.iter().chain(others).any(|&length| length != count) {
        return Err(PyValueError::new_err("the columns differ in length"));
    }
    if mesh.steps < 2 {
        return Err(PyValueError::new_err(format!(
            "steps is {}: must be at least 2",
            mesh.steps
        )));
    }
    let least = i64::try_from(STENCIL).unwrap_or(i64::MAX);
    if let Some(nodes) = rows
        .nodes
        .iter()
        .find(|&&n| !(least..=1 << 20).contains(&n))
    {
        return Err(PyValueError::new_err(format!(
            "nodes is {nodes}: must be from {least} to 2**20"
        )));
    }
    if let Some(halvings) = rows.halvings.iter().find(|&&n| !(0..=40).contains(&n)) {
        return Err(PyValueError::new_err(format!(
            "halvings is {halvings}: must be from 0 to 40"
        )));
    }
    Ok(())
}

/// Return (values, boundary, settled); see `premium_twin.premium_values`.
#[pyfunction]
#[pyo3(signature = (steps, width, x, rate, dividend, spread, nodes, halvings, tangents, threads))]
#[allow(
    clippy::needless_pass_by_value,
    clippy::too_many_arguments,
    clippy::type_complexity
)]
pub fn premium_values<'py>(
    py: Python<'py>,
    steps: usize,
    width: f64,
    x: PyReadonlyArray1<'py, f64>,
    rate: PyReadonlyArray1<'py, f64>,
    dividend: PyReadonlyArray1<'py, f64>,
    spread: PyReadonlyArray1<'py, f64>,
    nodes: PyReadonlyArray1<'py, i64>,
    halvings: PyReadonlyArray1<'py, i64>,
    tangents: bool,
    threads: usize,
) -> PyResult<(
    Bound<'py, PyArray2<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
)> {
    let (x, rate, dividend, spread) = (slice(&x), slice(&rate), slice(&dividend), slice(&spread));
    let (nodes, halvings) = (slice(&nodes), slice(&halvings));
    let rows = Rows {
        rate: &rate,
        dividend: &dividend,
        spread: &spread,
        nodes: &nodes,
        halvings: &halvings,
    };
    let mesh = Mesh { steps, width };
    check(mesh, rows, &[x.len()])?;
    let found = py.detach(|| premium::premium_values(mesh, &x, rows, tangents, threads));
    Ok((
        PyArray1::from_vec(py, found.values).reshape([x.len(), VALUES])?,
        PyArray1::from_vec(py, found.boundary),
        PyArray1::from_vec(py, found.settled),
    ))
}

/// Return (profiles, frame, boundary, settled); see `premium_twin.premium_march`.
#[pyfunction]
#[pyo3(signature = (steps, width, rate, dividend, spread, nodes, halvings, tangents, threads))]
#[allow(
    clippy::needless_pass_by_value,
    clippy::too_many_arguments,
    clippy::type_complexity
)]
pub fn premium_march<'py>(
    py: Python<'py>,
    steps: usize,
    width: f64,
    rate: PyReadonlyArray1<'py, f64>,
    dividend: PyReadonlyArray1<'py, f64>,
    spread: PyReadonlyArray1<'py, f64>,
    nodes: PyReadonlyArray1<'py, i64>,
    halvings: PyReadonlyArray1<'py, i64>,
    tangents: bool,
    threads: usize,
) -> PyResult<(
    Bound<'py, PyArray3<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<f64>>,
    Bound<'py, PyArray1<bool>>,
)> {
    let (rate, dividend, spread) = (slice(&rate), slice(&dividend), slice(&spread));
    let (nodes, halvings) = (slice(&nodes), slice(&halvings));
    let rows = Rows {
        rate: &rate,
        dividend: &dividend,
        spread: &spread,
        nodes: &nodes,
        halvings: &halvings,
    };
    let mesh = Mesh { steps, width };
    check(mesh, rows, &[])?;
    let found = py.detach(|| premium::premium_march(mesh, rows, tangents, threads));
    let components = if tangents { 4 } else { 1 };
    Ok((
        PyArray1::from_vec(py, found.profiles).reshape([rate.len(), components, found.labels])?,
        PyArray1::from_vec(py, found.frame),
        PyArray1::from_vec(py, found.boundary),
        PyArray1::from_vec(py, found.settled),
    ))
}

/// Return V/K and its derivatives at each x from the profile `row`; see `premium_twin.profile_values`.
#[pyfunction]
#[pyo3(signature = (width, rate, dividend, spread, nodes, halvings, profiles, frame, boundary, row, x))]
#[allow(clippy::needless_pass_by_value, clippy::too_many_arguments)]
pub fn profile_values<'py>(
    py: Python<'py>,
    width: f64,
    rate: PyReadonlyArray1<'py, f64>,
    dividend: PyReadonlyArray1<'py, f64>,
    spread: PyReadonlyArray1<'py, f64>,
    nodes: PyReadonlyArray1<'py, i64>,
    halvings: PyReadonlyArray1<'py, i64>,
    profiles: PyReadonlyArray3<'py, f64>,
    frame: PyReadonlyArray1<'py, f64>,
    boundary: PyReadonlyArray1<'py, f64>,
    row: PyReadonlyArray1<'py, i64>,
    x: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (rate, dividend, spread) = (slice(&rate), slice(&dividend), slice(&spread));
    let (nodes, halvings, row) = (slice(&nodes), slice(&halvings), slice(&row));
    let (frame, boundary, x) = (slice(&frame), slice(&boundary), slice(&x));
    let rows = Rows {
        rate: &rate,
        dividend: &dividend,
        spread: &spread,
        nodes: &nodes,
        halvings: &halvings,
    };
    let mesh = Mesh { steps: 2, width };
    let shape = profiles.shape();
    check(mesh, rows, &[frame.len(), boundary.len(), shape[0]])?;
    let known = i64::try_from(rate.len()).unwrap_or(i64::MAX);
    if row.len() != x.len() || row.iter().any(|r| !(0..known).contains(r)) {
        return Err(PyValueError::new_err(
            "row must hold one index of a profile per x",
        ));
    }
    let labels = i64::try_from(shape[2]).unwrap_or(i64::MAX);
    if !matches!(shape[1], 1 | 4) || nodes.iter().any(|&n| n >= labels) {
        return Err(PyValueError::new_err(
            "profiles must have the shape (rows, 1 or 4, nodes + 1)",
        ));
    }
    let library = Library {
        rows,
        profiles: profiles.as_slice()?,
        components: shape[1],
        labels: shape[2],
        frame: &frame,
        boundary: &boundary,
        width,
    };
    let found = py.detach(|| premium::profile_values(library, &row, &x));
    PyArray1::from_vec(py, found).reshape([x.len(), VALUES])
}
