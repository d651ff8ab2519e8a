//! Where the value without exercise meets the payoff: the place near which a contact set ends that comes from far away.

use super::boundary::Start;
use super::profile::Profile;
use super::stretch::Stretch;

/// Of a search.
const MOST_STEPS: usize = 200;
const MOST_NEAR_STEPS: usize = 8;
/// Spreads: after a step of Halley's method that short the place is known to its cube.
const SHORT: f64 = 0.01;

/// The value without exercise less the payoff, and its derivatives.
struct Gap {
    value: f64,
    by_x: f64,
    by_xx: f64,
    by_s: f64,
}

impl Gap {
    fn at(profile: &Profile, stretch: &Stretch, x: f64, s: f64) -> Gap {
        let (sign, flow) = (stretch.sign, &stretch.flow);
        let [value, by_x, by_xx] = profile.propagate(flow, x, s);
        let (spot, strike) = (x.exp(), stretch.strike(s));
        let grown = 0.5 * flow.volatility * flow.volatility * (by_xx - by_x)
            + (flow.rate - flow.dividend) * by_x
            - flow.rate * value;
        Gap {
            value: value - sign * (strike - spot),
            by_x: by_x + sign * spot,
            by_xx: by_xx + sign * spot,
            by_s: grown - sign * flow.rate * (1.0 - strike),
        }
    }

    /// A step of Halley's method.
    fn step(&self) -> f64 {
        let newton = self.value / self.by_x;
        -newton / (1.0 - 0.5 * newton * self.by_xx / self.by_x)
    }
}

/// The place at one time, and how it moves.
#[derive(Clone, Copy, Debug, Default)]
pub struct Touching {
    pub x: f64,
    /// sqrt(s - time), with the time at which the contact set begins.
    root: f64,
    /// dx by it.
    speed: f64,
}

impl Touching {
    /// From a place on the side of exercise, where the value is below the payoff, at time s.
    pub fn search(
        profile: &Profile,
        stretch: &Stretch,
        begins: f64,
        place: f64,
        s: f64,
    ) -> Touching {
        let gap = |x: f64| Gap::at(profile, stretch, x, s);
        // Panels are fine enough for such a step next to the place.
        let step = stretch.sign * stretch.flow.volatility * s.sqrt();
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
            let by = found.step();
            let next = x + by;
            let between = inside.min(outside) <= next && next <= inside.max(outside);
            let next = if between {
                next
            } else {
                0.5 * (inside + outside)
            };
            let moved = (next - x).abs();
            x = next;
            if moved <= SHORT * step.abs() {
                break;
            }
            found = gap(x);
        }
        Touching::moving(x, &found, begins, s)
    }

    fn moving(x: f64, gap: &Gap, begins: f64, s: f64) -> Touching {
        let root = (s - begins).sqrt();
        let speed = -2.0 * root * gap.by_s / gap.by_x;
        Touching { x, root, speed }
    }

    /// At a time s nearer to the stretch's end.
    pub fn earlier(&self, profile: &Profile, stretch: &Stretch, start: &Start, s: f64) -> Touching {
        let spread = stretch.flow.volatility * s.sqrt();
        let mut x = self.x + self.speed * ((s - start.time).sqrt() - self.root);
        for _ in 0..MOST_NEAR_STEPS {
            let gap = Gap::at(profile, stretch, x, s);
            let step = gap.step();
            if !(stretch.sign * gap.by_x > 0.0 && step.abs() < spread) {
                break;
            }
            x += step;
            if step.abs() <= SHORT * spread {
                return Touching::moving(x, &gap, start.time, s);
            }
        }
        Touching::search(profile, stretch, start.time, start.place, s)
    }
}
