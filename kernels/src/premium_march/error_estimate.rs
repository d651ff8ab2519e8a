//! The extrapolant of marches with M, M/2 and M/4 time steps, and its error estimate.

use super::mesh::STEPS;
use super::puts::VALUES;
use super::spot_evaluation::{SpotEvaluation, Spots};
use crate::lanes::vector::{Vector, LANES};

/// The first level whose extrapolant rests on three marches: with fewer steps there is no march with a quarter of them.
pub const COARSEST_CHECKED: usize = 4;
/// The level whose march is compared with a single step of implicit Euler's.
pub const ONE_STEP_CHECKED: usize = 0;

/// The difference of two marches over the error of the finer one; calibrated on random puts.
const GAIN: f64 = 5.5;
/// The same where there is no third march: half the steps are too few for that law; calibrated on random puts.
const LONE_GAIN: f64 = 12.0;
/// The same for ln(S*/K); calibrated on random puts.
const BOUNDARY_GAIN: f64 = 4.0;
/// The same at `ONE_STEP_CHECKED`; calibrated on random puts.
const ONE_STEP_BOUNDARY_GAIN: f64 = 7.0;
/// The share of the difference of M/2 and M/4 steps in the error estimate of ln(S*/K); calibrated on random puts.
const FAR_SHARE_OF_BOUNDARY: f64 = 0.06;
/// The share of the only difference where there is no third march; calibrated on random puts.
const LONE_SHARE_OF_BOUNDARY: f64 = 4.0;
/// The share of the difference of M and M/2 steps in the error estimate; calibrated on random puts.
const NEAR_SHARE: f64 = 0.25;
/// The share of the difference of M/2 and M/4 steps, about six times the other one; calibrated on random puts.
const FAR_SHARE: f64 = 0.05;
/// The share of the only difference where there is no third march; calibrated on random puts.
const LONE_SHARE: f64 = 2.0;
/// The factor on the error estimate of `COARSEST_CHECKED`, where the law of the differences does not hold yet; calibrated
/// on random puts.
const COARSE_FACTOR: f64 = 2.0;
/// The share of the difference of `u_xi` that the error estimate is not less than, in V/K: values of two marches may
/// agree by accident, but hardly their slopes as well; calibrated on random puts.
const SLOPE_SHARE: f64 = 0.4;
/// The same for `COARSEST_CHECKED`; calibrated on random puts.
const COARSE_SLOPE_SHARE: f64 = 0.6;
/// The same for the difference of `u_xixi`, where the slopes agree by accident as well; calibrated on random puts.
const CURVATURE_SHARE: f64 = 0.02;
/// The distance from the boundary from which that holds, in xi; chosen: nearer, the curvature says where the boundary lies.
const AWAY_FROM_BOUNDARY: f64 = 0.5;
/// The share of the premium that may be wrong in its tail where there is no third march; calibrated on random puts, on
/// which two marches with very few steps agree in a part of the tail.
const TAIL_SHARE: f64 = 0.7;
/// The largest error from that, times M^3, as a share of what exercise earns; calibrated on random puts.
const LARGEST_IN_TAIL: f64 = 0.0256;
/// The share of the difference of two marches that estimates the error of a derivative after extrapolation; calibrated
/// on random puts.
const DERIVATIVE_SHARE: f64 = 0.17;
/// The same where the boundary turns sharply near expiry: few steps do not resolve how the parameters move that turn;
/// calibrated on random puts.
const DERIVATIVE_SHARE_AT_TURN: f64 = 1.0;
/// The largest `Spots::cost_at_turn` of such puts; chosen.
const SHARP_TURN: f64 = 2e-3;
/// What marches in single precision may change V/K by; measured on random puts, of which none has half of it.
pub const SINGLE_ROUNDING: f64 = 2e-7;
/// The smallest number of steps from which derivatives do not ask for more; chosen.
const MOST_STEPS_FOR_DERIVATIVES: usize = 96;
/// The smallest number of steps with which a march that loses the boundary is not refined further; chosen.
const STEPS_TO_SETTLE: usize = 96;

/// What the last three marches say, with M (`whole`), M/2 and M/4 steps.
pub struct Comparison<'a, V> {
    pub spots: &'a Spots<V>,
    /// The place of M in `STEPS`.
    pub level: usize,
    pub whole: &'a SpotEvaluation<V>,
    pub half: &'a SpotEvaluation<V>,
    /// Not used below `COARSEST_CHECKED`.
    pub quarter: &'a SpotEvaluation<V>,
}

