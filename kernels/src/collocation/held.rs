//! A stretch that is solved: the value at its beginning as a function of x.

use super::boundary::Boundary;
use super::profile::Profile;
use super::stretch::Stretch;
use super::values::Continuation;

pub struct Held {
    /// At the stretch's end, after what the holder may do there.
    pub profile: Profile,
    /// Of each of its panels.
    pub points: usize,
    pub stretch: Stretch,
    /// None where the option is not exercised at the beginning.
    pub boundary: Option<Boundary>,
    /// The value at spot zero.
    pub at_zero: f64,
    /// Whether a share is worth no less than the option gains or loses with it: there was no negative yield.
    pub is_monotone: bool,
}

impl Held {
    /// The end of the contact set, NaN without one.
    pub fn edge(&self) -> f64 {
        self.boundary.as_ref().map_or(f64::NAN, |b| b.last)
    }

    /// What exercise is measured against.
    pub fn strike(&self) -> f64 {
        self.stretch.strike(self.stretch.duration)
    }

    /// Value, slope and second derivative of holding on.
    pub fn continued(&self, x: f64) -> [f64; 3] {
        let mut out = self
            .profile
            .propagate(&self.stretch.flow, x, self.stretch.duration);
        if let Some(boundary) = &self.boundary {
            let part = boundary.contribution(x);
            for (total, part) in out.iter_mut().zip(part) {
                *total += part;
            }
        }
        out
    }

    /// The value at increasing places: the payoff's on the contact set.
    pub fn values(&self, continuation: &Continuation, places: &[f64]) -> Vec<f64> {
        let mut values = continuation.values(places);
        if self.boundary.is_some() {
            let (sign, edge, strike) = (self.stretch.sign, self.edge(), self.strike());
            for (value, x) in values.iter_mut().zip(places) {
                if sign * (edge - x) >= 0.0 {
                    *value = sign * (strike - x.exp());
                }
            }
        }
        values
    }

    /// Value, slope and second derivative: the payoff's on the contact set.
    pub fn value(&self, x: f64) -> [f64; 3] {
        let sign = self.stretch.sign;
        if self.boundary.is_some() && sign * (self.edge() - x) >= 0.0 {
            let paid = -sign * x.exp();
            return [sign * self.strike() + paid, paid, paid];
        }
        self.continued(x)
    }
}
