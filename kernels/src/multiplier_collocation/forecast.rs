//! Where the spot is expected at the ends of the segments, as seen from now.

use super::segment::Segment;

/// The smallest share of the spot that is left by a dividend that would take more; chosen.
const SMALLEST_FORWARD: f64 = 0.1;

/// The distribution of x = ln(S/K) at one time.
#[derive(Clone, Copy)]
pub struct Forecast {
    /// The logarithm of the forward, over the strike.
    pub forward: f64,
    /// The variance of ln S.
    pub variance: f64,
    /// The cash dividends paid so far, with what they would have grown by, in strikes.
    pub paid: f64,
}

impl Forecast {
    /// The standard deviation of ln S.
    pub fn deviation(&self) -> f64 {
        self.variance.sqrt()
    }

    /// x on a path whose spot falls at once by so many standard deviations of ln S, with the same dividends, which take
    /// the more of it; no less than ln `least`.
    pub fn lowest(&self, deviations: f64, least: f64) -> f64 {
        let fallen = (-deviations * self.deviation()).exp();
        let left = self.forward.exp() * fallen - self.paid * (1.0 - fallen);
        left.max(least).ln()
    }

    /// The forecast at the beginning of a segment, from this one at its end.
    pub fn before(&self, segment: &Segment) -> Forecast {
        let dynamics = &segment.dynamics;
        Forecast {
            forward: self.forward - (dynamics.rate - dynamics.dividend) * segment.duration,
            variance: self.variance - segment.spread().powi(2),
            paid: self.paid,
        }
    }
}

/// The forecasts at the ends of all segments, before their events, for x now.
pub fn forecasts(segments: &[Segment], x: f64) -> Vec<Forecast> {
    let (mut variance, mut forward, mut paid) = (0.0, x, 0.0);
    segments
        .iter()
        .map(|segment| {
            let dynamics = &segment.dynamics;
            variance += dynamics.volatility * dynamics.volatility * segment.duration;
            let drift = (dynamics.rate - dynamics.dividend) * segment.duration;
            forward += drift;
            paid *= drift.exp();
            let here = Forecast {
                forward,
                variance,
                paid,
            };
            let spot = forward.exp();
            let left =
                (spot * (1.0 - segment.fraction) - segment.amount).max(SMALLEST_FORWARD * spot);
            forward += (left / spot).ln();
            paid = paid * (1.0 - segment.fraction) + segment.amount;
            here
        })
        .collect()
}
