//! The exercise boundary on a stretch: a polynomial in the root of time that meets smooth pasting at every stage.

use super::multiplier::Views;
use super::newton::newton;
use super::normal::{distribution, quantile};
use super::profile::Profile;
use super::roots::{find_root, CLOSE};
use super::stretch::Stretch;
use super::tables::{interpolation, table, Table};
use crate::lanes::normal::ONE_OVER_SQRT_TWO_PI;

/// Degrees solved before the one that is asked for.
const LADDER: [usize; 4] = [3, 6, 10, 16];
/// Of the coefficients; Newton's method doubles the digits once more.
const SETTLED: f64 = 1e-6;
const COARSELY_SETTLED: f64 = 1e-4;
/// Of a tail.
const SMALLEST_SHARE: f64 = 1e-12;
const FIRST_GUESS: f64 = 0.8;
const MOST_STAGES: usize = 16;
/// Of a search.
const MOST_STEPS: usize = 200;
/// Spreads, for the first guess of a boundary from far away.
const ROUGHLY: f64 = 1e-2;
/// Spreads, for a place that the boundary is measured from.
const ROUNDING: f64 = 1e-8;
const MOST_NEAR_STEPS: usize = 8;

/// What is a polynomial in eta = sqrt((s - time)/(h - time)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// The boundary b.
    Plain,
    /// The share N((b - centre)/scale).
    Tail { centre: f64, scale: f64 },
    /// b less the place where the value without exercise is the payoff.
    Shifted,
}

/// How the contact set begins: when, s, and where, x.
#[derive(Clone, Copy, Debug)]
pub struct Start {
    pub form: Form,
    pub time: f64,
    pub place: f64,
}

impl Start {
    /// The boundary that belongs to a coefficient, and its derivative.
    pub fn place_of(&self, sign: f64, coefficient: f64, shift: f64) -> (f64, f64) {
        match self.form {
            Form::Tail { centre, scale } => {
                let z = quantile(share(coefficient));
                let density = ONE_OVER_SQRT_TWO_PI * (-0.5 * z * z).exp();
                (centre + sign * scale * z, sign * scale / density)
            }
            _ => (coefficient + shift, 1.0),
        }
    }

    /// The coefficient at the beginning.
    fn first(&self, sign: f64) -> f64 {
        match self.form {
            Form::Tail { centre, scale } => distribution(sign * (self.place - centre) / scale),
            Form::Plain => self.place,
            Form::Shifted => 0.0,
        }
    }
}

fn share(coefficient: f64) -> f64 {
    coefficient.clamp(SMALLEST_SHARE, 1.0 - SMALLEST_SHARE)
}

/// Where a contact set ended how long ago, and its weight in the integral.
pub struct Past {
    pub boundary: f64,
    pub age: f64,
    pub weight: f64,
}

/// The end of the contact set at every time of a stretch since it began, and what its multiplier is worth.
pub struct Boundary {
    stretch: Stretch,
    start: Start,
    nodes: &'static Table,
    coefficients: Vec<f64>,
    /// The contact sets as seen from the stretch's beginning.
    pub past: Vec<Past>,
    /// The boundary at the stretch's beginning.
    pub last: f64,
    pub residual: f64,
}

impl Boundary {
    /// The boundary at time s to the stretch's end, NaN before the contact set began.
    pub fn at(&self, profile: &Profile, s: f64) -> f64 {
        if s < self.start.time {
            return f64::NAN;
        }
        let span = self.stretch.duration - self.start.time;
        let eta = ((s - self.start.time) / span).min(1.0).sqrt();
        if eta <= 0.0 {
            return self.start.place;
        }
        let mut weights = vec![0.0; self.coefficients.len()];
        interpolation(&self.nodes.eta, eta, &mut weights);
        let coefficient = dot(&weights, &self.coefficients);
        let shift = shift_at(profile, &self.stretch, &self.start, s);
        self.start.place_of(self.stretch.sign, coefficient, shift).0
    }

    /// Value, slope and second derivative of the multiplier's part at x, at the beginning.
    pub fn contribution(&self, x: f64) -> [f64; 3] {
        let mut views = Views::default();
        for past in &self.past {
            views.push(x, past.boundary, past.age, past.weight);
        }
        views.integrate(self.stretch.sign, &self.stretch.flow);
        views.sums(0..self.past.len())
    }
}

pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn shift_at(profile: &Profile, stretch: &Stretch, start: &Start, s: f64) -> f64 {
    shifts(profile, stretch, start, &[s])[0]
}

/// Where the value without exercise is the payoff at each time; zeros unless the form is `Shifted`.
fn shifts(profile: &Profile, stretch: &Stretch, start: &Start, times: &[f64]) -> Vec<f64> {
    let mut shifts = vec![0.0; times.len()];
    if start.form != Form::Shifted {
        return shifts;
    }
    let mut order: Vec<usize> = (0..times.len()).collect();
    order.sort_by(|&i, &j| times[j].total_cmp(&times[i]));
    let mut last = None;
    for index in order {
        let s = times[index];
        if s <= start.time * (1.0 + 1e-12) {
            shifts[index] = start.place;
            continue;
        }
        let near = last.and_then(|x| touching_near(profile, stretch, x, s, ROUNDING));
        let found = near.unwrap_or_else(|| touching_point(profile, stretch, start.place, s));
        shifts[index] = found;
        last = Some(found);
    }
    shifts
}

