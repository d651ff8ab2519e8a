//! Many puts to their tolerances, on several threads.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Mutex;

use super::integrand::{EuropeanAt, Parameters};
use super::newton::{Boundaries, BoundaryTangents, MOST_STEPS};
use super::nodes::DEGREES;
use super::put::Put;
use super::spot_value::SpotValue;
use super::start::LatestExercise;
use crate::flat_options::{Puts, Solved, COLUMNS, DERIVATIVES, SECOND, SECOND_COLUMNS, VALUES};
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::vector::Vector;

/// The error of a value as a share of its change from one level to the next; calibrated on random puts.
const CHANGE_SHARE: f64 = 0.5;
/// The same of the change of the derivative by x, times the spread: two values may agree by accident; calibrated.
const SLOPE_SHARE: f64 = 0.2;
/// The smallest error of a value, as a share of the premium: what is left out where the boundaries meet.
const LEFT_OUT: f64 = 2e-8;
/// The step of the difference by the spread, as a share of it; chosen: solutions are exact to rounding.
const SPREAD_STEP: f64 = 2e-4;
/// The step of the differences of the European put, in standard deviations and as a share of the spread; chosen.
const EUROPEAN_STEP: f64 = 0.01;
/// The largest premium that is left out, in tolerances; chosen.
const NEGLIGIBLE: f64 = 0.1;
/// The step of the differences by x, in standard deviations at expiry, and as a share of the distance from the boundary;
/// chosen.
const STEP: f64 = 1e-4;
const STEP_OF_DISTANCE: f64 = 0.25;

/// Find the puts whose exercise region has two boundaries; the others are not settled. See `premium_march::solve_puts`.
#[must_use]
pub fn solve_puts(puts: Puts, threads: usize) -> Solved {
    let solved = Solved::new(&puts);
    let per_spot = solved.per_spot;
    let solved = Mutex::new(solved);
    let next = AtomicUsize::new(0);
    let working = || loop {
        let run = next.fetch_add(1, Ordering::Relaxed);
        if run >= puts.rate.len() || (puts.interrupt)() {
            return;
        }
        let found = dispatch(Run { puts, run });
        if let Ok(mut solved) = solved.lock() {
            for (spot, found) in (puts.first[run]..).zip(found) {
                solved.numbers[spot * per_spot..(spot + 1) * per_spot]
                    .copy_from_slice(&found.numbers[..per_spot]);
                solved.exercised[spot] = found.exercised;
                solved.settled[spot] = found.degree > 0;
                solved.steps[spot] = found.degree;
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads.min(puts.rate.len()) {
            scope.spawn(working);
        }
        working();
    });
    solved
        .into_inner()
        .unwrap_or_else(std::sync::PoisonError::into_inner)
}

/// The spots of one run.
struct Run<'a> {
    puts: Puts<'a>,
    run: usize,
}

/// What is found of one spot; see `Solved`.
#[derive(Clone)]
struct Found {
    numbers: [f64; COLUMNS + SECOND_COLUMNS],
    exercised: bool,
    /// The degree of the value; 0 where there is none.
    degree: i64,
    /// Whether the value meets its tolerance, and whether the derivatives meet theirs.
    valued: bool,
    finished: bool,
    /// The values and the second derivatives of the last level.
    last: Option<([f64; VALUES], [f64; SECOND])>,
}

