//! The exercise boundary on a stretch: a polynomial in the root of time that meets smooth pasting at every stage.

use super::multiplier::Views;
use super::newton::newton;
use super::normal::{distribution, quantile};
use super::profile::Profile;
use super::stretch::Stretch;
use super::tables::{interpolation, table, Table};
use super::touching::Touching;
use crate::lanes::normal::ONE_OVER_SQRT_TWO_PI;

/// Degree of the polynomial, nodes of each of its integrals, and nodes of the integral for the value: near the boundary
/// it sees the youngest contact sets closely.
pub const RUNGS: [(usize, usize, usize); 7] = [
    (2, 4, 8),
    (3, 5, 12),
    (4, 6, 16),
    (6, 8, 20),
    (8, 12, 24),
    (12, 16, 32),
    (16, 24, 40),
];
/// Of the coefficients; Newton's method doubles the digits once more.
const SETTLED: f64 = 1e-6;
const COARSELY_SETTLED: f64 = 1e-4;
/// Of a tail.
const SMALLEST_SHARE: f64 = 1e-12;
const FIRST_GUESS: f64 = 0.8;
const SOON: f64 = 2.0;
/// Of a square.
const NEAREST: f64 = 1e-20;
const MOST_STAGES: usize = 16;
/// Where two boundaries are compared: cells of so many spreads, and what the places are blurred by.
const CELLS: usize = 8;
const CELL: f64 = 0.6;
const SMOOTHED: f64 = 0.5;
/// The first cells, whose chance weighs the violation inside the contact set, and its share in the value's error.
const NEXT: usize = 4;
const VIOLATION_SHARE: f64 = 0.4;
/// Spreads inside the contact set: where value and payoff are compared.
const CHECKED: f64 = 0.5;

/// What is a polynomial in eta = sqrt((s - time)/(h - time)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// The boundary b.
    Plain,
    /// The share N((b - centre)/scale).
    Tail { centre: f64, scale: f64 },
    /// The square of b less the place where the contact set begins.
    Root,
    /// b less the place where the value without exercise is the payoff.
    Shifted,
}

/// How the contact set begins: when, s, and where, x.
#[derive(Clone, Copy, Debug)]
pub struct Start {
    pub form: Form,
    pub time: f64,
    pub place: f64,
    /// At the stretch's beginning; of no meaning where the form is `Plain`.
    pub touching: Touching,
}

impl Start {
    /// A contact set that is measured from the touching point.
    pub fn shifted(profile: &Profile, stretch: &Stretch, time: f64, place: f64) -> Start {
        Start {
            form: Form::Shifted,
            time,
            place,
            touching: Touching::search(profile, stretch, time, place, stretch.duration),
        }
    }

    /// The boundary that belongs to a coefficient, and its derivative.
    pub fn place_of(&self, sign: f64, coefficient: f64, shift: f64) -> (f64, f64) {
        match self.form {
            Form::Tail { centre, scale } => {
                let z = quantile(share(coefficient));
                let density = ONE_OVER_SQRT_TWO_PI * (-0.5 * z * z).exp();
                (centre + sign * scale * z, sign * scale / density)
            }
            Form::Root => {
                if coefficient <= NEAREST {
                    return (self.place, 0.0);
                }
                let distance = coefficient.sqrt();
                (self.place - sign * distance, -0.5 * sign / distance)
            }
            _ => (coefficient + shift, 1.0),
        }
    }

