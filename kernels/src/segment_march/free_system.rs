//! Linear solves on the free nodes, for any contact set.

use super::elimination::{Bands, Factors, SMALLEST_RESPONSE};
use crate::error::KernelError;

/// M z + q = 0 on the free rows, z = 0 on the others, for any set of them; and responses to units in q.
pub(super) struct FreeSystem {
    by_factors: bool,
    reciprocal: Vec<f64>,
    factor: Vec<f64>,
    response: Vec<f64>,
    rows: (usize, usize),
}

impl FreeSystem {
    pub fn new(size: usize) -> Self {
        Self {
            by_factors: false,
            reciprocal: vec![0.0; size],
            factor: vec![0.0; size],
            response: vec![0.0; size],
            rows: (0, 0),
        }
    }

    /// Write z. `factors`, whose intercepts belong to q, do it where the contact set is one run around their seed;
    /// there `solved` is their solution for it, if that is at hand.
    pub fn solve(
        &mut self,
        bands: &Bands,
        factors: &Factors,
        q: &[f64],
        contact: &[bool],
        solved: Option<&[f64]>,
        z: &mut [f64],
    ) -> Result<(), KernelError> {
        let run = factors.run(contact);
        self.by_factors = run.is_some();
        if let Some(run) = run {
            match solved {
                Some(solved) => z.copy_from_slice(solved),
                None => factors.solve_outside(run, z),
            }
            return Ok(());
        }
        let size = z.len();
        let (mut before, mut factor) = (0.0, 0.0);
        for i in 0..size {
            if contact[i] {
                (before, factor) = (0.0, 0.0);
            } else {
                // The first row's `before` and `factor` are 0, so that the end node plays no part.
                let pivot = bands.diagonal[i] - bands.lower[i] * factor;
                if pivot == 0.0 {
                    return Err(KernelError::ZeroPivot { row: i });
                }
                let reciprocal = 1.0 / pivot;
                before = (-q[i] - bands.lower[i] * before) * reciprocal;
                factor = bands.upper[i] * reciprocal;
                self.reciprocal[i] = reciprocal;
            }
            (z[i], self.factor[i]) = (before, factor);
        }
        for i in (1..size).rev() {
            if !contact[i - 1] {
                z[i - 1] -= self.factor[i - 1] * z[i];
            }
        }
        Ok(())
    }

    /// Keep the solution for a unit in row `free` on the right-hand side; return its entry in that row.
    pub fn respond(
        &mut self,
        bands: &Bands,
        factors: &Factors,
        contact: &[bool],
        free: usize,
    ) -> f64 {
        if self.by_factors {
            self.rows = factors.respond(free, &mut self.response);
            return self.response[free];
        }
        let size = contact.len();
        let mut value = self.reciprocal[free];
        self.response[free] = value;
        let mut end = free + 1;
        while end < size && !contact[end] {
            value *= -bands.lower[end] * self.reciprocal[end];
            if value.abs() < SMALLEST_RESPONSE {
                break;
            }
            self.response[end] = value;
            end += 1;
        }
        for i in (free..end - 1).rev() {
            self.response[i] -= self.factor[i] * self.response[i + 1];
        }
        value = self.response[free];
        let mut start = free;
        while start > 0 && !contact[start - 1] {
            value *= -self.factor[start - 1];
            if value.abs() < SMALLEST_RESPONSE {
                break;
            }
            start -= 1;
            self.response[start] = value;
        }
        self.rows = (start, end);
        self.response[free]
    }

    /// Add `missing` times the response kept.
    pub fn add(&self, missing: f64, z: &mut [f64]) {
        let (start, end) = self.rows;
        for (value, response) in z[start..end].iter_mut().zip(&self.response[start..end]) {
            *value += missing * response;
        }
    }
}
