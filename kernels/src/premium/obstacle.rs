//! The obstacle of the premium: e^{r tau} (payoff - European put)/K.

use crate::lanes::normal::{exp, expm1, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use crate::lanes::vector::Vector;

/// What is left of the contracts: r T > 0, q T, sigma sqrt(T) > 0.
#[derive(Clone, Copy)]
pub struct Contracts<V> {
    pub rate: V,
    pub dividend: V,
    pub spread: V,
}

/// A time t in (0, 1] with what the obstacle needs of it.
#[derive(Clone, Copy)]
pub struct Moment<V> {
    /// tau/T.
    pub t: f64,
    /// sqrt(t).
    pub root: f64,
    /// e^{rate t} - 1.
    pub rate_growth: V,
    /// e^{dividend t} - 1.
    pub dividend_growth: V,
}

impl<V: Vector> Moment<V> {
    /// `root` is sqrt(t).
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

/// G and what goes with it at one xi.
#[derive(Clone, Copy)]
pub struct Obstacle<V> {
    /// G.
    pub value: V,
    /// Its derivative by xi.
    pub slope: V,
    /// Its second derivative by xi.
    pub curvature: V,
    /// Its third derivative by xi.
    pub third: V,
    /// e^y, y = xi spread + spread^2 t/2.
    pub growth: V,
    /// Derivatives by rate, dividend and spread.
    pub tangents: [V; 3],
}

impl<V: Vector> Obstacle<V> {
    /// Evaluate it; what is not used costs nothing.
    #[inline(always)]
    pub fn at(contracts: &Contracts<V>, moment: &Moment<V>, xi: V) -> Self {
        let spread = contracts.spread;
        let (t, root) = (moment.t, moment.root);
        let growth = exp(xi.times_plus(spread, (spread * spread).times(0.5 * t)));
        let d2 = xi.times(1.0 / root);
        let d1 = spread.times_plus(V::all(root), d2);
        let density = exp((d2 * d2).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI);
        let in_stock = weighted_normal(d1, density, growth);
        let in_bond = weighted_normal(d2, density, V::all(1.0));
        let held = growth.times_plus(moment.dividend_growth, in_stock);
        let slope = -(spread * held);
        let curvature = spread * (slope - density.times(1.0 / root));
        Self {
            value: (moment.rate_growth - growth * moment.dividend_growth) - (in_stock - in_bond),
            slope,
            curvature,
            third: spread * (curvature + d2 * density.times(1.0 / t)),
            growth,
            tangents: [
                moment.rate_growth.plus(1.0).times(t),
                -(growth * moment.dividend_growth.plus(1.0)).times(t),
                -spread.times_plus(V::all(t), xi) * held - density.times(root),
            ],
        }
    }
}
