//! When and where the contact set of a segment begins, and what about its boundary is a polynomial after that.

use super::payoff_crossing::PayoffCrossing;
use super::profile::Profile;
use super::segment::Segment;

/// The smallest `SquaredDistance` that is not taken for zero; chosen: its root has a finite derivative.
const SMALLEST_SQUARE: f64 = 1e-20;
/// The relative distance in time within which a time is that of the onset; chosen.
const SAME_TIME: f64 = 1e-12;

/// The quantity that is a polynomial in eta = sqrt((s - onset time)/(duration - onset time)), b being the boundary.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Representation {
    /// b: the boundary begins smoothly.
    Direct,
    /// The square of b less the place of the onset: the boundary begins like the root of time, up to logarithms.
    SquaredDistance,
    /// b less the place where the value without exercise is the payoff: the boundary comes from far away, or the contact
    /// set grows faster than diffusion follows.
    FromCrossing,
}

/// The onset of a contact set.
#[derive(Clone, Copy, Debug)]
pub struct ContactOnset {
    pub representation: Representation,
    /// s.
    pub time: f64,
    /// x.
    pub place: f64,
    /// The crossing at the segment's beginning; without meaning for `Direct` and `SquaredDistance`.
    pub crossing: PayoffCrossing,
}

impl ContactOnset {
    /// The onset of a contact set one of whose ends, `outward` from its inside, is measured from the payoff crossing.
    pub fn from_crossing(
        profile: &Profile,
        segment: &Segment,
        outward: f64,
        (time, place): (f64, f64),
    ) -> ContactOnset {
        let end = segment.duration;
        ContactOnset {
            representation: Representation::FromCrossing,
            time,
            place,
            crossing: PayoffCrossing::search(profile, segment, outward, (time, place), end),
        }
    }

    /// Whether this end is measured from the payoff crossing, and the value is its equation.
    pub fn is_from_crossing(&self) -> bool {
        self.representation == Representation::FromCrossing
    }

    /// The payoff crossing at an earlier s than that of `from`.
    pub fn crossing_before(
        &self,
        from: &PayoffCrossing,
        profile: &Profile,
        segment: &Segment,
        s: f64,
    ) -> PayoffCrossing {
        from.at_earlier_s(profile, segment, (self.time, self.place), s)
    }

    /// The boundary that belongs to a coefficient, and its derivative; `crossing` is that of its time, 0 unless the
    /// boundary is measured from there.
    pub fn boundary_of(&self, sign: f64, coefficient: f64, crossing: f64) -> (f64, f64) {
        match self.representation {
            Representation::SquaredDistance => {
                if coefficient <= SMALLEST_SQUARE {
                    return (self.place, 0.0);
                }
                let distance = coefficient.sqrt();
                (self.place - sign * distance, -0.5 * sign / distance)
            }
            Representation::Direct | Representation::FromCrossing => (coefficient + crossing, 1.0),
        }
    }

    /// The coefficient at the onset.
    pub fn first_coefficient(&self) -> f64 {
        match self.representation {
            Representation::Direct => self.place,
            Representation::SquaredDistance | Representation::FromCrossing => 0.0,
        }
    }

    /// The payoff crossings at these times; empty unless the boundary is measured from there.
    pub fn crossings(&self, profile: &Profile, segment: &Segment, times: &[f64]) -> Vec<f64> {
        if self.representation != Representation::FromCrossing {
            return Vec::new();
        }
        let mut places = vec![0.0; times.len()];
        let mut order: Vec<usize> = (0..times.len()).collect();
        order.sort_by(|&i, &j| times[j].total_cmp(&times[i]));
        let mut crossing = self.crossing;
        for index in order {
            let s = times[index];
            if s <= self.time * (1.0 + SAME_TIME) {
                places[index] = self.place;
                continue;
            }
            crossing = self.crossing_before(&crossing, profile, segment, s);
            places[index] = crossing.x;
        }
        places
    }
}

/// One of the crossings, 0 where there are none.
pub fn crossing_at(crossings: &[f64], index: usize) -> f64 {
    crossings.get(index).copied().unwrap_or(0.0)
}
