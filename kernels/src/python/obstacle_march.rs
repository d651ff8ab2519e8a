//! The classes and the function of `pricing_core._kernels` that march options with whatever happens to them.

use std::sync::Arc;

use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use super::arguments::{check_lengths, nonempty_group_starts, numbers};
use super::interrupt::Question;
use crate::obstacle_march::{
    solve, BySegment, Changing, Contract, End, Found, Greeks, Local, Segment, Settings, Surface,
    LOCAL,
};

/// A local volatility at nodes: at each time a monotone cubic in ln S, its square linear in time, flat outside.
///
/// Parameters
/// ----------
/// times : (m,) float
///     Years from now, increasing.
/// logs : (k,) float
///     ln of the spots, increasing.
/// values, slopes : (m, k) float
///     The volatilities, and their slopes by ln S.
#[pyclass(frozen, module = "pricing_core._kernels")]
pub struct VolatilitySurface(Arc<Surface>);

#[pymethods]
impl VolatilitySurface {
    #[new]
    #[pyo3(signature = (*, times, logs, values, slopes))]
    #[allow(clippy::needless_pass_by_value)]
    fn new(
        times: PyReadonlyArray1<'_, f64>,
        logs: PyReadonlyArray1<'_, f64>,
        values: PyReadonlyArray2<'_, f64>,
        slopes: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Self> {
        let [times, logs] = [times, logs].map(|axis| numbers(&axis).into_owned());
        let [values, slopes] =
            [values, slopes].map(|of| of.as_array().iter().copied().collect::<Vec<f64>>());
        if times.is_empty() || logs.is_empty() {
            return Err(PyValueError::new_err("a surface has at least one node"));
        }
        check_lengths(times.len() * logs.len(), &[values.len(), slopes.len()])?;
        let increases = |axis: &[f64]| axis.windows(2).all(|pair| pair[0] < pair[1]);
        if !increases(&times) || !increases(&logs) {
            return Err(PyValueError::new_err("times and logs must increase"));
        }
        Ok(Self(Arc::new(Surface {
            times,
            logs,
            values,
            slopes,
        })))
    }
}

/// The local volatility of a contract as it is given: with ln of its strike, and what stands for it in the segments.
type GivenSurface<'py> = (PyRef<'py, VolatilitySurface>, f64, f64);

/// The local volatility of a contract.
struct OwnSurface {
    surface: Arc<Surface>,
    log_strike: f64,
    reference: f64,
}

/// Contracts, n of them with m segments and p spots in all, money in strikes.
///
/// Parameters
/// ----------
/// sign : (n,) float
///     1 for a put and -1 for a call.
/// x : (p,) float
///     ln(S/K) of the spots that diffuse, of which the values are wanted.
/// owner : (p,) int
///     Which contract each of these belongs to; every contract has some.
/// european : (n,) bool
///     Whether the value without early exercise is wanted as well.
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
/// local : list of n (`VolatilitySurface`, float, float) or None, optional
///     The local volatility of each contract, ln of the strike in the money of its spots, and the number that stands for
///     it in the segments: what a segment's volatility exceeds that by is added.
#[pyclass(frozen, module = "pricing_core._kernels")]
pub struct SegmentTable {
    sign: Vec<f64>,
    /// The spots of each contract, and where each stands among all that were given.
    places: Vec<Vec<f64>>,
    given: Vec<Vec<usize>>,
    european: Vec<bool>,
    first: Vec<usize>,
    segments: Vec<Segment>,
    local: Vec<Option<OwnSurface>>,
}

