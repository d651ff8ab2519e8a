//! Where, when and how the contact set of a stretch begins.

use super::boundary::{Form, Start};
use super::normal::quantile;
use super::panels::Feature;
use super::profile::Profile;
use super::roots::find_root;
use super::stretch::Stretch;
use super::touching::Touching;
use super::Unsettled;

/// Times the time at which it begins, a contact set from far away has arrived.
const TAIL_SPLIT: f64 = 2.0;
const ARRIVED: f64 = 1.3;
const MOST_OF_THE_WAY: f64 = 0.7;
/// Spreads.
const FAR: f64 = 1.5;
/// Of the stretch.
const SOONEST: f64 = 1e-3;
const WORTH_SPLITTING: f64 = 1.1;
/// Of the stretch: sooner the panels are too wide to show the tail.
const SEEN: f64 = 0.02;
/// Of the slope far away: then value and payoff part like lines, not like a normal tail.
const STEEP: f64 = 1e-6;
/// Of the slope far away: then the contact set begins somewhere else, with two ends.
const OVERHANGING: f64 = 1e-4;
const AT_ONCE: f64 = 1e-9;
/// Of the stretch: how closely its time is looked for at which a contact set begins, and at which it has arrived.
const CLOSE: f64 = 1e-7;
const ROUGHLY: f64 = 1e-2;
/// Spreads by which a contact set grows that spreads faster than diffusion follows.
const FAST: f64 = 4.0;
/// Spreads from the bend towards exercise at which a tail is looked at, and the least and largest height.
const DEEP: f64 = 2.0;
const SHALLOW: f64 = 0.25;
const LOWEST: f64 = 1e-6;
const HIGHEST: f64 = 0.9;

/// What is known of a stretch before its contact set begins.
pub struct Outset<'a> {
    pub profile: &'a Profile,
    pub stretch: &'a Stretch,
    /// End of the contact set at the stretch's end, infinite without one.
    pub contact: f64,
    /// x beyond which, on the side of exercise, the value does not matter.
    pub relevant: f64,
    pub features: &'a [Feature],
    /// Whether the value there is known at nodes only, and not as a line: what happens at once is not seen then.
    pub nodes_only: bool,
}

