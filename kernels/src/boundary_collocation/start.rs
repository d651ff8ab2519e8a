//! Where the search for boundaries begins: a time beyond which there are none, and a guess of them.

use std::f64::consts::SQRT_2;

use super::integrand::European;
use super::nodes::Nodes;
use super::put::Put;
use super::system::Curves;
use crate::lanes::vector::{Part, Vector, LANES};
use crate::premium_march::{first_boundary, Contracts, TimeFactors};

/// The number of spots at which the European put is compared with the payoff; chosen.
const SPOTS_TRIED: usize = 64;
/// The smallest square root of a share of the time that is tried, and the number of halvings of its logarithm; chosen.
const SMALLEST_ROOT: f64 = 1e-8;
const BISECTIONS: usize = 10;
/// The first guess of the lower boundary, in standard deviations above its limit; chosen.
const GUESSED_LOWER: f64 = 0.3;
/// The smallest distance of the first guess of the upper boundary from the strike, in standard deviations; chosen.
const SMALLEST_GUESS: f64 = 1e-6;

/// A share of the time to expiry beyond which nothing is exercised: there the European put is worth more than the payoff,
/// at all spots between the limits of the boundaries at expiry.
pub struct LatestExercise<'a>(pub &'a Put);

impl<V: Vector> Part<V> for LatestExercise<'_> {
    type Result = f64;

    #[inline(always)]
    fn run(self) -> f64 {
        if self.may_exercise::<V>(1.0) {
            return 1.0;
        }
        let (mut low, mut high) = (SMALLEST_ROOT.ln(), 0.0_f64);
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (low + high);
            if self.may_exercise::<V>(middle.exp()) {
                low = middle;
            } else {
                high = middle;
            }
        }
        (2.0 * high).exp()
    }
}

impl LatestExercise<'_> {
    /// Whether exercise may pay at some spot, at z^2 of the time to expiry.
    #[inline(always)]
    #[allow(clippy::cast_precision_loss)]
    fn may_exercise<V: Vector>(&self, z: f64) -> bool {
        let at_expiry = self.0.lower_at_expiry();
        let mut x = [0.0; LANES];
        for chunk in 0..SPOTS_TRIED / LANES {
            for (lane, x) in x.iter_mut().enumerate() {
                let place = ((chunk * LANES + lane) as f64 + 0.5) / SPOTS_TRIED as f64;
                *x = at_expiry * place;
            }
            let put = European::at(self.0.parameters, V::all(z), V::from_lanes(x));
            for above in put.above_payoff.lanes() {
                if above < 0.0 {
                    return true;
                }
            }
        }
        false
    }
}

/// A guess of the boundaries up to a share of the time: the upper one that one step of implicit Euler's from expiry gives, or
/// where that is too low, its expansion or that of the put without expiry and without a lower boundary; and the expansion
/// of the lower one.
pub struct Guess<'a> {
    pub put: &'a Put,
    pub nodes: &'a Nodes,
    pub share: f64,
}

impl<V: Vector> Part<V> for Guess<'_> {
    type Result = Curves;

    #[inline(always)]
    fn run(self) -> Curves {
        let within = self.put.parameters.within(self.share);
        let contracts = Contracts {
            rate: V::all(within.rate),
            dividend: V::all(within.dividend),
            spread: V::all(within.spread),
        };
        let drift = (within.rate - within.dividend) / within.spread - 0.5 * within.spread;
        let discriminant = drift * drift + 2.0 * within.rate;
        let perpetual = if drift > 0.0 && discriminant > 0.0 {
            -(within.spread / (drift + discriminant.sqrt())).ln_1p() / within.spread
        } else {
            f64::NEG_INFINITY
        };
        let at_expiry = self.put.lower_at_expiry();
        let mut curves = Curves {
            upper_squared: vec![0.0; self.nodes.z.len()],
            lower: vec![at_expiry; self.nodes.z.len()],
            share: self.share,
        };
        for (k, &z) in self.nodes.z.iter().enumerate().skip(1) {
            let time = TimeFactors::new(&contracts, z * z, z);
            let xi = first_boundary(&contracts, &time, SQRT_2 / z).lane(0);
            let euler = xi - drift * z * z;
            let earned = (within.rate - within.dividend) * z / within.spread;
            let expansion = -(2.0 * (0.5 / earned).ln_1p()).sqrt() * z;
            let upper = euler.max(expansion).max(perpetual);
            curves.upper_squared[k] = (upper.min(-SMALLEST_GUESS * z) * within.spread).powi(2);
            curves.lower[k] += GUESSED_LOWER * within.spread * z;
        }
        curves
    }
}
