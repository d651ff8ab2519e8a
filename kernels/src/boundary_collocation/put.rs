//! What is known of a put with two boundaries before these are.

use super::integrand::Parameters;

/// A put whose exercise region has two boundaries: dividend < rate < 0.
#[derive(Clone, Copy)]
pub struct Put {
    /// r T, q T and sigma sqrt(T), T being the time to expiry.
    pub parameters: Parameters,
}

impl Put {
    /// Whether all parameters are numbers, and the region has two boundaries.
    pub(super) fn is_served(&self) -> bool {
        let Parameters {
            rate,
            dividend,
            spread,
        } = self.parameters;
        rate < 0.0 && dividend < rate && spread > 0.0 && dividend.is_finite() && spread.is_finite()
    }

    /// The limit of the lower boundary at expiry, ln(r/q).
    pub(super) fn lower_at_expiry(&self) -> f64 {
        (self.parameters.rate / self.parameters.dividend).ln()
    }

    /// The most that the right to exercise early may be worth, over K, where `latest` is the share of the time after which
    /// nothing is exercised.
    pub(super) fn largest_premium(&self, latest: f64) -> f64 {
        let Parameters { rate, dividend, .. } = self.parameters;
        (rate - dividend) * latest * (-rate).exp()
    }

    /// The derivatives of ln(r/q) by rate, dividend and spread.
    pub(super) fn lower_at_expiry_by(&self) -> [f64; 3] {
        let Parameters { rate, dividend, .. } = self.parameters;
        [1.0 / rate, -1.0 / dividend, 0.0]
    }
}
