//! A segment of time without events, and the event at its end, in units of the strike and of years.

/// The slope away from the payoff, in slopes of the payoff, from which the contact set begins between two spots, and has
/// two ends; chosen.
pub const OVERHANGING: f64 = 1e-4;

/// The rate and the yield (continuously compounded, per year) and the volatility (per square root of a year) of one
/// segment.
#[derive(Clone, Copy, Debug)]
pub struct Dynamics {
    pub rate: f64,
    pub dividend: f64,
    pub volatility: f64,
}

impl Dynamics {
    /// The drift of ln S, per year: r - q - sigma^2/2.
    pub fn drift(&self) -> f64 {
        self.rate - self.dividend - 0.5 * self.volatility * self.volatility
    }
}

/// One segment; s is the time to its end, from 0 (its end) to `duration` (its beginning).
#[derive(Clone, Copy, Debug)]
pub struct Segment {
    /// 1 for a put, -1 for a call.
    pub sign: f64,
    pub dynamics: Dynamics,
    /// Years.
    pub duration: f64,
    /// Whether the option may be exercised at any time inside.
    pub exercisable: bool,
    /// Whether it may be exercised at the end, just before the event.
    pub exercise_at_end: bool,
    /// The event: at the end the spot drops from S to max(S (1 - fraction) - amount, 0).
    pub fraction: f64,
    pub amount: f64,
    /// The dividends set aside at the end, before the event, which exercise is not paid; in strikes.
    pub escrow: f64,
}

impl Segment {
    /// The standard deviation of ln S over the segment, sigma sqrt(h).
    pub fn spread(&self) -> f64 {
        self.dynamics.volatility * self.duration.sqrt()
    }

    /// Whether nothing happens to the spot at the end.
    #[allow(clippy::float_cmp)] // an absent drop is exactly 0
    pub fn is_continuous(&self) -> bool {
        self.fraction == 0.0 && self.amount == 0.0
    }

    /// The strike less the escrow, over the strike, at time s.
    pub fn strike(&self, s: f64) -> f64 {
        1.0 - self.escrow * (-self.dynamics.rate * s).exp()
    }

    /// The payoff without its positive part, in strikes, at x = ln(S/K) and time s.
    pub fn payoff(&self, x: f64, s: f64) -> f64 {
        self.sign * (self.strike(s) - x.exp())
    }

    /// What waiting costs and what it brings at exercise, per year and unit: (r, q) for a put, (q, r) for a call.
    fn cost_rates(&self) -> (f64, f64) {
        if self.sign > 0.0 {
            (self.dynamics.rate, self.dynamics.dividend)
        } else {
            (self.dynamics.dividend, self.dynamics.rate)
        }
    }

    /// Whether waiting costs anything at some spot: the multiplier is positive there.
    #[allow(clippy::float_cmp)] // a rate of exactly 0
    pub fn has_cost_of_waiting(&self) -> bool {
        let (first, second) = self.cost_rates();
        first > 0.0 || (first == 0.0 && second < 0.0)
    }

    /// Whether the contact set can have two ends: q < r < 0 for a put, r < q < 0 for a call.
    pub fn is_two_sided(&self) -> bool {
        let (first, second) = self.cost_rates();
        second < first && first < 0.0
    }

    /// By how much the share grows over the segment where the contact set begins between two spots, 0 elsewhere: that of a
    /// put before a cash dividend, with a negative yield.
    pub fn overhang(&self) -> f64 {
        let is_paid_in_cash = self.amount > 0.0 || self.escrow > 0.0;
        if self.sign > 0.0 && is_paid_in_cash && self.dynamics.rate > 0.0 {
            (-self.dynamics.dividend * self.duration).max(0.0)
        } else {
            0.0
        }
    }

    /// The x beyond which the multiplier is negative and no contact set reaches: ln(r/q), infinite without such a place.
    pub fn zero_of_multiplier(&self) -> f64 {
        if self.dynamics.rate > 0.0 && self.dynamics.dividend > 0.0 {
            (self.dynamics.rate / self.dynamics.dividend).ln()
        } else {
            self.sign * f64::INFINITY
        }
    }

    /// The boundary of the option that never expires, as ln(S*/K); infinite where that is never exercised.
    pub fn perpetual_boundary(&self) -> f64 {
        let dynamics = &self.dynamics;
        let half = 0.5 * dynamics.volatility * dynamics.volatility;
        let drift = dynamics.drift();
        let root = (drift * drift + 4.0 * half * dynamics.rate).sqrt();
        let exponent = (-drift - self.sign * root) / (2.0 * half);
        let ratio = exponent / (exponent - 1.0);
        if ratio > 0.0 {
            ratio.ln()
        } else {
            -self.sign * f64::INFINITY
        }
    }

    /// The x up to which the event takes the whole spot, -infinity where it never does.
    pub fn paid_out_below(&self) -> f64 {
        let ratio = self.amount / (1.0 - self.fraction);
        if ratio > 0.0 {
            ratio.ln()
        } else {
            f64::NEG_INFINITY
        }
    }

    /// Cut at time s to the end: the earlier part, and the later one, which keeps the event.
    pub fn split(&self, s: f64) -> (Segment, Segment) {
        let earlier = Segment {
            duration: self.duration - s,
            exercise_at_end: self.exercisable,
            fraction: 0.0,
            amount: 0.0,
            escrow: self.escrow * (-self.dynamics.rate * s).exp(),
            ..*self
        };
        (
            earlier,
            Segment {
                duration: s,
                ..*self
            },
        )
    }
}
