//! One implicit stage: the complementarity problem by one elimination or by policy iteration.

use std::sync::atomic::{AtomicBool, Ordering};

use super::boundary_cell::{Correction, Placed};
use super::elimination::{Bands, Factors};
use super::{larger, Segment};
use crate::error::KernelError;
use crate::interrupt::Interrupt;
use crate::policy_iteration::{iterate, Settling};

/// The largest natural residual of an exact elimination, as a share of v and max(1, s).
pub(super) const NEGLIGIBLE: f64 = 1e-11;
/// The wrong sign in a row that counts as rounding, as a share of the row's terms.
const ROUNDING: f64 = 1e-14;
/// The number of independent maxima that are kept side by side, so that none waits for the one before it.
const LANES: usize = 4;

/// How far z and w are from complementary, in units of max(1, s).
#[derive(Clone, Copy)]
pub(super) struct Measured {
    /// max |min(z, w/d)|, d the diagonal of M: an error of v itself.
    pub residual: f64,
    /// max z, or 0 where that is larger.
    pub largest: f64,
}

impl Measured {
    /// The residual that rounding explains.
    pub fn rounding(self) -> f64 {
        NEGLIGIBLE * (self.largest + 1.0)
    }
}

/// The state after the last stage, and the buffers of the next one.
pub(super) struct Stage<'a> {
    segment: &'a Segment<'a>,
    pub value: Vec<f64>,
    pub slack: Vec<f64>,
    pub contact: Vec<bool>,
    pub residual: f64,
    interrupt: Interrupt<'a>,
    /// Whether the interrupt came in a stage, whose state is then worth nothing.
    pub interrupted: bool,
    w: Vec<f64>,
    q: Vec<f64>,
    weights: Vec<f64>,
    pub bands: Bands,
    /// Where the boundary lies in the cells that the last stage was corrected for.
    pub placed: Vec<Placed>,
    factors: Factors,
    basic_set: Vec<bool>,
    scratch: Vec<f64>,
    correction: Correction,
}

impl<'a> Stage<'a> {
    pub fn new(
        segment: &'a Segment<'a>,
        value: &[f64],
        contact: &[bool],
        interrupt: Interrupt<'a>,
    ) -> Self {
        let size = segment.size();
        let weight = |s: &f64| 1.0 / larger(*s, 1.0);
        Self {
            segment,
            value: value.to_vec(),
            slack: vec![0.0; size],
            contact: contact.to_vec(),
            residual: 0.0,
            interrupt,
            interrupted: false,
            w: vec![0.0; size],
            q: vec![0.0; size],
            weights: segment.nodes[1..=size].iter().map(weight).collect(),
            bands: Bands::new(size),
            placed: Vec::new(),
            factors: Factors::new(size),
            basic_set: vec![false; size],
            scratch: vec![0.0; size],
            correction: Correction::new(size),
        }
    }

    /// Solve (I - hL) v = base + h e + h u at t, years before the segment's end.
    pub fn solve(&mut self, t: f64, h: f64, base: &[f64]) -> Result<(), KernelError> {
        if h.is_nan() || h.to_bits() != self.bands.h.to_bits() {
            self.bands.form(self.segment, h);
            self.factors.factor(&self.bands)?;
        }
        self.placed.clear();
        if !self.segment.exercisable {
            self.solve_unconstrained(t, base);
            return Ok(());
        }
        let strike_left = self.segment.strike_left(t);
        self.form_q(strike_left, t, base);
        let direct = self.solve_complementarity()?;
        for (contact, z) in self.contact.iter_mut().zip(&self.slack) {
            *contact = *z == 0.0;
        }
        if self.contact.contains(&true) {
            self.correct(direct)?;
        }
        let (sign, nodes) = (self.segment.sign, &self.segment.nodes[1..]);
        for ((value, z), s) in self.value.iter_mut().zip(&self.slack).zip(nodes) {
            *value = sign * (strike_left - s) + z;
        }
        Ok(())
    }

    /// Choose the seed for the stages of a step.
    pub fn begin_step(&mut self) {
        let seed = self.segment.seed(&self.contact);
        if seed != self.factors.seed {
            self.factors.seed = seed;
            self.bands.h = f64::NAN;
        }
    }

    /// u >= 0 at the end of the last stage, per year.
    pub fn multiplier(&self) -> Vec<f64> {
        let h = self.bands.h;
        let any = self.segment.exercisable && !h.is_nan();
        let of = |w: &f64| {
            if any {
                crate::positive_part(*w) / h
            } else {
                0.0
            }
        };
        self.w.iter().map(of).collect()
    }

    fn solve_unconstrained(&mut self, t: f64, base: &[f64]) {
        for (q, b) in self.q.iter_mut().zip(base) {
            *q = -b;
        }
        self.subtract_ends(t);
        self.factors.eliminate(&self.q);
        self.factors.substitute(false, &mut self.value);
        self.contact.fill(false);
    }