/// Where the value without exercise, below the payoff at `place`, meets it at time s.
pub fn touching_point(profile: &Profile, stretch: &Stretch, place: f64, s: f64) -> f64 {
    let above = |x: f64| profile.propagate(&stretch.flow, x, s)[0] - stretch.payoff(x, s);
    // Panels are fine enough for such a step next to the place.
    let step = stretch.sign * stretch.flow.volatility * s.sqrt();
    let mut inside = place;
    for _ in 0..MOST_STEPS {
        if above(inside) <= 0.0 {
            break;
        }
        inside -= step;
    }
    let mut outside = inside + step;
    for _ in 0..MOST_STEPS {
        if above(outside) >= 0.0 {
            break;
        }
        (inside, outside) = (outside, outside + step);
    }
    find_root(above, inside, outside, CLOSE)
}

/// The same by Newton's method from a place near it, until a step is below `close` spreads; None where it goes astray.
fn touching_near(profile: &Profile, stretch: &Stretch, x: f64, s: f64, close: f64) -> Option<f64> {
    let mut place = x;
    for _ in 0..MOST_NEAR_STEPS {
        let [value, by_x, _] = profile.propagate(&stretch.flow, place, s);
        let slope = by_x + stretch.sign * place.exp();
        let step = (value - stretch.payoff(place, s)) / slope;
        if !(stretch.sign * slope > 0.0 && step.abs() < stretch.spread()) {
            return None;
        }
        place -= step;
        if step.abs() <= close * stretch.spread() {
            return Some(place);
        }
    }
    None
}

/// The equations of one degree.
pub struct System<'a> {
    pub profile: &'a Profile,
    pub stretch: &'a Stretch,
    pub start: &'a Start,
    pub nodes: &'static Table,
    /// s at the stages, (m).
    pub times: Vec<f64>,
    stage_shift: Vec<f64>,
    node_shift: Vec<f64>,
    views: Views,
    turns: Vec<f64>,
}

impl<'a> System<'a> {
    fn new(
        profile: &'a Profile,
        stretch: &'a Stretch,
        start: &'a Start,
        nodes: &'static Table,
    ) -> Self {
        let span = stretch.duration - start.time;
        let times: Vec<f64> = nodes.eta[1..]
            .iter()
            .map(|eta| start.time + span * eta * eta)
            .collect();
        let mut every = times.clone();
        for eta in &nodes.eta[1..] {
            every.extend(
                nodes
                    .sine
                    .iter()
                    .map(|sine| start.time + span * (eta * sine).powi(2)),
            );
        }
        let mut stage_shift = shifts(profile, stretch, start, &every);
        let node_shift = stage_shift.split_off(times.len());
        System {
            profile,
            stretch,
            start,
            nodes,
            times,
            stage_shift,
            node_shift,
            views: Views::default(),
            turns: vec![0.0; nodes.degree * nodes.points],
        }
    }

    /// The contact sets as seen from stage k at x: append them to the views; keep their derivatives by the coefficients.
    fn look_back(&mut self, k: usize, x: f64, coefficients: &[f64]) {
        let (nodes, points) = (self.nodes, self.nodes.points);
        let span = self.times[k] - self.start.time;
        for l in 0..points {
            let behind = dot(nodes.row(k, l), coefficients);
            let shift = self.node_shift[k * points + l];
            let (place, turn) = self.start.place_of(self.stretch.sign, behind, shift);
            self.turns[k * points + l] = turn;
            let age = span * nodes.cosine[l] * nodes.cosine[l];
            self.views.push(x, place, age, span * nodes.weight[l]);
        }
    }

