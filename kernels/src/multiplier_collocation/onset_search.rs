//! The search for the onset of a segment's contact set: when it is, where, and how the boundary goes on.

use super::contact_onset::{ContactOnset, Representation};
use super::payoff_crossing::PayoffCrossing;
use super::profile::Profile;
use super::roots::find_root;
use super::segment::Segment;
use super::unsettled::Unsettled;

/// The time after which a fast contact set has arrived, in times at which it has gone `MOST_OF_THE_WAY`; calibrated on
/// random contracts.
const ARRIVAL_OF_FAST: f64 = 1.3;
/// The share of its way after which a fast contact set is looked at; chosen.
const MOST_OF_THE_WAY: f64 = 0.7;
/// The smallest way of a contact set that arrives, in standard deviations of ln S over the segment; chosen.
const SMALLEST_WAY: f64 = 1.5;
/// The earliest arrival at which a segment is split, as a share of its duration; chosen.
const EARLIEST_ARRIVAL: f64 = 1e-3;
/// The smallest duration of a segment that is split, in times of the split; chosen.
const WORTH_SPLITTING: f64 = 1.1;
/// The earliest time at which panels show the value far from a kink, as a share of the duration; chosen: sooner they
/// are too wide.
const EARLIEST_SEEN: f64 = 0.02;
/// The earliest time that is looked at where the value is known as lines, as a share of the duration; chosen.
const AT_ONCE: f64 = 1e-9;
/// The slope away from the payoff, in slopes of the payoff, from which the contact set begins somewhere else, with two
/// ends; chosen.
const OVERHANGING: f64 = 1e-4;
/// The earliest time at which panels show the value everywhere, as a share of the duration; chosen.
const CLEARLY_SEEN: f64 = 0.1;
/// The longest way that a fast contact set is followed, in standard deviations of ln S over the segment; calibrated on
/// random contracts.
const LONGEST_WAY: f64 = 5.0;
/// The spot at which a contact set next to a spot of zero is taken to leap, in those that the event takes whole; calibrated
/// on random contracts.
const LEAP: f64 = 1.5;
/// The share of the time of the leap at which a segment is split; calibrated on random contracts.
const BEFORE_LEAP: f64 = 0.8;
/// The distance in time to which an onset is found, as a share of the duration; chosen.
const CLOSE: f64 = 1e-7;
/// The same for an arrival or a leap; chosen.
const ROUGHLY: f64 = 2e-4;
/// The growth of a contact set that is faster than diffusion follows, in standard deviations of ln S over the segment;
/// calibrated on random contracts.
const FAST: f64 = 4.0;

/// What is known of a segment before its boundary is.
pub struct OnsetSearch<'a> {
    /// The value at the segment's end.
    pub profile: &'a Profile,
    pub segment: &'a Segment,
    /// The end of the contact set at the segment's end, x, infinite without one.
    pub contact: f64,
    /// The x beyond which, on the side of exercise, the value does not matter.
    pub relevant: f64,
    /// Whether the value there is known at nodes only, and not as lines: what happens at once is not seen then.
    pub nodes_only: bool,
    /// Whether the segment was cut already: then nothing arrives in the middle of a part.
    pub is_cut: bool,
}

/// What the search finds.
pub struct FoundOnset {
    /// None where nothing is exercised.
    pub onset: Option<ContactOnset>,
    /// The time to the segment's end at which the segment is best split, so that the part before has a smooth boundary;
    /// 0 where it is not.
    pub split: f64,
}

