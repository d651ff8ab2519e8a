//! The exercise boundary on a stretch: a polynomial in the root of time that meets smooth pasting at every stage.

use super::multiplier::{blocks, contribution, Past, Views};
use super::newton::newton;
use super::normal::{distribution, quantile};
use super::profile::{Passage, Profile};
use super::stretch::Stretch;
use super::tables::{interpolation, table, Table};
use super::touching::Touching;
use crate::lanes::normal::ONE_OVER_SQRT_TWO_PI;
use crate::lanes::vector::LANES;

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
const VIOLATION_SHARE: f64 = 0.7;
/// Of a change from one rung to the next: what is left after it, where each gains a factor of nearly three at least.
const LEFT: f64 = 0.6;
/// A rung that fails, or leaves more than such a share of the error and so many times the budget, brings nothing.
const GAIN: f64 = 0.7;
const FAR: f64 = 10.0;
/// Residuals that are small enough, as shares of the tolerance, and at the least. Where the slope is a little wrong, so is
/// the boundary, and the value by a few hundredths of that.
const ENOUGH_OF_SLOPE: f64 = 0.5;
const ENOUGH_OF_VALUE: f64 = 0.05;
const LEAST_RESIDUAL: f64 = 1e-9;
/// Of the slope that is small enough, on the first rung, which hardly ever is the last: the next begins from there.
const ROUGHLY: f64 = 20.0;
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
        let shift = at(&shifts(profile, &self.stretch, &self.start, &[s]), 0);
        self.start.place_of(self.stretch.sign, coefficient, shift).0
    }

    /// Whether every equation is met.
    pub fn is_found(&self) -> bool {
        self.residual <= self.enough && self.last.is_finite()
    }

    /// Whether the value's error is beyond what it may be.
    pub fn is_too_rough(&self, climb: &Climb) -> bool {
        let is_beyond = |budget| self.error.is_nan() || self.error > budget;
        climb.budget.is_some_and(is_beyond)
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
        let ages: Vec<(f64, f64)> = nodes.ages(span).collect();
        let blocks = blocks(&stretch.flow, &ages).into_iter().enumerate();
        let past = blocks.map(|(block, ages)| {
            let mut boundary = [start.place; LANES];
            let nodes_here = (block * LANES..nodes.points).zip(&mut boundary);
            for (l, place) in nodes_here {
                let behind = dot(nodes.row(nodes.degree - 1, l), &self.coefficients);
                *place = start.place_of(stretch.sign, behind, at(&shifts, l)).0;
            }
            Past {
                ages,
                boundary,
                edge: boundary.map(f64::exp),
            }
        });
        self.past = past.collect();
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
        self.worth = places.map(|x| self.contribution(x)[0]);
    }

    /// What the value now may be off by: what is left of the change from one rung to the next at the stretch's beginning,
    /// weighed by the chance to be there.
    ///
    /// Without another one, all that exercise on this stretch is worth.
    fn distance(&self, before: Option<&Boundary>, chances: &[f64; CELLS]) -> f64 {
        if !(self.is_found() && before.is_none_or(Boundary::is_found)) {
            return f64::INFINITY;
        }
        let left = if before.is_none() { 1.0 } else { LEFT };
        let before = before.map_or([0.0; CELLS], |before| before.worth);
        let changes = self.worth.iter().zip(before);
        let change: f64 = changes
            .zip(chances)
            .map(|((now, before), chance)| (now - before).abs() * chance)
            .sum();
        left * change
    }

    /// Value, slope and second derivative of the multiplier's part at x, at the beginning.
    pub fn contribution(&self, x: f64) -> [f64; 3] {
        contribution(self.stretch.sign, &self.stretch.flow, &self.past, x)
    }
}

pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

