//! What the first step of a segment starts from: the values, and what the compact scheme misses of them at their kinks.
//!
//! At a kink M V is not the integral of the hat and the value. Their difference, brought back by the inverse of M, is
//! added to the values: M's inverse falls so fast away from its diagonal that a few nodes around the kinks are changed.

use super::event::{hat, hat_weights, points_of_hat, tilt, Before, Kinks};
use super::mesh::Grid;
use super::terms::AtEnd;

/// How many nodes beyond those next to the kinks are changed: M's inverse falls by about ten from node to node.
const AROUND: usize = 12;

/// Some rows around kinks, and the matrix M there.
pub struct Window {
    /// The first of the rows.
    pub first: usize,
    weights: Vec<[f64; 3]>,
}

impl Window {
    /// The rows around the kinks of values on a grid, in windows apart from each other.
    pub fn around(kinks: &Kinks, grid: &Grid, terms: &AtEnd) -> Vec<Self> {
        let mut bounds: Vec<(usize, usize)> = Vec::new();
        kinks.each_row(grid, |row, _| {
            let first = row.saturating_sub(AROUND).max(1);
            let end = (row + AROUND).min(grid.cells - 1) + 1;
            match bounds.last_mut() {
                Some(before) if first <= before.1 => before.1 = end,
                _ => bounds.push((first, end)),
            }
        });
        let weights = |(first, end)| (first..end).map(|row| terms.mass(row)).collect();
        bounds
            .into_iter()
            .map(|own| Self {
                first: own.0,
                weights: weights(own),
            })
            .collect()
    }

    /// The rows.
    pub fn rows(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.weights.len()
    }

    /// Solve M x = `right` in these rows of all, with nothing outside them.
    pub fn solve(&self, right: &mut [f64]) {
        let own = &self.weights;
        self.eliminate(right, |row| own[row][0], |row| own[row][2]);
    }

    /// Solve the same with M transposed.
    pub fn solve_transposed(&self, right: &mut [f64]) {
        let own = &self.weights;
        self.eliminate(right, |row| own[row - 1][2], |row| own[row + 1][0]);
    }

    fn eliminate(
        &self,
        right: &mut [f64],
        before: impl Fn(usize) -> f64,
        behind: impl Fn(usize) -> f64,
    ) {
        let right = &mut right[self.rows()];
        let count = right.len();
        let mut factors = vec![0.0; count];
        for row in 0..count {
            let (mut pivot, mut rest) = (self.weights[row][1], right[row]);
            if row > 0 {
                pivot -= before(row) * factors[row - 1];
                rest -= before(row) * right[row - 1];
            }
            let inverse = 1.0 / pivot;
            if row + 1 < count {
                factors[row] = behind(row) * inverse;
            }
            right[row] = rest * inverse;
        }
        for row in (1..count).rev() {
            right[row - 1] -= factors[row - 1] * right[row];
        }
    }
}

/// What the first step starts from at the nodes, given the values just before what happens at the segment's end.
#[allow(clippy::cast_precision_loss)]
pub fn start_values(
    before: &Before,
    grid: &Grid,
    kinks: &Kinks,
    values: &[f64],
    terms: &AtEnd,
) -> Vec<f64> {
    let mut missed = vec![0.0; values.len()];
    kinks.each_row(grid, |row, kinks| {
        let peclet = terms.peclet(row)[0];
        let [lower, middle, upper] = hat_weights(peclet);
        let mut total = -(lower * values[row - 1] + middle * values[row] + upper * values[row + 1]);
        points_of_hat(row, kinks, |u, weight| {
            let (value, _) = before.at(grid.spot_at(u + row as f64));
            total += weight * (hat(u) + peclet * tilt(u)) * value;
        });
        missed[row] = total * terms.share(row, kinks);
    });
    for window in Window::around(kinks, grid, terms) {
        window.solve(&mut missed);
    }
    for (missed, value) in missed.iter_mut().zip(values) {
        *missed += value;
    }
    missed
}
