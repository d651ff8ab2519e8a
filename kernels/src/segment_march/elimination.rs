//! The matrix M = I - hL of a stage, and its elimination towards a row in the exercise region.

use super::Segment;
use crate::error::KernelError;
use crate::positive_part;
use crate::tridiagonal::Tridiagonal;

/// The size of a response to one row below which it changes no digit of a slack; what is left of it is
/// left out, because arithmetic with subnormal numbers is slow.
pub(super) const SMALLEST_RESPONSE: f64 = 1e-200;

/// The bands of M; the first entry of `lower` and the last of `upper` belong to the end nodes.
pub(super) struct Bands {
    pub h: f64,
    pub lower: Vec<f64>,
    pub diagonal: Vec<f64>,
    pub upper: Vec<f64>,
    /// One over the diagonal.
    pub reciprocal: Vec<f64>,
}

impl Bands {
    pub fn new(size: usize) -> Self {
        Self {
            h: f64::NAN,
            lower: vec![0.0; size],
            diagonal: vec![0.0; size],
            upper: vec![0.0; size],
            reciprocal: vec![0.0; size],
        }
    }

    /// Form M for steps of size h.
    pub fn form(&mut self, segment: &Segment<'_>, h: f64) {
        self.h = h;
        for i in 0..self.diagonal.len() {
            self.lower[i] = -h * segment.lower[i];
            self.upper[i] = -h * segment.upper[i];
            self.diagonal[i] = 1.0 - h * segment.diagonal[i];
            self.reciprocal[i] = 1.0 / self.diagonal[i];
        }
    }

    pub fn matrix(&self) -> Tridiagonal<'_> {
        Tridiagonal {
            lower: &self.lower[1..],
            diagonal: &self.diagonal,
            upper: &self.upper[..self.upper.len() - 1],
        }
    }

    /// Write w = M z + q.
    pub fn apply(&self, z: &[f64], q: &[f64], w: &mut [f64]) {
        let size = w.len();
        let (lower, diagonal, upper) = (
            &self.lower[..size],
            &self.diagonal[..size],
            &self.upper[..size],
        );
        let (z, q) = (&z[..size], &q[..size]);
        let row = |i: usize, below: f64, above: f64| {
            diagonal[i] * z[i] + (lower[i] * below + upper[i] * above) + q[i]
        };
        for i in 1..size.saturating_sub(1) {
            w[i] = row(i, z[i - 1], z[i + 1]);
        }
        let last = size - 1;
        w[0] = row(0, 0.0, if last > 0 { z[1] } else { 0.0 });
        if last > 0 {
            w[last] = row(last, z[last - 1], 0.0);
        }
    }
}

/// Brennan and Schwartz's elimination from both ends towards a seed row, its pivots kept for further right-hand sides.
///
/// z[row] = intercept[row] + slope[row] z[next], next the row after it on the seed's side: the solution of
/// M z + q = 0 on every run of rows that leads from an end of the grid up to a row in contact. With the seed in the
/// exercise region, which may touch an end of the grid or none, substitution from it with projection solves the
/// complementarity problem.
pub(super) struct Factors {
    pub seed: usize,
    reciprocal: Vec<f64>,
    slope: Vec<f64>,
    carry: Vec<f64>,
    intercept: Vec<f64>,
}

impl Factors {
    pub fn new(size: usize) -> Self {
        Self {
            seed: 0,
            reciprocal: vec![0.0; size],
            slope: vec![0.0; size],
            carry: vec![0.0; size],
            intercept: vec![0.0; size],
        }
    }

    /// Compute the pivots.
    pub fn factor(&mut self, bands: &Bands) -> Result<(), KernelError> {
        let (size, seed) = (self.reciprocal.len(), self.seed);
        let (lower, upper) = (&bands.lower[..size], &bands.upper[..size]);
        let diagonal = &bands.diagonal[..size];
        let mut into_seed = diagonal[seed];
        for (rows, inward, outward) in [
            (Side::below(seed), upper, lower),
            (Side::above(seed, size), lower, upper),
        ] {
            // `inward` couples a row to the next one on the seed's side, `outward` that one to it.
            let Some(mut row) = rows.first() else {
                continue;
            };
            let mut pivot = diagonal[row];
            loop {
                if pivot == 0.0 {
                    return Err(KernelError::ZeroPivot { row });
                }
                let next = rows.next(row);
                let reciprocal = 1.0 / pivot;
                self.reciprocal[row] = reciprocal;
                self.slope[row] = -inward[row] * reciprocal;
                self.carry[row] = outward[next] * reciprocal;
                let less = self.carry[row] * inward[row];
                if next == seed {
                    into_seed -= less;
                    break;
                }
                pivot = diagonal[next] - less;
                row = next;
            }
        }
        if into_seed == 0.0 {
            return Err(KernelError::ZeroPivot { row: seed });
        }
        (self.reciprocal[seed], self.slope[seed]) = (1.0 / into_seed, 0.0);
        Ok(())
    }

