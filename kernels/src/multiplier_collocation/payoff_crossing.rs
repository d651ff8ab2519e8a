//! The place where the value without exercise is the payoff. The boundary of a contact set that comes from far away is
//! near it.

use super::profile::Profile;
use super::segment::Segment;

/// The largest number of steps of a search; chosen.
const MOST_STEPS: usize = 200;
/// The largest number of Halley's steps from an extrapolated place; chosen.
const MOST_CORRECTIONS: usize = 8;
/// The largest last step of Halley's method, in standard deviations of ln S: the error left is about its cube; chosen.
const LAST_STEP: f64 = 0.01;

/// The value without exercise less the payoff, and its derivatives by x and by the time s to the segment's end.
pub struct Gap {
    pub value: f64,
    pub by_x: f64,
    by_xx: f64,
    pub by_s: f64,
}

impl Gap {
    /// The gap at x and s.
    pub fn at(profile: &Profile, segment: &Segment, x: f64, s: f64) -> Gap {
        let (sign, dynamics) = (segment.sign, &segment.dynamics);
        let [value, by_x, by_xx] = profile.propagate(dynamics, x, s);
        let (spot, strike) = (x.exp(), segment.strike(s));
        // dV/ds = L V.
        let value_by_s = 0.5 * dynamics.volatility * dynamics.volatility * (by_xx - by_x)
            + (dynamics.rate - dynamics.dividend) * by_x
            - dynamics.rate * value;
        Gap {
            value: value - sign * (strike - spot),
            by_x: by_x + sign * spot,
            by_xx: by_xx + sign * spot,
            by_s: value_by_s - sign * dynamics.rate * (1.0 - strike),
        }
    }

    /// A step of Halley's method.
    fn halley_step(&self) -> f64 {
        let newton = self.value / self.by_x;
        -newton / (1.0 - 0.5 * newton * self.by_xx / self.by_x)
    }
}

/// The crossing at one time, and how it moves.
#[derive(Clone, Copy, Debug, Default)]
pub struct PayoffCrossing {
    pub x: f64,
    /// The direction of x out of the contact set, 1 or -1.
    outward: f64,
    /// sqrt(s - onset time).
    root: f64,
    /// The derivative of x by `root`.
    speed: f64,
}

impl PayoffCrossing {
    /// The crossing at time s of a contact set with this onset, searched outwards from a place on the side of exercise,
    /// where the value is below the payoff.
    pub fn search(
        profile: &Profile,
        segment: &Segment,
        outward: f64,
        (onset_time, place): (f64, f64),
        s: f64,
    ) -> PayoffCrossing {
        let gap = |x: f64| Gap::at(profile, segment, x, s);
        // The panels next to the place are fine enough for such a step.
        let step = outward * segment.dynamics.volatility * s.sqrt();
        let mut inside = place;
        for _ in 0..MOST_STEPS {
            if gap(inside).value <= 0.0 {
                break;
            }
            inside -= step;
        }
        let mut outside = inside + step;
        let mut found = gap(outside);
        for _ in 0..MOST_STEPS {
            if found.value >= 0.0 {
                break;
            }
            (inside, outside) = (outside, outside + step);
            found = gap(outside);
        }
        let mut x = outside;
        for _ in 0..MOST_STEPS {
            if found.value > 0.0 {
                outside = x;
            } else {
                inside = x;
            }
            let by = found.halley_step();
            let next = x + by;
            let between = inside.min(outside) <= next && next <= inside.max(outside);
            let next = if between {
                next
            } else {
                0.5 * (inside + outside)
            };
            let moved = (next - x).abs();
            x = next;
            if moved <= LAST_STEP * step.abs() {
                break;
            }
            found = gap(x);
        }
        PayoffCrossing::new(x, &found, outward, onset_time, s)
    }

    fn new(x: f64, gap: &Gap, outward: f64, onset_time: f64, s: f64) -> PayoffCrossing {
        let root = (s - onset_time).sqrt();
        let speed = -2.0 * root * gap.by_s / gap.by_x;
        PayoffCrossing {
            x,
            outward,
            root,
            speed,
        }
    }

    /// The crossing at a time s nearer to the segment's end, for the same onset.
    pub fn at_earlier_s(
        &self,
        profile: &Profile,
        segment: &Segment,
        onset: (f64, f64),
        s: f64,
    ) -> PayoffCrossing {
        let spread = segment.dynamics.volatility * s.sqrt();
        let mut x = self.x + self.speed * ((s - onset.0).sqrt() - self.root);
        for _ in 0..MOST_CORRECTIONS {
            let gap = Gap::at(profile, segment, x, s);
            let step = gap.halley_step();
            if !(self.outward * gap.by_x > 0.0 && step.abs() < spread) {
                break;
            }
            x += step;
            if step.abs() <= LAST_STEP * spread {
                return PayoffCrossing::new(x, &gap, self.outward, onset.0, s);
            }
        }
        PayoffCrossing::search(profile, segment, self.outward, onset, s)
    }
}
