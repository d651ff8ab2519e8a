//! The viewpoints at a segment's beginning, which all see the profile through the same time and have weights of the value alone.
//!
//! Nothing is kept of what each of them sees: only sums over all of them are returned. Several walks that come to the same
//! places are served at once, for what is costly depends on the places alone.

use super::gradient::{add, SegmentGradient, Weights, FUNCTIONALS};
use super::profile::{PieceEnd, Profile};
use super::propagation::{load, Transition};
use super::segment::Segment;
use super::viewpoint::{Densities, Viewpoint};
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::normal::{exp, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use crate::lanes::vector::{sum_of_lanes, Vector, LANES};

/// The adjoint weights of the value at the viewpoints, of its first two derivatives by x, and of the first over the spot.
type Sums<T> = [[T; FUNCTIONALS]; 4];

/// The adjoint weights of the profile's value at its nodes, per unit of x, and of its slope at the viewpoints, in spots there;
/// and the derivatives by the parameters.
pub struct PointsSeen {
    pub densities: Densities,
    pub by_amount: Weights,
    pub gradient: SegmentGradient,
}

/// See a profile from viewpoints at the segment's beginning, which are at the same places in every walk.
pub fn see_from_points<const WALKS: usize>(
    profile: &Profile,
    segment: &Segment,
    views: [&[Viewpoint]; WALKS],
) -> [PointsSeen; WALKS] {
    let seen = dispatch(Seeing {
        profile,
        transition: Transition::new(&segment.dynamics, segment.duration),
        views,
    });
    seen.map(|(sums, densities)| of_sums(segment, &sums, densities))
}

fn of_sums(segment: &Segment, sums: &Sums<f64>, densities: Densities) -> PointsSeen {
    let [value, by_x, by_xx, by_amount] = sums;
    let (s, by_volatility) = (
        segment.duration,
        segment.duration * segment.dynamics.volatility,
    );
    let mut gradient = SegmentGradient::default();
    add(&mut gradient.volatility, by_volatility, by_xx);
    add(&mut gradient.volatility, -by_volatility, by_x);
    add(&mut gradient.rate, s, by_x);
    add(&mut gradient.rate, -s, value);
    add(&mut gradient.dividend, -s, by_x);
    PointsSeen {
        densities,
        by_amount: *by_amount,
        gradient,
    }
}

struct Seeing<'a, const WALKS: usize> {
    profile: &'a Profile,
    transition: Transition,
    views: [&'a [Viewpoint]; WALKS],
}

impl<const WALKS: usize> Work for Seeing<'_, WALKS> {
    type Result = [(Sums<f64>, Densities); WALKS];

    #[inline(always)]
    fn run<V: Vector>(self) -> Self::Result {
        let (profile, transition) = (self.profile, &self.transition);
        let inverse = transition.inverse;
        let scale = ONE_OVER_SQRT_TWO_PI * transition.bond * inverse;
        let mut found: [(Sums<V>, Densities); WALKS] = std::array::from_fn(|_| {
            let densities = std::array::from_fn(|_| vec![0.0; profile.nodes.len()]);
            ([[V::zero(); FUNCTIONALS]; 4], densities)
        });
        for start in (0..self.views[0].len()).step_by(LANES) {
            let end = (start + LANES).min(self.views[0].len());
            let views = self.views.map(|views| &views[start..end]);
            let counts = |k: usize| views.iter().any(|views| !views[k].is_negligible());
            if !(0..end - start).any(counts) {
                continue;
            }
            let over_spot = see_pieces(profile, transition, views, &mut found);
            for (k, over_spot) in (0..end - start).zip(over_spot) {
                if !counts(k) {
                    continue;
                }
                let weights = views.map(|views| views[k].value.map(|weight| weight * scale));
                let x = views[0][k].x;
                let [value, first, second] =
                    see_nodes::<V, WALKS>(profile, transition, x, &weights, &mut found);
                let seen = [
                    (value, 1.0),
                    (first, inverse),
                    (second - value, inverse * inverse),
                    (first, inverse * over_spot),
                ];
                for ((sums, _), weights) in found.iter_mut().zip(weights) {
                    for (sum, (seen, factor)) in sums.iter_mut().zip(seen) {
                        for (sum, weight) in sum.iter_mut().zip(weights) {
                            *sum = seen.times_plus(V::all(factor * weight), *sum);
                        }
                    }
                }
            }
        }
        found.map(|(sums, densities)| (sums.map(|sum| sum.map(sum_of_lanes)), densities))
    }
}