impl Found {
    /// Leave the European value where no boundaries are found; it lacks at most `premium`, and its derivatives by rate and
    /// dividend at most about `latest`: where that is more than `limit`, the derivatives by the parameters are left out.
    #[inline(always)]
    fn leave_european<V: Vector>(
        &mut self,
        put: &Put,
        x: f64,
        (latest, premium): (f64, f64),
        limit: Option<f64>,
    ) {
        if !x.is_finite() {
            return;
        }
        let spread = put.parameters.spread;
        let at = |x: f64, factor: f64| {
            let mut parameters = put.parameters;
            parameters.spread *= factor;
            V::call(EuropeanAt { parameters, x })
        };
        // Central differences of fourth order.
        let slope = |of: &dyn Fn(f64) -> f64, step: f64| {
            (8.0 * (of(step) - of(-step)) - (of(2.0 * step) - of(-2.0 * step))) / (12.0 * step)
        };
        self.numbers = [0.0; COLUMNS + SECOND_COLUMNS];
        self.numbers[..VALUES].copy_from_slice(&at(x, 1.0));
        self.numbers[VALUES] = premium;
        self.numbers[VALUES + 1] = f64::NAN;
        for j in 0..3 {
            let by_x = slope(&|step| at(x + step * spread, 1.0)[4 + j], EUROPEAN_STEP);
            self.numbers[COLUMNS + j] = by_x / spread;
        }
        let by_spread = slope(&|step| at(x, 1.0 + step)[6], EUROPEAN_STEP);
        self.numbers[COLUMNS + SECOND - 1] = by_spread / spread;
        let by_x = premium / spread;
        self.numbers[VALUES + 2..COLUMNS].copy_from_slice(&[
            by_x,
            by_x / spread,
            latest,
            latest,
            by_x,
        ]);
        self.numbers[COLUMNS + SECOND..].copy_from_slice(&[
            latest / spread,
            latest / spread,
            by_x / spread,
            by_x / spread,
        ]);
        if limit.is_none_or(|limit| latest > limit) {
            self.numbers[4..VALUES].fill(f64::NAN);
            self.numbers[COLUMNS..].fill(f64::NAN);
        }
        self.degree = 1;
    }
}

/// Boundaries of one level, with what Greeks need.
struct Level {
    boundaries: Boundaries,
    tangents: Option<BoundaryTangents>,
    /// The same for a larger and a smaller spread, and the relative step.
    beside: Option<[(Put, Boundaries, BoundaryTangents); 2]>,
}

impl Work for Run<'_> {
    type Result = Vec<Found>;

    #[inline(always)]
    fn run<V: Vector>(self) -> Vec<Found> {
        let (puts, run) = (self.puts, self.run);
        let spots = puts.first[run]..puts.first[run + 1];
        let nothing = Found {
            numbers: [f64::NAN; COLUMNS + SECOND_COLUMNS],
            exercised: false,
            degree: 0,
            valued: false,
            finished: false,
            last: None,
        };
        let mut found = vec![nothing; spots.len()];
        let put = Put {
            parameters: Parameters {
                rate: puts.rate[run],
                dividend: puts.dividend[run],
                spread: puts.spread[run],
            },
        };
        let (mut boundaries, mut european) = (None, None);
        if put.is_served() {
            let latest = V::call(LatestExercise(&put));
            let premium = put.largest_premium(latest);
            european = Some((latest, premium));
            boundaries = put.first_boundaries::<V>(latest);
        }
        while let Some(at) = boundaries {
            let level = self.with_tangents::<V>(&put, at);
            for (spot, found) in spots.clone().zip(&mut found) {
                if !found.finished {
                    self.evaluate::<V>(&put, &level, spot, found);
                }
            }
            let at = level.boundaries;
            if at.level == puts.levels.1
                || found.iter().all(|found| found.finished)
                || (puts.interrupt)()
            {
                break;
            }
            boundaries = put.next_boundaries::<V>(&at);
        }
        if let Some((latest, premium)) = european {
            for (spot, found) in spots.zip(&mut found) {
                if found.degree == 0 && premium <= NEGLIGIBLE * puts.tolerance[spot] {
                    let limits = puts.limits.map(|limits| limits[spot * VALUES + 4]);
                    found.leave_european::<V>(&put, puts.x[spot], (latest, premium), limits);
                }
            }
        }
        found
    }
}