    /// Subtract h e from q.
    fn subtract_ends(&mut self, t: f64) {
        let (size, ends) = (self.q.len(), self.segment.ends(t));
        self.q[0] -= self.bands.h * (self.segment.lower[0] * ends[0]);
        self.q[size - 1] -= self.bands.h * (self.segment.upper[size - 1] * ends[1]);
    }

    /// Form q = M g - base - h e.
    fn form_q(&mut self, strike_left: f64, t: f64, base: &[f64]) {
        let size = base.len();
        let (sign, nodes) = (self.segment.sign, &self.segment.nodes[..size + 2]);
        let (lower, diagonal, upper) = (
            &self.bands.lower[..size],
            &self.bands.diagonal[..size],
            &self.bands.upper[..size],
        );
        let g = |node: usize| sign * (strike_left - nodes[node]);
        let q = &mut self.q[..size];
        for i in 1..size.saturating_sub(1) {
            q[i] = diagonal[i] * g(i + 1) + (lower[i] * g(i) + upper[i] * g(i + 2)) - base[i];
        }
        let last = size - 1;
        let above = if last > 0 { upper[0] * g(2) } else { 0.0 };
        q[0] = diagonal[0] * g(1) + above - base[0];
        if last > 0 {
            q[last] = diagonal[last] * g(size) + lower[last] * g(last) - base[last];
        }
        self.subtract_ends(t);
    }

    /// Write slack, w and residual; return whether one elimination was enough.
    ///
    /// It is exact where the exercise region is one run around the seed, or empty; policy iteration finds any region.
    fn solve_complementarity(&mut self) -> Result<bool, KernelError> {
        self.factors.eliminate(&self.q);
        self.factors.substitute(true, &mut self.slack);
        self.bands.apply(&self.slack, &self.q, &mut self.w);
        let measured = self.bands.measure(&self.slack, &self.w, &self.weights);
        if measured.residual <= measured.rounding() {
            self.residual = measured.residual;
            return Ok(true);
        }
        for (basic, contact) in self.basic_set.iter_mut().zip(&self.contact) {
            *basic = !contact;
        }
        let settling = Settling {
            tolerance: ROUNDING,
            limit: u32::try_from(self.q.len() + 2).unwrap_or(u32::MAX),
        };
        let (ended, interrupt) = (AtomicBool::new(false), self.interrupt);
        let ask = || {
            let end = interrupt();
            ended.fetch_or(end, Ordering::Relaxed);
            end
        };
        iterate(
            self.bands.matrix(),
            &self.q,
            &mut self.basic_set,
            &mut self.slack,
            &mut self.scratch,
            settling,
            &ask,
        )?;
        self.interrupted |= ended.into_inner();
        self.bands.apply(&self.slack, &self.q, &mut self.w);
        self.residual = self
            .bands
            .measure(&self.slack, &self.w, &self.weights)
            .residual;
        Ok(false)
    }

    /// Place the exercise boundary inside its cell, unless that makes the residual larger.
    fn correct(&mut self, direct: bool) -> Result<(), KernelError> {
        let (bands, factors) = (&self.bands, &self.factors);
        let correction = &mut self.correction;
        let solved = direct.then_some(&self.slack[..]);
        let (q, contact) = (&mut self.q, &self.contact);
        if !correction.settle(self.segment, bands, factors, q, contact, solved)? {
            return Ok(());
        }
        bands.apply(&correction.slack, &self.q, &mut correction.w);
        let measured = bands.measure(&correction.slack, &correction.w, &self.weights);
        if measured.residual > self.residual + measured.rounding() {
            return Ok(());
        }
        self.residual = measured.residual;
        std::mem::swap(&mut self.slack, &mut self.correction.slack);
        std::mem::swap(&mut self.w, &mut self.correction.w);
        std::mem::swap(&mut self.contact, &mut self.correction.contact);
        std::mem::swap(&mut self.placed, &mut self.correction.placed);
        Ok(())
    }
}

impl Bands {
    fn measure(&self, z: &[f64], w: &[f64], weights: &[f64]) -> Measured {
        let size = z.len();
        let (w, weights, reciprocal) = (&w[..size], &weights[..size], &self.reciprocal[..size]);
        let mut top = [[0.0; LANES]; 2];
        let mut see = |lane: usize, i: usize| {
            let natural = smaller(z[i], w[i] * reciprocal[i]).abs();
            top[0][lane] = larger(top[0][lane], natural * weights[i]);
            top[1][lane] = larger(top[1][lane], z[i] * weights[i]);
        };
        let whole = size - size % LANES;
        for first in (0..whole).step_by(LANES) {
            for lane in 0..LANES {
                see(lane, first + lane);
            }
        }
        for i in whole..size {
            see(0, i);
        }
        let [residual, largest] = top.map(|lanes| lanes.into_iter().fold(0.0, larger));
        Measured { residual, largest }
    }
}

/// The smaller of two numbers; NaN stays NaN.
#[inline]
fn smaller(a: f64, b: f64) -> f64 {
    if a < b || a.is_nan() {
        a
    } else {
        b
    }
}
