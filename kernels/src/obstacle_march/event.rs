//! What happens between two segments: from the value after it to what the first step of the segment before starts from.

use super::contract::{Contract, Segment};
use super::line::{Contact, Line};
use super::mesh::Grid;
use crate::lanes::normal::ln;
use crate::lanes::vector::{Vector, LANES};

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

/// The value after what happens at the end of a segment.
pub enum After<'a> {
    /// At expiry.
    Payoff,
    Line(Line<'a>),
}

/// The value just before the end of a segment as a function of the spot: max(V(after the drop), exercise).
pub struct Before<'a> {
    pub after: After<'a>,
    pub segment: &'a Segment,
    /// 1 for a put, -1 for a call.
    pub sign: f64,
    /// Whether the holder may exercise.
    pub exercise: bool,
}

impl<'a> Before<'a> {
    /// What happens at the end of a segment, given the value after it.
    pub fn new(contract: &Contract<'a>, number: usize, after: After<'a>) -> Self {
        let segment = &contract.segments[number];
        Self {
            after,
            segment,
            sign: contract.sign,
            exercise: segment.exercise_at_end || segment.exercisable,
        }
    }

    /// What exercise brings.
    pub fn obstacle(&self, spot: f64) -> f64 {
        self.sign * (1.0 - self.segment.escrow - spot)
    }

    /// The spot after the drop.
    pub fn spot_after(&self, spot: f64) -> f64 {
        if self.segment.drops() {
            self.segment.after_drop(spot)
        } else {
            spot
        }
    }

    /// The value of waiting.
    fn waiting(&self, spot: f64) -> f64 {
        let after = self.spot_after(spot);
        match &self.after {
            After::Payoff => (self.sign * (1.0 - after)).max(0.0),
            After::Line(line) => line.at(after),
        }
    }

    /// The value, and whether it is that of exercise.
    pub fn at(&self, spot: f64) -> (f64, bool) {
        let (waiting, obstacle) = (self.waiting(spot), self.obstacle(spot));
        if self.exercise && obstacle >= waiting {
            (obstacle, true)
        } else {
            (waiting, false)
        }
    }

    /// Fill in the value of waiting at the nodes.
    #[inline(always)]
    fn wait<V: Vector>(&self, grid: &Grid, spots: &[f64], values: &mut [f64]) {
        match &self.after {
            After::Line(line) if !self.segment.drops() => values.copy_from_slice(line.values),
            After::Line(line) => {
                let mut indices = [0.0; LANES];
                for (values, spots) in values.chunks_mut(V::WIDTH).zip(spots.chunks(V::WIDTH)) {
                    indices_after::<V>(grid, self.segment, spots, &mut indices);
                    line.at_many::<V>(spots.len(), &indices, |k| self.spot_after(spots[k]), values);
                }
            }
            After::Payoff => {
                for (value, &spot) in values.iter_mut().zip(spots) {
                    *value = self.waiting(spot);
                }
            }
        }
    }

    /// Fill in the values at the nodes, append to the kinks, in numbers of nodes, those where exercise begins, and return
    /// where exercise brings more than waiting: of several intervals the one that is furthest from the near end.
    #[inline(always)]
    #[must_use]
    pub fn fill<V: Vector>(
        &self,
        grid: &Grid,
        spots: &[f64],
        values: &mut [f64],
        kinks: &mut Kinks,
    ) -> Contact {
        self.wait::<V>(grid, spots, values);
        let mut exercised = Contact::NONE;
        if !self.exercise {
            return exercised;
        }
        let mut last_gain = 0.0;
        for (node, (value, &spot)) in values.iter_mut().zip(spots).enumerate() {
            let obstacle = self.obstacle(spot);
            let gain = obstacle - *value;
            let (pays, paid) = (gain > 0.0, last_gain > 0.0);
            let mut place = f64::NEG_INFINITY;
            if node > 0 && pays != paid && gain - last_gain != 0.0 {
                place = self.crossing(grid, node, last_gain, gain);
                kinks.push(place);
            }
            if pays && !paid {
                exercised = Contact {
                    begin: place,
                    end: f64::INFINITY,
                };
            } else if paid && !pays {
                exercised.end = place;
            }
            last_gain = gain;
            *value = value.max(obstacle);
        }
        exercised
    }

    /// Where between two nodes exercise and waiting bring the same.
    #[allow(clippy::cast_precision_loss)]
    fn crossing(&self, grid: &Grid, node: usize, gain_before: f64, gain: f64) -> f64 {
        let (mut left, mut right) = (node as f64 - 1.0, node as f64);
        let (mut low, mut high) = (gain_before, gain);
        let mut found = left;
        for _ in 0..SECANTS {
            let ratio = low * (right - left) / (high - low);
            if ratio.is_nan() {
                break; // of values that have overflowed, which no estimate of their error lets pass
            }
            found = (left - ratio).clamp(left, right);
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
}

/// The numbers of the nodes, which need not be whole, at the spots after the drop at the end of a segment.
#[inline(always)]
pub fn indices_after<V: Vector>(
    grid: &Grid,
    segment: &Segment,
    spots: &[f64],
    indices: &mut [f64; LANES],
) {
    let mut own = [1.0; LANES];
    own[..spots.len()].copy_from_slice(spots);
    let after =
        V::from_lanes(own).times_plus(V::all(1.0 - segment.fraction), V::all(-segment.amount));
    let places = ln(after.max(V::all(f64::MIN_POSITIVE))).times(grid.sign);
    *indices = places.plus(-grid.start).times(1.0 / grid.h).lanes();
}

/// Gauss points of the cells next to a node, cut at the kinks: their distance from the node and their weight, in cells.
#[allow(clippy::cast_precision_loss)]
pub fn points_of_hat(row: usize, kinks: &[f64], mut each: impl FnMut(f64, f64)) {
    let mut cuts = vec![-1.0, 0.0, 1.0];
    let near = kinks.iter().map(|k| k - row as f64);
    cuts.extend(near.filter(|u| u.abs() < 1.0 && *u != 0.0));
    cuts.sort_by(f64::total_cmp);
    for pair in cuts.windows(2) {
        let (middle, half) = (0.5 * (pair[1] + pair[0]), 0.5 * (pair[1] - pair[0]));
        for (point, weight) in GAUSS {
            each(half.mul_add(point, middle), half * weight);
        }
    }
}

/// The hat of a node, at a distance in cells.
pub fn hat(u: f64) -> f64 {
    1.0 - u.abs()
}

/// How the hat changes with the cell Peclet number.
pub fn tilt(u: f64) -> f64 {
    0.5 * u.signum() * (u.abs() - u * u)
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

    /// Visit the inner nodes less than a cell from one of the kinks, in order; `each` takes all of these, sorted.
    #[allow(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss
    )]
    pub fn each_row(&self, grid: &Grid, mut each: impl FnMut(usize, &[f64])) {
        let mut places = self.places[..self.count].to_vec();
        places.sort_by(f64::total_cmp);
        let mut done = 0;
        for &kink in &places {
            let node = kink.floor().max(0.0) as usize;
            for row in [node.saturating_sub(1), node, node + 1, node + 2] {
                let is_near = places.iter().any(|k| (k - row as f64).abs() < 1.0);
                if row > done && row < grid.cells && is_near {
                    done = row;
                    each(row, &places);
                }
            }
        }
    }
}
