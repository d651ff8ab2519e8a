//! The exercise boundary of the steps taken so far, and its extrapolation to the next one.
//!
//! All places are x = ln(S*/K)/spread. Near expiry (x - `at_expiry`)/sqrt(t) changes slowly with ln sqrt(t): this
//! reduced boundary is what is extrapolated and differentiated.

use super::contracts::Contracts;
use super::mesh::TimeStep;
use crate::lanes::normal::ln;
use crate::lanes::vector::Vector;

/// The boundary of sixteen puts; what ends in `_by` has the derivatives by rate, dividend and spread.
pub struct BoundaryHistory<V> {
    /// (r - q - sigma^2/2) T / spread: xi - x at t = 1.
    pub drift: V,
    /// The boundary just before expiry.
    pub at_expiry: V,
    /// The boundary of the option without expiry, which no boundary passes.
    pub perpetual: V,
    /// The boundary after the last step.
    pub latest: V,
    /// The boundary after one step of implicit Euler's from expiry to the end of the last step, see `first_step`.
    pub euler: V,
    pub latest_by: [V; 3],
    /// The reduced boundary after the last three steps, newest first.
    pub reduced: [V; 3],
    pub drift_by: [V; 3],
    pub at_expiry_by: [V; 3],
    /// The derivatives of the newest two of `reduced`.
    pub reduced_by: [[V; 3]; 2],
    /// The time over which `GridValues::increment` arose, STAGE times the last step (1 before the second step).
    pub increment_time: f64,
    /// The speed of the nodes in the last step, d xi/dt.
    pub speed: V,
    pub speed_by: [V; 3],
}

impl<V: Vector> BoundaryHistory<V> {
    /// The history at expiry.
    #[inline(always)]
    pub fn new(contracts: &Contracts<V>) -> Self {
        let Contracts {
            rate,
            dividend,
            spread,
        } = *contracts;
        let drift = (rate - dividend - (spread * spread).times(0.5)) / spread;
        let logarithm = ln((-dividend).negative(rate / dividend, V::all(1.0)));
        let at_expiry = logarithm.min(V::zero()) / spread;
        let decay = drift + (drift * drift + rate + rate).sqrt();
        let perpetual = -(ln((spread / decay).plus(1.0)) / spread);
        let inverse = V::all(1.0) / spread;
        let zero = V::zero();
        Self {
            drift,
            at_expiry,
            perpetual,
            latest: at_expiry,
            euler: at_expiry,
            latest_by: [zero; 3],
            reduced: [zero; 3],
            drift_by: [inverse, -inverse, -(drift * inverse).plus(1.0)],
            at_expiry_by: [
                logarithm.negative(inverse / rate, zero),
                logarithm.negative(-(inverse / dividend), zero),
                logarithm.negative(-(at_expiry * inverse), zero),
            ],
            reduced_by: [[zero; 3]; 2],
            increment_time: 1.0,
            speed: zero,
            speed_by: [zero; 3],
        }
    }

    /// The place, moved between the perpetual boundary and that of the last step.
    #[inline(always)]
    pub fn bounded(&self, x: V) -> V {
        x.min(self.latest).max(self.perpetual)
    }

    /// Extrapolate the reduced boundary to the end of a step.
    #[inline(always)]
    pub fn predicted(&self, step: &TimeStep) -> V {
        self.reduced[0].times(step.prediction[0])
            + self.reduced[1].times(step.prediction[1])
            + self.reduced[2].times(step.prediction[2])
    }

    /// The derivatives of xi of node 0 at time t by the parameters: the nodes may move with the parameters in any way;
    /// here they move as the boundary did a step before.
    #[inline(always)]
    pub fn node_motion(&self, t: f64) -> [V; 3] {
        let mut by = self.latest_by;
        for (by, drift) in by.iter_mut().zip(self.drift_by) {
            *by = drift.times_plus(V::all(t), *by);
        }
        by
    }

    /// Keep the boundary x at sqrt(t) = `root`, and how the parameters move it in xi.
    #[inline(always)]
    pub fn record(&mut self, x: V, xi_by: [V; 3], root: f64) {
        self.latest = x;
        let newest = (x - self.at_expiry).times(1.0 / root);
        self.reduced = [newest, self.reduced[0], self.reduced[1]];
        let mut by = xi_by;
        for (j, by) in by.iter_mut().enumerate() {
            self.latest_by[j] = *by - self.drift_by[j].times(root * root);
            *by = (self.latest_by[j] - self.at_expiry_by[j]).times(1.0 / root);
        }
        self.reduced_by = [by, self.reduced_by[0]];
    }
}
