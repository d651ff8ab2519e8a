//! Events so close together that they are taken as one.
//!
//! Between them the spot hardly diffuses, and panels fine enough to see that are thousands. Moving an event by such a time
//! hardly changes the value, as long as an option that is exercised because of it is exercised at the same time: a call
//! before the first of two payments, a put after the last.

use super::gradient::SegmentGradient;
use super::segment::Segment;
use super::unsettled::Unsettled;

/// The largest error by that in a value, in strikes; chosen.
const LARGEST_ERROR: f64 = 3e-8;
/// The largest share of the tolerance that this error may be; chosen.
const LARGEST_SHARE: f64 = 0.5;
/// The smallest standard deviation of ln S over a segment that is solved, and the smallest share of that at expiry; measured.
const SMALLEST_SPREAD: f64 = 1e-7;
const SMALLEST_SHARE_OF_SPREAD: f64 = 5e-4;
/// The smallest payment that is one, as a share of the spot or in strikes; chosen: smaller ones are rounding.
const SMALLEST_PAYMENT: f64 = 1e-12;

/// Consecutive segments solved as one.
#[derive(Clone, Copy)]
struct Group {
    /// The place of the first of them in the schedule, and the place behind the last.
    first: usize,
    end: usize,
    /// The place of the one whose escrow is set aside at the end.
    escrow: usize,
}

/// A schedule whose close events are taken as one.
pub struct Merged {
    pub segments: Vec<Segment>,
    groups: Vec<Group>,
    /// The largest change of the value by that, in strikes.
    pub error: f64,
}

/// Two events, the second at the end of a segment next to the first, and the segment that follows.
struct Pair<'a> {
    first: &'a Segment,
    second: &'a Segment,
    next: Option<&'a Segment>,
}

impl Merged {
    /// Take close events of a schedule as one, as far as the tolerance allows; x is ln(S/K) now, and a tolerance of 0 stands
    /// for one that does not matter. Unsettled where segments are left that are too short for panels.
    pub fn of(segments: &[Segment], x: f64, tolerance: f64) -> Result<Merged, Unsettled> {
        let mut merged = Merged {
            segments: Vec::with_capacity(segments.len()),
            groups: Vec::with_capacity(segments.len()),
            error: 0.0,
        };
        let limit = if tolerance > 0.0 {
            LARGEST_ERROR.min(LARGEST_SHARE * tolerance)
        } else {
            LARGEST_ERROR
        };
        // The time from now to the last end, years, and the spot expected there without dividends, in strikes.
        let (mut time, mut spot) = (0.0, x.exp());
        // By how much what comes next begins earlier.
        let mut earlier = 0.0;
        for (place, segment) in segments.iter().enumerate() {
            let last = merged.segments.last_mut().zip(merged.groups.last_mut());
            if let Some((last, group)) = last {
                let pair = Pair {
                    first: last,
                    second: segment,
                    next: segments.get(place + 1),
                };
                let error = merged.error + pair.error(time, spot);
                if error <= limit && pair.is_representable() {
                    merged.error = error;
                    group.end = place + 1;
                    if !pair.first_pays() {
                        group.escrow = place;
                    }
                    let is_at_first = pair.is_at_first();
                    *last = pair.joined();
                    if is_at_first {
                        earlier += segment.duration;
                    } else {
                        last.duration += segment.duration;
                        time += segment.duration;
                    }
                    continue;
                }
            }
            let duration = segment.duration + earlier;
            earlier = 0.0;
            merged.segments.push(Segment {
                duration,
                ..*segment
            });
            merged.groups.push(Group {
                first: place,
                end: place + 1,
                escrow: place,
            });
            time += duration;
            spot *= ((segment.dynamics.rate - segment.dynamics.dividend) * duration).exp();
        }
        if let Some(last) = merged.segments.last_mut() {
            last.duration += earlier; // nothing came next
        }
        let spreads = || merged.segments.iter().map(Segment::spread);
        let variance: f64 = spreads().map(|spread| spread * spread).sum();
        let least = SMALLEST_SPREAD.max(SMALLEST_SHARE_OF_SPREAD * variance.sqrt());
        if spreads().any(|spread| spread < least) {
            return Err(Unsettled);
        }
        Ok(merged)
    }