    /// The coefficient at the beginning.
    fn first(&self, sign: f64) -> f64 {
        match self.form {
            Form::Tail { centre, scale } => distribution(sign * (self.place - centre) / scale),
            Form::Plain => self.place,
            Form::Root | Form::Shifted => 0.0,
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
    pub start: Start,
    nodes: &'static Table,
    coefficients: Vec<f64>,
    /// The contact sets as seen from the stretch's beginning.
    pub past: Vec<Past>,
    /// The boundary at the stretch's beginning.
    pub last: f64,
    pub residual: f64,
    enough: f64,
    /// What exercise is worth, at places outside the contact set.
    worth: [f64; CELLS],
    /// Strikes: how far value and payoff are apart inside the contact set, at the stretch's beginning.
    pub violation: f64,
    /// Strikes, of the value now; 0 where it was not asked for.
    pub error: f64,
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
        let shift = shifts(profile, &self.stretch, &self.start, &[s])[0];
        self.start.place_of(self.stretch.sign, coefficient, shift).0
    }

    /// Whether every equation is met.
    pub fn is_found(&self) -> bool {
        self.residual <= self.enough && self.last.is_finite()
    }

    /// Keep the contact sets as seen from the stretch's beginning.
    fn look_back(&mut self, profile: &Profile, nodes: &Table) {
        let (stretch, start) = (&self.stretch, &self.start);
        let span = stretch.duration - start.time;
        let times: Vec<f64> = nodes
            .sine
            .iter()
            .map(|sine| start.time + span * sine * sine)
            .collect();
        let shifts = shifts(profile, stretch, start, &times);
        let seen = shifts.into_iter().enumerate().map(|(l, shift)| {
            let behind = dot(nodes.row(nodes.degree - 1, l), &self.coefficients);
            Past {
                boundary: start.place_of(stretch.sign, behind, shift).0,
                age: span * nodes.cosine[l] * nodes.cosine[l],
                weight: span * nodes.weight[l],
            }
        });
        self.past = seen.collect();
    }

    /// How far value and payoff are apart inside the contact set, where they should be equal.
    fn violation_inside(&self, profile: &Profile) -> f64 {
        let (stretch, s) = (&self.stretch, self.stretch.duration);
        let x = self.last - stretch.sign * CHECKED * stretch.spread();
        let held = profile.propagate(&stretch.flow, x, s)[0] + self.contribution(x)[0];
        (held - stretch.payoff(x, s)).abs()
    }

    /// Keep what exercise is worth at the cells' middles from `origin` outwards.
    fn weigh(&mut self, origin: f64) {
        let outwards = self.stretch.sign * self.stretch.spread() * CELL;
        #[allow(clippy::cast_precision_loss)]
        let places: [f64; CELLS] =
            std::array::from_fn(|cell| origin + outwards * (cell as f64 + 0.5));
        let (views, count) = (self.seen_from(&places), self.past.len());
        self.worth = std::array::from_fn(|cell| views.sums(cell * count..(cell + 1) * count)[0]);
    }

    /// The contact sets as seen from each of the places, one after the other.
    fn seen_from(&self, places: &[f64]) -> Views {
        let mut views = Views::with_room(places.len() * self.past.len());
        for x in places {
            for past in &self.past {
                views.push(*x, past.boundary, past.age, past.weight);
            }
        }
        views.integrate(self.stretch.sign, &self.stretch.flow);
        views
    }

    /// How much the two change the value now: their difference at the stretch's beginning, by the chance to be there.
    ///
    /// Without another one, by all that exercise on this stretch is worth.
    fn distance(&self, before: Option<&Boundary>, chances: &[f64; CELLS]) -> f64 {
        if !(self.is_found() && before.is_none_or(Boundary::is_found)) {
            return f64::INFINITY;
        }
        let before = before.map_or([0.0; CELLS], |before| before.worth);
        let changes = self.worth.iter().zip(before);
        changes
            .zip(chances)
            .map(|((now, before), chance)| (now - before).abs() * chance)
            .sum()
    }

    /// Value, slope and second derivative of the multiplier's part at x, at the beginning.
    pub fn contribution(&self, x: f64) -> [f64; 3] {
        self.seen_from(&[x]).sums(0..self.past.len())
    }
}

pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Where the value without exercise is the payoff at each time; zeros unless the form is `Shifted`.
fn shifts(profile: &Profile, stretch: &Stretch, start: &Start, times: &[f64]) -> Vec<f64> {
    let mut shifts = vec![0.0; times.len()];
    if start.form != Form::Shifted {
        return shifts;
    }
    let mut order: Vec<usize> = (0..times.len()).collect();
    order.sort_by(|&i, &j| times[j].total_cmp(&times[i]));
    let mut touching = start.touching;
    for index in order {
        let s = times[index];
        if s <= start.time * (1.0 + 1e-12) {
            shifts[index] = start.place;
            continue;
        }
        touching = touching.earlier(profile, stretch, start, s);
        shifts[index] = touching.x;
    }
    shifts
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
        let mut every = Vec::with_capacity(times.len() * (1 + nodes.points));
        every.extend_from_slice(&times);
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
            views: Views::with_room(nodes.degree * nodes.points),
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
            let [value_by_boundary, slope_by_boundary] = self.views.by_boundary(range.clone());
            let paid = stretch.sign * x.exp();
            let slope = held[1] + parts[1] + paid;
            let (left, by_place, by_boundary) = if start.form == Form::Shifted {
                let value = held[0] + parts[0] - stretch.payoff(x, self.times[k]);
                (value, slope, value_by_boundary)
            } else {
                let bend = held[2] + parts[2] + paid;
                (slope, bend, slope_by_boundary)
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
            Form::Shifted => {}
            Form::Plain => {
                let step = if self.profile.continues(stretch) {
                    0.0
                } else {
                    FIRST_GUESS
                };
                let spread = stretch.flow.volatility * (stretch.duration - start.time).sqrt();
                for (coefficient, eta) in coefficients.iter_mut().zip(&self.nodes.eta) {
                    *coefficient -= stretch.sign * step * spread * eta;
                }
            }
            Form::Root => {
                let furthest = stretch.sign * (start.place - stretch.perpetual());
                for (coefficient, eta) in coefficients.iter_mut().zip(&self.nodes.eta) {
                    let soon = SOON * stretch.spread() * eta;
                    let distance = if furthest < f64::INFINITY {
                        -furthest * (-soon / furthest).exp_m1()
                    } else {
                        soon
                    };
                    *coefficient = distance * distance;
                }
            }
            Form::Tail { centre, scale } => {
                let mut touching = start.touching;
                let stages = coefficients[1..].iter_mut().zip(&self.times);
                for (coefficient, &s) in stages.rev() {
                    touching = touching.earlier(self.profile, stretch, start, s);
                    *coefficient = distribution(stretch.sign * (touching.x - centre) / scale);
                }
            }
        }
        coefficients
    }
}

