//! Many schedules, each by itself, on several threads.

use super::boundary_query::BoundaryQuery;
use super::close_events::Merged;
use super::gradient::{FUNCTIONALS, PARAMETERS};
use super::schedule::Schedule;
use super::segment::{Dynamics, Segment};
use super::solution::{solve_schedule, ERROR, RESULTS};
use crate::interrupt::Interrupt;

/// The number of numbers of a segment: duration (years), rate, yield, volatility, exercisable, exercise at the end (0 or
/// 1), fraction, amount and escrow (strikes).
pub const COLUMNS: usize = 9;

/// What is to be solved: n schedules with m segments and t wanted times in all.
#[derive(Clone, Copy)]
pub struct Schedules<'a> {
    /// 1 for a put, -1 for a call, (n,).
    pub sign: &'a [f64],
    /// ln(S/K) now, (n,).
    pub x: &'a [f64],
    /// The first segment of each schedule, and the number of segments, (n + 1,).
    pub first: &'a [usize],
    /// `COLUMNS` numbers for each segment, in the order of time, (m x `COLUMNS`,).
    pub segments: &'a [f64],
    /// How finely the value is held, below `LEVELS`, (n,).
    pub level: &'a [usize],
    /// The largest error estimate of the boundaries, in strikes; 0 for the level's own degree, (n,).
    pub tolerance: &'a [f64],
    /// The step of all volatilities at which values nearby are wanted, for which there must be a walk; 0 for none, (n,).
    pub volatility_step: &'a [f64],
    /// Years from now at which boundaries are wanted, increasing for each schedule, (t,).
    pub times: &'a [f64],
    /// The first time of each schedule, and the number of times, (n + 1,).
    pub first_time: &'a [usize],
    /// How many walks there are for the derivatives by the segments' numbers: 0 for none of them, 2 if it is wanted as well how
    /// far they change with the boundaries' degrees.
    pub walks: usize,
}

/// The derivatives of one functional of one segment after the other, by rate, yield, volatility, amount and escrow, and what exercise on
/// the segment contributes; in strikes.
pub type Gradient = [[f64; PARAMETERS]; FUNCTIONALS];

/// The results of each schedule, the boundaries at the times, and whether they may be used.
pub struct Solved {
    /// `RESULTS` rows of n numbers.
    pub numbers: Vec<f64>,
    /// ln(S*/K) at each of the times, just before what happens then, NaN without one, (t,).
    pub boundary: Vec<f64>,
    /// The derivatives of value and slope by the numbers of each segment, and how far they change with the boundaries' degrees,
    /// (m,); none where they are not wanted, NaN what is not found or not wanted.
    pub gradient: Vec<[Gradient; 2]>,
    /// Whether every boundary was found, (n,); nothing else of a schedule may be used where not.
    pub settled: Vec<bool>,
}