impl<V: Vector> Comparison<'_, V> {
    /// The evaluation with M steps less that with M/2; `settled` where all marches were.
    #[inline(always)]
    pub fn difference(&self) -> SpotEvaluation<V> {
        let Self {
            whole,
            half,
            quarter,
            ..
        } = self;
        // Loops, for `std::array::from_fn` is not compiled for the instruction set.
        let (mut tangents, mut tangent_slopes) = (whole.tangents, whole.tangent_slopes);
        for j in 0..3 {
            tangents[j] = tangents[j] - half.tangents[j];
            tangent_slopes[j] = tangent_slopes[j] - half.tangent_slopes[j];
        }
        SpotEvaluation {
            tangents,
            tangent_slopes,
            u: whole.u - half.u,
            slope: whole.slope - half.slope,
            curvature: whole.curvature - half.curvature,
            boundary: whole.boundary - half.boundary,
            settled: whole.settled.min(half.settled).min(quarter.settled),
        }
    }

    /// Richardson's extrapolant.
    #[inline(always)]
    pub fn extrapolant(&self, difference: &SpotEvaluation<V>) -> SpotEvaluation<V> {
        let (whole, gain) = (self.whole, self.gain());
        let boundary_gain = if self.level == ONE_STEP_CHECKED {
            ONE_STEP_BOUNDARY_GAIN
        } else {
            BOUNDARY_GAIN
        };
        let (mut tangents, mut tangent_slopes) = (whole.tangents, whole.tangent_slopes);
        for j in 0..3 {
            tangents[j] = extrapolated(tangents[j], difference.tangents[j], gain);
            tangent_slopes[j] = extrapolated(tangent_slopes[j], difference.tangent_slopes[j], gain);
        }
        SpotEvaluation {
            tangents,
            tangent_slopes,
            u: extrapolated(whole.u, difference.u, gain),
            slope: extrapolated(whole.slope, difference.slope, gain),
            curvature: extrapolated(whole.curvature, difference.curvature, gain),
            boundary: extrapolated(whole.boundary, difference.boundary, boundary_gain),
            settled: difference.settled,
        }
    }

    #[inline(always)]
    fn gain(&self) -> f64 {
        if self.level < COARSEST_CHECKED {
            LONE_GAIN
        } else {
            GAIN
        }
    }

    /// The error estimate of the extrapolant, in V/K; `of_values` is the difference of V/K.
    #[inline(always)]
    pub fn error(&self, difference: &SpotEvaluation<V>, of_values: V) -> V {
        let Self {
            spots,
            whole,
            half,
            quarter,
            ..
        } = *self;
        let lone = self.level < COARSEST_CHECKED;
        let coarsest = self.level == COARSEST_CHECKED;
        let slopes = spots.discounted(difference.slope).abs();
        let curvatures = spots.discounted(difference.curvature).abs();
        let depth = whole.boundary - spots.x; // negative where the option is not exercised
        let error = if lone {
            let tail = spots.discounted(whole.u).abs().times(TAIL_SHARE);
            let most = spots.earned().times(self.largest_in_tail());
            let tail = depth.negative(tail.min(most), V::zero());
            of_values.abs().times(LONE_SHARE).max(tail)
        } else {
            let before = spots.discounted(half.u - quarter.u).abs();
            let error = before.times_plus(V::all(FAR_SHARE), of_values.abs().times(NEAR_SHARE));
            error.times(if coarsest { COARSE_FACTOR } else { 1.0 })
        };
        let error = error.max(slopes.times(if coarsest {
            COARSE_SLOPE_SHARE
        } else {
            SLOPE_SHARE
        }));
        let is_away = depth + spots.spread().times(AWAY_FROM_BOUNDARY);
        let error = is_away.negative(error.max(curvatures.times(CURVATURE_SHARE)), error);
        // Just inside the exercise region the value exceeds the payoff if the boundary is as far off as it moved.
        let shortfall = (difference.boundary.abs() - depth).max(V::zero());
        let excess = shortfall * shortfall * spots.half_curvature_at_boundary();
        let error = depth.negative(error, error.max(excess));
        // Beyond the nodes u is taken for zero.
        let mut least = whole.u.abs().min(half.u.abs());
        if !lone {
            least = least.min(quarter.u.abs());
        }
        (-least).negative(error, error.max(spots.premium_bound()))
    }

    /// The error estimate of the extrapolant's ln(S*/K).
    #[inline(always)]
    pub fn boundary_error(&self, difference: &SpotEvaluation<V>) -> V {
        let last = difference.boundary.abs();
        if self.level < COARSEST_CHECKED {
            return last.times(LONE_SHARE_OF_BOUNDARY);
        }
        let before = (self.half.boundary - self.quarter.boundary).abs();
        before.times_plus(V::all(FAR_SHARE_OF_BOUNDARY), last)
    }

    /// `LARGEST_IN_TAIL` over M^3.
    #[inline(always)]
    #[allow(clippy::cast_precision_loss)]
    fn largest_in_tail(&self) -> f64 {
        LARGEST_IN_TAIL / (STEPS[self.level] as f64).powi(3)
    }
}

/// The limit, from the newest march and its difference from the one before.
#[inline(always)]
fn extrapolated<V: Vector>(newest: V, difference: V, gain: f64) -> V {
    newest + difference.times(1.0 / gain)
}

/// Whether the derivatives of one lane are close enough for its limits, or need no more steps.
#[inline(always)]
pub fn derivatives_are_met(
    level: usize,
    limits: Option<&[f64]>,
    differences: &[[f64; LANES]; VALUES],
    cost_at_turn: f64,
    lane: usize,
) -> bool {
    let share = if cost_at_turn < SHARP_TURN {
        DERIVATIVE_SHARE_AT_TURN
    } else {
        DERIVATIVE_SHARE
    };
    let close = |limits: &[f64]| {
        let mut limits = limits.iter().zip(differences);
        limits.all(|(limit, d)| share * d[lane].abs() <= *limit)
    };
    STEPS[level] >= MOST_STEPS_FOR_DERIVATIVES || limits.is_none_or(close)
}

/// Whether a march that loses the boundary at this level is given up.
#[inline(always)]
pub fn is_hopeless(level: usize) -> bool {
    STEPS[level] >= STEPS_TO_SETTLE
}