/// How far the degree is raised.
#[derive(Clone, Copy)]
pub struct Climb {
    /// The last rung.
    pub top: usize,
    /// Strikes: where the value now changes less from one rung to the next is the end; None for the last rung alone.
    pub budget: Option<f64>,
    /// The residual that is small enough.
    pub enough: f64,
    /// x at the stretch's beginning as it is expected now, and its standard deviation.
    pub centre: f64,
    pub deviation: f64,
}

impl Climb {
    /// The chance to be in each of the cells from `origin` outwards at the stretch's beginning.
    fn chances(&self, stretch: &Stretch, origin: f64) -> [f64; CELLS] {
        let spread = stretch.spread();
        let deviation = self.deviation.hypot(SMOOTHED * spread);
        let place = stretch.sign * (origin - self.centre);
        #[allow(clippy::cast_precision_loss)]
        let below = |cell: usize| distribution((place + CELL * spread * cell as f64) / deviation);
        std::array::from_fn(|cell| below(cell + 1) - below(cell))
    }
}

/// The boundary of the contact set that begins as told; its residual says whether it was found.
pub fn solve_boundary(
    profile: &Profile,
    stretch: &Stretch,
    start: &Start,
    climb: &Climb,
) -> Boundary {
    let mut rung = 0;
    let mut last: Option<Boundary> = None;
    let (mut origin, mut chances) = (f64::NAN, [0.0; CELLS]);
    loop {
        let (degree, points, value_points) = RUNGS[rung];
        let nodes = table(degree, points);
        let mut system = System::new(profile, stretch, start, nodes);
        let mut coefficients = match &last {
            None => system.guess(),
            Some(before) => refined(before, nodes, start.first(stretch.sign)),
        };
        let settled = if rung < climb.top && climb.budget.is_none() {
            COARSELY_SETTLED
        } else {
            SETTLED
        };
        let residual = newton(&mut system, &mut coefficients, settled, climb.enough);
        let end = start.place_of(
            stretch.sign,
            coefficients[degree],
            system.stage_shift[degree - 1],
        );
        let mut now = Boundary {
            stretch: *stretch,
            start: *start,
            nodes,
            past: Vec::new(),
            coefficients,
            last: end.0,
            residual,
            enough: climb.enough,
            worth: [0.0; CELLS],
            violation: 0.0,
            error: 0.0,
        };
        if rung >= climb.top || climb.budget.is_some() {
            now.look_back(profile, table(degree, value_points));
            now.violation = now.violation_inside(profile);
        }
        if let Some(budget) = climb.budget {
            if origin.is_nan() {
                origin = now.last;
                chances = climb.chances(stretch, origin);
            }
            now.weigh(origin);
            let seen = chances[..NEXT].iter().sum::<f64>() * now.violation;
            now.error = now.distance(last.as_ref(), &chances) + VIOLATION_SHARE * seen;
            if now.error <= budget {
                return now;
            }
        }
        // Where a degree fails or brings nothing, the one before stays.
        let kept = match last.take() {
            Some(before)
                if climb.budget.is_some() && before.is_found() && before.error <= now.error =>
            {
                before
            }
            _ => now,
        };
        if rung >= climb.top {
            return kept;
        }
        last = Some(kept);
        rung += 1;
    }
}

/// The coefficients at the nodes of a higher degree.
fn refined(before: &Boundary, nodes: &Table, first: f64) -> Vec<f64> {
    let mut weights = vec![0.0; before.coefficients.len()];
    let mut after: Vec<f64> = nodes
        .eta
        .iter()
        .map(|&eta| {
            interpolation(&before.nodes.eta, eta, &mut weights);
            dot(&weights, &before.coefficients)
        })
        .collect();
    after[0] = first;
    after
}
