//! Schedules from expiry to now, each by itself.

use super::boundary::{solve_boundary, Boundary, Climb, Form, Start, RUNGS};
use super::held::Held;
use super::panels::{Feature, Fineness};
use super::start::Outset;
use super::stretch::{Flow, Stretch};
use super::transfer::{at_expiry, before_event, Transferred};
use super::Unsettled;

/// How finely a schedule is solved; as in `collocation_twin.solve.Level`.
#[derive(Clone, Copy)]
struct Level {
    panel_points: usize,
    kernel: f64,
    feature: f64,
    reach: f64,
}

const fn level(panel_points: usize, kernel: f64, feature: f64, reach: f64) -> Level {
    Level {
        panel_points,
        kernel,
        feature,
        reach,
    }
}

/// The number of levels, and of rungs of a boundary.
pub const LEVELS: usize = RUNGS.len();
const FINENESS: [Level; LEVELS] = [
    level(5, 2.0, 1.5, 4.6),
    level(5, 2.0, 1.4, 4.9),
    level(8, 2.0, 1.3, 5.8),
    level(8, 1.6, 1.1, 6.4),
    level(10, 1.6, 1.1, 6.9),
    level(10, 1.4, 1.0, 7.3),
    level(12, 1.4, 1.0, 7.6),
];
/// Numbers of a stretch.
pub const COLUMNS: usize = 9;
/// Value, slope, second derivative by x; boundary now; residual; error.
pub const RESULTS: usize = 6;
/// Spreads: widest panel where the contact set begins at nodes.
const FINE_KERNEL: f64 = 0.4;
/// Spreads outside the contact set: where value and payoff are compared.
const CHECKED: f64 = 0.5;
/// Strikes, by which holding may be worth less than exercise outside the contact set.
const LARGEST_VIOLATION: f64 = 1e-4;
/// Standard deviations of ln(spot) at a stretch's end within which its contact set matters.
const RELEVANT: f64 = 5.0;
/// Deviations at expiry within which boundaries are looked for: the one now, and any that is asked for.
const BOUNDARY_REACH: f64 = 2.5;
/// Of one stretch.
const MOST_CUTS: usize = 4;
/// Of a stretch: where it is cut whose boundary no degree follows closely enough.
const NEXT_TO_EVENT: f64 = 0.1;
/// Spreads of what is cut off: a wider interval needs too many panels.
const MOST_SPREADS: f64 = 600.0;
/// Where so many rungs in a row fail or bring nothing, a stretch is cut without trying any further one.
const MOST_STALLS: usize = 2;
/// Of a spot that a dividend would take to zero or less.
const LEAST_FORWARD: f64 = 0.1;
/// Of what is left of the tolerance, for one boundary; and of the tolerance, at the least for all of them together.
const SHARE: f64 = 0.5;
const LEAST_SHARE: f64 = 0.2;
const SAME_TIME: f64 = 1e-12;

/// What is to be solved; see `collocation_twin.solve_schedules`.
#[derive(Clone, Copy)]
pub struct Schedules<'a> {
    /// 1 for a put, -1 for a call.
    pub sign: &'a [f64],
    /// ln(S/K) now.
    pub x: &'a [f64],
    /// The first stretch of each schedule, and the number of stretches.
    pub first: &'a [usize],
    /// `COLUMNS` numbers for each stretch.
    pub stretches: &'a [f64],
    /// Below `LEVELS`.
    pub level: &'a [usize],
    /// Strikes, that boundaries may change the value by; 0 for the level's own rung.
    pub tolerance: &'a [f64],
    /// Years from now at which boundaries are wanted.
    pub times: &'a [f64],
    /// The first time of each schedule, and the number of times.
    pub first_time: &'a [usize],
}

/// The results of each schedule, the boundaries at the times, and whether they may be used.
pub struct Solved {
    /// `RESULTS` rows of as many numbers as there are schedules.
    pub numbers: Vec<f64>,
    /// ln(S*/K) at each of the times, NaN without one.
    pub boundary: Vec<f64>,
    /// Whether every boundary was found.
    pub settled: Vec<bool>,
}

