//! The value of holding on at many places at once, sixteen side by side.

use super::bumps::Bumps;
use super::held::Held;
use super::profile::End;
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::normal::{exp, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use crate::lanes::vector::{Vector, LANES};

/// In standard deviations: what lies further away has no weight.
const FURTHEST: f64 = 7.5;

/// One node of the integral over the contact sets.
struct Source {
    boundary: f64,
    drift: f64,
    spread: f64,
    interest: f64,
    dividends: f64,
    /// bond e^boundary over the stock's discount: e^x n(d1) e^{-q age} = e^boundary n(d2) e^{-r age}.
    density: f64,
}

/// Everything about a stretch that does not depend on the place.
pub struct Continuation<'a> {
    sign: f64,
    spread: f64,
    shift: f64,
    bond: f64,
    discount: f64,
    far_right: (f64, f64),
    bumps: Bumps<'a>,
    ends: &'a [End],
    sources: Vec<Source>,
}

impl<'a> Continuation<'a> {
    pub fn new(held: &'a Held) -> Self {
        let (stretch, flow) = (&held.stretch, &held.stretch.flow);
        let (s, spread) = (stretch.duration, stretch.spread());
        let profile = &held.profile;
        let past = held.boundary.iter().flat_map(|boundary| &boundary.past);
        let sources = past
            .flat_map(|past| (0..LANES).map(move |lane| (past, lane)))
            .filter(|(past, lane)| past.ages.weight[*lane] > 0.0)
            .map(|(past, lane)| {
                let ages = &past.ages;
                let (bond, discount) = (ages.bond[lane], ages.discount[lane]);
                let weight = stretch.sign * ages.weight[lane];
                Source {
                    boundary: past.boundary[lane],
                    drift: ages.drift[lane],
                    spread: ages.spread[lane],
                    interest: weight * flow.rate * bond,
                    dividends: weight * flow.dividend * discount,
                    density: bond / discount * past.edge[lane],
                }
            })
            .collect();
        Continuation {
            sign: stretch.sign,
            spread,
            shift: flow.drift() * s,
            bond: (-flow.rate * s).exp(),
            discount: (-flow.dividend * s).exp(),
            far_right: profile.far_right(),
            bumps: Bumps::new(held),
            ends: profile.ends(),
            sources,
        }
    }

    /// The value of holding on at increasing places.
    pub fn values(&self, places: &[f64]) -> Vec<f64> {
        let mut out = vec![0.0; places.len()];
        dispatch(Evaluation {
            of: self,
            places,
            out: &mut out,
        });
        out
    }
}

struct Evaluation<'a> {
    of: &'a Continuation<'a>,
    places: &'a [f64],
    out: &'a mut [f64],
}

impl Work for Evaluation<'_> {
    type Result = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Evaluation { of, places, out } = self;
        let inverse = 1.0 / of.spread;
        let one = V::all(1.0);
        for (places, out) in places.chunks(LANES).zip(out.chunks_mut(LANES)) {
            let mut lanes = [places[places.len() - 1]; LANES];
            lanes[..places.len()].copy_from_slice(places);
            let (first, last) = (lanes[0] + of.shift, lanes[LANES - 1] + of.shift);
            let x = V::from_lanes(lanes);
            let centre = x.plus(of.shift);
            let spot = exp(x);
            let stock = spot.times(of.discount);
            let mut total = V::zero();
            for bump in of.bumps.iter() {
                let panel = bump.panel;
                if (panel.middle - panel.half - last) * inverse > FURTHEST
                    || (panel.middle + panel.half - first) * inverse < -FURTHEST
                {
                    continue;
                }
                let z = (V::all(panel.middle) - centre).times(inverse);
                let z2 = z * z;
                // Two interleaved chains.
                let (mut odd, mut even) = (V::zero(), V::zero());
                for k in (0..bump.terms).step_by(2).rev() {
                    odd = odd.times_plus(z2, V::all(bump.polynomial[(k + 1) * LANES]));
                    even = even.times_plus(z2, V::all(bump.polynomial[k * LANES]));
                }
                total = exp(z2.times(-0.5)).times_plus(odd.times_plus(z, even), total);
            }
            total = total.times(ONE_OVER_SQRT_TWO_PI * of.bond * inverse);
            total = total.plus(of.far_right.0 * of.bond) + stock.times(of.far_right.1);
            for end in of.ends {
                let z = (V::all(end.place) - centre).times(inverse);
                let density = exp((z * z).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI * of.bond);
                let in_bond = weighted_normal(z, density, V::all(of.bond)).times(end.constant);
                let in_stock = weighted_normal(z.plus(-of.spread), density.times(end.spot), stock);
                total = total + in_bond + in_stock.times(end.slope);
            }
            for past in &of.sources {
                let nearest = if of.sign > 0.0 {
                    lanes[0]
                } else {
                    lanes[LANES - 1]
                };
                if of.sign * (nearest + past.drift - past.boundary) > FURTHEST * past.spread {
                    continue;
                }
                let d2 = (x.plus(past.drift - past.boundary)).times(1.0 / past.spread);
                let density = exp((d2 * d2).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI);
                let interest = weighted_normal(d2.times(-of.sign), density, one);
                total = interest.times_plus(V::all(past.interest), total);
                if past.dividends != 0.0 {
                    let d1 = d2.plus(past.spread).times(-of.sign);
                    let dividends = weighted_normal(d1, density.times(past.density), spot);
                    total = total - dividends.times(past.dividends);
                }
            }
            let lanes = total.lanes();
            out.copy_from_slice(&lanes[..out.len()]);
        }
    }
}