impl Outset<'_> {
    /// Whether there is a contact set, now or before the stretch's beginning.
    pub fn begins(&self) -> bool {
        let stretch = self.stretch;
        if !(stretch.exercisable && stretch.can_pay()) {
            return false;
        }
        if stretch.sign * (self.contact - self.relevant) > 0.0 {
            return true;
        }
        let reached = stretch.sign * (stretch.furthest() - self.relevant) > 0.0;
        reached && self.above(self.relevant, stretch.duration) < 0.0
    }

    /// The start, None where nothing is exercised, and the time at which the stretch is best parted, or 0.
    pub fn find_start(&self) -> Result<(Option<Start>, f64), Unsettled> {
        if !self.begins() {
            return Ok((None, 0.0));
        }
        let stretch = self.stretch;
        let (sign, furthest) = (stretch.sign, stretch.furthest());
        if sign * (self.contact - self.relevant) > 0.0 {
            let place = if sign > 0.0 {
                self.contact.min(furthest)
            } else {
                self.contact.max(furthest)
            };
            let ahead = place + FAST * sign * stretch.spread();
            if self.above(ahead, stretch.duration) < 0.0 {
                return Ok(self.shifted(0.0, place));
            }
            let gradual = sign * (furthest - self.contact) <= 0.0;
            let start = Start {
                form: if gradual || self.profile.continues(stretch) {
                    Form::Plain
                } else {
                    Form::Root
                },
                time: 0.0,
                place,
                touching: Touching::default(),
            };
            return Ok((Some(start), 0.0));
        }
        let place = self.relevant;
        let above = |s: f64| self.above(place, s);
        let duration = stretch.duration;
        let share = if self.profile.has_nodes() && self.nodes_only {
            SEEN
        } else {
            AT_ONCE
        };
        let soon = share * duration;
        let time = if above(soon) > 0.0 {
            find_root(above, soon, duration, CLOSE * duration)
        } else {
            soon
        };
        let steepness = self.height(place, time) * place.exp();
        if steepness < -OVERHANGING {
            return Err(Unsettled);
        }
        if sign < 0.0 || steepness > STEEP || place < stretch.gone() {
            return Ok(self.shifted(time, place));
        }
        let split = TAIL_SPLIT * time;
        let worth = WORTH_SPLITTING * split < duration && split > 1e-6 * duration;
        let start = Start {
            form: self.tail(time),
            time,
            place,
            touching: Touching::search(self.profile, stretch, time, place, duration),
        };
        Ok((Some(start), if worth { split } else { 0.0 }))
    }

    /// The start of a contact set that is measured from the touching point, and when it has arrived.
    fn shifted(&self, time: f64, place: f64) -> (Option<Start>, f64) {
        let start = Start::shifted(self.profile, self.stretch, time, place);
        (Some(start), self.arrival(time, place, start.touching.x))
    }

    /// A time after that at which a contact set that grows far and fast has arrived; 0 where it does not.
    ///
    /// The boundary is near the place where the value without exercise is the payoff, which is followed until it has gone
    /// most of its way.
    fn arrival(&self, begins: f64, place: f64, end: f64) -> f64 {
        let stretch = self.stretch;
        if stretch.sign * (end - place) < FAR * stretch.spread() {
            return 0.0;
        }
        let most = place + MOST_OF_THE_WAY * (end - place);
        let soon = begins.max(AT_ONCE * stretch.duration);
        if self.above(most, soon) <= 0.0 {
            return 0.0;
        }
        let above = |s: f64| self.above(most, s);
        let close = ROUGHLY * stretch.duration;
        let arrival = ARRIVED * find_root(above, soon, stretch.duration, close);
        let worth =
            SOONEST * stretch.duration < arrival && WORTH_SPLITTING * arrival < stretch.duration;
        if worth {
            arrival
        } else {
            0.0
        }
    }

    /// Where the value bends next to what is held.
    fn bend(&self) -> f64 {
        let (sign, bends) = (self.stretch.sign, self.features.iter());
        bends
            .filter(|f| f.scale <= 0.0)
            .map(|f| f.place)
            .reduce(|a, b| if sign > 0.0 { a.max(b) } else { a.min(b) })
            .unwrap_or(0.0)
    }

    /// The form whose tail has the shape of 1 + delta at the beginning, from its height at two places.
    fn tail(&self, begins: f64) -> Form {
        let (sign, flow) = (self.stretch.sign, &self.stretch.flow);
        let seen = begins.max(SEEN * self.stretch.duration);
        let spread = sign * flow.volatility * seen.sqrt();
        let bend = self.bend() - flow.drift() * seen;
        let quantile_at = |x: f64| quantile(self.height(x, seen).clamp(LOWEST, HIGHEST));
        let (deep, shallow) = (bend - DEEP * spread, bend - SHALLOW * spread);
        let (low, high) = (quantile_at(deep), quantile_at(shallow));
        let scale = ((shallow - deep) / (high - low)).abs();
        let scale = scale.clamp(0.5 * spread.abs(), 5.0 * spread.abs());
        Form::Tail {
            centre: shallow - sign * scale * high,
            scale,
        }
    }

    /// How much holding, without exercise before s, is worth more than exercise at x.
    fn above(&self, x: f64, s: f64) -> f64 {
        self.profile.propagate(&self.stretch.flow, x, s)[0] - self.stretch.payoff(x, s)
    }

    /// 1 + delta of a put, 1 - delta of a call, both without exercise before s.
    fn height(&self, x: f64, s: f64) -> f64 {
        let by_x = self.profile.propagate(&self.stretch.flow, x, s)[1];
        1.0 + by_x * (-x).exp() * self.stretch.sign
    }
}
