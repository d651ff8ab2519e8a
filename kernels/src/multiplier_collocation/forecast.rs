//! Where the spot is expected at the ends of the segments, as seen from now.

use super::segment::Segment;

/// The smallest share of the spot that is left by a dividend that would take more; chosen.
const SMALLEST_FORWARD: f64 = 0.1;

/// The shares of the variance still to come at which a spot is taken to meet the strike; chosen: on the way the distance to it
/// is hardly ever smaller, in standard deviations, than at the nearest of these.
const MEETINGS: [f64; 5] = [0.0625, 0.125, 0.25, 0.5, 1.0];

/// The number of largest drops of the spot at which it is taken to meet the strike as well; chosen.
const DROPS: usize = 4;

/// A segment and those after it, and the forecasts at their ends.
pub struct Later<'a> {
    pub segments: &'a [Segment],
    pub forecasts: &'a [Forecast],
    /// The places of those that end with the largest drops.
    pub largest_drops: Vec<usize>,
}

impl<'a> Later<'a> {
    /// Those from the place `index` on.
    pub fn from(segments: &'a [Segment], forecasts: &'a [Forecast], index: usize) -> Later<'a> {
        let (segments, forecasts) = (&segments[index..], &forecasts[index..]);
        let mut places: Vec<usize> = (0..segments.len()).collect();
        if places.len() > DROPS {
            places.select_nth_unstable_by(DROPS, |a, b| {
                forecasts[*b].drop.total_cmp(&forecasts[*a].drop)
            });
            places.truncate(DROPS);
        }
        Later {
            segments,
            forecasts,
            largest_drops: places,
        }
    }
}

/// The distribution of x = ln(S/K) at one time.
#[derive(Clone, Copy)]
pub struct Forecast {
    /// The logarithm of the forward, over the strike.
    pub forward: f64,
    /// The variance of ln S.
    pub variance: f64,
    /// The cash dividends paid so far, with what they would have grown by, in strikes.
    pub paid: f64,
    /// The logarithm of the forward, over the strike, of a spot that pays no cash dividends.
    growth: f64,
    /// The share of the forward that the next event takes.
    drop: f64,
}

impl Forecast {
    /// The standard deviation of ln S.
    pub fn deviation(&self) -> f64 {
        self.variance.max(0.0).sqrt()
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
        let drift = (dynamics.rate - dynamics.dividend) * segment.duration;
        Forecast {
            forward: self.forward - drift,
            variance: self.variance - segment.spread().powi(2),
            paid: self.paid * (-drift).exp(),
            growth: self.growth - drift,
            drop: self.drop,
        }
    }

    /// The x furthest away from exercise, above for a put, at which waiting can differ from a line in the spot: on a path that
    /// comes there from now and then meets the strike, and moves by `reach` standard deviations of ln S in all, the root of
    /// the sum of the squares of both ways. None where a call is in the money whatever happens. `later` are the segments that
    /// end later, the forecasts at their ends, and which of them end with the largest drops.
    pub fn furthest_held(&self, later: &Later, reach: f64) -> Option<f64> {
        let sign = later.segments[0].sign;
        let still_to_come = later.forecasts.last()?.variance - self.variance;
        let on_the_way = MEETINGS.map(|share| {
            let ahead = share * still_to_come;
            let is_before = |end: &Forecast| end.variance < self.variance + ahead;
            let index = later.forecasts.partition_point(is_before);
            (index.min(later.segments.len() - 1), ahead)
        });
        let mut events = later.largest_drops.clone();
        events.push(0);
        events.extend(on_the_way.map(|(index, _)| index));
        events.sort_unstable();
        events.dedup();
        let at_events = events
            .into_iter()
            .map(|index| self.meeting_at(later, index));
        on_the_way
            .into_iter()
            .chain(at_events)
            .filter_map(|meeting| self.furthest_by_meeting(later, meeting, reach))
            .reduce(|a, b| if sign * (a - b) > 0.0 { a } else { b })
    }

    /// In which segment, and after how much variance, the strike is met at the end of the segment at the place `index`: by a
    /// call before the event, by a put after it.
    fn meeting_at(&self, later: &Later, index: usize) -> (usize, f64) {
        let after = usize::from(later.segments[0].sign > 0.0 && index + 1 < later.segments.len());
        let ahead = (later.forecasts[index].variance - self.variance).max(0.0);
        (index + after, ahead)
    }

    /// The x furthest away from exercise where the strike is met after so much variance, in the segment at the place `index`.
    fn furthest_by_meeting(
        &self,
        later: &Later,
        (index, ahead): (usize, f64),
        reach: f64,
    ) -> Option<f64> {
        let sign = later.segments[0].sign;
        // Cash dividends hardly matter to spots that have risen far.
        let forward = if sign > 0.0 {
            self.growth
        } else {
            self.forward
        };
        // What is left of a put counts in shares on the way there and in cash on the way on, that of a call the other way
        // round: so far these two laws of ln S are from the middle between them.
        let forward = forward + 0.5 * sign * self.variance;
        let strike = self.meeting(&later.segments[index], &later.forecasts[index], ahead)?;
        let strike = strike + 0.5 * sign * ahead;
        let on_the_way_on = strike + sign * reach * ahead.sqrt();
        if sign * (on_the_way_on - forward) <= 0.0 {
            return Some(on_the_way_on);
        }
        // The furthest x with (x - forward)^2/variance + (x - strike)^2/ahead = reach^2.
        let total = self.variance + ahead;
        let square = reach * reach - (forward - strike).powi(2) / total;
        if square < 0.0 {
            return Some(forward + sign * reach * self.deviation());
        }
        let centre = (ahead * forward + self.variance * strike) / total;
        Some(centre + sign * (self.variance * ahead / total * square).sqrt())
    }

    /// The x from which a spot without volatility meets the strike after so much variance, in a segment with the forecast `end`
    /// at its end; None where every spot is above it.
    fn meeting(&self, segment: &Segment, end: &Forecast, ahead: f64) -> Option<f64> {
        let dynamics = &segment.dynamics;
        let s = (end.variance - self.variance - ahead) / dynamics.volatility.powi(2);
        let growth = end.growth - self.growth;
        let paid = end.paid - self.paid * growth.exp();
        let strike = segment.strike(s) * ((dynamics.rate - dynamics.dividend) * s).exp();
        (strike + paid > 0.0).then(|| (strike + paid).ln() - growth)
    }
}

/// The forecasts at the ends of all segments, before their events, for x now.
pub fn forecasts(segments: &[Segment], x: f64) -> Vec<Forecast> {
    let (mut variance, mut forward, mut paid, mut growth) = (0.0, x, 0.0, x);
    segments
        .iter()
        .map(|segment| {
            let dynamics = &segment.dynamics;
            variance += dynamics.volatility * dynamics.volatility * segment.duration;
            let drift = (dynamics.rate - dynamics.dividend) * segment.duration;
            forward += drift;
            growth += drift;
            paid *= drift.exp();
            let spot = forward.exp();
            let left =
                (spot * (1.0 - segment.fraction) - segment.amount).max(SMALLEST_FORWARD * spot);
            let here = Forecast {
                forward,
                variance,
                paid,
                growth,
                drop: 1.0 - left / spot,
            };
            forward += (left / spot).ln();
            paid = paid * (1.0 - segment.fraction) + segment.amount;
            growth += (1.0 - segment.fraction).max(SMALLEST_FORWARD).ln();
            here
        })
        .collect()
}