    /// Fill in m residuals and m x m derivatives by the coefficients behind the first.
    ///
    /// The slope of V - g, a Volterra equation of the second kind for the boundary, is the better equation; where the
    /// contact set spreads faster than diffusion follows, the slope jumps in a layer that the integrals do not see, and
    /// V - g is taken.
    pub fn residual(&mut self, coefficients: &[f64], residual: &mut [f64], jacobian: &mut [f64]) {
        let (stretch, start, degree) = (self.stretch, self.start, self.nodes.degree);
        let points = self.nodes.points;
        self.views.clear();
        let mut places = [(0.0, 0.0); MOST_STAGES];
        for k in 0..degree {
            let coefficient = coefficients[k + 1];
            places[k] = start.place_of(stretch.sign, coefficient, self.stage_shift[k]);
            self.look_back(k, places[k].0, coefficients);
        }
        self.views.integrate(stretch.sign, &stretch.flow);
        for k in 0..degree {
            let (x, turn) = places[k];
            let held = self.profile.propagate(&stretch.flow, x, self.times[k]);
            let range = k * points..(k + 1) * points;
            let parts = self.views.sums(range.clone());
            let paid = stretch.sign * x.exp();
            let slope = held[1] + parts[1] + paid;
            let (left, by_place, by_boundary) = if start.form == Form::Shifted {
                let value = held[0] + parts[0] - stretch.payoff(x, self.times[k]);
                (value, slope, &self.views.value_by_boundary[range.clone()])
            } else {
                let bend = held[2] + parts[2] + paid;
                (slope, bend, &self.views.slope_by_boundary[range.clone()])
            };
            residual[k] = left;
            let row = &mut jacobian[k * degree..(k + 1) * degree];
            row.fill(0.0);
            for (l, (by_boundary, turn)) in by_boundary.iter().zip(&self.turns[range]).enumerate() {
                let turned = by_boundary * turn;
                for (entry, weight) in row.iter_mut().zip(&self.nodes.row(k, l)[1..]) {
                    *entry += turned * weight;
                }
            }
            row[k] += by_place * turn;
        }
    }

    fn guess(&self) -> Vec<f64> {
        let (stretch, start) = (self.stretch, self.start);
        let mut coefficients = vec![start.first(stretch.sign); self.nodes.eta.len()];
        match start.form {
            Form::Plain => {
                let smooth =
                    stretch.is_continuous() && stretch.exercise_at_end && self.profile.has_nodes();
                let spread = stretch.flow.volatility * (stretch.duration - start.time).sqrt();
                let step = if smooth { 0.0 } else { FIRST_GUESS };
                for (coefficient, eta) in coefficients.iter_mut().zip(&self.nodes.eta) {
                    *coefficient -= stretch.sign * step * spread * eta;
                }
            }
            Form::Tail { centre, scale } => {
                let mut touching = centre;
                let stages = coefficients[1..].iter_mut().zip(&self.times);
                for (coefficient, &s) in stages.rev() {
                    let near = touching_near(self.profile, stretch, touching, s, ROUGHLY);
                    touching = near
                        .unwrap_or_else(|| touching_point(self.profile, stretch, start.place, s));
                    *coefficient = distribution(stretch.sign * (touching - centre) / scale);
                }
            }
            Form::Shifted => {}
        }
        coefficients
    }
}

/// The boundary of the contact set that begins as told; its residual says whether it was found.
pub fn solve_boundary(
    profile: &Profile,
    stretch: &Stretch,
    start: &Start,
    degree: usize,
    points: usize,
    value_points: usize,
) -> Boundary {
    let mut known: Option<(Vec<f64>, &'static Table)> = None;
    let lower = LADDER.into_iter().filter(|&m| m < degree);
    for m in lower.chain(std::iter::once(degree)) {
        let (settled, count) = if m == degree {
            (SETTLED, points)
        } else {
            (COARSELY_SETTLED, m + 3)
        };
        let nodes = table(m, count);
        let mut system = System::new(profile, stretch, start, nodes);
        let mut coefficients = match &known {
            None => system.guess(),
            Some((before, old)) => refined(before, old, nodes, start.first(stretch.sign)),
        };
        let residual = newton(&mut system, &mut coefficients, settled);
        if m == degree {
            let shift = system.stage_shift[m - 1];
            let (last, _) = start.place_of(stretch.sign, coefficients[m], shift);
            return Boundary {
                stretch: *stretch,
                start: *start,
                nodes,
                past: past(
                    profile,
                    stretch,
                    start,
                    &coefficients,
                    table(m, value_points),
                ),
                coefficients,
                last,
                residual,
            };
        }
        known = Some((coefficients, nodes));
    }
    unreachable!("the last degree returns")
}

/// The contact sets as seen from the stretch's beginning.
fn past(
    profile: &Profile,
    stretch: &Stretch,
    start: &Start,
    coefficients: &[f64],
    nodes: &Table,
) -> Vec<Past> {
    let span = stretch.duration - start.time;
    let times: Vec<f64> = nodes
        .sine
        .iter()
        .map(|sine| start.time + span * sine * sine)
        .collect();
    shifts(profile, stretch, start, &times)
        .into_iter()
        .enumerate()
        .map(|(l, shift)| {
            let behind = dot(nodes.row(nodes.degree - 1, l), coefficients);
            Past {
                boundary: start.place_of(stretch.sign, behind, shift).0,
                age: span * nodes.cosine[l] * nodes.cosine[l],
                weight: span * nodes.weight[l],
            }
        })
        .collect()
}

/// The coefficients at the nodes of a higher degree.
fn refined(before: &[f64], old: &Table, nodes: &Table, first: f64) -> Vec<f64> {
    let mut weights = vec![0.0; before.len()];
    let mut after: Vec<f64> = nodes
        .eta
        .iter()
        .map(|&eta| {
            interpolation(&old.eta, eta, &mut weights);
            dot(&weights, before)
        })
        .collect();
    after[0] = first;
    after
}