#[pymethods]
impl SegmentTable {
    #[new]
    #[pyo3(signature = (*, sign, x, owner, european, first, duration, rate, dividend_yield, volatility, exercisable, exercise_at_end, fraction, amount, escrow, local=None))]
    #[allow(clippy::too_many_arguments, clippy::needless_pass_by_value)]
    fn new(
        sign: PyReadonlyArray1<'_, f64>,
        x: PyReadonlyArray1<'_, f64>,
        owner: PyReadonlyArray1<'_, i64>,
        european: PyReadonlyArray1<'_, bool>,
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
        local: Option<Vec<Option<GivenSurface<'_>>>>,
    ) -> PyResult<Self> {
        let (sign, x, owner) = (numbers(&sign).into_owned(), numbers(&x), numbers(&owner));
        let european = numbers(&european).into_owned();
        let count = sign.len();
        check_lengths(count, &[european.len()])?;
        check_lengths(x.len(), &[owner.len()])?;
        let (mut places, mut given) = (vec![Vec::new(); count], vec![Vec::new(); count]);
        for (k, (x, owner)) in x.iter().zip(owner.iter()).enumerate() {
            let owner = usize::try_from(*owner).ok().filter(|owner| *owner < count);
            let owner = owner.ok_or_else(|| PyValueError::new_err("there is no such owner"))?;
            places[owner].push(*x);
            given[owner].push(k);
        }
        if places.iter().any(Vec::is_empty) {
            return Err(PyValueError::new_err("every contract needs a spot"));
        }
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
        let first = nonempty_group_starts("first", &numbers(&first), count, rows)?;
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
        let local: Vec<Option<OwnSurface>> = match local {
            None => sign.iter().map(|_| None).collect(),
            Some(each) => each
                .into_iter()
                .map(|one| {
                    one.map(|(surface, log_strike, reference)| OwnSurface {
                        surface: surface.0.clone(),
                        log_strike,
                        reference,
                    })
                })
                .collect(),
        };
        check_lengths(count, &[local.len()])?;
        Ok(Self {
            sign,
            places,
            given,
            european,
            first,
            segments,
            local,
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
/// fewest : float
///     The fewest steps of a segment over the cells.
#[pyclass(frozen, module = "pricing_core._kernels")]
pub struct MarchSettings(Settings);

#[pymethods]
impl MarchSettings {
    #[new]
    #[pyo3(signature = (*, cells, width, steps, rounded, fewest))]
    fn new(cells: usize, width: f64, steps: f64, rounded: f64, fewest: f64) -> Self {
        Self(Settings {
            cells,
            width,
            steps,
            rounded,
            fewest,
        })
    }
}

/// What a march found at n spots, of contracts with m segments in all, money in strikes.
#[pyclass(frozen, module = "pricing_core._kernels")]
pub struct MarchedSegments {
    found: Vec<Found>,
}

impl MarchedSegments {
    fn column<'py, T: numpy::Element>(
        &self,
        py: Python<'py>,
        of: impl Fn(&Found) -> T,
    ) -> Bound<'py, PyArray1<T>> {
        PyArray1::from_vec(py, self.found.iter().map(of).collect())
    }

    fn matrix(
        py: Python<'_>,
        rows: impl Iterator<Item = Changing>,
        width: usize,
        of: fn(&Changing) -> f64,
    ) -> PyResult<Bound<'_, PyArray2<f64>>> {
        let numbers: Vec<f64> = rows.map(|one| of(&one)).collect();
        let length = numbers.len() / width;
        PyArray1::from_vec(py, numbers).reshape([length, width])
    }

    fn locals(&self) -> impl Iterator<Item = Changing> + '_ {
        self.found.iter().flat_map(|one| one.local)
    }

    fn segments(&self) -> impl Iterator<Item = Changing> + '_ {
        self.found
            .iter()
            .flat_map(|one| one.by_segment.iter().flatten().copied())
    }
}

