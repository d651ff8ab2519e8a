//! The value of waiting at many places at once, sixteen side by side.

use super::multiplier::ContactBlock;
use super::panel_polynomials::PanelPolynomials;
use super::profile::{PieceEnd, Profile};
use super::propagation::LARGEST_DEVIATION;
use super::segment::Segment;
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::normal::{exp, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use crate::lanes::vector::{Vector, LANES};

/// One node of the integral over the contact sets; see `multiplier` for the formula.
struct ContactNode {
    boundary: f64,
    /// The drift and the standard deviation of ln S over the age.
    drift: f64,
    spread: f64,
    /// The factors of N(-sign d2) and of e^x N(-sign d1), the quadrature weight included.
    interest: f64,
    dividends: f64,
    /// e^{(q - r) age + boundary}: e^x n(d1) e^{-q age} = e^boundary n(d2) e^{-r age}.
    density: f64,
}

/// The parts of the value of waiting, at a segment's beginning, that do not depend on the place.
pub struct Continuation<'a> {
    sign: f64,
    /// The standard deviation of ln S over the segment, and its drift.
    spread: f64,
    shift: f64,
    /// e^{-r h} and e^{-q h}.
    bond: f64,
    discount: f64,
    profile: &'a Profile,
    polynomials: PanelPolynomials<'a>,
    contact_nodes: Vec<ContactNode>,
}

impl<'a> Continuation<'a> {
    /// The continuation from the value at the segment's end, with `points` nodes in each panel, and the segment's contact
    /// sets.
    pub fn new(
        profile: &'a Profile,
        points: usize,
        segment: &Segment,
        contact_blocks: &[ContactBlock],
    ) -> Self {
        let dynamics = &segment.dynamics;
        let (s, spread) = (segment.duration, segment.spread());
        let contact_nodes = contact_blocks
            .iter()
            .flat_map(|block| (0..LANES).map(move |lane| (block, lane)))
            .filter(|(block, lane)| block.ages.weight[*lane] != 0.0)
            .map(|(block, lane)| {
                let ages = &block.ages;
                let (bond, discount) = (ages.bond[lane], ages.discount[lane]);
                let weight = segment.sign * ages.weight[lane];
                ContactNode {
                    boundary: block.boundary[lane],
                    drift: ages.drift[lane],
                    spread: ages.spread[lane],
                    interest: weight * dynamics.rate * bond,
                    dividends: weight * dynamics.dividend * discount,
                    density: bond / discount * block.boundary_spot[lane],
                }
            })
            .collect();
        Continuation {
            sign: segment.sign,
            spread,
            shift: dynamics.drift() * s,
            bond: (-dynamics.rate * s).exp(),
            discount: (-dynamics.dividend * s).exp(),
            profile,
            polynomials: PanelPolynomials::new(profile, points, spread),
            contact_nodes,
        }
    }

    /// The value of waiting at increasing places x, in strikes.
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
        for (places, out) in places.chunks(LANES).zip(out.chunks_mut(LANES)) {
            let mut lanes = [places[places.len() - 1]; LANES];
            lanes[..places.len()].copy_from_slice(places);
            let x = V::from_lanes(lanes);
            let spot = exp(x);
            let total = of.at_panels(x, (lanes[0], lanes[LANES - 1]));
            let total = of.with_piece_ends(total, x, spot);
            let nearest = if of.sign > 0.0 {
                lanes[0]
            } else {
                lanes[LANES - 1]
            };
            let total = of.with_contact_sets(total, x, spot, nearest);
            let lanes = total.lanes();
            out.copy_from_slice(&lanes[..out.len()]);
        }
    }
}

impl Continuation<'_> {
    /// The part of the panels at x, which lies between `first` and `last`, not discounted.
    #[inline(always)]
    fn at_panels<V: Vector>(&self, x: V, (first, last): (f64, f64)) -> V {
        let inverse = 1.0 / self.spread;
        let (first, last) = (first + self.shift, last + self.shift);
        let centre = x.plus(self.shift);
        let mut total = V::zero();
        for polynomial in self.polynomials.iter() {
            let panel = polynomial.panel;
            if (panel.middle - panel.half - last) * inverse > LARGEST_DEVIATION
                || (panel.middle + panel.half - first) * inverse < -LARGEST_DEVIATION
            {
                continue;
            }
            let z = (V::all(panel.middle) - centre).times(inverse);
            let z2 = z * z;
            // Two interleaved chains.
            let (mut odd, mut even) = (V::zero(), V::zero());
            for k in (0..polynomial.terms).step_by(2).rev() {
                odd = odd.times_plus(z2, V::all(polynomial.coefficients[(k + 1) * LANES]));
                even = even.times_plus(z2, V::all(polynomial.coefficients[k * LANES]));
            }
            total = exp(z2.times(-0.5)).times_plus(odd.times_plus(z, even), total);
        }
        total
    }

    /// The part of the panels, discounted, with that of the linear pieces.
    #[inline(always)]
    fn with_piece_ends<V: Vector>(&self, panels: V, x: V, spot: V) -> V {
        let inverse = 1.0 / self.spread;
        let centre = x.plus(self.shift);
        let stock = spot.times(self.discount);
        let mut total = panels.times(ONE_OVER_SQRT_TWO_PI * self.bond * inverse);
        total = total.plus(self.profile.constant * self.bond) + stock.times(self.profile.slope);
        for &PieceEnd {
            place,
            constant,
            slope,
            spot,
        } in &self.profile.ends
        {
            let z = (V::all(place) - centre).times(inverse);
            let density = exp((z * z).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI * self.bond);
            let in_bond = weighted_normal(z, density, V::all(self.bond)).times(constant);
            let in_stock = weighted_normal(z.plus(-self.spread), density.times(spot), stock);
            total = total + in_bond + in_stock.times(slope);
        }
        total
    }

    /// The value with the part of the multiplier; `nearest` is the place nearest to the contact sets.
    #[inline(always)]
    fn with_contact_sets<V: Vector>(&self, mut total: V, x: V, spot: V, nearest: f64) -> V {
        let one = V::all(1.0);
        for node in &self.contact_nodes {
            if self.sign * (nearest + node.drift - node.boundary) > LARGEST_DEVIATION * node.spread
            {
                continue;
            }
            let d2 = (x.plus(node.drift - node.boundary)).times(1.0 / node.spread);
            let density = exp((d2 * d2).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI);
            let interest = weighted_normal(d2.times(-self.sign), density, one);
            total = interest.times_plus(V::all(node.interest), total);
            if node.dividends != 0.0 {
                let d1 = d2.plus(node.spread).times(-self.sign);
                let dividends = weighted_normal(d1, density.times(node.density), spot);
                total = total - dividends.times(node.dividends);
            }
        }
        total
    }
}
