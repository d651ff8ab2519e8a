//! The obstacle of the premium, G = e^{r tau} (payoff - European put)/K in closed form:
//!
//! G = expm1(rate t) - e^y expm1(dividend t) - e^y N(d1) + N(d2) with y = xi spread + spread^2 t/2, d2 = xi/sqrt(t)
//! and d1 = d2 + spread sqrt(t).

use super::contracts::Contracts;
use crate::lanes::normal::{exp, expm1, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use crate::lanes::vector::Vector;

/// A time t in (0, 1], as a fraction of the time to expiry, and the growth factors up to it.
#[derive(Clone, Copy)]
pub struct TimeFactors<V> {
    /// tau/T.
    pub t: f64,
    /// sqrt(t).
    pub root: f64,
    /// e^{rate t} - 1.
    pub rate_growth: V,
    /// e^{dividend t} - 1.
    pub dividend_growth: V,
}

impl<V: Vector> TimeFactors<V> {
    /// The obstacle at t = `root`^2.
    #[inline(always)]
    pub fn new(contracts: &Contracts<V>, t: f64, root: f64) -> Self {
        Self {
            t,
            root,
            rate_growth: expm1(contracts.rate.times(t)),
            dividend_growth: expm1(contracts.dividend.times(t)),
        }
    }
}

/// G and its derivatives at one xi.
#[derive(Clone, Copy)]
pub struct Obstacle<V> {
    /// G.
    pub value: V,
    /// dG/dxi.
    pub slope: V,
    /// The second derivative of G by xi.
    pub curvature: V,
    /// The third derivative of G by xi.
    pub third: V,
    /// e^y.
    pub growth: V,
    /// The derivatives of G by rate, dividend and spread at fixed xi and t.
    pub tangents: [V; 3],
}

impl<V: Vector> Obstacle<V> {
    /// Evaluate all of it; the compiler drops what the caller does not use.
    #[inline(always)]
    pub fn at(contracts: &Contracts<V>, time: &TimeFactors<V>, xi: V) -> Self {
        let spread = contracts.spread;
        let (t, root) = (time.t, time.root);
        let growth = exp(xi.times_plus(spread, (spread * spread).times(0.5 * t)));
        let d2 = xi.times(1.0 / root);
        let d1 = spread.times_plus(V::all(root), d2);
        // The density n(d2), which is e^y n(d1) as well.
        let density = exp((d2 * d2).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI);
        let in_stock = weighted_normal(d1, density, growth);
        let in_bond = weighted_normal(d2, density, V::all(1.0));
        let shares = growth.times_plus(time.dividend_growth, in_stock);
        let slope = -(spread * shares);
        let curvature = spread * (slope - density.times(1.0 / root));
        Self {
            value: (time.rate_growth - growth * time.dividend_growth) - (in_stock - in_bond),
            slope,
            curvature,
            third: spread * (curvature + d2 * density.times(1.0 / t)),
            growth,
            tangents: [
                time.rate_growth.plus(1.0).times(t),
                -(growth * time.dividend_growth.plus(1.0)).times(t),
                -spread.times_plus(V::all(t), xi) * shares - density.times(root),
            ],
        }
    }
}
