//! The contribution of contact sets (`multiplier`), as seen from viewpoints, differentiated by the parameters and by where the
//! contact sets ended.
//!
//! What exercise at one age contributes is e^{age L} of its cash flow, so that its derivatives by the parameters are those of
//! `viewpoint` with the age in the place of s, and the cash flow's own derivatives: r and q are its factors.

use super::gradient::{SegmentGradient, FUNCTIONALS};
use super::multiplier::ContactBlock;
use super::propagation::LARGEST_DEVIATION;
use super::segment::Dynamics;
use super::viewpoint::Viewpoint;
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::normal::{exp, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use crate::lanes::vector::{sum_of_lanes, Vector, LANES};

/// The adjoint weights of one block of contact sets: the derivatives by the places where these ended.
pub type BoundaryWeights = [[f64; LANES]; FUNCTIONALS];

/// What sixteen contact sets contribute to a value, up to the third derivative by x.
struct Seen<V> {
    derivatives: [V; 4],
    /// The contributions of interest and of dividends per unit of r and -q, and their first derivatives by x.
    interest: [V; 2],
    dividends: [V; 2],
    /// The derivatives of value and slope by the boundary.
    by_boundary: [V; 2],
}

/// The part of one block.
#[inline(always)]
fn see<V: Vector>(sign: f64, dynamics: &Dynamics, block: &ContactBlock, x: V, spot: V) -> Seen<V> {
    let (ages, q) = (&block.ages, dynamics.dividend);
    let (inverse, weight) = (V::from_lanes(ages.inverse), V::from_lanes(ages.weight));
    let (bond, boundary_spot) = (V::from_lanes(ages.bond), V::from_lanes(block.boundary_spot));
    let d2 = (x + V::from_lanes(ages.drift) - V::from_lanes(block.boundary)) * inverse;
    let d1 = d2 + V::from_lanes(ages.spread);
    let density = exp((d2 * d2).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI) * bond;
    let signed = weight.times(sign);
    let interest = weighted_normal(d2.times(-sign), density, bond) * signed;
    let stock = spot * V::from_lanes(ages.discount);
    let shares = weighted_normal(d1.times(-sign), density * boundary_spot, stock) * signed;
    let there = density * inverse * weight;
    let there_in_spot = there * boundary_spot;
    let slope = -(d2 * inverse); // of the logarithm of the density
    let flux = there.times(dynamics.rate) - there_in_spot.times(q);
    let flux_by_x = flux * slope;
    let flux_by_xx = flux * (slope * slope - inverse * inverse);
    let shares_by_x = shares - there_in_spot;
    let shares_by_xx = shares_by_x - there_in_spot * slope;
    Seen {
        derivatives: [
            interest.times(dynamics.rate) - shares.times(q),
            -flux - shares.times(q),
            -flux_by_x - shares_by_x.times(q),
            -flux_by_xx - shares_by_xx.times(q),
        ],
        interest: [interest, -there],
        dividends: [shares, shares_by_x],
        by_boundary: [flux, flux_by_x],
    }
}

/// The place, times the sign, beyond which the contact sets of a block are too far away to count.
fn beyond(sign: f64, block: &ContactBlock) -> f64 {
    let ages = &block.ages;
    (0..LANES)
        .filter(|&lane| ages.weight[lane] != 0.0)
        .map(|lane| {
            sign * (block.boundary[lane] - ages.drift[lane]) + LARGEST_DEVIATION * ages.spread[lane]
        })
        .fold(f64::NEG_INFINITY, f64::max)
}

/// The adjoint weights of the contact sets, block by block, as seen from the viewpoints.
///
/// The contributions and their derivatives by the parameters are added to `gradient`, and what the slopes at the viewpoints count
/// for by the amount of a drop of the spot, e^{-x} times the slope, is returned as well.
pub fn see_contact_sets(
    sign: f64,
    dynamics: &Dynamics,
    blocks: &[ContactBlock],
    views: &[Viewpoint],
    gradient: &mut SegmentGradient,
) -> (Vec<BoundaryWeights>, [f64; FUNCTIONALS]) {
    dispatch(Seeing {
        sign,
        dynamics,
        blocks,
        views,
        gradient,
    })
}

struct Seeing<'a> {
    sign: f64,
    dynamics: &'a Dynamics,
    blocks: &'a [ContactBlock],
    views: &'a [Viewpoint],
    gradient: &'a mut SegmentGradient,
}

impl Work for Seeing<'_> {
    type Result = (Vec<BoundaryWeights>, [f64; FUNCTIONALS]);

    #[inline(always)]
    fn run<V: Vector>(self) -> Self::Result {
        let dynamics = self.dynamics;
        let mut weights = Vec::with_capacity(self.blocks.len());
        let mut by_amount = [V::zero(); FUNCTIONALS];
        let mut by_parameters = [[V::zero(); FUNCTIONALS]; 4];
        let spots: Vec<f64> = self.views.iter().map(|view| view.x.exp()).collect();
        for block in self.blocks {
            let age = V::from_lanes(block.ages.spread).times(1.0 / dynamics.volatility);
            let age = age * age;
            let mut of_boundary = [V::zero(); FUNCTIONALS];
            let beyond = beyond(self.sign, block);
            for (view, &spot) in self.views.iter().zip(&spots) {
                if self.sign * view.x > beyond || view.is_negligible() {
                    continue;
                }
                let seen = see(self.sign, dynamics, block, V::all(view.x), V::all(spot));
                let derivatives = &seen.derivatives;
                for (order, counted) in [(0, &view.value), (1, &view.slope)] {
                    if order == 1 && !view.has_slope() {
                        continue;
                    }
                    let by_x = derivatives[order + 1] * age;
                    let changes = [
                        by_x - derivatives[order] * age + seen.interest[order],
                        -(by_x + seen.dividends[order]),
                        (derivatives[order + 2] * age - by_x).times(dynamics.volatility),
                        derivatives[order],
                    ];
                    for k in 0..FUNCTIONALS {
                        for (total, change) in by_parameters.iter_mut().zip(changes) {
                            total[k] = total[k] + change.times(counted[k]);
                        }
                        of_boundary[k] = of_boundary[k] + seen.by_boundary[order].times(counted[k]);
                    }
                }
                for (k, total) in by_amount.iter_mut().enumerate() {
                    *total = *total + derivatives[1].times(view.value[k] / spot);
                }
            }
            weights.push(of_boundary.map(V::lanes));
        }
        let gradient = self.gradient;
        let columns = [
            &mut gradient.rate,
            &mut gradient.dividend,
            &mut gradient.volatility,
            &mut gradient.exercise,
        ];
        for (column, totals) in columns.into_iter().zip(by_parameters) {
            for (entry, total) in column.iter_mut().zip(totals) {
                *entry += sum_of_lanes(total);
            }
        }
        (weights, by_amount.map(sum_of_lanes))
    }
}