/// Where the value without exercise is the payoff at each time; empty unless the form is `Shifted`.
fn shifts(profile: &Profile, stretch: &Stretch, start: &Start, times: &[f64]) -> Vec<f64> {
    if start.form != Form::Shifted {
        return Vec::new();
    }
    let mut shifts = vec![0.0; times.len()];
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

/// One of the shifts.
fn at(shifts: &[f64], index: usize) -> f64 {
    shifts.get(index).copied().unwrap_or(0.0)
}

/// The equations of one degree.
pub struct System<'a> {
    pub profile: &'a Profile,
    pub stretch: &'a Stretch,
    pub start: &'a Start,
    pub nodes: &'static Table,
    /// s at the stages, (m).
    pub times: Vec<f64>,
    passages: Vec<Passage>,
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
        let behind = nodes.eta[1..]
            .iter()
            .flat_map(|eta| nodes.sine.iter().map(move |sine| eta * sine))
            .map(|eta| start.time + span * eta * eta);
        let every: Vec<f64> = times.iter().copied().chain(behind).collect();
        let mut stage_shift = shifts(profile, stretch, start, &every);
        let node_shift = stage_shift.split_off(times.len().min(stage_shift.len()));
        let ages = times.iter().flat_map(|s| nodes.ages(s - start.time));
        let ages: Vec<(f64, f64)> = ages.collect();
        System {
            profile,
            stretch,
            start,
            nodes,
            passages: times
                .iter()
                .map(|&s| Passage::new(&stretch.flow, s))
                .collect(),
            times,
            stage_shift,
            node_shift,
            views: Views::new(&stretch.flow, &ages),
            turns: vec![0.0; nodes.degree * nodes.points],
        }
    }

    /// The contact sets as seen from stage k at x: keep the views, and their derivatives by the coefficients.
    fn look_back(&mut self, k: usize, x: f64, spot: f64, coefficients: &[f64]) {
        let (nodes, points) = (self.nodes, self.nodes.points);
        for l in 0..points {
            let behind = dot(nodes.row(k, l), coefficients);
            let index = k * points + l;
            let shift = at(&self.node_shift, index);
            let (place, turn) = self.start.place_of(self.stretch.sign, behind, shift);
            self.turns[index] = turn;
            self.views.place(index, x, spot, place);
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
        let mut places = [(0.0, 0.0, 0.0); MOST_STAGES];
        for k in 0..degree {
            let shift = at(&self.stage_shift, k);
            let (x, turn) = start.place_of(stretch.sign, coefficients[k + 1], shift);
            places[k] = (x, x.exp(), turn);
            self.look_back(k, x, places[k].1, coefficients);
        }
        let with_value = start.form == Form::Shifted;
        self.views
            .integrate(stretch.sign, &stretch.flow, with_value);
        for k in 0..degree {
            let (x, spot, turn) = places[k];
            let row = &mut jacobian[k * degree..(k + 1) * degree];
            row.fill(0.0);
            let [mut value, mut slope, mut bend] = self.profile.passed(&self.passages[k], x, spot);
            for l in 0..points {
                let seen = self.views.seen(k * points + l);
                value += seen.value;
                slope += seen.by_x;
                bend += seen.by_xx;
                let by_boundary = if with_value {
                    seen.value_by_boundary
                } else {
                    seen.slope_by_boundary
                };
                let turned = by_boundary * self.turns[k * points + l];
                for (entry, weight) in row.iter_mut().zip(&self.nodes.row(k, l)[1..]) {
                    *entry += turned * weight;
                }
            }
            let paid = stretch.sign * spot;
            slope += paid;
            let (left, by_place) = if with_value {
                (value - stretch.payoff(x, self.times[k]), slope)
            } else {
                (slope, bend + paid)
            };
            residual[k] = left;
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
    /// Strikes, of the whole value; 0 where no budget is given.
    pub tolerance: f64,
    /// Where so many rungs in a row bring nothing, no further one is tried.
    pub patience: usize,
    /// x at the stretch's beginning as it is expected now, and its standard deviation.
    pub centre: f64,
    pub deviation: f64,
}

impl Climb {
    /// The residual that is small enough: of the slope, or of the value.
    fn enough(&self, form: Form) -> f64 {
        let share = if form == Form::Shifted {
            ENOUGH_OF_VALUE
        } else {
            ENOUGH_OF_SLOPE
        };
        LEAST_RESIDUAL.max(share * self.tolerance)
    }

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
    let (mut curvature, mut stalls) = (f64::INFINITY, 0);
    let least = climb.enough(start.form);
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
        let is_sketch = rung == 0 && climb.budget.is_some() && start.form != Form::Shifted;
        let enough = if is_sketch { ROUGHLY * least } else { least };
        let ends = (settled, enough);
        let residual = newton(&mut system, &mut coefficients, ends, &mut curvature);
        let end = start.place_of(
            stretch.sign,
            coefficients[degree],
            at(&system.stage_shift, degree - 1),
        );
        let mut now = Boundary {
            stretch: *stretch,
            start: *start,
            nodes,
            past: Vec::new(),
            coefficients,
            last: end.0,
            residual,
            enough,
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
            if now.residual <= least && !now.is_too_rough(climb) {
                return now;
            }
            if let Some(before) = &last {
                let gains = now.error < (GAIN * before.error).max(FAR * budget);
                stalls = if gains { 0 } else { stalls + 1 };
            }
        }
        // Where a degree fails or brings nothing, the one before stays.
        let kept = match last.take() {
            Some(before)
                if climb.budget.is_some()
                    && before.residual <= least
                    && before.error <= now.error =>
            {
                before
            }
            _ => now,
        };
        if rung >= climb.top || stalls == climb.patience {
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
