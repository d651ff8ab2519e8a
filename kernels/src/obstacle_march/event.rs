//! What happens between two segments: from the value after it to what the first step of the segment before starts from.

use super::contract::{Contract, Segment};
use super::mesh::Grid;

/// The steps towards a crossing inside a cell, of the secant method kept between its ends.
const SECANTS: usize = 8;
/// Points and weights of Gauss on [-1, 1].
const GAUSS: [(f64, f64); 3] = [
    (0.0, 8.0 / 9.0),
    (-0.774_596_669_241_483_4, 5.0 / 9.0),
    (0.774_596_669_241_483_4, 5.0 / 9.0),
];
/// The largest number of places where a value is not smooth.
const MOST_KINKS: usize = 6;

/// The value just before the end of a segment as a function of the spot: max(V(after the drop), exercise).
pub struct Before<'a, F> {
    /// The value after the drop.
    pub after: F,
    pub segment: &'a Segment,
    pub sign: f64,
    /// Whether the holder may exercise.
    pub exercise: bool,
}

impl<F: Fn(f64) -> f64> Before<'_, F> {
    /// What exercise brings.
    fn obstacle(&self, spot: f64) -> f64 {
        self.sign * (1.0 - self.segment.escrow - spot)
    }

    /// The value of waiting.
    fn waiting(&self, spot: f64) -> f64 {
        (self.after)(if self.segment.drops() {
            self.segment.after_drop(spot)
        } else {
            spot
        })
    }

    /// The value.
    pub fn at(&self, spot: f64) -> f64 {
        let waiting = self.waiting(spot);
        if self.exercise {
            waiting.max(self.obstacle(spot))
        } else {
            waiting
        }
    }

    /// Fill in the values at the nodes, and append to the kinks, in numbers of nodes, those where exercise begins.
    #[allow(clippy::cast_precision_loss)]
    pub fn fill(&self, grid: &Grid, spots: &[f64], values: &mut [f64], kinks: &mut Kinks) {
        let mut last_gain = 0.0;
        for (node, (value, &spot)) in values.iter_mut().zip(spots).enumerate() {
            *value = self.waiting(spot);
            if self.exercise {
                let gain = self.obstacle(spot) - *value;
                if node > 0 && (gain > 0.0) != (last_gain > 0.0) && gain - last_gain != 0.0 {
                    kinks.push(self.crossing(grid, node, last_gain, gain));
                }
                last_gain = gain;
                *value = value.max(self.obstacle(spot));
            }
        }
    }

    /// Where between two nodes exercise and waiting bring the same.
    #[allow(clippy::cast_precision_loss)]
    fn crossing(&self, grid: &Grid, node: usize, gain_before: f64, gain: f64) -> f64 {
        let (mut left, mut right) = (node as f64 - 1.0, node as f64);
        let (mut low, mut high) = (gain_before, gain);
        let mut found = left;
        for _ in 0..SECANTS {
            found = (left - low * (right - left) / (high - low)).clamp(left, right);
            let spot = grid.spot_at(found);
            let gain = self.obstacle(spot) - self.waiting(spot);
            if (gain > 0.0) == (low > 0.0) {
                (left, low) = (found, gain);
            } else {
                (right, high) = (found, gain);
            }
            if (high - low).abs() < f64::MIN_POSITIVE {
                break;
            }
        }
        found
    }

    /// Add what the sums over three nodes miss of the integrals against the hats next to the kinks.
    #[allow(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss
    )]
    pub fn add_missing(
        &self,
        grid: &Grid,
        values: &[f64],
        kinks: &Kinks,
        peclet: f64,
        mut add: impl FnMut(usize, f64),
    ) {
        let kinks = kinks.sorted();
        let mut done = 0;
        for &kink in &kinks {
            let node = kink.floor().max(0.0) as usize;
            for row in [node.saturating_sub(1), node, node + 1, node + 2] {
                let inside = kinks.iter().any(|k| (k - row as f64).abs() < 1.0);
                if row <= done || row < 1 || row >= grid.cells || !inside {
                    continue;
                }
                done = row;
                let [lower, middle, upper] = hat_weights(peclet);
                let sum = lower * values[row - 1] + middle * values[row] + upper * values[row + 1];
                add(row, self.integral(grid, row, &kinks, peclet) - sum);
            }
        }
    }

    /// The integral of the value against the hat of a node, over h.
    #[allow(clippy::cast_precision_loss)]
    fn integral(&self, grid: &Grid, row: usize, kinks: &[f64], peclet: f64) -> f64 {
        let mut cuts = vec![-1.0, 0.0, 1.0];
        cuts.extend(
            kinks
                .iter()
                .map(|k| k - row as f64)
                .filter(|u| u.abs() < 1.0 && *u != 0.0),
        );
        cuts.sort_by(f64::total_cmp);
        let mut total = 0.0;
        for pair in cuts.windows(2) {
            let (middle, half) = (0.5 * (pair[1] + pair[0]), 0.5 * (pair[1] - pair[0]));
            for (point, weight) in GAUSS {
                let u = half.mul_add(point, middle);
                let away = u.abs();
                let hat = 1.0 - away + 0.5 * peclet * u.signum() * (away - away * away);
                let spot = grid.spot_at(row as f64 + u);
                total += half * weight * hat * self.at(spot);
            }
        }
        total
    }
}

/// The weights of the compact scheme's mass matrix.
pub fn hat_weights(peclet: f64) -> [f64; 3] {
    [
        1.0 / 12.0 - peclet / 24.0,
        10.0 / 12.0,
        1.0 / 12.0 + peclet / 24.0,
    ]
}

/// Places where a value is not smooth, in numbers of nodes.
#[derive(Clone, Copy, Default)]
pub struct Kinks {
    places: [f64; MOST_KINKS],
    count: usize,
}

impl Kinks {
    /// Keep a place, as long as there is room.
    pub fn push(&mut self, place: f64) {
        if self.count < MOST_KINKS && place.is_finite() {
            self.places[self.count] = place;
            self.count += 1;
        }
    }

    fn sorted(&self) -> Vec<f64> {
        let mut places = self.places[..self.count].to_vec();
        places.sort_by(f64::total_cmp);
        places
    }
}

/// The value at expiry, before anything that happens there.
pub fn payoff(contract: &Contract, spot: f64) -> f64 {
    contract.obstacle(spot, 1.0).max(0.0)
}