impl Run<'_> {
    /// The boundaries with what the wanted Greeks need, as far as it is found.
    #[inline(always)]
    fn with_tangents<V: Vector>(&self, put: &Put, boundaries: Boundaries) -> Level {
        let mut level = Level {
            boundaries,
            tangents: None,
            beside: None,
        };
        if self.puts.limits.is_some() {
            level.tangents = put.tangents::<V>(&level.boundaries);
        }
        if self.puts.spread_step.is_some() {
            let side = |factor: f64| {
                let mut other = *put;
                other.parameters.spread *= factor;
                let mut boundaries = level.boundaries.clone();
                if !other.settle::<V>(&mut boundaries, MOST_STEPS) {
                    return None;
                }
                let tangents = other.tangents::<V>(&boundaries)?;
                Some((other, boundaries, tangents))
            };
            if let (Some(up), Some(down)) = (side(1.0 + SPREAD_STEP), side(1.0 - SPREAD_STEP)) {
                level.beside = Some([up, down]);
            }
        }
        level
    }

    /// Evaluate a level at a spot, and compare it with the last.
    #[inline(always)]
    fn evaluate<V: Vector>(&self, put: &Put, level: &Level, spot: usize, found: &mut Found) {
        let puts = self.puts;
        let x = puts.x[spot];
        if !x.is_finite() {
            found.finished = true;
            return;
        }
        let (boundaries, tangents) = (&level.boundaries, level.tangents.as_ref());
        let exercised = boundaries.exercised(x);
        let mut values = V::call(SpotValue {
            put,
            boundaries,
            tangents,
            x,
        });
        let premium = values[0] - values[3];
        if exercised {
            let moneyness = x.exp();
            values = [
                -x.exp_m1(),
                -moneyness,
                -moneyness,
                values[3],
                0.0,
                0.0,
                0.0,
            ];
        }
        let seconds = if exercised {
            [0.0; SECOND]
        } else {
            level.seconds::<V>(put, x, boundaries.distance(x))
        };
        if let Some((last, last_seconds)) = found.last {
            let change = |k: usize| values[k] - last[k];
            let slope = SLOPE_SHARE * put.parameters.spread * change(1).abs();
            let error = CHANGE_SHARE * change(0).abs() + slope + LEFT_OUT * premium.abs();
            let numbers = &mut found.numbers;
            if !found.valued {
                numbers[..VALUES].copy_from_slice(&values);
                numbers[VALUES] = error;
                numbers[VALUES + 1] = boundaries.now().map_or(f64::NAN, |(upper, _)| upper);
                found.exercised = exercised;
                found.degree = i64::try_from(DEGREES[boundaries.level]).unwrap_or(i64::MAX);
            }
            // A derivative whose change is not known is left out.
            for (k, derivative) in DERIVATIVES.into_iter().enumerate() {
                let change = change(derivative);
                numbers[derivative] = with_change(values[derivative], change);
                numbers[VALUES + 2 + k] = change;
            }
            for k in 0..SECOND {
                let change = seconds[k] - last_seconds[k];
                numbers[COLUMNS + k] = with_change(seconds[k], change);
                numbers[COLUMNS + SECOND + k] = change;
            }
            found.valued |= error <= puts.tolerance[spot];
            let limits = puts.limits.map(|limits| &limits[spot * VALUES..]);
            let met = limits.is_none_or(|limits| {
                DERIVATIVES
                    .iter()
                    .all(|&k| CHANGE_SHARE * change(k).abs() <= limits[k])
            });
            found.finished = found.valued && met;
        }
        found.last = Some((values, seconds));
    }
}

/// The number, or none where its change is none.
fn with_change(number: f64, change: f64) -> f64 {
    if change.is_nan() {
        f64::NAN
    } else {
        number
    }
}

impl Level {
    /// The derivatives by x and each parameter, and by the spread twice.
    #[inline(always)]
    fn seconds<V: Vector>(&self, put: &Put, x: f64, distance: f64) -> [f64; SECOND] {
        let Some(beside) = &self.beside else {
            return [f64::NAN; SECOND];
        };
        let spread = put.parameters.spread;
        let at = |x: f64| {
            V::call(SpotValue {
                put,
                boundaries: &self.boundaries,
                tangents: self.tangents.as_ref(),
                x,
            })
        };
        let step = (STEP * spread).min(STEP_OF_DISTANCE * distance);
        let (up, down) = (at(x + step), at(x - step));
        let mut found = [0.0; SECOND];
        for j in 0..3 {
            found[j] = (up[4 + j] - down[4 + j]) / (2.0 * step);
        }
        let [up, down] = beside.each_ref().map(|(put, boundaries, tangents)| {
            let values = V::call(SpotValue {
                put,
                boundaries,
                tangents: Some(tangents),
                x,
            });
            (put.parameters.spread, values[6])
        });
        found[SECOND - 1] = (up.1 - down.1) / (up.0 - down.0);
        found
    }
}
