//! The multiplier's contribution to the value: u = r - q e^x on the contact set (a put; its negative for a call).

use std::ops::Range;

use super::profile::load;
use super::stretch::Flow;
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::normal::{exp, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use crate::lanes::vector::{Vector, LANES};

const COLUMNS: usize = 9;
const X: usize = 0;
const BOUNDARY: usize = 1;
const AGE: usize = 2;
const WEIGHT: usize = 3;
/// Weighted: value, its first and second derivative by x, and derivatives of value and slope by the boundary.
const VALUE: usize = 4;
const BY_X: usize = 5;
const BY_XX: usize = 6;
const VALUE_BY_BOUNDARY: usize = 7;
const SLOPE_BY_BOUNDARY: usize = 8;

/// Contact sets as seen from places: columns filled up to whole vectors with what has no weight.
pub struct Views {
    count: usize,
    room: usize,
    /// One column after the other.
    numbers: Vec<f64>,
}

impl Views {
    /// Room for so many.
    pub fn with_room(count: usize) -> Self {
        let room = count.next_multiple_of(LANES);
        let mut views = Views {
            count: 0,
            room,
            numbers: vec![0.0; COLUMNS * room],
        };
        views.numbers[AGE * room..(AGE + 1) * room].fill(1.0);
        views
    }

    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// Add the contact set that ended at `boundary` so long ago, as seen from x.
    pub fn push(&mut self, x: f64, boundary: f64, age: f64, weight: f64) {
        for (column, number) in [(X, x), (BOUNDARY, boundary), (AGE, age), (WEIGHT, weight)] {
            self.numbers[column * self.room + self.count] = number;
        }
        self.count += 1;
    }

    /// Fill in what they contribute.
    pub fn integrate(&mut self, sign: f64, flow: &Flow) {
        dispatch(Integration {
            sign,
            flow,
            views: self,
        });
    }

    /// Value, first and second derivative by x of some of them together.
    pub fn sums(&self, range: Range<usize>) -> [f64; 3] {
        [VALUE, BY_X, BY_XX].map(|column| self.column(column, range.clone()).iter().sum())
    }

    /// The weighted derivatives by the boundary, of the value and of its slope, of some of them.
    pub fn by_boundary(&self, range: Range<usize>) -> [&[f64]; 2] {
        [VALUE_BY_BOUNDARY, SLOPE_BY_BOUNDARY].map(|column| self.column(column, range.clone()))
    }

    fn column(&self, column: usize, range: Range<usize>) -> &[f64] {
        &self.numbers[column * self.room..][range]
    }
}

struct Integration<'a> {
    sign: f64,
    flow: &'a Flow,
    views: &'a mut Views,
}

impl Work for Integration<'_> {
    type Result = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Integration { sign, flow, views } = self;
        let (rate, dividend, drift) = (flow.rate, flow.dividend, flow.drift());
        let one = V::all(1.0);
        for start in (0..views.count).step_by(LANES) {
            let [x, boundary, age, weight] = [X, BOUNDARY, AGE, WEIGHT]
                .map(|column| load::<V>(&views.numbers[column * views.room + start..]));
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
            let dividends = if dividend == 0.0 {
                V::zero()
            } else {
                weighted_normal(d1.times(-sign), density * spot, stock).times(dividend * sign)
            };
            let at_boundary = spot.times(dividend);
            let multiplier = V::all(rate) - at_boundary;
            let density = density * inverse;
            let flux = multiplier * density * weight;
            let turn = flux * d2 * inverse;
            let dividends = dividends * weight;
            let curved = (at_boundary * density).times_plus(weight, turn - dividends);
            for (column, numbers) in [
                (VALUE, interest.times(sign) * weight - dividends),
                (BY_X, -(flux + dividends)),
                (BY_XX, curved),
                (VALUE_BY_BOUNDARY, flux),
                (SLOPE_BY_BOUNDARY, -turn),
            ] {
                let at = column * views.room + start;
                views.numbers[at..at + LANES].copy_from_slice(&numbers.lanes());
            }
        }
    }
}