    /// The derivatives by the numbers of the segments themselves, from those by the numbers of the merged ones.
    pub fn apart(
        &self,
        segments: &[Segment],
        gradients: &[SegmentGradient],
    ) -> Vec<SegmentGradient> {
        let mut apart = vec![SegmentGradient::default(); segments.len()];
        for (group, gradient) in self.groups.iter().zip(gradients) {
            let members = group.first..group.end;
            let duration: f64 = segments[members.clone()].iter().map(|s| s.duration).sum();
            let mut kept = 1.0;
            for place in members.rev() {
                let segment = &segments[place];
                let share = segment.duration / duration;
                apart[place] = SegmentGradient {
                    rate: gradient.rate.map(|weight| share * weight),
                    dividend: gradient.dividend.map(|weight| share * weight),
                    volatility: gradient.volatility.map(|weight| share * weight),
                    amount: gradient.amount.map(|weight| kept * weight),
                    exercise: gradient.exercise.map(|weight| share * weight),
                    ..SegmentGradient::default()
                };
                kept *= 1.0 - segment.fraction;
            }
            apart[group.escrow].escrow = gradient.escrow;
        }
        apart
    }
}

/// What the event at the end of `segment` pays out of the escrow: that less what the next one begins with, in strikes.
fn paid_from_escrow(segment: &Segment, next: Option<&Segment>) -> f64 {
    let left = next.map_or(0.0, |next| {
        next.escrow * (-next.dynamics.rate * next.duration).exp()
    });
    (segment.escrow - left).max(0.0)
}

/// Whether the event at the end of `segment` pays anything.
fn pays(segment: &Segment, next: Option<&Segment>) -> bool {
    let paid = paid_from_escrow(segment, next)
        .max(segment.amount)
        .max(segment.fraction);
    paid > SMALLEST_PAYMENT
}

