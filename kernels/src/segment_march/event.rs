//! What an event does to the value and to its derivatives by parameters: V(s, t-) = max(g(s), V(s (1 - f) - d, t+)).
//!
//! Kinks are kept apart: a function with the kink jump (s - k)^+ enters a grid as its projection on hat functions (Pooley,
//! Vetzal, Forsyth 2003), so that the error is regular wherever k lies between the nodes; so does a step.

use super::grid_function::{cell_of, GridFunction, Kink, Place, SlopeWeights, ValueFunction};
use super::region::EMPTY;
use super::roots::find_root;

/// The smallest gain of exercise that is more than rounding, in strikes; measured.
const SMALLEST_GAIN: f64 = 1e-13;
/// How close a crossing is found, as a share of 1 + s.
const CLOSE: f64 = 1e-13;

/// What happens at the end of a segment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Event {
    /// 1 for a put, -1 for a call.
    pub sign: f64,
    /// The share of the spot that is paid.
    pub fraction: f64,
    /// What is paid, in units of the strike.
    pub amount: f64,
    /// In units of the strike.
    pub escrow: f64,
    /// Whether the holder may exercise just before.
    pub exercisable: bool,
}

/// The value just before an event.
pub(super) struct Before {
    pub values: Vec<f64>,
    pub at_zero: f64,
    /// The ends of the exercise region in s.
    pub region: [f64; 2],
    exercised: Vec<bool>,
    crossings: Vec<f64>,
    exercised_at_zero: bool,
    kinks: Vec<Kink>,
}

/// The derivatives by the parameters: at the nodes, and at s = 0.
pub(super) struct Derivatives {
    pub values: Vec<Vec<f64>>,
    pub at_zero: Vec<f64>,
}

impl Event {
    fn kept(&self) -> f64 {
        1.0 - self.fraction
    }

    fn ex(&self, s: f64) -> f64 {
        (s * self.kept() - self.amount).max(0.0)
    }

    fn exercise(&self, s: f64) -> f64 {
        self.sign * (1.0 - self.escrow - s)
    }

    fn pays(&self) -> bool {
        self.fraction > 0.0 || self.amount > 0.0
    }

    fn held(&self, after: &ValueFunction<'_>, s: f64) -> f64 {
        after.value(if self.pays() { self.ex(s) } else { s })
    }

    fn held_slope(&self, after: &ValueFunction<'_>, s: f64) -> f64 {
        if !self.pays() {
            after.slope(s)
        } else if s * self.kept() - self.amount > 0.0 {
            self.kept() * after.slope(self.ex(s))
        } else {
            0.0
        }
    }

    /// Those of the value after, moved, and the spot that the amount takes to zero.
    fn kinks(&self, after: &ValueFunction<'_>) -> Vec<Kink> {
        let (kept, mut kinks) = (self.kept(), after.kinks());
        if !self.pays() {
            return kinks;
        }
        if kept <= 0.0 {
            return Vec::new();
        }
        for kink in &mut kinks {
            kink.place = (kink.place + self.amount) / kept;
            kink.jump *= kept;
        }
        if self.amount > 0.0 {
            kinks.push(Kink {
                place: self.amount / kept,
                jump: after.slope(0.0) * kept,
            });
        }
        kinks
    }

    /// The value just before the event; `at_zero` is the one after it at s = 0.
    pub fn before(&self, after: &ValueFunction<'_>, at_zero: f64, nodes: &[f64]) -> Before {
        let ex = |s: &f64| if self.pays() { self.ex(*s) } else { *s };
        let mut before = Before {
            values: after.values(nodes.iter().map(ex)),
            at_zero,
            region: EMPTY,
            exercised: vec![false; nodes.len()],
            crossings: Vec::new(),
            exercised_at_zero: false,
            kinks: self.kinks(after),
        };
        if self.exercisable {
            self.exercise_where_it_gains(after, nodes, &mut before);
        } else {
            for kink in &before.kinks {
                project_kink(nodes, *kink, &mut before.values);
            }
        }
        before
    }

    fn exercise_where_it_gains(
        &self,
        after: &ValueFunction<'_>,
        nodes: &[f64],
        before: &mut Before,
    ) {
        let gain = |s: f64| self.exercise(s) - self.held(after, s);
        for ((exercised, s), v) in before.exercised.iter_mut().zip(nodes).zip(&before.values) {
            *exercised = self.exercise(*s) - v > SMALLEST_GAIN;
        }
        for (cell, pair) in before.exercised.windows(2).enumerate() {
            if pair[0] != pair[1] {
                before
                    .crossings
                    .push(root(gain, nodes[cell], nodes[cell + 1]));
            }
        }
        let mut projected: Vec<Kink> = before.kinks.clone();
        projected.retain(|kink| gain(kink.place) <= SMALLEST_GAIN);
        projected.extend(before.crossings.iter().map(|&place| Kink {
            place,
            jump: (-self.sign - self.held_slope(after, place)).abs(),
        }));
        for (v, s) in before.values.iter_mut().zip(nodes) {
            *v = v.max(self.exercise(*s));
        }
        for kink in projected {
            project_kink(nodes, kink, &mut before.values);
        }
        for (v, s) in before.values.iter_mut().zip(nodes) {
            *v = v.max(self.exercise(*s));
        }
        before.region = region(&before.exercised, &before.crossings);
        let earned = self.exercise(0.0);
        before.exercised_at_zero = earned > before.at_zero;
        before.at_zero = before.at_zero.max(earned);
    }

