//! A stretch of time without events, and the event at its end, in units of the strike and of years.

/// Rate, yield and volatility of one stretch.
#[derive(Clone, Copy, Debug)]
pub struct Flow {
    pub rate: f64,
    pub dividend: f64,
    pub volatility: f64,
}

impl Flow {
    /// Of ln(spot), per year.
    pub fn drift(&self) -> f64 {
        self.rate - self.dividend - 0.5 * self.volatility * self.volatility
    }
}

/// s is the time to the stretch's end.
#[derive(Clone, Copy, Debug)]
pub struct Stretch {
    /// 1 for a put, -1 for a call.
    pub sign: f64,
    pub flow: Flow,
    pub duration: f64,
    pub exercisable: bool,
    pub exercise_at_end: bool,
    /// At the end the spot drops from S to max(S (1 - fraction) - amount, 0).
    pub fraction: f64,
    pub amount: f64,
    /// At the end, before that drop.
    pub escrow: f64,
}

impl Stretch {
    /// sigma sqrt(h).
    pub fn spread(&self) -> f64 {
        self.flow.volatility * self.duration.sqrt()
    }

    /// Whether nothing happens to the spot at the end.
    #[allow(clippy::float_cmp)] // an absent drop is exactly 0
    pub fn is_continuous(&self) -> bool {
        self.fraction == 0.0 && self.amount == 0.0
    }

    /// What exercise is measured against, K - A over K.
    pub fn strike(&self, s: f64) -> f64 {
        1.0 - self.escrow * (-self.flow.rate * s).exp()
    }

    /// What exercise brings, which may be negative.
    pub fn payoff(&self, x: f64, s: f64) -> f64 {
        self.sign * (self.strike(s) - x.exp())
    }

    fn interest(&self) -> (f64, f64) {
        if self.sign > 0.0 {
            (self.flow.rate, self.flow.dividend)
        } else {
            (self.flow.dividend, self.flow.rate)
        }
    }

    /// Whether holding can cost anything: the multiplier is positive at some spot.
    #[allow(clippy::float_cmp)] // a rate of exactly 0
    pub fn can_pay(&self) -> bool {
        let (first, second) = self.interest();
        first > 0.0 || (first == 0.0 && second < 0.0)
    }

    /// Whether the contact set can have two ends.
    pub fn is_two_sided(&self) -> bool {
        let (first, second) = self.interest();
        second < first && first < 0.0
    }

    /// The x beyond which the multiplier is negative: ln(r/q), infinite where it never is.
    pub fn furthest(&self) -> f64 {
        if self.flow.rate > 0.0 && self.flow.dividend > 0.0 {
            (self.flow.rate / self.flow.dividend).ln()
        } else {
            self.sign * f64::INFINITY
        }
    }

    /// The boundary of the option that never expires, as ln(S*/K); infinite where that is never exercised.
    pub fn perpetual(&self) -> f64 {
        let flow = &self.flow;
        let half = 0.5 * flow.volatility * flow.volatility;
        let drift = flow.drift();
        let root = (drift * drift + 4.0 * half * flow.rate).sqrt();
        let exponent = (-drift - self.sign * root) / (2.0 * half);
        let ratio = exponent / (exponent - 1.0);
        if ratio > 0.0 {
            ratio.ln()
        } else {
            -self.sign * f64::INFINITY
        }
    }

    /// The x up to which the event takes the whole spot.
    pub fn gone(&self) -> f64 {
        let ratio = self.amount / (1.0 - self.fraction);
        if ratio > 0.0 {
            ratio.ln()
        } else {
            f64::NEG_INFINITY
        }
    }

    /// The stretch cut at time s to its end: the earlier part and the later one, which keeps the event.
    pub fn parted(&self, s: f64) -> (Stretch, Stretch) {
        let earlier = Stretch {
            duration: self.duration - s,
            exercise_at_end: self.exercisable,
            fraction: 0.0,
            amount: 0.0,
            escrow: self.escrow * (-self.flow.rate * s).exp(),
            ..*self
        };
        (
            earlier,
            Stretch {
                duration: s,
                ..*self
            },
        )
    }
}
