//! The multiplier's contribution to the value: u = r - q e^x on the contact set (a put; its negative for a call).

use std::ops::Range;

use super::profile::load;
use super::stretch::Flow;
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::normal::{exp, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use crate::lanes::vector::{Vector, LANES};

/// Contact sets as seen from places: columns filled up to whole vectors with what has no weight.
#[derive(Clone, Debug, Default)]
pub struct Views {
    count: usize,
    x: Vec<f64>,
    pub boundary: Vec<f64>,
    pub age: Vec<f64>,
    pub weight: Vec<f64>,
    /// Weighted: value, its first and second derivative by x, and derivatives of value and slope by the boundary.
    value: Vec<f64>,
    by_x: Vec<f64>,
    by_xx: Vec<f64>,
    pub value_by_boundary: Vec<f64>,
    pub slope_by_boundary: Vec<f64>,
}

impl Views {
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// Add the contact set that ended at `boundary` so long ago, as seen from x.
    pub fn push(&mut self, x: f64, boundary: f64, age: f64, weight: f64) {
        if self.count == self.x.len() {
            let room = self.count + LANES;
            self.x.resize(room, 0.0);
            self.boundary.resize(room, 0.0);
            self.age.resize(room, 1.0);
            self.weight.resize(room, 0.0);
        }
        self.x[self.count] = x;
        self.boundary[self.count] = boundary;
        self.age[self.count] = age;
        self.weight[self.count] = weight;
        self.count += 1;
    }

    /// Fill in what they contribute.
    pub fn integrate(&mut self, sign: f64, flow: &Flow) {
        let room = self.x.len();
        for column in [
            &mut self.value,
            &mut self.by_x,
            &mut self.by_xx,
            &mut self.value_by_boundary,
            &mut self.slope_by_boundary,
        ] {
            column.resize(room, 0.0);
        }
        dispatch(Integration {
            sign,
            flow,
            views: self,
        });
    }

    /// Value, first and second derivative by x of some of them together.
    pub fn sums(&self, range: Range<usize>) -> [f64; 3] {
        [&self.value, &self.by_x, &self.by_xx].map(|column| column[range.clone()].iter().sum())
    }
}

struct Integration<'a> {
    sign: f64,
    flow: &'a Flow,
    views: &'a mut Views,
}

#[inline(always)]
fn store<V: Vector>(values: V, column: &mut [f64]) {
    column[..LANES].copy_from_slice(&values.lanes());
}

impl Work for Integration<'_> {
    type Result = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Integration { sign, flow, views } = self;
        let (rate, dividend, drift) = (flow.rate, flow.dividend, flow.drift());
        let one = V::all(1.0);
        for start in (0..views.count).step_by(LANES) {
            let x = load::<V>(&views.x[start..]);
            let age = load::<V>(&views.age[start..]);
            let boundary = load::<V>(&views.boundary[start..]);
            let weight = load::<V>(&views.weight[start..]);
            let spread = age.sqrt().times(flow.volatility);
            let inverse = one / spread;
            let d2 = (age.times_plus(V::all(drift), x) - boundary) * inverse;
            let d1 = d2 + spread;
            let bond = exp(age.times(-rate));
            let stock = exp(age.times_plus(V::all(-dividend), x));
            let density = exp((d2 * d2).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI);
            let spot = exp(boundary);
            let interest = weighted_normal(d2.times(-sign), density, one) * bond.times(rate);
            // e^x n(d1) e^{-q age} = e^boundary n(d2) e^{-r age}
            let density = density * bond;
            let dividends =
                weighted_normal(d1.times(-sign), density * spot, stock).times(dividend * sign);
            let at_boundary = spot.times(dividend);
            let multiplier = V::all(rate) - at_boundary;
            let density = density * inverse;
            let flux = multiplier * density * weight;
            let turn = flux * d2 * inverse;
            let dividends = dividends * weight;
            store(
                interest.times(sign) * weight - dividends,
                &mut views.value[start..],
            );
            store(-(flux + dividends), &mut views.by_x[start..]);
            store(
                (at_boundary * density).times_plus(weight, turn - dividends),
                &mut views.by_xx[start..],
            );
            store(flux, &mut views.value_by_boundary[start..]);
            store(-turn, &mut views.slope_by_boundary[start..]);
        }
    }
}
