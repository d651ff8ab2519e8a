//! Values at volatilities next to those of a solved schedule, whose differences give the second derivative by the volatility.
//!
//! They are solved alike: with the cuts of the segments and the degrees of the boundaries that the solution has, and from its
//! boundaries. The value at the same volatility is the solution's own, as the adjoint corrects it. So the errors of the three values
//! are nearly the same, and their second difference is that of the values.

use super::backward_recursion::BackwardRecursion;
use super::boundary_query::BoundaryQuery;
use super::schedule::Schedule;
use super::solved_part::SolvedPart;

/// The largest difference of two moves of a boundary, by equal steps of the volatility down and up, that are alike, as a share of
/// both; chosen: an uneven move is to another solution of the same equations.
const UNEVEN: f64 = 0.08;
/// The difference of two moves that is too small to tell, in x; chosen.
const SMALLEST_MOVE: f64 = 2e-5;

/// The values at volatilities lower by the step, the same and higher, with the cuts and the degrees of a solution, in strikes;
/// None where the three are not alike. `same` is the value of the solution after one more step of Newton's method, which
/// solves the equations as closely as those of the others are.
pub fn values_nearby(schedule: &Schedule, solved: &[SolvedPart], same: f64) -> Option<[f64; 3]> {
    let step = schedule.volatility_step;
    let (lower, lower_ends) = solve_alike_nearby(schedule, -step, solved)?;
    let (higher, higher_ends) = solve_alike_nearby(schedule, step, solved)?;
    let moves_evenly = |ends: &[f64]| {
        let mut all = lower_ends.iter().zip(ends).zip(&higher_ends);
        all.all(|((lower, same), higher)| {
            let (down, up) = (same - lower, higher - same);
            let uneven = (up - down).abs() > UNEVEN * (up.abs() + down.abs()) + SMALLEST_MOVE;
            !uneven // also where there is no end
        })
    };
    let ends: Vec<f64> = solved.iter().map(SolvedPart::relevant_end).collect();
    if moves_evenly(&ends) {
        return Some([lower, same, higher]);
    }
    // The ends of the solution are solved for less closely, which may have been what was uneven.
    let (same, ends) = solve_alike_nearby(schedule, 0.0, solved)?;
    moves_evenly(&ends).then_some([lower, same, higher])
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
