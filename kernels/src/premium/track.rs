//! What a march remembers of the exercise boundary.

use super::obstacle::Contracts;
use super::plan::Step;
use crate::lanes::normal::ln;
use crate::lanes::vector::Vector;

/// What a march remembers of the boundary, in units of spread.
pub struct Track<V> {
    /// (r - q - sigma^2/2) T / spread.
    pub drift: V,
    /// Just before expiry.
    pub start: V,
    /// Of the option without expiry.
    pub perpetual: V,
    /// ln(S*/K)/spread after the last step, and its derivatives by rate, dividend and spread.
    pub held: V,
    pub held_by: [V; 3],
    /// (ln(S*/K)/spread - start)/sqrt(t) after the last three, newest first.
    pub reduced: [V; 3],
    /// The derivatives of `drift`, `start`, and of the newest two of `reduced`.
    pub drift_by: [V; 3],
    pub start_by: [V; 3],
    pub reduced_by: [[V; 3]; 2],
    /// The time that made the change in `push` (1 at first), and the speed of the labels in the last step.
    pub change_time: f64,
    pub speed: V,
    pub speed_by: [V; 3],
}

impl<V: Vector> Track<V> {
    #[inline(always)]
    pub fn new(contracts: &Contracts<V>) -> Self {
        let Contracts {
            rate,
            dividend,
            spread,
        } = *contracts;
        let drift = (rate - dividend - (spread * spread).times(0.5)) / spread;
        let early = ln((-dividend).negative(rate / dividend, V::all(1.0)));
        let start = early.min(V::zero()) / spread;
        let decay = drift + (drift * drift + rate + rate).sqrt();
        let perpetual = -(ln((spread / decay).plus(1.0)) / spread);
        let inverse = V::all(1.0) / spread;
        let zero = V::zero();
        Self {
            drift,
            start,
            perpetual,
            held: start,
            held_by: [zero; 3],
            reduced: [zero; 3],
            drift_by: [inverse, -inverse, -(drift * inverse).plus(1.0)],
            start_by: [
                early.negative(inverse / rate, zero),
                early.negative(-(inverse / dividend), zero),
                early.negative(-(start * inverse), zero),
            ],
            reduced_by: [[zero; 3]; 2],
            change_time: 1.0,
            speed: zero,
            speed_by: [zero; 3],
        }
    }

    /// Between the perpetual boundary and that of the last step.
    #[inline(always)]
    pub fn bounded(&self, x: V) -> V {
        x.min(self.held).max(self.perpetual)
    }

    /// Extrapolate (ln(S*/K)/spread - start)/sqrt(t) to the end of a step.
    #[inline(always)]
    pub fn predicted(&self, step: &Step) -> V {
        self.reduced[0].times(step.prediction[0])
            + self.reduced[1].times(step.prediction[1])
            + self.reduced[2].times(step.prediction[2])
    }

    /// How label 0 moves with the parameters at a step's end. Any motion serves; this is the boundary's, a step before.
    #[inline(always)]
    pub fn following(&self, t: f64) -> [V; 3] {
        let mut by = self.held_by;
        for (by, drift) in by.iter_mut().zip(self.drift_by) {
            *by = drift.times_plus(V::all(t), *by);
        }
        by
    }

    /// Keep a place of the boundary and how the parameters move it in xi.
    #[inline(always)]
    pub fn remember(&mut self, x: V, found_by: [V; 3], root: f64) {
        self.held = x;
        let newest = (x - self.start).times(1.0 / root);
        self.reduced = [newest, self.reduced[0], self.reduced[1]];
        let mut by = found_by;
        for (j, by) in by.iter_mut().enumerate() {
            self.held_by[j] = *by - self.drift_by[j].times(root * root);
            *by = (self.held_by[j] - self.start_by[j]).times(1.0 / root);
        }
        self.reduced_by = [by, self.reduced_by[0]];
    }
}
