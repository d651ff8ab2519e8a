//! The matrix M = I - hL of a stage, and its elimination towards the end that lies in the exercise region.

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
    pub largest_diagonal: f64,
}

impl Bands {
    pub fn new(size: usize) -> Self {
        Self {
            h: f64::NAN,
            lower: vec![0.0; size],
            diagonal: vec![0.0; size],
            upper: vec![0.0; size],
            largest_diagonal: 0.0,
        }
    }

    /// Form M for steps of size h.
    pub fn form(&mut self, segment: &Segment<'_>, h: f64) {
        self.h = h;
        self.largest_diagonal = f64::NEG_INFINITY;
        for i in 0..self.diagonal.len() {
            self.lower[i] = -h * segment.lower[i];
            self.upper[i] = -h * segment.upper[i];
            self.diagonal[i] = 1.0 - h * segment.diagonal[i];
            self.largest_diagonal = self.largest_diagonal.max(self.diagonal[i]);
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
            diagonal[i] * z[i] + lower[i] * below + upper[i] * above + q[i]
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

/// The index of the k-th entry, counted from the contact end.
#[inline]
fn at<const CONTACT_FIRST: bool>(k: usize, size: usize) -> usize {
    if CONTACT_FIRST {
        k
    } else {
        size - 1 - k
    }
}

/// Brennan and Schwartz's elimination towards the contact end, its pivots kept for further right-hand sides.
///
/// z[row] = intercept[row] + slope[row] z[next], next the row after it on the contact side: the solution of
/// M z + q = 0 on every run of rows that leads from the far end up to a row in contact.
pub(super) struct Factors {
    contact_first: bool,
    reciprocal: Vec<f64>,
    slope: Vec<f64>,
    carry: Vec<f64>,
    intercept: Vec<f64>,
}

impl Factors {
    pub fn new(size: usize, contact_first: bool) -> Self {
        Self {
            contact_first,
            reciprocal: vec![0.0; size],
            slope: vec![0.0; size],
            carry: vec![0.0; size],
            intercept: vec![0.0; size],
        }
    }

    /// Compute the pivots.
    pub fn factor(&mut self, bands: &Bands) -> Result<(), KernelError> {
        if self.contact_first {
            self.factor_towards::<true>(bands)
        } else {
            self.factor_towards::<false>(bands)
        }
    }

    fn factor_towards<const CONTACT_FIRST: bool>(
        &mut self,
        bands: &Bands,
    ) -> Result<(), KernelError> {
        let size = self.reciprocal.len();
        // `inward` couples a row to the next one on its contact side, `outward` to the one before it.
        let (inward, outward) = if CONTACT_FIRST {
            (&bands.lower[..size], &bands.upper[..size])
        } else {
            (&bands.upper[..size], &bands.lower[..size])
        };
        let mut row = at::<CONTACT_FIRST>(size - 1, size);
        let mut pivot = bands.diagonal[row];
        for k in (1..size).rev() {
            let next = at::<CONTACT_FIRST>(k - 1, size);
            if pivot == 0.0 {
                return Err(KernelError::ZeroPivot { row });
            }
            let reciprocal = 1.0 / pivot;
            self.reciprocal[row] = reciprocal;
            self.slope[row] = -inward[row] * reciprocal;
            self.carry[row] = outward[next] * reciprocal;
            // Its own division keeps the chain from pivot to pivot short.
            pivot = bands.diagonal[next] - outward[next] * inward[row] / pivot;
            row = next;
        }
        if pivot == 0.0 {
            return Err(KernelError::ZeroPivot { row });
        }
        (self.reciprocal[row], self.slope[row]) = (1.0 / pivot, 0.0);
        Ok(())
    }

    /// Carry q along: the intercepts.
    pub fn eliminate(&mut self, q: &[f64]) {
        if self.contact_first {
            self.eliminate_towards::<true>(q);
        } else {
            self.eliminate_towards::<false>(q);
        }
    }

    fn eliminate_towards<const CONTACT_FIRST: bool>(&mut self, q: &[f64]) {
        let size = q.len();
        let (reciprocal, carry) = (&self.reciprocal[..size], &self.carry[..size]);
        let intercept = &mut self.intercept[..size];
        let mut row = at::<CONTACT_FIRST>(size - 1, size);
        let mut rest = q[row];
        for k in (1..size).rev() {
            intercept[row] = -rest * reciprocal[row];
            let next = at::<CONTACT_FIRST>(k - 1, size);
            rest = q[next] - carry[row] * rest;
            row = next;
        }
        intercept[row] = -rest * reciprocal[row];
    }

    /// Write the solution of M z + q = 0 on all rows, or of the complementarity problem by projection.
    pub fn substitute(&self, projected: bool, z: &mut [f64]) {
        let free = |x: f64| x;
        match (self.contact_first, projected) {
            (true, true) => self.substitute_from::<true>(0, z, positive_part),
            (false, true) => self.substitute_from::<false>(0, z, positive_part),
            (true, false) => self.substitute_from::<true>(0, z, free),
            (false, false) => self.substitute_from::<false>(0, z, free),
        }
    }

    fn substitute_from<const CONTACT_FIRST: bool>(
        &self,
        contact: usize,
        z: &mut [f64],
        project: impl Fn(f64) -> f64,
    ) {
        let size = z.len();
        let (intercept, slope) = (&self.intercept[..size], &self.slope[..size]);
        let mut neighbour = 0.0;
        for k in contact..size {
            let row = at::<CONTACT_FIRST>(k, size);
            neighbour = project(intercept[row] + slope[row] * neighbour);
            z[row] = neighbour;
        }
    }

    /// The length of the contact set where it is one run at the contact end (or empty).
    pub fn run_length(&self, contact: &[bool]) -> Option<usize> {
        let size = contact.len();
        let length = contact.iter().filter(|c| **c).count();
        let run = if self.contact_first {
            &contact[..length]
        } else {
            &contact[size - length..]
        };
        run.iter().all(|c| *c).then_some(length)
    }

    /// Write the solution on the rows beyond a run of `length` rows in contact.
    pub fn solve_beyond(&self, length: usize, z: &mut [f64]) {
        let size = z.len();
        if self.contact_first {
            z[..length].fill(0.0);
            self.substitute_from::<true>(length, z, |x| x);
        } else {
            z[size - length..].fill(0.0);
            self.substitute_from::<false>(length, z, |x| x);
        }
    }

    /// Write the response to a unit in row `free`, the first one beyond the run; return its rows.
    pub fn respond(&self, free: usize, response: &mut [f64]) -> (usize, usize) {
        let size = response.len();
        let mut value = self.reciprocal[free];
        response[free] = value;
        if self.contact_first {
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
