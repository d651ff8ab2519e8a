//! The two boundaries of one put at given times.

use super::nodes::{Nodes, DEGREES};
use super::put::Put;
use super::start::LatestExercise;
use crate::interrupt::Interrupt;
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::vector::Vector;

/// What is found at one time.
#[derive(Clone, Copy)]
pub struct BoundaryPair {
    /// ln(S*/K) of the upper boundary; not a number where nothing is exercised at that time.
    pub upper: f64,
    /// The same of the lower boundary.
    pub lower: f64,
    /// How far the upper one was from that in the last level.
    pub change: f64,
}

/// Return both boundaries at the times to expiry, as shares of the whole time; None where they are not found.
///
/// They are refined until the upper one changes by at most `accuracy` at all times, or to the last level.
#[must_use]
pub fn boundaries_over_time(
    put: Put,
    shares: &[f64],
    accuracy: f64,
    interrupt: Interrupt,
) -> Option<Vec<BoundaryPair>> {
    if put.is_served() {
        dispatch(OverTime {
            put,
            shares,
            accuracy,
            interrupt,
        })
    } else {
        None
    }
}

struct OverTime<'a> {
    put: Put,
    shares: &'a [f64],
    accuracy: f64,
    interrupt: Interrupt<'a>,
}

impl Work for OverTime<'_> {
    type Result = Option<Vec<BoundaryPair>>;

    #[inline(always)]
    fn run<V: Vector>(self) -> Self::Result {
        let mut boundaries = self
            .put
            .first_boundaries::<V>(V::call(LatestExercise(&self.put)))?;
        let mut found: Option<Vec<BoundaryPair>> = None;
        loop {
            let (nodes, curves) = (Nodes::of_level(boundaries.level), &boundaries.curves);
            let at = |(place, &share): (usize, &f64)| {
                let mut pair = BoundaryPair {
                    upper: f64::NAN,
                    lower: f64::NAN,
                    change: f64::INFINITY,
                };
                if share <= curves.share {
                    let z = (share / curves.share).sqrt();
                    pair.upper = -nodes.value(&curves.upper_squared, z).max(0.0).sqrt();
                    pair.lower = nodes.value(&curves.lower, z);
                }
                if let Some(last) = &found {
                    let change = (pair.upper - last[place].upper).abs();
                    pair.change = if change.is_nan() { 0.0 } else { change };
                }
                pair
            };
            let pairs: Vec<BoundaryPair> = self.shares.iter().enumerate().map(at).collect();
            let is_met = pairs.iter().all(|pair| pair.change <= self.accuracy);
            let is_compared = found.replace(pairs).is_some();
            let ends = is_met || boundaries.level + 1 == DEGREES.len() || (self.interrupt)();
            let next = (!ends).then(|| self.put.next_boundaries::<V>(&boundaries));
            match next.flatten() {
                Some(next) => boundaries = next,
                None => return found.filter(|_| is_compared),
            }
        }
    }
}
