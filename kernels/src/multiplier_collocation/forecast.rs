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
}

impl Forecast {
    /// The standard deviation of ln S.
    pub fn deviation(&self) -> f64 {
        self.variance.sqrt()
    }

    /// The forecast at the beginning of a segment, from this one at its end.
    pub fn before(&self, segment: &Segment) -> Forecast {
        let dynamics = &segment.dynamics;
        Forecast {
            forward: self.forward - (dynamics.rate - dynamics.dividend) * segment.duration,
            variance: self.variance - segment.spread().powi(2),
        }
    }
}

/// The forecasts at the ends of all segments, before their events, for x now.
pub fn forecasts(segments: &[Segment], x: f64) -> Vec<Forecast> {
    let (mut variance, mut forward) = (0.0, x);
    segments
        .iter()
        .map(|segment| {
            let dynamics = &segment.dynamics;
            variance += dynamics.volatility * dynamics.volatility * segment.duration;
            forward += (dynamics.rate - dynamics.dividend) * segment.duration;
            let here = Forecast { forward, variance };
            let spot = forward.exp();
            let left =
                (spot * (1.0 - segment.fraction) - segment.amount).max(SMALLEST_FORWARD * spot);
            forward += (left / spot).ln();
            here
        })
        .collect()
}
