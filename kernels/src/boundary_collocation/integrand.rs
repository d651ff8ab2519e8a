//! What exercise earns inside the region, as it is worth now: the integrand of the premium, and its derivatives.

use crate::flat_options::VALUES;
use crate::lanes::normal::{exp, expm1, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use crate::lanes::vector::{Part, Vector};

/// The parameters of a put, T being the time that the integral of the premium runs over.
#[derive(Clone, Copy, Debug)]
pub struct Parameters {
    /// r T.
    pub rate: f64,
    /// q T.
    pub dividend: f64,
    /// sigma sqrt(T).
    pub spread: f64,
}

impl Parameters {
    /// Those of a share of the time.
    pub(super) fn within(&self, share: f64) -> Self {
        Self {
            rate: self.rate * share,
            dividend: self.dividend * share,
            spread: self.spread * share.sqrt(),
        }
    }
}

/// The time that passes between now and the exercise, and what it does to money; as many times as lanes.
pub struct Passed<V> {
    parameters: Parameters,
    time: V,
    root: V,
    /// sigma times the root of the time.
    deviation: V,
    /// e^{-rate time} and e^{-dividend time}.
    bond: V,
    stock: V,
}

/// The integrand for a region that reaches from nothing up to y = ln(S*/K), at x = ln(S/K).
///
/// With D2 = (x - y + (rate - dividend - spread^2/2) time)/(spread sqrt(time)) and D1 = D2 + spread sqrt(time) it is
/// rate e^{-rate time} N(-D2) - dividend e^{x - dividend time} N(-D1). The region between two boundaries has the difference
/// of two of them.
pub struct Integrand<V> {
    pub value: V,
    /// Its derivatives by x, once and twice, and by y.
    pub by_x: V,
    pub by_x_twice: V,
    pub by_y: V,
    /// The derivatives by rate, dividend and spread at fixed x and y.
    pub by_parameters: [V; 3],
}

impl<V: Vector> Passed<V> {
    /// The times, by their square roots.
    #[inline(always)]
    pub(super) fn new(parameters: Parameters, root: V) -> Self {
        let time = root * root;
        Self {
            parameters,
            time,
            root,
            deviation: root.times(parameters.spread),
            bond: exp(-time.times(parameters.rate)),
            stock: exp(-time.times(parameters.dividend)),
        }
    }

    /// The integrand at x, e^x being `moneyness`, for the boundary y.
    #[inline(always)]
    pub(super) fn integrand(&self, x: V, moneyness: V, y: V) -> Integrand<V> {
        let Parameters {
            rate,
            dividend,
            spread,
        } = self.parameters;
        let (time, boundary) = (self.time, exp(y));
        let inverse = V::all(1.0) / self.deviation;
        let drift = rate - dividend - 0.5 * spread * spread;
        let d2 = (x - y + time.times(drift)) * inverse;
        let d1 = d2 + self.deviation;
        let density = exp((d2 * d2).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI) * self.bond;
        // e^{-dividend time} n(D1) S is e^{-rate time} n(D2) S*.
        let in_stock_density = density * boundary;
        let in_bond = weighted_normal(-d2, density, self.bond);
        let in_stock = weighted_normal(-d1, in_stock_density, moneyness * self.stock);
        let earned = density.times(rate) - in_stock_density.times(dividend);
        let by_y = earned * inverse;
        let paid = in_stock.times(dividend);
        let by_drift = by_y * time;
        Integrand {
            value: in_bond.times(rate) - paid,
            by_x: -(by_y + paid),
            by_x_twice: (d2 * by_y + in_stock_density.times(dividend)) * inverse - paid,
            by_y,
            by_parameters: [
                in_bond - (time * in_bond).times(rate) - by_drift,
                by_drift - in_stock + time * paid,
                (earned * d2).times(1.0 / spread) + (density * self.root).times(rate),
            ],
        }
    }
}

/// The European put over K, and its derivatives.
pub struct European<V> {
    pub value: V,
    /// The value less the payoff 1 - e^x, without cancellation where that is small, and its derivative by x.
    pub above_payoff: V,
    pub above_payoff_by_x: V,
    pub by_x: V,
    pub by_x_twice: V,
    pub by_parameters: [V; 3],
}

impl<V: Vector> European<V> {
    /// The put at x, after the square root of a time.
    #[inline(always)]
    pub(super) fn at(parameters: Parameters, root: V, x: V) -> Self {
        let passed = Passed::new(parameters, root);
        let Parameters {
            rate,
            dividend,
            spread,
        } = parameters;
        let drift = rate - dividend - 0.5 * spread * spread;
        let d2 = (x + passed.time.times(drift)) / passed.deviation;
        let d1 = d2 + passed.deviation;
        let density = exp((d2 * d2).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI) * passed.bond;
        let moneyness = exp(x);
        let forward = moneyness * passed.stock;
        let in_bond = weighted_normal(-d2, density, passed.bond);
        let in_stock = weighted_normal(-d1, density, forward);
        // The European call, and what the put's payoff would earn until expiry.
        let (stock_left, bond_left) = (
            weighted_normal(d1, density, forward),
            weighted_normal(d2, density, passed.bond),
        );
        let bond_lost = expm1(passed.time.times(-rate));
        let stock_lost = moneyness * expm1(passed.time.times(-dividend));
        Self {
            value: in_bond - in_stock,
            above_payoff: (stock_left - bond_left) + (bond_lost - stock_lost),
            above_payoff_by_x: stock_left - stock_lost,
            by_x: -in_stock,
            by_x_twice: density / passed.deviation - in_stock,
            by_parameters: [
                -(passed.time * in_bond),
                passed.time * in_stock,
                density * passed.root,
            ],
        }
    }
}

/// The work of finding the `VALUES` of a European put at x = ln(S/K).
pub struct EuropeanAt {
    pub parameters: Parameters,
    pub x: f64,
}

impl<V: Vector> Part<V> for EuropeanAt {
    type Result = [f64; VALUES];

    #[inline(always)]
    fn run(self) -> [f64; VALUES] {
        let put = European::at(self.parameters, V::all(1.0), V::all(self.x));
        let [by_rate, by_dividend, by_spread] = put.by_parameters;
        let value = put.value;
        let (by_x, by_x_twice) = (put.by_x, put.by_x_twice);
        [
            value,
            by_x,
            by_x_twice,
            value,
            by_rate,
            by_dividend,
            by_spread,
        ]
        .map(|v| v.lane(0))
    }
}