#[pymethods]
impl MarchedSegments {
    /// The value, (n,).
    #[getter]
    fn value<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |one| one.value)
    }

    /// The estimate of the value's error, (n,).
    #[getter]
    fn error<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |one| one.error)
    }

    /// The value without early exercise, not a number where it is not wanted, (n,).
    #[getter]
    fn european<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |one| one.european)
    }

    /// The spot at which exercise begins, not a number without one, (n,).
    #[getter]
    fn boundary<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |one| one.boundary)
    }

    /// The estimate of its error, (n,).
    #[getter]
    fn boundary_error<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |one| one.boundary_error)
    }

    /// Whether the spot is in the exercise region, (n,).
    #[getter]
    fn exercised<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        self.column(py, |one| one.exercised)
    }

    /// Whether all stages of the finest march were solved, (n,).
    #[getter]
    fn settled<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<bool>> {
        self.column(py, |one| one.settled)
    }

    /// The steps of the finest march, (n,).
    #[getter]
    #[allow(clippy::cast_possible_wrap)]
    fn steps<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        self.column(py, |one| one.steps as i64)
    }

    /// How many grids each contract was marched on, (n,).
    #[getter]
    #[allow(clippy::cast_possible_wrap)]
    fn levels<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        self.column(py, |one| one.levels as i64)
    }

    /// Where the contact set of a contract ends over time, on the last grid but one and on the finest: rows of the number
    /// of the segment, the years to its end, ln(S/K) at the end next to the strike and at the other one, and how far the
    /// former may be moved unseen, from expiry to now; not a number where there is none. A row of 0 years is just before what
    /// happens at the segment's end.
    fn ends<'py>(
        &self,
        py: Python<'py>,
        contract: usize,
    ) -> PyResult<Vec<Bound<'py, PyArray2<f64>>>> {
        let Some(found) = self.found.get(contract) else {
            return Err(PyValueError::new_err("there is no such contract"));
        };
        #[allow(clippy::cast_precision_loss)]
        let row = |end: &End| [end.segment as f64, end.years, end.near, end.far, end.unseen];
        let rows = |ends: &Vec<End>| ends.iter().map(row).collect::<Vec<_>>().concat();
        let matrix = |ends| PyArray1::from_vec(py, rows(ends)).reshape([ends.len(), 5]);
        found.ends.iter().map(matrix).collect()
    }

    /// The first two derivatives by x, the rate `V_tau` and its derivative by x, the derivative of the first by a parallel
    /// change of the volatilities, and the second and the first derivative by that, (n, 7).
    #[getter]
    fn local<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        Self::matrix(py, self.locals(), LOCAL, |one| one.value)
    }

    /// By how much these are others on the last two grids, (n, 7).
    #[getter]
    fn local_change<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        Self::matrix(py, self.locals(), LOCAL, |one| one.change)
    }

    /// The derivatives by rate, `dividend_yield`, volatility, fraction, amount and escrow of the segments and by a shift of the
    /// local volatility in ln S, (m, 7), where they are wanted and contracts have one spot each.
    #[getter]
    fn by_segment<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        Self::matrix(py, self.segments(), BySegment::COUNT, |one| one.value)
    }

    /// By how much these are others on the last two grids, (m, 7).
    #[getter]
    fn by_segment_change<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        Self::matrix(py, self.segments(), BySegment::COUNT, |one| one.change)
    }
}

/// March every contract until the error estimates of its values meet their tolerances, (p,), in strikes.
///
/// `greeks` is 0 for none, 1 for the standard ones, 2 for the extended ones. `interrupt`, a function or None, is asked
/// every few milliseconds whether the work shall end; what is not solved then is not a number.
#[pyfunction]
#[pyo3(signature = (table, tolerance, settings, greeks, threads, interrupt))]
#[allow(clippy::needless_pass_by_value)]
pub fn march_segments(
    py: Python<'_>,
    table: &SegmentTable,
    tolerance: PyReadonlyArray1<'_, f64>,
    settings: &MarchSettings,
    greeks: usize,
    threads: usize,
    interrupt: Option<Py<PyAny>>,
) -> PyResult<MarchedSegments> {
    let tolerance = numbers(&tolerance);
    let order: Vec<usize> = table.given.iter().flatten().copied().collect();
    check_lengths(order.len(), &[tolerance.len()])?;
    let tolerance: Vec<f64> = order.iter().map(|k| tolerance[*k]).collect();
    let contracts: Vec<Contract> = (0..table.sign.len())
        .map(|k| {
            let segments = &table.segments[table.first[k]..table.first[k + 1]];
            Contract {
                sign: table.sign[k],
                places: &table.places[k],
                segments,
                mesh: segments,
                european: table.european[k],
                local: table.local[k].as_ref().map(|own| Local {
                    surface: &own.surface,
                    log_strike: own.log_strike,
                    reference: own.reference,
                }),
            }
        })
        .collect();
    let greeks = match greeks {
        0 => Greeks::None,
        1 => Greeks::Standard,
        2 => Greeks::Extended,
        _ => return Err(PyValueError::new_err("greeks must be 0, 1 or 2")),
    };
    let question = Question::new(interrupt);
    let found = py.detach(|| {
        let interrupt = || question.is_ended();
        solve(
            &contracts, &tolerance, settings.0, greeks, threads, &interrupt,
        )
    });
    question.result()?;
    let mut placed: Vec<(usize, Found)> = order.into_iter().zip(found).collect();
    placed.sort_by_key(|(given, _)| *given);
    let found = placed.into_iter().map(|(_, found)| found).collect();
    Ok(MarchedSegments { found })
}