/// Solve every schedule at its level, on at most so many threads; those that an interrupt leaves are not settled.
#[must_use]
pub fn solve_schedules(schedules: Schedules, threads: usize, interrupt: Interrupt) -> Solved {
    let count = schedules.x.len();
    let mut rows = vec![[f64::NAN; RESULTS]; count];
    let mut settled = vec![false; count];
    let mut boundary = vec![f64::NAN; schedules.times.len()];
    let wanted = if schedules.walks > 0 {
        schedules.first[count]
    } else {
        0
    };
    let mut gradient = vec![[[[f64::NAN; PARAMETERS]; FUNCTIONALS]; 2]; wanted];
    let workers = threads.clamp(1, count.max(1));
    let share = count.div_ceil(workers).max(1);
    std::thread::scope(|scope| {
        let mut left = boundary.as_mut_slice();
        let mut segments_left = gradient.as_mut_slice();
        let parts = rows.chunks_mut(share).zip(settled.chunks_mut(share));
        for (part, (rows, settled)) in parts.enumerate() {
            let start = part * share;
            let end = start + rows.len();
            let times = schedules.first_time[end] - schedules.first_time[start];
            let (mine, rest) = std::mem::take(&mut left).split_at_mut(times);
            left = rest;
            let own = schedules.first[end] - schedules.first[start];
            let own = own.min(segments_left.len());
            let (gradient, rest) = std::mem::take(&mut segments_left).split_at_mut(own);
            segments_left = rest;
            let mut output = Output {
                rows,
                settled,
                boundary: mine,
                gradient,
            };
            let mut work = move || solve_rows(schedules, start, &mut output, interrupt);
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
        gradient,
        settled,
    }
}

/// Where the results of some schedules go, as in `Solved`.
struct Output<'a> {
    rows: &'a mut [[f64; RESULTS]],
    settled: &'a mut [bool],
    boundary: &'a mut [f64],
    gradient: &'a mut [[Gradient; 2]],
}

/// Solve the schedules from `start` on.
fn solve_rows(schedules: Schedules, start: usize, output: &mut Output, interrupt: Interrupt) {
    let origin = schedules.first_time[start];
    for k in 0..output.rows.len() {
        let row = start + k;
        let numbers =
            &schedules.segments[COLUMNS * schedules.first[row]..COLUMNS * schedules.first[row + 1]];
        let segments: Vec<Segment> = numbers
            .chunks_exact(COLUMNS)
            .map(|numbers| segment(schedules.sign[row], numbers))
            .collect();
        let wanted = schedules.first_time[row]..schedules.first_time[row + 1];
        let mut query = BoundaryQuery {
            times: &schedules.times[wanted.clone()],
            found: &mut output.boundary[wanted.start - origin..wanted.end - origin],
        };
        let tolerance = schedules.tolerance[row];
        let Ok(merged) = Merged::of(&segments, schedules.x[row], tolerance) else {
            continue;
        };
        let schedule = Schedule {
            segments: &merged.segments,
            x: schedules.x[row],
            level: schedules.level[row],
            tolerance: (tolerance - merged.error).max(0.0),
            volatility_step: schedules.volatility_step[row],
            interrupt,
        };
        let result = &mut output.rows[k];
        let Ok(found) = solve_schedule(&schedule, &mut query, result, schedules.walks) else {
            continue;
        };
        output.settled[k] = true;
        result[ERROR] += merged.error;
        if let Some(found) = found {
            let place = schedules.first[row] - schedules.first[start];
            let own = &mut output.gradient[place..place + segments.len()];
            let by_segment = merged.apart(&segments, &found.by_segment);
            for (out, gradient) in own.iter_mut().zip(&by_segment) {
                out[0] = std::array::from_fn(|functional| gradient.of(functional));
            }
            let others = found.by_segment_otherwise;
            let others = others.map(|others| merged.apart(&segments, &others));
            let others = others.iter().flatten();
            for ((out, gradient), other) in own.iter_mut().zip(&by_segment).zip(others) {
                out[1] = std::array::from_fn(|functional| gradient.distance(other, functional));
            }
        }
    }
}

/// The segment that these numbers state.
fn segment(sign: f64, numbers: &[f64]) -> Segment {
    Segment {
        sign,
        dynamics: Dynamics {
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

#[cfg(test)]
mod tests {
    use super::{solve_schedules, Schedules};
    use crate::interrupt::never;

    /// American put, r = q = 5 %, volatility 25 %, one year, at the money: 9.569445299 per 100 of strike, from an
    /// integral equation (tests/data names the source).
    #[test]
    fn a_flat_put_has_its_known_value() {
        let segment = [1.0, 0.05, 0.05, 0.25, 1.0, 1.0, 0.0, 0.0, 0.0];
        let solved = solve_schedules(
            Schedules {
                sign: &[1.0],
                x: &[0.0],
                first: &[0, 1],
                segments: &segment,
                level: &[5],
                tolerance: &[0.0],
                volatility_step: &[0.0],
                times: &[],
                first_time: &[0, 0],
                walks: 0,
            },
            1,
            &never,
        );
        assert!(solved.settled[0]);
        assert!((solved.numbers[0] - 0.095_694_452_99).abs() < 2e-9);
    }
}
