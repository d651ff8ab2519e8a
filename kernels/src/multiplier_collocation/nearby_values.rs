//! Values at volatilities next to those of a solved schedule, whose differences give the second derivative by the volatility.
//!
//! They are solved alike: with the cuts of the segments and the degrees of the boundaries that the solution has, and from its
//! boundaries. So the errors of the three values are nearly the same, and their second difference is that of the values.

use super::backward_recursion::BackwardRecursion;
use super::boundary_query::BoundaryQuery;
use super::schedule::Schedule;
use super::solved_part::SolvedPart;

/// The largest difference of two moves of a boundary, by equal steps of the volatility down and up, that are alike, as a share of
/// both; chosen.
const UNEVEN: f64 = 0.08;
/// The difference of two moves that is too small to tell, in x; chosen.
const SMALLEST_MOVE: f64 = 2e-5;

/// The values at volatilities lower by the step, the same and higher, with the cuts and the degrees of a solution, in strikes;
/// NaN where they are not wanted, or where the three are not alike.
pub fn values_nearby(schedule: &Schedule, solved: &[SolvedPart]) -> [f64; 3] {
    let step = schedule.volatility_step;
    if step <= 0.0 {
        return [f64::NAN; 3];
    }
    let mut values = [f64::NAN; 3];
    let mut ends: [Vec<f64>; 3] = Default::default();
    for (k, more) in [-step, 0.0, step].into_iter().enumerate() {
        let Some(found) = solve_alike_nearby(schedule, more, solved) else {
            return [f64::NAN; 3];
        };
        (values[k], ends[k]) = found;
    }
    let [lower, same, higher] = &ends;
    let mut moves = lower.iter().zip(same).zip(higher);
    let leaps = |((lower, same), higher): ((&f64, &f64), &f64)| {
        let (down, up) = (same - lower, higher - same);
        (up - down).abs() > UNEVEN * (up.abs() + down.abs()) + SMALLEST_MOVE
    };
    if moves.any(leaps) {
        return [f64::NAN; 3]; // another solution of the same equations
    }
    values
}

/// The value where every volatility is larger by some amount, with the cuts and the degrees of a solution, in strikes, and the
/// relevant ends of the contact sets; None where it is not found that way.
fn solve_alike_nearby(
    schedule: &Schedule,
    more: f64,
    solved: &[SolvedPart],
) -> Option<(f64, Vec<f64>)> {
    let mut segments = schedule.segments.to_vec();
    for segment in &mut segments {
        segment.dynamics.volatility += more;
    }
    let moved = Schedule {
        segments: &segments,
        ..*schedule
    };
    let mut nothing = BoundaryQuery {
        times: &[],
        found: &mut [],
    };
    let found = BackwardRecursion::run(&moved, Some(solved), &mut nothing).ok()?;
    let ends = found.solved.iter().map(SolvedPart::relevant_end);
    let now = found.later()?;
    Some((now.value(schedule.x)[0], ends.collect()))
}
