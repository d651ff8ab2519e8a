//! The contribution of the multiplier to the value: u = r - q e^x on the contact set (a put; its negative for a call).
//!
//! A contact set that ended at b an age a ago contributes, per unit of time and seen from x,
//!
//! sign (r e^{-r a} N(-sign d2) - q e^{x - q a} N(-sign d1)), d2 = (x - b + drift a)/(sigma sqrt(a)),
//! d1 = d2 + sigma sqrt(a).
//!
//! The integral over the ages has sixteen of its nodes side by side; the nodes that fill up the last sixteen have no
//! weight.

use super::segment::Dynamics;
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::normal::{exp, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use crate::lanes::vector::{sum_of_lanes, Vector, LANES};

/// What sixteen nodes have from their ages alone.
#[derive(Clone, Copy)]
pub struct AgeBlock {
    /// The drift of ln S over the age.
    pub drift: [f64; LANES],
    /// The standard deviation of ln S over the age, and 1 over it.
    pub spread: [f64; LANES],
    pub inverse: [f64; LANES],
    /// e^{-r age} and e^{-q age}.
    pub bond: [f64; LANES],
    pub discount: [f64; LANES],
    /// The quadrature weights, years.
    pub weight: [f64; LANES],
}

/// The blocks of nodes (age, weight), both in years.
pub fn age_blocks(dynamics: &Dynamics, nodes: &[(f64, f64)]) -> Vec<AgeBlock> {
    dispatch(Aging { dynamics, nodes })
}

struct Aging<'a> {
    dynamics: &'a Dynamics,
    nodes: &'a [(f64, f64)],
}

impl Work for Aging<'_> {
    type Result = Vec<AgeBlock>;

    #[inline(always)]
    fn run<V: Vector>(self) -> Vec<AgeBlock> {
        let dynamics = self.dynamics;
        let blocks = self.nodes.chunks(LANES).map(|nodes| {
            let (mut age, mut weight) = ([1.0; LANES], [0.0; LANES]);
            for (lane, node) in nodes.iter().enumerate() {
                (age[lane], weight[lane]) = *node;
            }
            let age = V::from_lanes(age);
            let spread = age.sqrt().times(dynamics.volatility);
            AgeBlock {
                drift: age.times(dynamics.drift()).lanes(),
                spread: spread.lanes(),
                inverse: (V::all(1.0) / spread).lanes(),
                bond: exp(age.times(-dynamics.rate)).lanes(),
                discount: exp(age.times(-dynamics.dividend)).lanes(),
                weight,
            }
        });
        blocks.collect()
    }
}

/// The places that contact sets are seen from, and where they ended: x and e^x of both.
pub(super) struct Places<V> {
    pub(super) x: V,
    pub(super) spot: V,
    pub(super) boundary: V,
    pub(super) boundary_spot: V,
}

/// The weighted integrands of the value, of its first and second derivative by x, and of the derivatives of value and
/// slope by the boundary.
pub(super) struct Integrands<V> {
    pub(super) value: V,
    pub(super) by_x: V,
    pub(super) by_xx: V,
    pub(super) value_by_boundary: V,
    pub(super) slope_by_boundary: V,
}

/// The integrands of one block; that of the value only where it is asked for.
#[inline(always)]
pub(super) fn integrands<V: Vector>(
    sign: f64,
    dynamics: &Dynamics,
    ages: &AgeBlock,
    places: &Places<V>,
    with_value: bool,
) -> Integrands<V> {
    let (inverse, bond) = (V::from_lanes(ages.inverse), V::from_lanes(ages.bond));
    let weight = V::from_lanes(ages.weight);
    let d2 = (places.x + V::from_lanes(ages.drift) - places.boundary) * inverse;
    let density = exp((d2 * d2).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI) * bond;
    let dividends = if dynamics.dividend == 0.0 {
        V::zero()
    } else {
        let d1 = d2 + V::from_lanes(ages.spread);
        let stock = places.spot * V::from_lanes(ages.discount);
        // e^x n(d1) e^{-q age} = e^boundary n(d2) e^{-r age}
        let shares = weighted_normal(d1.times(-sign), density * places.boundary_spot, stock);
        shares.times(dynamics.dividend * sign) * weight
    };
    let value = if with_value {
        let interest = weighted_normal(d2.times(-sign), density, bond).times(dynamics.rate * sign);
        interest.times_plus(weight, -dividends)
    } else {
        V::zero()
    };
    let yield_there = places.boundary_spot.times(dynamics.dividend);
    let density = density * inverse * weight;
    // The multiplier at the boundary, r - q e^b, times the density of being there.
    let flux = (V::all(dynamics.rate) - yield_there) * density;
    let flux_by_x = flux * d2 * inverse;
    Integrands {
        value,
        by_x: -(flux + dividends),
        by_xx: yield_there.times_plus(density, flux_by_x - dividends),
        value_by_boundary: flux,
        slope_by_boundary: -flux_by_x,
    }
}

/// Sixteen contact sets, by their age.
#[derive(Clone, Copy)]
pub struct ContactBlock {
    pub ages: AgeBlock,
    /// Where they ended, x.
    pub boundary: [f64; LANES],
    /// e^boundary.
    pub boundary_spot: [f64; LANES],
}

/// The value, slope and second derivative at x of what contact sets contribute.
pub fn contribution(sign: f64, dynamics: &Dynamics, blocks: &[ContactBlock], x: f64) -> [f64; 3] {
    dispatch(Contribution {
        sign,
        dynamics,
        blocks,
        x,
    })
}

struct Contribution<'a> {
    sign: f64,
    dynamics: &'a Dynamics,
    blocks: &'a [ContactBlock],
    x: f64,
}

impl Work for Contribution<'_> {
    type Result = [f64; 3];

    #[inline(always)]
    fn run<V: Vector>(self) -> [f64; 3] {
        let (x, spot) = (V::all(self.x), V::all(self.x.exp()));
        let mut sums = [V::zero(); 3];
        for block in self.blocks {
            let places = Places {
                x,
                spot,
                boundary: V::from_lanes(block.boundary),
                boundary_spot: V::from_lanes(block.boundary_spot),
            };
            let found = integrands(self.sign, self.dynamics, &block.ages, &places, true);
            for (sum, part) in sums.iter_mut().zip([found.value, found.by_x, found.by_xx]) {
                *sum = *sum + part;
            }
        }
        sums.map(sum_of_lanes)
    }
}