/// Solve every schedule at its level, on at most so many threads.
#[must_use]
pub fn solve_schedules(schedules: Schedules, threads: usize) -> Solved {
    let count = schedules.x.len();
    let mut rows = vec![[f64::NAN; RESULTS]; count];
    let mut settled = vec![false; count];
    let mut boundary = vec![f64::NAN; schedules.times.len()];
    let workers = threads.clamp(1, count.max(1));
    let share = count.div_ceil(workers).max(1);
    std::thread::scope(|scope| {
        let mut left = boundary.as_mut_slice();
        let parts = rows.chunks_mut(share).zip(settled.chunks_mut(share));
        for (part, (rows, settled)) in parts.enumerate() {
            let start = part * share;
            let end = start + rows.len();
            let times = schedules.first_time[end] - schedules.first_time[start];
            let (mine, rest) = std::mem::take(&mut left).split_at_mut(times);
            left = rest;
            let mut work = move || solve_rows(schedules, start, rows, settled, mine);
            if workers == 1 {
                work();
            } else {
                scope.spawn(work);
            }
        }
    });
    let mut numbers = vec![f64::NAN; RESULTS * count];
    for (row, results) in rows.iter().enumerate() {
        for (column, number) in results.iter().enumerate() {
            numbers[column * count + row] = *number;
        }
    }
    Solved {
        numbers,
        boundary,
        settled,
    }
}

fn solve_rows(
    schedules: Schedules,
    start: usize,
    rows: &mut [[f64; RESULTS]],
    settled: &mut [bool],
    boundary: &mut [f64],
) {
    let origin = schedules.first_time[start];
    for (k, (result, settled)) in rows.iter_mut().zip(settled).enumerate() {
        let row = start + k;
        let numbers = &schedules.stretches
            [COLUMNS * schedules.first[row]..COLUMNS * schedules.first[row + 1]];
        let parts: Vec<Stretch> = numbers
            .chunks_exact(COLUMNS)
            .map(|numbers| stretch(schedules.sign[row], numbers))
            .collect();
        let wanted = schedules.first_time[row]..schedules.first_time[row + 1];
        let mut query = Query {
            times: &schedules.times[wanted.clone()],
            found: &mut boundary[wanted.start - origin..wanted.end - origin],
        };
        let (level, tolerance) = (schedules.level[row], schedules.tolerance[row]);
        *settled = solve(
            &parts,
            schedules.x[row],
            level,
            tolerance,
            &mut query,
            result,
        )
        .is_ok();
    }
}

fn stretch(sign: f64, numbers: &[f64]) -> Stretch {
    Stretch {
        sign,
        flow: Flow {
            rate: numbers[1],
            dividend: numbers[2],
            volatility: numbers[3],
        },
        duration: numbers[0],
        exercisable: numbers[4] != 0.0,
        exercise_at_end: numbers[5] != 0.0,
        fraction: numbers[6],
        amount: numbers[7],
        escrow: numbers[8],
    }
}

/// Times from now at which the boundary is wanted, and the answers.
struct Query<'a> {
    times: &'a [f64],
    found: &'a mut [f64],
}

/// The variance of ln(spot) and its logarithm at a stretch's end.
#[derive(Clone, Copy)]
struct Forecast {
    variance: f64,
    forward: f64,
}

fn forecast(parts: &[Stretch], x: f64) -> Vec<Forecast> {
    let (mut variance, mut place) = (0.0, x);
    parts
        .iter()
        .map(|part| {
            let flow = &part.flow;
            variance += flow.volatility * flow.volatility * part.duration;
            place += (flow.rate - flow.dividend) * part.duration;
            let here = Forecast {
                variance,
                forward: place,
            };
            let spot = place.exp();
            let left = (spot * (1.0 - part.fraction) - part.amount).max(LEAST_FORWARD * spot);
            place += (left / spot).ln();
            here
        })
        .collect()
}