    /// The derivatives just before the event from those just after it; `changes` are those of amount and escrow.
    pub fn derivatives_before(
        &self,
        derivatives: &mut Derivatives,
        after: &ValueFunction<'_>,
        before: &Before,
        changes: &[[f64; 2]],
        nodes: &[f64],
        weights: &SlopeWeights,
    ) {
        let moves = self.pays() || changes.iter().any(|change| change[0] != 0.0);
        let ex = |s: &f64| Place::of(self.ex(*s), nodes);
        let places: Vec<Place> = nodes.iter().map(ex).collect();
        let slope = |s: &f64| {
            let ex = self.ex(*s);
            if ex > 0.0 {
                after.slope(ex)
            } else {
                0.0
            }
        };
        let slopes: Vec<f64> = nodes.iter().map(slope).collect();
        let rows = derivatives.values.iter_mut().zip(&mut derivatives.at_zero);
        for ((values, at_zero), &[by_amount, by_escrow]) in rows.zip(changes) {
            let by_obstacle = -self.sign * by_escrow;
            if moves {
                let function = GridFunction {
                    nodes,
                    values: &*values,
                    slopes: weights.slopes(values),
                    at_zero: *at_zero,
                };
                let carried =
                    |(place, slope): (&Place, &f64)| function.value(*place) - by_amount * slope;
                *values = places.iter().zip(&slopes).map(carried).collect();
            }
            let mut steps = Vec::new();
            if moves && self.kept() > 0.0 {
                let kinks = before.kinks.iter();
                steps.extend(kinks.map(|kink| (kink.place, -by_amount * kink.jump / self.kept())));
            }
            if self.exercisable {
                let [lower, upper] = before.region;
                steps.retain(|(place, _)| !(lower <= *place && *place <= upper));
                for &place in &before.crossings {
                    let left = cell_of(place, nodes);
                    let rises = before.exercised[left];
                    let jump = values[left + usize::from(rises)] - by_obstacle;
                    steps.push((place, if rises { jump } else { -jump }));
                }
                for (value, exercised) in values.iter_mut().zip(&before.exercised) {
                    if *exercised {
                        *value = by_obstacle;
                    }
                }
                if before.exercised_at_zero {
                    *at_zero = by_obstacle;
                }
            }
            for (place, jump) in steps {
                project_step(nodes, place, jump, values);
            }
        }
    }
}

/// Where exercise gains nothing, between two nodes of which one gains and one does not.
fn root(gain: impl Fn(f64) -> f64, a: f64, b: f64) -> f64 {
    let ends = [gain(a), gain(b)];
    if ends[0] * ends[1] < 0.0 {
        return find_root(gain, a, b, CLOSE);
    }
    if ends[0].abs() < ends[1].abs() {
        a
    } else {
        b
    }
}

fn region(exercised: &[bool], crossings: &[f64]) -> [f64; 2] {
    if !exercised.contains(&true) {
        return EMPTY;
    }
    let end = |crossing: Option<&f64>, inside: bool, infinite: f64| {
        crossing.filter(|_| !inside).copied().unwrap_or(infinite)
    };
    let last = exercised.len() - 1;
    [
        end(crossings.first(), exercised[0], f64::NEG_INFINITY),
        end(crossings.last(), exercised[last], f64::INFINITY),
    ]
}

/// Whether a place is so far inside that both nodes next to it are interior, with a neighbour.
fn is_inside(nodes: &[f64], place: f64) -> bool {
    nodes[1] < place && place < nodes[nodes.len() - 2]
}

/// Add what projecting a kink on hat functions adds to the values at the nodes.
fn project_kink(nodes: &[f64], kink: Kink, values: &mut [f64]) {
    if !is_inside(nodes, kink.place) {
        return;
    }
    let i = cell_of(kink.place, nodes);
    let h = nodes[i + 1] - nodes[i];
    let right = (kink.place - nodes[i]) / h;
    for (node, near) in [(i, 1.0 - right), (i + 1, right)] {
        let weight = 0.5 * (nodes[node + 1] - nodes[node - 1]);
        values[node] += kink.jump * (h * h) * (near * near * near) / (6.0 * weight);
    }
}

/// Add what projecting a step on hat functions adds to the values at the nodes.
fn project_step(nodes: &[f64], place: f64, jump: f64, values: &mut [f64]) {
    if !is_inside(nodes, place) {
        return;
    }
    let i = cell_of(place, nodes);
    let h = nodes[i + 1] - nodes[i];
    let below = (place - nodes[i]) / h;
    let above = 1.0 - below;
    values[i] += jump * h * (above * above) / (nodes[i + 1] - nodes[i - 1]);
    values[i + 1] -= jump * h * (below * below) / (nodes[i + 2] - nodes[i]);
}

#[cfg(test)]
mod tests {
    use super::{project_kink, project_step, Kink};

    #[test]
    fn steps_and_kinks_are_projected_without_loss_of_mass() {
        let nodes: Vec<f64> = (0..26).map(|i| f64::from(i) / 25.0).collect();
        let mass = |values: &[f64]| (values.iter().sum::<f64>() - 0.5 * values[25]) / 25.0;
        for place in [0.5, 0.513, 0.53] {
            let rest = 1.0 - place;
            let mut step: Vec<f64> = nodes.iter().map(|s| f64::from(*s > place)).collect();
            project_step(&nodes, place, 1.0, &mut step);
            assert!((mass(&step) - rest).abs() < 1e-12);
            let mut ramp: Vec<f64> = nodes.iter().map(|s| (s - place).max(0.0)).collect();
            project_kink(&nodes, Kink { place, jump: 1.0 }, &mut ramp);
            // The trapezoidal rule counts a sixth of a cell's square too much at the last node.
            let exact = 0.5 * rest * rest + 1.0 / (6.0 * 625.0);
            assert!((mass(&ramp) - exact).abs() < 1e-12);
        }
    }
}