impl Pair<'_> {
    fn first_pays(&self) -> bool {
        pays(self.first, Some(self.second))
    }

    fn may_be_exercised_between(&self) -> bool {
        self.second.exercisable || self.second.exercise_at_end
    }

    /// Whether both happen when the first does, and not when the second does: after the first payment a call is not exercised,
    /// nor a put before the second one.
    fn is_at_first(&self) -> bool {
        let second_pays = pays(self.second, self.next);
        self.next.is_some() && self.first_pays() && (self.first.sign < 0.0 || !second_pays)
    }

    /// The most that the value changes, in strikes, if both happen at once; the first is so much `time` from now, where the spot
    /// is expected at `spot`, in strikes.
    ///
    /// What is paid earlier or later has drift and interest on it, and adds the density of the spot times its variance. Rates,
    /// volatilities and exercise on one date alone change the whole value.
    fn error(&self, time: f64, spot: f64) -> f64 {
        // The segment between them takes the numbers of the one that it becomes a part of.
        let (moved, next, becomes) = match self.next {
            Some(next) if self.is_at_first() => (self.second, Some(next), next),
            _ => (self.first, Some(self.second), self.first),
        };
        let (between, dynamics) = (&self.second.dynamics, &becomes.dynamics);
        let paid = moved.amount + moved.fraction * spot + paid_from_escrow(moved, next);
        let variance = between.volatility.powi(2).max(dynamics.volatility.powi(2));
        let spread = (variance * time).sqrt();
        let carry = between.rate.abs() + between.dividend.abs();
        let rates =
            (between.rate - dynamics.rate).abs() + (between.dividend - dynamics.dividend).abs();
        let variances = (between.volatility.powi(2) - dynamics.volatility.powi(2)).abs();
        let is_date = moved.exercise_at_end && !moved.exercisable;
        let is_next_to_expiry = self.next.is_none() && self.first_pays();
        let is_exercised_otherwise = self.second.exercisable != becomes.exercisable;
        let dates = if is_date || is_next_to_expiry || is_exercised_otherwise {
            carry
        } else {
            0.0
        };
        let by_payments = paid * (carry + variance / spread);
        let by_rates = spot.max(1.0) * (rates + dates + variances / spread);
        self.second.duration * (by_payments + by_rates)
    }

    /// Whether exercise between the two is exercise before or after both, or not worth while.
    fn is_representable(&self) -> bool {
        let after = self.next.is_none_or(|next| next.exercisable);
        !self.may_be_exercised_between()
            || !self.first_pays()
            || (self.first.exercise_at_end && after)
    }

    /// The first segment with both events at its end.
    fn joined(&self) -> Segment {
        let (first, second, pays) = (self.first, self.second, self.first_pays());
        let keep = 1.0 - second.fraction;
        Segment {
            exercise_at_end: first.exercise_at_end || (!pays && self.may_be_exercised_between()),
            fraction: 1.0 - (1.0 - first.fraction) * keep,
            amount: first.amount * keep + second.amount,
            escrow: if pays { first.escrow } else { second.escrow },
            ..*first
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::gradient::SegmentGradient;
    use super::super::segment::{Dynamics, Segment};
    use super::Merged;

    const APART: f64 = 1e-8;
    const TOLERANCE: f64 = 1e-6;

    /// A segment that ends with a dividend, in strikes.
    fn segment(sign: f64, duration: f64, amount: f64) -> Segment {
        Segment {
            sign,
            dynamics: Dynamics {
                rate: 0.05,
                dividend: 0.02,
                volatility: 0.3,
            },
            duration,
            exercisable: true,
            exercise_at_end: true,
            fraction: 0.0,
            amount,
            escrow: 0.0,
        }
    }

    /// Two dividends in the middle of a year.
    fn two_dividends(sign: f64) -> [Segment; 3] {
        [
            segment(sign, 0.5, 0.01),
            segment(sign, APART, 0.02),
            segment(sign, 0.5 - APART, 0.0),
        ]
    }

    fn merged(segments: &[Segment]) -> Merged {
        Merged::of(segments, 0.0, TOLERANCE).ok().unwrap()
    }

    #[test]
    fn a_call_meets_two_dividends_at_the_first_and_a_put_at_the_second() {
        for (sign, until) in [(1.0, 0.5 + APART), (-1.0, 0.5)] {
            let merged = merged(&two_dividends(sign));
            assert_eq!(merged.segments.len(), 2);
            assert!((merged.segments[0].duration - until).abs() < 1e-15);
            assert!((merged.segments[1].duration + until - 1.0).abs() < 1e-15);
            assert!((merged.segments[0].amount - 0.03).abs() < 1e-15);
            assert!(0.0 < merged.error && merged.error < 0.1 * TOLERANCE);
        }
    }

    #[test]
    fn events_further_apart_stay_apart() {
        let mut segments = two_dividends(1.0);
        segments[1].duration = 1e-3;
        assert_eq!(merged(&segments).segments.len(), 3);
        segments[1] = segment(1.0, 0.2, 0.0); // a cut where nothing happens is none
        assert_eq!(merged(&segments).segments.len(), 2);
        segments[2].dynamics.rate = 0.06;
        assert_eq!(merged(&segments).segments.len(), 3);
    }

    #[test]
    fn a_put_that_may_be_exercised_only_after_a_dividend_is_not_taken_to_be_before() {
        let mut segments = two_dividends(1.0);
        segments[1].amount = 0.0;
        for segment in &mut segments {
            segment.exercisable = false;
        }
        segments[0].exercise_at_end = false;
        assert!(Merged::of(&segments, 0.0, TOLERANCE).is_err()); // the segment between is too short
    }

    #[test]
    #[allow(clippy::float_cmp)] // products of powers of two
    fn a_later_fraction_takes_from_what_an_earlier_amount_changes() {
        let mut segments = two_dividends(1.0);
        segments[1].fraction = 0.25;
        let merged = merged(&segments);
        assert!((merged.segments[0].amount - (0.75 * 0.01 + 0.02)).abs() < 1e-15);
        let gradient = SegmentGradient {
            amount: [2.0, 4.0],
            rate: [1.0, 1.0],
            ..SegmentGradient::default()
        };
        let apart = merged.apart(&segments, &[gradient, SegmentGradient::default()]);
        assert_eq!(apart[0].amount, [1.5, 3.0]);
        assert_eq!(apart[1].amount, [2.0, 4.0]);
        assert!((apart[0].rate[0] + apart[1].rate[0] - 1.0).abs() < 1e-15);
    }
}