impl OnsetSearch<'_> {
    /// Whether there is a contact set, at the segment's end or before.
    pub fn has_contact(&self) -> bool {
        let segment = self.segment;
        if !(segment.exercisable && segment.has_cost_of_waiting()) {
            return false;
        }
        if segment.sign * (self.contact - self.relevant) > 0.0 {
            return true;
        }
        let reached = segment.sign * (segment.zero_of_multiplier() - self.relevant) > 0.0;
        reached && self.excess(self.relevant, segment.duration) < 0.0
    }

    /// Find the onset.
    pub fn find(&self) -> Result<FoundOnset, Unsettled> {
        if !self.has_contact() {
            return Ok(FoundOnset {
                onset: None,
                split: 0.0,
            });
        }
        if self.segment.sign * (self.contact - self.relevant) > 0.0 {
            Ok(self.at_segment_end())
        } else {
            self.inside_segment()
        }
    }

    /// The onset of a contact set that exists at the segment's end.
    fn at_segment_end(&self) -> FoundOnset {
        let segment = self.segment;
        let (sign, largest) = (segment.sign, segment.zero_of_multiplier());
        let place = if sign > 0.0 {
            self.contact.min(largest)
        } else {
            self.contact.max(largest)
        };
        let ahead = place + FAST * sign * segment.spread();
        if self.excess(ahead, segment.duration) < 0.0 {
            return self.crossing_onset(0.0, place);
        }
        let gradual = sign * (largest - self.contact) <= 0.0;
        let onset = ContactOnset {
            representation: if gradual || self.profile.continues(segment) {
                Representation::Direct
            } else {
                Representation::SquaredDistance
            },
            time: 0.0,
            place,
            crossing: PayoffCrossing::default(),
        };
        FoundOnset {
            onset: Some(onset),
            split: 0.0,
        }
    }

    /// The onset of a contact set that comes from far away some time before the segment's end.
    fn inside_segment(&self) -> Result<FoundOnset, Unsettled> {
        let (segment, place) = (self.segment, self.relevant);
        let excess = |s: f64| self.excess(place, s);
        let duration = segment.duration;
        let share = if self.profile.has_nodes() && self.nodes_only {
            EARLIEST_SEEN
        } else {
            AT_ONCE
        };
        let soon = share * duration;
        let time = if excess(soon) > 0.0 {
            find_root(excess, soon, duration, CLOSE * duration)
        } else {
            soon
        };
        if self.steepness(place, time) < -OVERHANGING {
            return Err(Unsettled);
        }
        Ok(self.crossing_onset(time, place))
    }

    /// The onset of a boundary that is measured from the payoff crossing, split where it has arrived, or before it leaps.
    fn crossing_onset(&self, time: f64, place: f64) -> FoundOnset {
        let segment = self.segment;
        let mut onset = ContactOnset::from_crossing(self.profile, segment, time, place);
        // Contact sets further away than this do not change the value next to the boundary at the beginning.
        let near = onset.crossing.x - segment.sign * LONGEST_WAY * segment.spread();
        if segment.sign * (near - place) > 0.0 {
            let soon = if self.profile.has_nodes() {
                CLEARLY_SEEN
            } else {
                AT_ONCE
            };
            if let Some(time) = self.reached(near, (soon, CLOSE), time) {
                onset = ContactOnset::from_crossing(self.profile, segment, time, near);
            }
        }
        let split = if self.is_cut {
            0.0
        } else {
            self.arrival(&onset)
        };
        FoundOnset {
            onset: Some(onset),
            split: if split > 0.0 {
                split
            } else {
                self.leap((time, place), onset.crossing.x)
            },
        }
    }

    /// A time after that at which a contact set that grows far and fast has arrived; 0 where it does not.
    ///
    /// The boundary is near the payoff crossing, which is followed until it has gone most of its way.
    fn arrival(&self, onset: &ContactOnset) -> f64 {
        let (segment, place, end) = (self.segment, onset.place, onset.crossing.x);
        if segment.sign * (end - place) < SMALLEST_WAY * segment.spread() {
            return 0.0;
        }
        // For a put the way counts in spots: next to a spot of zero, boundaries go far in x and hardly anywhere.
        let most = if segment.sign > 0.0 {
            (place.exp() + MOST_OF_THE_WAY * (end.exp() - place.exp())).ln()
        } else {
            place + MOST_OF_THE_WAY * (end - place)
        };
        let time = self.reached(most, (AT_ONCE, ROUGHLY), onset.time);
        self.worth_splitting(ARRIVAL_OF_FAST * time.unwrap_or(0.0))
    }

    /// A time before the contact set of a put, next to a spot of zero, leaps beyond the spots that the event takes; 0
    /// where it does not. Integrals over the time of the leap would see a jump.
    fn leap(&self, (onset_time, place): (f64, f64), end: f64) -> f64 {
        let paid_out = self.segment.paid_out_below() + LEAP.ln();
        if self.segment.sign < 0.0 || !(place < paid_out && paid_out < end) {
            return 0.0;
        }
        let time = self.reached(paid_out, (AT_ONCE, ROUGHLY), onset_time);
        self.worth_splitting(BEFORE_LEAP * time.unwrap_or(0.0))
    }

    /// The time at which the payoff crossing reaches x, to a share `close` of the duration; None where it is there before
    /// the share `soon`.
    fn reached(&self, x: f64, (soon, close): (f64, f64), onset_time: f64) -> Option<f64> {
        let duration = self.segment.duration;
        let soon = onset_time.max(soon * duration);
        let excess = |s: f64| self.excess(x, s);
        (excess(soon) > 0.0).then(|| find_root(excess, soon, duration, close * duration))
    }

    /// The time if it is not too early for a segment to be split then, nor too late, otherwise 0.
    fn worth_splitting(&self, time: f64) -> f64 {
        let duration = self.segment.duration;
        if EARLIEST_ARRIVAL * duration < time && WORTH_SPLITTING * time < duration {
            time
        } else {
            0.0
        }
    }

    /// The value without exercise before s less the payoff at x, in strikes.
    fn excess(&self, x: f64, s: f64) -> f64 {
        self.profile.propagate(&self.segment.dynamics, x, s)[0] - self.segment.payoff(x, s)
    }

    /// The slope of the value without exercise before s less that of the payoff, by x, away from exercise, in strikes.
    fn steepness(&self, x: f64, s: f64) -> f64 {
        let by_x = self.profile.propagate(&self.segment.dynamics, x, s)[1];
        x.exp() + by_x * self.segment.sign
    }
}
