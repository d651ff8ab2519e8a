//! The solution of one schedule: what the recursion finds, its derivatives, and values next to it.

use super::adjoint::differentiate;
use super::backward_recursion::BackwardRecursion;
use super::boundary_query::BoundaryQuery;
use super::gradient::SegmentGradient;
use super::nearby_values::values_nearby;
use super::schedule::Schedule;
use super::solved_part::SolvedPart;
use super::unsettled::Unsettled;

/// The number of results of a schedule: value, slope and second derivative by x, in strikes; the boundary ln(S*/K) now,
/// NaN without one; the largest violation of complementarity that was seen and the error estimate of the boundaries,
/// both in strikes; and, NaN where they are not wanted or not found, the values at volatilities lower by a step, the same and
/// higher, with boundaries of the same degrees, in strikes.
pub const RESULTS: usize = 9;
/// The place of the error estimate among them.
pub const ERROR: usize = 5;

/// The derivatives of a schedule's value, in strikes.
pub struct Derivatives {
    /// The derivatives of value and slope by the numbers of every segment.
    pub by_segment: Vec<SegmentGradient>,
    /// The same with other degrees of the boundaries; None where only one walk was wanted.
    pub by_segment_otherwise: Option<Vec<SegmentGradient>>,
}

/// The derivatives from the solved parts of a schedule, by one walk or two.
fn derivatives(
    parts: &[SolvedPart],
    schedule: &Schedule,
    walks: usize,
) -> Result<Derivatives, Unsettled> {
    let has_boundary = parts.iter().any(|part| part.value.boundary.is_some());
    let (by_segment, by_segment_otherwise) = if walks > 1 && has_boundary {
        let [own, other] = differentiate(parts, schedule)?;
        (own, Some(other))
    } else {
        let [own] = differentiate(parts, schedule)?;
        let same = (walks > 1).then(|| own.clone());
        (own, same)
    };
    Ok(Derivatives {
        by_segment,
        by_segment_otherwise,
    })
}

/// Fill in the results and the boundaries that are asked for; return the derivatives where they are.
pub fn solve_schedule(
    schedule: &Schedule,
    query: &mut BoundaryQuery,
    result: &mut [f64; RESULTS],
    walks: usize,
) -> Result<Option<Derivatives>, Unsettled> {
    let recursion = BackwardRecursion::run(schedule, None, query)?;
    let now = recursion.later().ok_or(Unsettled)?;
    if now.segment.sign * (schedule.x - now.far) < 0.0 {
        return Err(Unsettled); // the boundary that is reported is the one next to the strike
    }
    let [value, slope, second] = now.value(schedule.x);
    if !(value.is_finite() && slope.is_finite() && second.is_finite()) {
        return Err(Unsettled);
    }
    let derivatives = if walks > 0 {
        derivatives(&recursion.solved, schedule, walks).ok()
    } else {
        None
    };
    let mut nearby = None;
    if let Some(found) = derivatives
        .as_ref()
        .filter(|_| schedule.volatility_step > 0.0)
    {
        let last_step = SegmentGradient::last_step_of_value(&found.by_segment);
        nearby = values_nearby(schedule, &recursion.solved, value + last_step);
    }
    let [lower, same, higher] = nearby.unwrap_or([f64::NAN; 3]);
    *result = [
        value,
        slope,
        second,
        now.boundary_now(),
        recursion.violation,
        recursion.error.total(),
        lower,
        same,
        higher,
    ];
    Ok(derivatives)
}