fn solve(
    parts: &[Stretch],
    x: f64,
    level: usize,
    tolerance: f64,
    query: &mut Query,
    result: &mut [f64; RESULTS],
) -> Result<(), Unsettled> {
    let fine = &FINENESS[level];
    let forecasts = forecast(parts, x);
    let deviation = forecasts.last().map_or(0.0, |f| f.variance).sqrt();
    let exercised = parts
        .iter()
        .any(|part| part.exercisable || part.exercise_at_end);
    let mut held: Option<Held> = None;
    let mut features: Vec<Feature> = Vec::new();
    let mut end: f64 = parts.iter().map(|part| part.duration).sum();
    let (mut residual, mut error) = (0.0_f64, 0.0);
    #[allow(clippy::cast_precision_loss)]
    let least = LEAST_SHARE * tolerance / parts.len() as f64;
    for (part, here) in parts.iter().zip(&forecasts).rev() {
        let mut waiting = vec![*part];
        let mut cuts = 0;
        let (mut centre, mut variance) = (here.forward, here.variance);
        while let Some(part) = waiting.pop() {
            if part.exercisable && part.is_two_sided() {
                return Err(Unsettled);
            }
            let ends = interval(fine, &part, here, deviation, exercised);
            let mut fineness = Fineness {
                spread: part.spread(),
                points: fine.panel_points,
                kernel: fine.kernel,
                feature: fine.feature,
            };
            let transfer = |fineness: &Fineness| match &held {
                None => at_expiry(&part),
                Some(later) => before_event(later, &part, &features, ends, fineness),
            };
            let mut before = transfer(&fineness);
            let asked = if query.times.is_empty() {
                0.0
            } else {
                BOUNDARY_REACH * deviation
            };
            let far = asked.max(RELEVANT * here.variance.sqrt());
            let relevant = relevant(&before, &part, here.forward, far);
            let nodes_only = held.as_ref().is_some_and(|later| later.boundary.is_none());
            if nodes_only && outset(&before, &part, relevant, nodes_only).begins() {
                fineness.kernel = FINE_KERNEL;
                before = transfer(&fineness);
            }
            let (start, split) = outset(&before, &part, relevant, nodes_only).find_start()?;
            if start.is_some() && split > 0.0 && cuts < MOST_CUTS {
                cuts += 1;
                let (earlier, later) = part.parted(split);
                waiting.extend([earlier, later]); // the later one needs panels of its own width
                continue;
            }
            let begins = (
                centre - (part.flow.rate - part.flow.dividend) * part.duration,
                variance - part.spread().powi(2),
            );
            let cut_off = part.spread() * NEXT_TO_EVENT.sqrt();
            let may_cut = cuts < MOST_CUTS && ends.1 - ends.0 <= MOST_SPREADS * cut_off;
            let climb = Climb {
                top: if tolerance > 0.0 { LEVELS - 1 } else { level },
                budget: (tolerance > 0.0)
                    .then(|| least.max(SHARE * ((1.0 - LEAST_SHARE) * tolerance - error))),
                tolerance,
                patience: if cuts < MOST_CUTS {
                    MOST_STALLS
                } else {
                    LEVELS
                },
                centre: begins.0,
                deviation: begins.1.max(0.0).sqrt(),
            };
            let boundary = start.map(|start| find_boundary(&before, &part, start, &climb));
            let is_close = |b: &Boundary| b.is_found() && !b.is_too_rough(&climb);
            if may_cut && !boundary.as_ref().is_none_or(is_close) {
                cuts += 1;
                let (earlier, later) = part.parted(NEXT_TO_EVENT * part.duration);
                waiting.extend([earlier, later]);
                continue;
            }
            (centre, variance) = begins;
            if let Some(boundary) = &boundary {
                residual = residual.max(boundary.violation);
                error += boundary.error;
            }
            let (contact, bends) = (before.contact, std::mem::take(&mut before.features));
            let now = hold(before, part, boundary, fine.panel_points, held.as_ref())?;
            answer(query, end, contact, &now);
            end -= part.duration;
            features = carried(&bends, &now);
            held = Some(now);
        }
    }
    let held = held.ok_or(Unsettled)?;
    let [value, slope, second] = held.value(x);
    *result = [value, slope, second, held.edge(), residual, error];
    if value.is_finite() && slope.is_finite() && second.is_finite() {
        Ok(())
    } else {
        Err(Unsettled)
    }
}

/// The interval of x that matters at a stretch's end: where the spot may be then, and as far as a boundary may be.
fn interval(
    fine: &Level,
    part: &Stretch,
    here: &Forecast,
    deviation: f64,
    exercised: bool,
) -> (f64, f64) {
    let near = fine.reach * here.variance.sqrt();
    if !exercised {
        return (here.forward - near, here.forward + near);
    }
    let far = near + fine.reach.min(BOUNDARY_REACH) * (deviation - here.variance.sqrt());
    let (below, above) = if part.sign > 0.0 {
        (far, near)
    } else {
        (near, far)
    };
    (here.forward.min(0.0) - below, here.forward.max(0.0) + above)
}

/// The boundary; where smooth pasting does not find it, the other equation is tried.
fn find_boundary(before: &Transferred, part: &Stretch, start: Start, climb: &Climb) -> Boundary {
    let found = solve_boundary(&before.profile, part, &start, climb);
    if found.is_found() || !matches!(start.form, Form::Plain | Form::Root) {
        return found;
    }
    let start = Start::shifted(&before.profile, part, start.time, start.place);
    solve_boundary(&before.profile, part, &start, climb)
}

