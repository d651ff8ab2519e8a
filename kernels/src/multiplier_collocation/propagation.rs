//! The value of a profile a time s earlier without exercise, e^{sL} profile: a Gaussian integral.
//!
//! The transition density of ln S is normal, so that lines in the spot give normal distribution functions at their ends,
//! and the nodes between them a sum of normal densities.

use super::profile::{EndBlock, Profile};
use super::segment::Dynamics;
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::normal::{exp, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use crate::lanes::vector::{sum_of_lanes, Vector, LANES};

/// The largest distance of a node that counts, in standard deviations; chosen: the density beyond is below 1e-12 of its
/// peak.
pub const LARGEST_DEVIATION: f64 = 7.5;

/// The Gaussian transition through a time s.
#[derive(Clone, Copy, Debug)]
pub struct Transition {
    /// sigma sqrt(s), and 1 over it.
    pub spread: f64,
    pub inverse: f64,
    /// The drift of ln S through s.
    pub shift: f64,
    /// e^{-r s} and e^{-q s}.
    pub bond: f64,
    pub discount: f64,
}

impl Transition {
    /// The transition through a time s > 0, years.
    pub fn new(dynamics: &Dynamics, s: f64) -> Transition {
        let spread = dynamics.volatility * s.sqrt();
        Transition {
            spread,
            inverse: 1.0 / spread,
            shift: dynamics.drift() * s,
            bond: (-dynamics.rate * s).exp(),
            discount: (-dynamics.dividend * s).exp(),
        }
    }
}

impl Profile {
    /// The value, slope and second derivative by x of e^{sL} profile at x, for s > 0.
    pub fn propagate(&self, dynamics: &Dynamics, x: f64, s: f64) -> [f64; 3] {
        self.propagate_through(&Transition::new(dynamics, s), x, x.exp())
    }

    /// The same through a known transition, at x = ln(spot).
    pub fn propagate_through(&self, transition: &Transition, x: f64, spot: f64) -> [f64; 3] {
        dispatch(Propagation {
            profile: self,
            transition,
            x,
            spot,
        })
    }
}

impl Profile {
    /// The distances z of the sixteen nodes from `start` on, in standard deviations, 1 over which is `inverse`; None where
    /// all of them are too far from `centre` to count.
    #[inline(always)]
    pub fn distances<V: Vector>(&self, start: usize, centre: f64, inverse: f64) -> Option<V> {
        let highest = (self.nodes[start + LANES - 1] - centre) * inverse;
        let lowest = (self.nodes[start] - centre) * inverse;
        if highest < -LARGEST_DEVIATION || lowest > LARGEST_DEVIATION {
            return None;
        }
        let nodes = load::<V>(&self.nodes[start..]);
        Some(nodes.plus(-centre).times(inverse))
    }
}

/// The first sixteen numbers of a slice.
#[inline(always)]
pub fn load<V: Vector>(values: &[f64]) -> V {
    let mut lanes = [0.0; LANES];
    lanes.copy_from_slice(&values[..LANES]);
    V::from_lanes(lanes)
}

struct Propagation<'a> {
    profile: &'a Profile,
    transition: &'a Transition,
    x: f64,
    spot: f64,
}

impl Work for Propagation<'_> {
    type Result = [f64; 3];

    #[inline(always)]
    fn run<V: Vector>(self) -> [f64; 3] {
        let (profile, stock) = (self.profile, self.spot * self.transition.discount);
        let &Transition {
            spread,
            inverse,
            shift,
            bond,
            ..
        } = self.transition;
        let centre = self.x + shift;
        let mut zeroth = V::zero();
        let mut first = V::zero();
        let mut second = V::zero();
        for start in (0..profile.nodes.len()).step_by(LANES) {
            let Some(z) = profile.distances::<V>(start, centre, inverse) else {
                continue;
            };
            let mass = exp((z * z).times(-0.5)) * load::<V>(&profile.weighted[start..]);
            let moment = mass * z;
            zeroth = zeroth + mass;
            first = first + moment;
            second = moment.times_plus(z, second - mass);
        }
        let scale = ONE_OVER_SQRT_TWO_PI * bond * inverse;
        zeroth = zeroth.times(scale);
        first = first.times(scale * inverse);
        second = second.times(scale * inverse * inverse);
        if !profile.end_blocks.is_empty() {
            let in_stocks = V::from_lanes(EndBlock::SLOPES);
            let wholes = in_stocks.times_plus(V::all(stock - bond), V::all(bond));
            let d1_less_d2 = in_stocks.times(-spread);
            for block in &profile.end_blocks {
                let z = V::from_lanes(block.places).plus(-centre).times(inverse);
                let density = exp((z * z).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI * bond);
                // e^x n(z - spread) e^{-q s} = e^end n(z) e^{-r s}
                let there = density * V::from_lanes(block.spots);
                let part =
                    V::from_lanes(block.amounts) * weighted_normal(z + d1_less_d2, there, wholes);
                let in_stock = part * in_stocks;
                let height = V::from_lanes(block.heights);
                let bend = height * (z.times(inverse) + in_stocks);
                let density = density.times(inverse);
                zeroth = zeroth + part;
                first = first + in_stock - height * density;
                second = second + in_stock - bend * density;
            }
        }
        let far_right = profile.slope * stock;
        [
            sum_of_lanes(zeroth) + profile.constant * bond + far_right,
            sum_of_lanes(first) + far_right,
            sum_of_lanes(second) + far_right,
        ]
    }
}
