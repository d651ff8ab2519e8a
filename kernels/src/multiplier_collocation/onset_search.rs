//! The search for the onset of a segment's contact set: when it is, where, and how the boundary goes on.

use super::contact_onset::{ContactOnset, Representation};
use super::payoff_crossing::{Gap, PayoffCrossing};
use super::profile::Profile;
use super::roots::find_root;
use super::segment::{Segment, OVERHANGING};
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
/// The number of intervals in which the least difference of value and payoff is looked for; chosen.
const SCANNED: u32 = 16;
/// The share of the duration from which on an arrival is at the segment's beginning; chosen.
const AT_THE_END: f64 = 0.999;
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
    /// The end of that contact set which is far from the strike, x; -sign infinity without one that matters.
    pub far: f64,
    /// Whether the contact set may begin between two spots.
    pub overhangs: bool,
    /// The x beyond which, on the side of exercise, the value does not matter.
    pub relevant: f64,
    /// Whether the value there is known at nodes only, and not as lines: what happens at once is not seen then.
    pub nodes_only: bool,
    /// Whether the segment was cut already: then nothing arrives in the middle of a part.
    pub is_cut: bool,
}

/// What the search finds.
pub struct FoundOnset {
    /// The onsets of the ends of the contact set, that next to the strike first; none where nothing is exercised, or where
    /// the segment has to be split.
    pub onsets: Vec<ContactOnset>,
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
        let duration = segment.duration;
        let is_far = reached && self.excess(self.relevant, duration) < 0.0;
        is_far || (self.overhangs && self.least_gap(duration).1 < 0.0)
    }

    /// Find the onset.
    pub fn find(&self) -> Result<FoundOnset, Unsettled> {
        if !self.has_contact() {
            return Ok(FoundOnset {
                onsets: Vec::new(),
                split: 0.0,
            });
        }
        if self.segment.sign * (self.contact - self.relevant) <= 0.0 {
            return self.inside_segment();
        }
        if self.far.is_finite() {
            return self.between_at_segment_end();
        }
        Ok(self.at_segment_end())
    }

    /// The onset of a contact set with two ends that exists at the segment's end.
    fn between_at_segment_end(&self) -> Result<FoundOnset, Unsettled> {
        if !self.profile.continues(self.segment) {
            return Err(Unsettled);
        }
        if let Some(split) = self.arrival_of_far_end() {
            return Ok(FoundOnset {
                onsets: Vec::new(),
                split,
            });
        }
        let mut found = self.at_segment_end();
        found.onsets.push(self.far_onset((0.0, self.far)));
        found.split = 0.0;
        Ok(found)
    }

    /// The onset of the end of a contact set that is far from the strike.
    fn far_onset(&self, onset: (f64, f64)) -> ContactOnset {
        ContactOnset::from_crossing(self.profile, self.segment, -self.segment.sign, onset)
    }

    /// The time from which on the contact set reaches to what is relevant, None where it does not.
    fn arrival_of_far_end(&self) -> Option<f64> {
        let duration = self.segment.duration;
        let excess = |s: f64| self.excess(self.relevant, s);
        if excess(duration) >= 0.0 {
            return None;
        }
        let soon = CLEARLY_SEEN * duration;
        if excess(soon) <= 0.0 {
            return Some(soon);
        }
        let time = find_root(excess, soon, duration, CLOSE * duration);
        (time < AT_THE_END * duration).then_some(time)
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
            onsets: vec![onset],
            split: 0.0,
        }
    }

    /// The onset of a contact set that comes from far away, or begins between two spots, before the segment's end.
    fn inside_segment(&self) -> Result<FoundOnset, Unsettled> {
        if self.overhangs {
            return Ok(self.between());
        }
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

    /// The onset of a contact set that begins between two spots, where value and payoff touch; the segment is split where that
    /// reaches beyond what is relevant, and next to its event where panels are too wide for what happens so soon.
    fn between(&self) -> FoundOnset {
        let (place, duration) = (self.relevant, self.segment.duration);
        let split = |split: f64| FoundOnset {
            onsets: Vec::new(),
            split,
        };
        let soon = CLEARLY_SEEN * duration;
        let least = |s: f64| self.least_gap(s).1;
        if least(soon) <= 0.0 {
            return split(soon);
        }
        if let Some(time) = self.arrival_of_far_end() {
            let arrives_from_far = self.steepness(place, time) >= 0.0;
            let has_begun = least(time) < 0.0;
            if arrives_from_far && !has_begun {
                return self.crossing_onset(time, place);
            }
            // One that has begun nearer the strike by then is what matters, while the two stay apart.
            if !(arrives_from_far && self.stays_apart(place)) {
                return split(time);
            }
        }
        let time = find_root(least, soon, duration, CLOSE * duration);
        let onset = (time, self.least_gap(time).0);
        let (profile, segment) = (self.profile, self.segment);
        let near = ContactOnset::from_crossing(profile, segment, segment.sign, onset);
        FoundOnset {
            onsets: vec![near, self.far_onset(onset)],
            split: 0.0,
        }
    }

    /// Whether the value exceeds the payoff, at the segment's beginning, somewhere between x and where it does so least.
    fn stays_apart(&self, x: f64) -> bool {
        let duration = self.segment.duration;
        let step = (self.least_gap(duration).0 - x) / f64::from(SCANNED);
        (1..SCANNED).any(|k| self.excess(x + f64::from(k) * step, duration) > 0.0)
    }

    /// The x between what is relevant and the strike at which the value of a put without exercise before s exceeds the
    /// payoff least, and by how much, in strikes.
    fn least_gap(&self, s: f64) -> (f64, f64) {
        let gap = |x: f64| Gap::at(self.profile, self.segment, x, s);
        let by_x = |x: f64| gap(x).by_x;
        let (start, stop) = (self.relevant, self.segment.strike(s).ln());
        let mut falling = start;
        if by_x(start) >= 0.0 {
            // Next to the spots that the event takes whole the difference rises first.
            let step = (stop - start) / f64::from(SCANNED);
            let places = (1..SCANNED).map(|k| start + f64::from(k) * step);
            let lowest = places.min_by(|&a, &b| gap(a).value.total_cmp(&gap(b).value));
            falling = lowest.unwrap_or(start);
            if by_x(falling) >= 0.0 {
                falling -= step;
            }
        }
        let x = if by_x(falling) < 0.0 && by_x(stop) > 0.0 {
            find_root(by_x, falling, stop, CLOSE)
        } else {
            start
        };
        (x, self.excess(x, s))
    }

    /// The onset of a boundary that is measured from the payoff crossing, split where it has arrived, or before it leaps.
    fn crossing_onset(&self, time: f64, place: f64) -> FoundOnset {
        let segment = self.segment;
        let sign = segment.sign;
        let mut onset = ContactOnset::from_crossing(self.profile, segment, sign, (time, place));
        // Contact sets further away than this do not change the value next to the boundary at the beginning.
        let near = onset.crossing.x - segment.sign * LONGEST_WAY * segment.spread();
        if segment.sign * (near - place) > 0.0 {
            let soon = if self.profile.has_nodes() {
                CLEARLY_SEEN
            } else {
                AT_ONCE
            };
            if let Some(time) = self.reached(near, (soon, CLOSE), time) {
                onset = ContactOnset::from_crossing(self.profile, segment, sign, (time, near));
            }
        }
        let split = if self.is_cut {
            0.0
        } else {
            self.arrival(&onset)
        };
        FoundOnset {
            onsets: vec![onset],
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
