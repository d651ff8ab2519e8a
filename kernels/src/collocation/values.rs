//! The value of holding on at many places at once, sixteen side by side.
//!
//! A panel's part of the Gaussian integral, the sum of f n(z + t) over its nodes with z the panel's middle and |t| <= 1 in
//! standard deviations, is n(z) times a polynomial in z, for `n(z + t) = n(z) sum_k (-t)^k He_k(z)/k!`.

use super::held::Held;
use super::panels::Panel;
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::normal::{exp, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use crate::lanes::vector::{Vector, LANES};

/// Terms of the Hermite series: t^24/sqrt(24!) < 2e-12.
const TERMS: usize = 24;
/// In standard deviations: what lies further away has no weight.
const FURTHEST: f64 = 9.0;

/// The polynomial of one panel, lowest power first.
struct Bump {
    panel: Panel,
    polynomial: [f64; TERMS],
}

/// A place where a piece of the profile ends.
struct End {
    place: f64,
    constant: f64,
    slope: f64,
    /// e^place.
    spot: f64,
}

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
pub struct Continuation {
    sign: f64,
    spread: f64,
    shift: f64,
    bond: f64,
    discount: f64,
    far_right: (f64, f64),
    bumps: Vec<Bump>,
    ends: Vec<End>,
    sources: Vec<Source>,
}

impl Continuation {
    pub fn new(held: &Held) -> Self {
        let (stretch, flow) = (&held.stretch, &held.stretch.flow);
        let (s, spread) = (stretch.duration, stretch.spread());
        let profile = &held.profile;
        let past = held.boundary.iter().flat_map(|boundary| &boundary.past);
        let sources = past
            .map(|past| {
                let bond = (-flow.rate * past.age).exp();
                let discount = (-flow.dividend * past.age).exp();
                let sign = stretch.sign * past.weight;
                Source {
                    boundary: past.boundary,
                    drift: flow.drift() * past.age,
                    spread: flow.volatility * past.age.sqrt(),
                    interest: sign * flow.rate * bond,
                    dividends: sign * flow.dividend * discount,
                    density: bond / discount * past.boundary.exp(),
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
            bumps: (0..profile.panels.len())
                .map(|index| bump(held, index))
                .collect(),
            ends: profile
                .ends()
                .map(|(place, constant, slope)| End {
                    place,
                    constant,
                    slope,
                    spot: place.exp(),
                })
                .collect(),
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

/// The moments of a panel, turned into its polynomial.
#[allow(clippy::cast_precision_loss)]
fn bump(held: &Held, index: usize) -> Bump {
    let panel = held.profile.panels[index];
    let inverse = 1.0 / held.stretch.spread();
    let (nodes, weighted) = held.profile.panel(index, held.points);
    // (-1)^k/k! sum_j w_j t_j^k
    let mut moments = [0.0; TERMS];
    for (node, weight) in nodes.iter().zip(weighted) {
        let t = -(node - panel.middle) * inverse;
        let mut term = *weight;
        for (k, moment) in moments.iter_mut().enumerate() {
            *moment += term;
            term *= t / (k + 1) as f64;
        }
    }
    let mut polynomial = [0.0; TERMS];
    for (moment, coefficients) in moments.iter().zip(hermite()) {
        for (total, coefficient) in polynomial.iter_mut().zip(coefficients) {
            *total += moment * coefficient;
        }
    }
    Bump { panel, polynomial }
}

/// The coefficients of the Hermite polynomials, lowest power first: `He_{k+1} = z He_k - k He_{k-1}`.
#[allow(clippy::cast_precision_loss)]
fn hermite() -> &'static [[f64; TERMS]; TERMS] {
    static TABLE: std::sync::OnceLock<[[f64; TERMS]; TERMS]> = std::sync::OnceLock::new();
    TABLE.get_or_init(|| {
        let mut table = [[0.0; TERMS]; TERMS];
        table[0][0] = 1.0;
        table[1][1] = 1.0;
        for k in 1..TERMS - 1 {
            for power in 0..TERMS {
                let raised = if power > 0 { table[k][power - 1] } else { 0.0 };
                table[k + 1][power] = raised - k as f64 * table[k - 1][power];
            }
        }
        table
    })
}

struct Evaluation<'a> {
    of: &'a Continuation,
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
            for Bump { panel, polynomial } in &of.bumps {
                if (panel.middle - panel.half - last) * inverse > FURTHEST
                    || (panel.middle + panel.half - first) * inverse < -FURTHEST
                {
                    continue;
                }
                let z = (V::all(panel.middle) - centre).times(inverse);
                let z2 = z * z;
                // Two interleaved chains.
                let mut odd = V::all(polynomial[TERMS - 1]);
                let mut even = V::all(polynomial[TERMS - 2]);
                let mut k = TERMS - 2;
                while k >= 2 {
                    odd = odd.times_plus(z2, V::all(polynomial[k - 1]));
                    even = even.times_plus(z2, V::all(polynomial[k - 2]));
                    k -= 2;
                }
                total = exp(z2.times(-0.5)).times_plus(odd.times_plus(z, even), total);
            }
            total = total.times(ONE_OVER_SQRT_TWO_PI * of.bond * inverse);
            total = total.plus(of.far_right.0 * of.bond) + stock.times(of.far_right.1);
            for end in &of.ends {
                let z = (V::all(end.place) - centre).times(inverse);
                let density = exp((z * z).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI * of.bond);
                let in_bond = weighted_normal(z, density, V::all(of.bond)).times(end.constant);
                let in_stock = weighted_normal(z.plus(-of.spread), density.times(end.spot), stock);
                total = total + in_bond + in_stock.times(end.slope);
            }
            for past in &of.sources {
                let d2 = (x.plus(past.drift - past.boundary)).times(1.0 / past.spread);
                let density = exp((d2 * d2).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI);
                let interest = weighted_normal(d2.times(-of.sign), density, one);
                let d1 = d2.plus(past.spread).times(-of.sign);
                let dividends = weighted_normal(d1, density.times(past.density), spot);
                total = total + interest.times(past.interest) - dividends.times(past.dividends);
            }
            let lanes = total.lanes();
            out.copy_from_slice(&lanes[..out.len()]);
        }
    }
}
