//! The drop of the spot at an event, from S to max(S keep - amount, 0), in x = ln(S/K).

use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::normal::{exp, ln};
use crate::lanes::vector::{Vector, LANES};

/// The smallest spot after a drop, in strikes; chosen: its logarithm is finite.
const SMALLEST_SPOT: f64 = 1e-300;

/// One drop.
#[derive(Clone, Copy)]
pub struct SpotDrop {
    /// The share of the spot that is left.
    pub keep: f64,
    /// Strikes.
    pub amount: f64,
}

impl SpotDrop {
    /// x after the event, from that before it.
    pub fn after(self, x: f64) -> f64 {
        (self.keep * x.exp() - self.amount).max(SMALLEST_SPOT).ln()
    }

    /// The same for many places.
    pub fn after_all(self, places: &[f64]) -> Vec<f64> {
        let mut after = vec![0.0; places.len()];
        dispatch(Dropping {
            drop: self,
            places,
            after: &mut after,
        });
        after
    }

    /// x before the event, from that after it.
    #[allow(clippy::float_cmp)] // no event at all
    pub fn before(self, x: f64) -> f64 {
        if self.amount == 0.0 && self.keep == 1.0 {
            return x;
        }
        logarithm((x.exp() + self.amount) / self.keep)
    }
}

struct Dropping<'a> {
    drop: SpotDrop,
    places: &'a [f64],
    after: &'a mut [f64],
}

impl Work for Dropping<'_> {
    type Result = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let chunks = self.places.chunks(LANES).zip(self.after.chunks_mut(LANES));
        for (places, after) in chunks {
            let mut lanes = [places[0]; LANES];
            lanes[..places.len()].copy_from_slice(places);
            let spot = exp(V::from_lanes(lanes)).times(self.drop.keep);
            let left = spot.plus(-self.drop.amount).max(V::all(SMALLEST_SPOT));
            after.copy_from_slice(&ln(left).lanes()[..places.len()]);
        }
    }
}

/// ln x, -infinity where x is not positive.
pub fn logarithm(x: f64) -> f64 {
    if x > 0.0 {
        x.ln()
    } else {
        f64::NEG_INFINITY
    }
}