/// The value at the stretch's beginning, where everything is as it should be.
fn hold(
    before: Transferred,
    part: Stretch,
    boundary: Option<Boundary>,
    points: usize,
    later: Option<&Held>,
) -> Result<Held, Unsettled> {
    let mut at_zero = before.at_zero * (-part.flow.rate * part.duration).exp();
    if part.exercisable && part.sign > 0.0 {
        at_zero = at_zero.max(part.strike(part.duration));
    }
    let held = Held {
        profile: before.profile,
        points,
        stretch: part,
        boundary,
        at_zero,
        is_monotone: part.flow.dividend >= 0.0 && later.is_none_or(|later| later.is_monotone),
    };
    if let Some(boundary) = &held.boundary {
        if !boundary.is_found() {
            return Err(Unsettled);
        }
        check_outside(&held, boundary)?;
    }
    Ok(held)
}

fn outset<'a>(
    before: &'a Transferred,
    part: &'a Stretch,
    relevant: f64,
    nodes_only: bool,
) -> Outset<'a> {
    Outset {
        profile: &before.profile,
        stretch: part,
        contact: before.contact,
        relevant,
        features: &before.features,
        nodes_only,
    }
}

/// The x beyond which, on the side of exercise, the contact set does not matter while it begins.
fn relevant(before: &Transferred, part: &Stretch, forward: f64, reach: f64) -> f64 {
    let sign = part.sign;
    let furthest = (sign * forward).min(0.0) - reach;
    let bends = before.features.iter().filter(|f| f.scale <= 0.0);
    let seen = bends.map(|f| sign * f.place).filter(|&x| x > furthest);
    let bend = seen.reduce(f64::min).unwrap_or(0.0);
    sign * furthest.min(bend - RELEVANT * part.spread())
}

/// Refuse what is worth less than exercise outside the contact set: next to it, and where it has left.
fn check_outside(held: &Held, boundary: &Boundary) -> Result<(), Unsettled> {
    let (sign, spread) = (held.stretch.sign, held.stretch.spread());
    let mut places = vec![boundary.last + sign * CHECKED * spread];
    if sign * (boundary.start.place - boundary.last) > spread {
        places.extend([
            0.5 * (boundary.start.place + boundary.last),
            boundary.start.place,
        ]);
    }
    for x in places {
        if held.continued(x)[0] - sign * (held.strike() - x.exp()) < -LARGEST_VIOLATION {
            return Err(Unsettled);
        }
    }
    Ok(())
}

/// The features at the stretch's beginning: moved by the drift and smoothed.
fn carried(features: &[Feature], held: &Held) -> Vec<Feature> {
    let (spread, shift) = (
        held.stretch.spread(),
        held.stretch.flow.drift() * held.stretch.duration,
    );
    let mut carried: Vec<Feature> = features
        .iter()
        .map(|f| Feature {
            place: f.place - shift,
            scale: f.scale.hypot(spread),
        })
        .collect();
    if held.boundary.is_some() {
        carried.push(Feature {
            place: held.edge(),
            scale: 0.0,
        });
    }
    carried
}

/// Fill in the boundaries at the times that fall on the stretch's end, or inside and on its beginning.
fn answer(query: &mut Query, end: f64, contact: f64, held: &Held) {
    let duration = held.stretch.duration;
    for (time, found) in query.times.iter().zip(query.found.iter_mut()) {
        if (time - end).abs() <= SAME_TIME * end.max(1.0) {
            *found = if contact.is_finite() {
                contact
            } else {
                f64::NAN
            };
        } else if end - duration - SAME_TIME <= *time && *time < end {
            if let Some(boundary) = &held.boundary {
                *found = boundary.at(&held.profile, (end - time).min(duration));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{solve_schedules, Schedules};

    /// American put, r = q = 5 %, volatility 25 %, one year, at the money: 9.569445299 per 100 of strike, from an
    /// integral equation (tests/data names the source).
    #[test]
    fn a_flat_put_has_its_known_value() {
        let stretch = [1.0, 0.05, 0.05, 0.25, 1.0, 1.0, 0.0, 0.0, 0.0];
        let solved = solve_schedules(
            Schedules {
                sign: &[1.0],
                x: &[0.0],
                first: &[0, 1],
                stretches: &stretch,
                level: &[5],
                tolerance: &[0.0],
                times: &[],
                first_time: &[0, 0],
            },
            1,
        );
        assert!(solved.settled[0]);
        assert!((solved.numbers[0] - 0.095_694_452_99).abs() < 2e-9);
    }
}