/// The sums over the nodes of z^k e^{-z^2/2} times the weighted values there, k = 0, 1, 2, in lanes; what the functionals count
/// the nodes for is added to their densities.
#[inline(always)]
fn see_nodes<V: Vector, const WALKS: usize>(
    profile: &Profile,
    transition: &Transition,
    x: f64,
    weights: &[Weights; WALKS],
    found: &mut [(Sums<V>, Densities); WALKS],
) -> [V; 3] {
    let (centre, inverse) = (x + transition.shift, transition.inverse);
    let mut moments = [V::zero(); 3];
    for start in (0..profile.nodes.len()).step_by(LANES) {
        let Some(z) = profile.distances::<V>(start, centre, inverse) else {
            continue;
        };
        let density = exp((z * z).times(-0.5));
        let mass = density * load::<V>(&profile.weighted[start..]);
        let moment = mass * z;
        moments[0] = moments[0] + mass;
        moments[1] = moments[1] + moment;
        moments[2] = moment.times_plus(z, moments[2]);
        for ((_, densities), weights) in found.iter_mut().zip(weights) {
            for (there, weight) in densities.iter_mut().zip(weights) {
                let there = &mut there[start..start + LANES];
                let total = density.times_plus(V::all(*weight), load::<V>(there));
                there.copy_from_slice(&total.lanes());
            }
        }
    }
    moments
}

/// Add the pieces of a profile to what at most sixteen viewpoints see; return 1 over the spot of each.
#[inline(always)]
fn see_pieces<V: Vector, const WALKS: usize>(
    profile: &Profile,
    transition: &Transition,
    views: [&[Viewpoint]; WALKS],
    found: &mut [(Sums<V>, Densities); WALKS],
) -> [f64; LANES] {
    let mut places = [views[0][0].x; LANES];
    for (place, view) in places.iter_mut().zip(views[0]) {
        *place = view.x;
    }
    let (x, inverse, bond) = (V::from_lanes(places), transition.inverse, transition.bond);
    let spot = exp(x);
    let stock = spot.times(transition.discount);
    let far_right = stock.times(profile.slope);
    let mut seen = [
        far_right.plus(profile.constant * bond),
        far_right,
        far_right,
    ];
    for &PieceEnd {
        place,
        constant,
        slope,
        spot: there,
    } in &profile.ends
    {
        let z = (V::all(place - transition.shift) - x).times(inverse);
        let density = exp((z * z).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI * bond);
        let in_bond = weighted_normal(z, density, V::all(bond)).times(constant);
        let d1 = z.plus(-transition.spread);
        let in_stock = weighted_normal(d1, density.times(there), stock).times(slope);
        let by_place = density.times(inverse);
        let height = by_place.times(constant + slope * there);
        let bend = height * z.times(inverse) + by_place.times(slope * there);
        seen[0] = seen[0] + in_bond + in_stock;
        seen[1] = seen[1] + in_stock - height;
        seen[2] = seen[2] + in_stock - bend;
    }
    let over_spot = V::all(1.0) / spot;
    let seen = [seen[0], seen[1], seen[2], seen[1] * over_spot];
    for ((sums, _), views) in found.iter_mut().zip(views) {
        for k in 0..FUNCTIONALS {
            let mut weights = [0.0; LANES];
            for (weight, view) in weights.iter_mut().zip(views) {
                *weight = view.value[k];
            }
            let weights = V::from_lanes(weights);
            for (sum, seen) in sums.iter_mut().zip(seen) {
                sum[k] = weights.times_plus(seen, sum[k]);
            }
        }
    }
    over_spot.lanes()
}
