//! Where implicit Euler's first step from u = 0 puts the boundary.

use super::obstacle::{Contracts, Moment, Obstacle};
use crate::lanes::normal::ln;
use crate::lanes::vector::Vector;

const ITERATIONS: usize = 16;
/// Of sqrt(t), for the last iteration, which cubes it.
const TOLERANCE: f64 = 0.03;
/// Of the guess, in sqrt(t); fitted.
const SHIFT: f64 = 0.45;

/// Solve G' + lam G = 0, which falls with xi, by Halley's method inside a bracket.
#[inline(always)]
pub fn first_boundary<V: Vector>(contracts: &Contracts<V>, moment: &Moment<V>, lam: f64) -> V {
    let Contracts {
        rate,
        dividend,
        spread,
    } = *contracts;
    let (t, root) = (moment.t, moment.root);
    // Where chance has no part: e^y (lam + spread) expm1(dividend t) = lam expm1(rate t).
    let ratio = moment.rate_growth.times(lam) / (spread.plus(lam) * moment.dividend_growth);
    let logarithm = ln((-dividend).negative(ratio, V::all(f64::MAX)));
    let certain = (logarithm - (spread * spread).times(0.5 * t)) / spread;
    let mut high = certain.min(V::all(0.5 * root));
    let mut low = high.plus(-9.0 * root);
    // The option alive at d = xi/sqrt(t) is worth waiting with as N(d) falls to what waiting costs.
    let cost =
        (rate - dividend).max(V::zero()).times(root) / spread + dividend.times(t).max(V::zero());
    let odds = V::all(0.5) / cost.max(V::all(1e-300));
    let guess = (V::all(SHIFT) - (ln(odds.plus(1.0)).times(2.0)).sqrt()).times(root);
    let mut xi = guess.min(high).max(low);
    let mut open = V::all(1.0); // -1 where it is done
    for _ in 0..ITERATIONS {
        let obstacle = Obstacle::at(contracts, moment, xi);
        let residual = obstacle.value.times_plus(V::all(lam), obstacle.slope);
        let derivative = obstacle.slope.times_plus(V::all(lam), obstacle.curvature);
        low = (-residual).negative(xi.max(low), low);
        high = (-residual).negative(high, xi.min(high));
        let second = obstacle.curvature.times_plus(V::all(lam), obstacle.third);
        let pull = derivative * derivative - (residual * second).times(0.5);
        let halley = xi - residual * derivative / pull;
        let middle = (low + high).times(0.5);
        let inside = (halley - low).negative(middle, (high - halley).negative(middle, halley));
        let inside = derivative.negative((-pull).negative(inside, middle), middle);
        let following = open.negative(xi, inside);
        open = ((following - xi).abs().plus(-TOLERANCE * root)).negative(V::all(-1.0), open);
        xi = following;
        if open.lanes().iter().all(|&o| o < 0.0) {
            break;
        }
    }
    xi
}