    /// Carry q along: the intercepts.
    pub fn eliminate(&mut self, q: &[f64]) {
        let (size, seed) = (q.len(), self.seed);
        let (reciprocal, carry) = (&self.reciprocal[..size], &self.carry[..size]);
        let intercept = &mut self.intercept[..size];
        // Two chains side by side, so that neither waits for its own last result alone.
        let (mut low, mut high) = (0, size - 1);
        let mut rest = [q[low], q[high]];
        while low < seed && high > seed {
            intercept[low] = -rest[0] * reciprocal[low];
            intercept[high] = -rest[1] * reciprocal[high];
            rest[0] = q[low + 1] - carry[low] * rest[0];
            rest[1] = q[high - 1] - carry[high] * rest[1];
            low += 1;
            high -= 1;
        }
        while low < seed {
            intercept[low] = -rest[0] * reciprocal[low];
            rest[0] = q[low + 1] - carry[low] * rest[0];
            low += 1;
        }
        while high > seed {
            intercept[high] = -rest[1] * reciprocal[high];
            rest[1] = q[high - 1] - carry[high] * rest[1];
            high -= 1;
        }
        let into_seed = if seed == 0 {
            rest[1]
        } else if seed + 1 == size {
            rest[0]
        } else {
            rest[0] + (rest[1] - q[seed])
        };
        intercept[seed] = -into_seed * reciprocal[seed];
    }

    /// Write the solution of M z + q = 0 on all rows, or of the complementarity problem by projection.
    pub fn substitute(&self, projected: bool, z: &mut [f64]) {
        if projected {
            self.substitute_from(self.intercept[self.seed], z, positive_part);
        } else {
            self.substitute_from(self.intercept[self.seed], z, |x| x);
        }
    }

    fn substitute_from(&self, start: f64, z: &mut [f64], project: impl Fn(f64) -> f64) {
        let (size, seed) = (z.len(), self.seed);
        let (intercept, slope) = (&self.intercept[..size], &self.slope[..size]);
        z[seed] = project(start);
        let mut neighbours = [z[seed]; 2];
        let (mut low, mut high) = (seed, seed + 1);
        while low > 0 && high < size {
            low -= 1;
            neighbours[0] = project(intercept[low] + slope[low] * neighbours[0]);
            neighbours[1] = project(intercept[high] + slope[high] * neighbours[1]);
            z[low] = neighbours[0];
            z[high] = neighbours[1];
            high += 1;
        }
        while low > 0 {
            low -= 1;
            neighbours[0] = project(intercept[low] + slope[low] * neighbours[0]);
            z[low] = neighbours[0];
        }
        while high < size {
            neighbours[1] = project(intercept[high] + slope[high] * neighbours[1]);
            z[high] = neighbours[1];
            high += 1;
        }
    }

    /// The first and the last row of the contact set where it is one run with the seed in it.
    pub fn run(&self, contact: &[bool]) -> Option<(usize, usize)> {
        let first = contact.iter().position(|c| *c)?;
        let last = contact.iter().rposition(|c| *c)?;
        let around = first <= self.seed && self.seed <= last;
        (around && contact[first..=last].iter().all(|c| *c)).then_some((first, last))
    }

    /// Write the solution on the rows outside a run in contact.
    pub fn solve_outside(&self, (first, last): (usize, usize), z: &mut [f64]) {
        z[first..=last].fill(0.0);
        let mut neighbour = 0.0;
        for row in (0..first).rev() {
            neighbour = self.intercept[row] + self.slope[row] * neighbour;
            z[row] = neighbour;
        }
        neighbour = 0.0;
        for (row, entry) in z.iter_mut().enumerate().skip(last + 1) {
            neighbour = self.intercept[row] + self.slope[row] * neighbour;
            *entry = neighbour;
        }
    }

    /// Write the response to a unit in row `free`, the first one outside the run; return its rows.
    pub fn respond(&self, free: usize, response: &mut [f64]) -> (usize, usize) {
        let size = response.len();
        let mut value = self.reciprocal[free];
        response[free] = value;
        if free > self.seed {
            let beyond = free + 1;
            let rows = response[beyond..].iter_mut().zip(&self.slope[beyond..]);
            for (k, (entry, slope)) in rows.enumerate() {
                value *= slope;
                if value.abs() < SMALLEST_RESPONSE {
                    return (free, beyond + k);
                }
                *entry = value;
            }
            return (free, size);
        }
        for row in (0..free).rev() {
            value *= self.slope[row];
            if value.abs() < SMALLEST_RESPONSE {
                return (row + 1, free + 1);
            }
            response[row] = value;
        }
        (0, free + 1)
    }
}

/// The rows on one side of the seed, from the end of the grid inward.
struct Side {
    start: Option<usize>,
    rising: bool,
}

impl Side {
    fn below(seed: usize) -> Self {
        Self {
            start: (seed > 0).then_some(0),
            rising: true,
        }
    }

    fn above(seed: usize, size: usize) -> Self {
        Self {
            start: (seed + 1 < size).then_some(size - 1),
            rising: false,
        }
    }

    fn first(&self) -> Option<usize> {
        self.start
    }

    fn next(&self, row: usize) -> usize {
        if self.rising {
            row + 1
        } else {
            row - 1
        }
    }
}
