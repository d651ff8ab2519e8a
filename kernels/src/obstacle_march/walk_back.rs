//! The march transposed: the derivatives of a value now by all coefficients and by all that happens, in one walk back.
//!
//! The walk carries what a change of each number of the march would do to the value, from now to expiry. At each stage
//! it solves the transposed system, in which a node's row is s times that of the equation and 1 - s times the identity,
//! s its distance from the contact set in cells, 0 in it and 1 from one cell on. What is held fixed are the grid, the
//! steps and the nodes that a step has not looked at, for they are in contact and nothing depends on what was there.

use super::contract::{Contract, Segment};
use super::event::{hat, hat_weights, indices_after, points_of_hat, tilt, After, Before};
use super::line::{Line, Reading};
use super::mesh::Grid;
use super::record::{clear_before, Record, Start};
use super::stage::{Elimination, Obstacle, Rows, Stage};
use super::start::Window;
use super::steps::{LaneSteps, Step};
use super::tableau::GAMMA;
use super::terms::Terms;
use crate::interrupt::Interrupt;
use crate::lanes::vector::{Part, Vector, LANES};

/// Derivatives of a value by the numbers of a segment, in the units of `Segment`.
#[derive(Clone, Copy, Debug, Default)]
pub struct BySegment {
    /// By the rate.
    pub rate: f64,
    /// By the dividend yield.
    pub dividend_yield: f64,
    /// By the volatility.
    pub volatility: f64,
    /// By the share of the spot by which it drops.
    pub fraction: f64,
    /// By the amount by which it drops.
    pub amount: f64,
    /// By what is escrowed at the end.
    pub escrow: f64,
    /// By a shift of the local volatility in ln S.
    pub shift: f64,
}

impl BySegment {
    /// How many there are.
    pub const COUNT: usize = 7;

    /// In the order of the fields.
    #[must_use]
    pub fn numbers(&self) -> [f64; Self::COUNT] {
        [
            self.rate,
            self.dividend_yield,
            self.volatility,
            self.fraction,
            self.amount,
            self.escrow,
            self.shift,
        ]
    }
}

/// What a value now is made of: a sum over nodal values, and how it goes with the strike less what is escrowed.
pub struct Functional {
    pub reading: Option<Reading>,
    pub by_strike: f64,
}

impl Functional {
    /// The value at a spot.
    pub fn of(line: &Line, spot: f64) -> Self {
        let index = line.grid.index(spot);
        if line.contact.holds(index) {
            return Self {
                reading: None,
                by_strike: line.grid.sign,
            };
        }
        Self {
            reading: Some(line.reading(spot, index)),
            by_strike: 0.0,
        }
    }
}

/// What the walk needs to know of a march.
#[derive(Clone, Copy)]
pub struct Course<'w, 'a, V> {
    pub contracts: &'w [Contract<'a>],
    pub cells: usize,
    pub grids: &'w [Grid],
    pub steps: &'w [Vec<Step>],
    pub spots: &'w [Vec<f64>],
    pub signed: &'w [V],
    pub last_kink: usize,
    pub interrupt: Interrupt<'w>,
}

/// A walk back, and what each number of the march is worth.
pub struct WalkBack<'w, 'a, T, V: 'static> {
    pub march: Course<'w, 'a, V>,
    pub terms: T,
    pub record: &'w Record<V>,
    /// What is asked of each lane.
    pub functionals: &'w [Functional],
}

impl<T: Terms<V>, V: Vector> Part<V> for WalkBack<'_, '_, T, V> {
    type Result = Option<Vec<Vec<BySegment>>>;

    #[inline(always)]
    fn run(self) -> Self::Result {
        let mut terms = self.terms.clone();
        Walk::<V>::new(&self).run(&mut terms)
    }
}

/// What a change of the obstacle does at a stage, and in the cells that hold an end of the contact set a change of c, of c's
/// part by the spot, of the volatility, and a shift of it.
struct OfContact<V> {
    obstacle: V,
    cost: V,
    cost_by_spot: V,
    volatility: V,
    shift: V,
}

struct Walk<'w, 'a, V: 'static> {
    march: Course<'w, 'a, V>,
    record: &'w Record<V>,
    functionals: &'w [Functional],
    /// The weights of V at the nodes at the step's end and at its start, and of the rates at its start and of its stages.
    ended: Vec<V>,
    begun: Vec<V>,
    rates: [Vec<V>; 4],
    /// The weights of V at a stage, of its rows, and of what it starts from.
    direct: Vec<V>,
    of_rows: Vec<V>,
    elimination: Elimination<V>,
    /// The recursion e - f `nu_before` for the weights of the rows.
    known: Vec<V>,
    factor: Vec<V>,
    /// How far the nodes are from the contact set, in cells.
    distance: Vec<V>,
    /// The first inner node that is looked at; the weights before it are 0.
    first: usize,
    /// (1 + a r) V less the base of each stage.
    forces: [Vec<V>; 3],
    found: Vec<Vec<BySegment>>,
}

impl<'w, 'a, V: Vector> Walk<'w, 'a, V> {
    fn new<T>(part: &WalkBack<'w, 'a, T, V>) -> Self {
        let nodes = part.march.cells + 1;
        let array = || vec![V::zero(); nodes];
        let contracts = &part.march.contracts;
        Self {
            march: part.march,
            record: part.record,
            functionals: part.functionals,
            ended: array(),
            begun: array(),
            rates: [array(), array(), array(), array()],
            direct: array(),
            of_rows: array(),
            elimination: Elimination::new(nodes),
            known: array(),
            factor: array(),
            distance: array(),
            first: 1,
            forces: [array(), array(), array()],
            found: contracts
                .iter()
                .map(|one| vec![BySegment::default(); one.segments.len()])
                .collect(),
        }
    }

    #[inline(always)]
    fn run<T: Terms<V>>(mut self, terms: &mut T) -> Option<Vec<Vec<BySegment>>> {
        let steps = self.march.steps;
        let most = steps.iter().map(Vec::len).max().unwrap_or(0);
        for n in (0..most).rev() {
            if (self.march.interrupt)() {
                return None;
            }
            for (lane, own) in steps.iter().enumerate() {
                if n + 1 == own.len() {
                    self.begin(lane);
                } else if own.get(n).is_some_and(|step| step.is_last) {
                    self.through_start(terms, lane, own[n + 1].segment);
                }
                if let Some(step) = own.get(n) {
                    let contract = &self.march.contracts[lane];
                    terms.enter(lane, contract, step.segment, &self.march.grids[lane]);
                }
            }
            self.step(terms, n);
        }
        for (lane, own) in steps.iter().enumerate() {
            self.through_start(terms, lane, own[0].segment);
        }
        Some(self.found)
    }

    /// Take in what is asked of a lane.
    fn begin(&mut self, lane: usize) {
        self.clear_rates(lane);
        self.first = 1;
        let mut weights = vec![0.0; self.ended.len()];
        let asked = &self.functionals[lane];
        if let Some(reading) = &asked.reading {
            let own = &reading.weights[..reading.points];
            weights[reading.start..][..reading.points].copy_from_slice(own);
        }
        self.set_ended(lane, &weights);
        let contract = &self.march.contracts[lane];
        self.by_strike_now(lane, 0, &contract.segments[0], asked.by_strike);
    }

    /// Take the weights of a lane's values at the end of the step to come.
    #[inline(always)]
    fn set_ended(&mut self, lane: usize, weights: &[f64]) {
        for (row, weight) in self.ended.iter_mut().zip(weights) {
            *row = row.with_lane(lane, *weight);
        }
    }

    /// Look at no node before a given one: what has been asked of those that are passed depends on nothing.
    fn pass(&mut self, first: usize) {
        if first > self.first {
            let arrays = self.rates.iter_mut().chain([&mut self.ended]);
            for array in arrays {
                array[self.first - 1..first].fill(V::zero());
            }
        }
        self.first = first;
    }

    /// Nothing has been asked of a lane's rates.
    fn clear_rates(&mut self, lane: usize) {
        let mut keep = [-1.0; LANES];
        keep[lane] = 1.0;
        let keep = V::from_lanes(keep);
        for rates in &mut self.rates {
            for rate in rates {
                *rate = keep.negative(*rate, V::zero());
            }
        }
    }

    /// A change of the strike less what is escrowed at the beginning of a segment.
    fn by_strike_now(&mut self, lane: usize, number: usize, segment: &Segment, weight: f64) {
        if segment.escrow != 0.0 {
            let discount = (-segment.rate * segment.duration).exp();
            let found = &mut self.found[lane][number];
            found.escrow -= weight * discount;
            found.rate += weight * segment.escrow * segment.duration * discount;
        }
    }

    /// Walk through a step of all lanes.
    #[inline(always)]
    fn step<T: Terms<V>>(&mut self, terms: &mut T, n: usize) {
        let steps = LaneSteps::<V>::at(n, self.march.contracts, self.march.steps);
        let a = steps.dt.times(GAMMA);
        let walked = &self.record.first[n][..self.march.contracts.len()];
        let first = walked.iter().copied().min().unwrap_or(1);
        self.pass(first);
        self.march_again(n, &steps, a);
        // The rate of the last stage is that of the next step's start.
        self.rates.swap(0, 3);
        let from = self.from();
        self.rates[0][from..].fill(V::zero());
        self.begun[from..].fill(V::zero());
        self.direct[from..].copy_from_slice(&self.ended[from..]);
        for number in (0..3).rev() {
            let is_other = terms.set(number, &steps, number == 2);
            let stage = terms.stage(a);
            if is_other {
                // The transposed elimination has the same pivots where nothing is in contact.
                self.elimination.of(&stage, first);
            }
            let of_contact = self.stage(3 * n + number, number, terms, &stage, &steps);
            let values = self.record.stage(3 * n + number);
            let forces = &mut self.forces[number];
            let more = stage.growth.plus(-1.0);
            for (force, value) in forces[first - 1..].iter_mut().zip(&values[first - 1..]) {
                *force = more.times_plus(*value, *force);
            }
            let of_rows = terms.by_coefficients(&stage, first, &self.of_rows, values, forces);
            self.add_up(n, number, &steps, of_rows, &of_contact);
            self.direct[from..].fill(V::zero());
        }
        self.ended[from..].copy_from_slice(&self.begun[from..]);
        // The march began the step with rates of 0 in contact.
        let own_first = &self.record.first[n];
        clear_before(&mut self.rates[0], first, own_first, self.march.cells);
    }

    /// The first node that is looked at.
    fn from(&self) -> usize {
        if self.first == 1 {
            0
        } else {
            self.first
        }
    }

    /// Leave in `forces` V less the base of each stage of a step, which is the implicit weight times the stage's rate.
    #[inline(always)]
    fn march_again(&mut self, n: usize, steps: &LaneSteps<V>, a: V) {
        let known = self.first - 1;
        if n > 0 {
            self.begun[known..].copy_from_slice(&self.record.stage(3 * n - 1)[known..]);
        }
        for (lane, own) in self.march.steps.iter().enumerate() {
            let Some(step) = own.get(n).filter(|step| step.is_first) else {
                continue;
            };
            if let Some(start) = &self.record.starts[lane][step.segment] {
                for (row, value) in self.begun.iter_mut().zip(&start.begun) {
                    *row = row.with_lane(lane, *value);
                }
            }
        }
        let inverse = V::all(1.0) / a;
        let at_start = self.record.rates(n);
        for number in 0..3 {
            let weights = steps.weights(number);
            let values = self.record.stage(3 * n + number);
            let (before, found) = self.forces.split_at_mut(number);
            let count = values.len();
            let (begun, at_start) = (&self.begun[..count], &at_start[..count]);
            let found = &mut found[0][..count];
            for i in known..count {
                found[i] = (-at_start[i]).times_plus(weights[0], values[i] - begun[i]);
            }
            for (before, weight) in before.iter().zip(&weights[1..]) {
                let share = -(*weight * inverse);
                for (force, before) in found[known..].iter_mut().zip(&before[known..]) {
                    *force = before.times_plus(share, *force);
                }
            }
        }
    }

    /// Walk through one stage: from the weights of its values and its rates to those of what it starts from.
    #[inline(always)]
    #[allow(clippy::cast_precision_loss)]
    fn stage<T: Terms<V>>(
        &mut self,
        index: usize,
        number: usize,
        terms: &T,
        stage: &Stage<T::Rows<'_>, V>,
        steps: &LaneSteps<V>,
    ) -> OfContact<V> {
        let values = self.record.stage(index);
        let (first, last) = (self.first, self.march.cells - 1);
        let from = self.from();
        let (zero, one) = (V::zero(), V::all(1.0));
        let obstacle = terms.exercise().obstacle(steps.strikes[number]);
        let rates = &self.rates[number + 1][from..];
        for (direct, rate) in self.direct[from..].iter_mut().zip(rates) {
            *direct = rate.times_plus(stage.inverse, *direct);
        }
        // The ends: linear in the spot, or in contact.
        let (q, p) = (stage.near_rule, stage.far_rule);
        let end = self.direct[last + 1];
        self.direct[last] = p.plus(1.0).times_plus(end, self.direct[last]);
        self.direct[last - 1] = (-p).times_plus(end, self.direct[last - 1]);
        let (mut near_end, mut touching) = (zero, one);
        if first == 1 {
            let gap = values[0] - (obstacle.strike - self.march.signed[0]);
            touching = gap.abs().plus(-f64::MIN_POSITIVE).negative(one, zero);
            near_end = self.direct[0];
            let loose_end = (one - touching) * near_end;
            self.direct[1] = q.plus(1.0).times_plus(loose_end, self.direct[1]);
            self.direct[2] = (-q).times_plus(loose_end, self.direct[2]);
        }
        let loose = one - touching;
        let top = self.top_of_contact(index);
        let reach = V::from_lanes(self.record.reach[index]);
        // The weights of the rows, the elimination from the far end.
        let (mut after, mut factor) = (zero, zero);
        let direct = &self.direct[..last + 2];
        let inverse = &self.elimination.inverse[..=last];
        let (known, factors) = (&mut self.known[..=last], &mut self.factor[..=last]);
        let free = (top + 1).max(first).max(3);
        for i in (free..=last).rev() {
            let [upper, _, low] = stage.column(i, last, loose);
            after = (-(low * inverse[i])).times_plus(after, direct[i] * inverse[i]);
            factor = -(upper * inverse[i]);
            (known[i], factors[i]) = (after, factor);
        }
        for i in (first..free.min(last + 1)).rev() {
            let [upper, diagonal, low] = stage.column(i, last, loose);
            let half_inverse = stage.rows.at(i).half_inverse;
            let (gain, rise) = obstacle.at(self.march.signed[i], half_inverse);
            let s = distance_of(gain, rise, values[i], reach.plus(1.0 - i as f64));
            self.distance[i] = s;
            let own = low.times_plus(factor, diagonal);
            let pivot = s * own + stage.rows.at(i).spread * (one - s);
            let pivot_inverse = s / pivot;
            after = (-(low * pivot_inverse)).times_plus(after, direct[i] * pivot_inverse);
            factor = -(upper * pivot_inverse);
            (known[i], factors[i]) = (after, factor);
        }
        let of_rows = &mut self.of_rows[..=last];
        let mut found = zero;
        for i in first..=last {
            found = factors[i].times_plus(found, known[i]);
            of_rows[i] = found;
        }
        // What the stage starts from: M transposed times the weights of the rows, less what the rates take of it.
        let weights = steps.weights(number);
        let (earlier, own) = self.rates.split_at_mut(number + 1);
        let (own, begun) = (&mut own[0][..last + 2], &mut self.begun[..last + 2]);
        // What rows have given to a node and to the one behind it; row i + 1 gives to nodes i, i + 1 and i + 2.
        let mut taken = [zero; 2];
        if from == first {
            let [_, mass, after] = stage.rows.at(first).mass;
            taken = [of_rows[first] * mass, of_rows[first] * after];
        }
        let based = &mut self.known[..last + 2];
        for i in from..last {
            let (row, mass) = (of_rows[i + 1], stage.rows.at(i + 1).mass);
            based[i] = row.times_plus(mass[0], taken[0]);
            taken = [row.times_plus(mass[1], taken[1]), row * mass[2]];
        }
        [based[last], based[last + 1]] = taken;
        let minus = -stage.inverse;
        for i in from..last + 2 {
            let share = own[i].times_plus(minus, based[i]);
            (based[i], begun[i]) = (share, begun[i] + share);
            own[i] = zero;
        }
        for (rates, weight) in earlier.iter_mut().zip(weights) {
            for (rate, based) in rates[from..].iter_mut().zip(&based[from..]) {
                *rate = weight.times_plus(*based, *rate);
            }
        }
        let mut sums = self.of_contact(terms, stage, &obstacle, top, loose);
        if first == 1 {
            let pinned = near_end - stage.rows.at(1).lower * self.of_rows[1];
            sums.obstacle = touching.times_plus(pinned, sums.obstacle);
        }
        sums
    }

    /// The last node whose cell may hold a part of the boundary at a stage, at least the first inner one.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss
    )]
    fn top_of_contact(&self, index: usize) -> usize {
        let own = &self.record.reach[index][..self.march.contracts.len()];
        let reach = own.iter().copied().fold(0.0, f64::max);
        (reach.min(self.march.last_kink as f64) as usize + 1)
            .min(self.march.last_kink)
            .max(1)
    }

    /// What the nodes in contact, and those whose cells hold its ends, have to do with the obstacle, c and the volatility.
    #[inline(always)]
    fn of_contact<T: Terms<V>>(
        &self,
        terms: &T,
        stage: &Stage<T::Rows<'_>, V>,
        obstacle: &Obstacle<V>,
        top: usize,
        loose: V,
    ) -> OfContact<V> {
        let last = self.march.cells - 1;
        let (zero, one) = (V::zero(), V::all(1.0));
        let half_a = stage.a.times(0.5);
        let mut sums = OfContact {
            obstacle: zero,
            cost: zero,
            cost_by_spot: zero,
            volatility: zero,
            shift: zero,
        };
        for i in self.first..=top.min(last) {
            let (signed, half_inverse) = (self.march.signed[i], stage.rows.at(i).half_inverse);
            let rise = obstacle.at(signed, half_inverse).1;
            let s = self.distance[i];
            let [upper, diagonal, low] = stage.column(i, last, loose);
            let before = if i > self.first {
                self.of_rows[i - 1]
            } else {
                zero
            };
            let behind = if i < last { self.of_rows[i + 1] } else { zero };
            let rows = upper * before + diagonal * self.of_rows[i] + low * behind;
            let pushed = s.plus(-1.0).negative(self.direct[i] - rows, zero);
            let square = s * s * pushed;
            let short = one - s;
            let cost = short * short * half_a * self.of_rows[i] + square * half_inverse;
            sums.obstacle = sums.obstacle + pushed;
            sums.cost = sums.cost + cost;
            sums.cost_by_spot = cost.times_plus(signed, sums.cost_by_spot);
            let [by_volatility, by_shift] = terms.log_diffusion_slopes(i);
            sums.volatility = sums.volatility - square * rise * by_volatility;
            sums.shift = sums.shift - square * rise * by_shift;
        }
        sums
    }

    /// Make derivatives by the numbers of the segments out of the sums of a stage.
    fn add_up(
        &mut self,
        n: usize,
        number: usize,
        steps: &LaneSteps<V>,
        of_rows: [V; 4],
        of_contact: &OfContact<V>,
    ) {
        let [rate, dividend_yield, volatility, shift] = of_rows.map(V::lanes);
        let [obstacle, cost, cost_by_spot, bend, bend_by_shift] = [
            of_contact.obstacle,
            of_contact.cost,
            of_contact.cost_by_spot,
            of_contact.volatility,
            of_contact.shift,
        ]
        .map(V::lanes);
        for (lane, own) in self.march.steps.iter().enumerate() {
            let Some(step) = own.get(n) else { continue };
            let segment = &self.march.contracts[lane].segments[step.segment];
            let found = &mut self.found[lane][step.segment];
            found.rate += rate[lane];
            found.dividend_yield += dividend_yield[lane];
            found.volatility += volatility[lane] + bend[lane];
            found.shift += shift[lane] + bend_by_shift[lane];
            let sign = self.march.grids[lane].sign;
            if segment.exercisable {
                found.rate += sign * cost[lane];
                found.dividend_yield -= cost_by_spot[lane];
            }
            if segment.escrow != 0.0 {
                let years = steps.years[number][lane];
                let discount = (-segment.rate * years).exp();
                found.escrow -= sign * obstacle[lane] * discount;
                found.rate += sign * obstacle[lane] * segment.escrow * years * discount;
            }
        }
    }

    /// Walk from what a segment started from to the value after what happens at its end.
    #[inline(always)]
    fn through_start<T: Terms<V>>(&mut self, terms: &T, lane: usize, number: usize) {
        let Some(start) = &self.record.starts[lane][number] else {
            return;
        };
        let contract = self.march.contracts[lane];
        let grid = self.march.grids[lane];
        let weights: Vec<f64> = self.ended.iter().map(|row| row.lane(lane)).collect();
        let after = match &start.later {
            None => After::Payoff,
            Some((values, contact)) => {
                After::Line(Line::after(&contract, number, &grid, values, *contact))
            }
        };
        let mut through = ThroughStart {
            before: Before::new(&contract, number, after),
            grid: &grid,
            later: vec![0.0; weights.len()],
            by: BySegment::default(),
            by_later_strike: 0.0,
        };
        through.walk::<T, V>(start, &self.march.spots[lane], weights, terms, lane);
        let (by, found) = (through.by, &mut self.found[lane]);
        found[number].rate += by.rate;
        found[number].dividend_yield += by.dividend_yield;
        found[number].volatility += by.volatility;
        found[number].amount += by.amount;
        found[number].fraction += by.fraction;
        found[number].escrow += by.escrow;
        let (by_later_strike, later) = (through.by_later_strike, through.later);
        self.first = 1;
        self.set_ended(lane, &later);
        if let Some(later) = contract.segments.get(number + 1) {
            self.by_strike_now(lane, number + 1, later, by_later_strike);
        }
    }
}

/// The distance of the contact set from a node, in cells: 0 in it, 1 from one cell on, and where `reached` is not above 0.
#[inline(always)]
fn distance_of<V: Vector>(gain: V, rise: V, value: V, reached: V) -> V {
    let (zero, one) = (V::zero(), V::all(1.0));
    let height = (value - gain) / rise.max(V::all(f64::MIN_POSITIVE));
    let inside = height.max(zero).min(one).sqrt();
    gain.min(rise)
        .negative(one, (-reached).negative(inside, one))
}

/// The walk through what happens at the end of a segment, in one lane.
struct ThroughStart<'t> {
    before: Before<'t>,
    grid: &'t Grid,
    /// The weights of the values after it.
    later: Vec<f64>,
    by: BySegment,
    /// A change of the strike less what is escrowed, after it.
    by_later_strike: f64,
}

impl ThroughStart<'_> {
    /// Walk from the weights of what the segment's first step starts from.
    #[inline(always)]
    #[allow(clippy::cast_precision_loss)]
    fn walk<T: Terms<V>, V: Vector>(
        &mut self,
        start: &Start,
        spots: &[f64],
        mut weights: Vec<f64>,
        terms: &T,
        lane: usize,
    ) {
        let values = &start.values;
        let mut points = Vec::new();
        let terms = terms.at_end(lane);
        let mut own = weights.clone();
        for window in Window::around(&start.kinks, self.grid, &terms) {
            window.solve_transposed(&mut own);
            let missed = |node: usize| start.begun[node] - values[node];
            for row in window.rows() {
                let bend = own[row] * (missed(row + 1) - missed(row - 1)) / 24.0;
                self.by_peclet(terms.peclet(row), -bend);
            }
        }
        start.kinks.each_row(self.grid, |row, kinks| {
            let weight = own[row] * terms.share(row, kinks);
            let numbers = terms.peclet(row);
            let mut by_peclet = -(values[row + 1] - values[row - 1]) / 24.0;
            for (k, part) in hat_weights(numbers[0]).into_iter().enumerate() {
                weights[row - 1 + k] -= weight * part;
            }
            points_of_hat(row, kinks, |u, share| {
                let place = row as f64 + u;
                let (value, _) = self.before.at(self.grid.spot_at(place));
                by_peclet += share * tilt(u) * value;
                points.push((place, weight * share * (hat(u) + numbers[0] * tilt(u))));
            });
            self.by_peclet(numbers, weight * by_peclet);
        });
        let mut indices = [0.0; LANES];
        for (node, weight) in weights.into_iter().enumerate() {
            if node % V::WIDTH == 0 {
                let some = &spots[node..spots.len().min(node + V::WIDTH)];
                if self.before.segment.drops() {
                    indices_after::<V>(self.grid, self.before.segment, some, &mut indices);
                } else {
                    indices = std::array::from_fn(|k| (node + k) as f64);
                }
            }
            let spot = spots[node];
            #[allow(clippy::float_cmp)] // it was taken over as it is
            let exercised = self.before.exercise && values[node] == self.before.obstacle(spot);
            self.take(spot, indices[node % V::WIDTH], weight, exercised);
        }
        for (index, weight) in points {
            let spot = self.grid.spot_at(index);
            let exercised = self.before.at(spot).1;
            let after = self.grid.index(self.before.spot_after(spot));
            self.take(spot, after, weight, exercised);
        }
    }

    /// Add what a change of a row's cell Peclet number does, given this number's derivatives by rate and volatility.
    fn by_peclet(&mut self, [_, by_rate, by_volatility]: [f64; 3], weight: f64) {
        self.by.rate += weight * by_rate;
        self.by.dividend_yield -= weight * by_rate;
        self.by.volatility += weight * by_volatility;
    }

    /// Hand the weight of the value just before at a spot on to what it is made of, at a number of a node after it.
    fn take(&mut self, spot: f64, index: f64, weight: f64, exercised: bool) {
        if weight == 0.0 {
            return;
        }
        let (segment, sign) = (self.before.segment, self.before.sign);
        if exercised {
            self.by.escrow -= sign * weight;
            return;
        }
        let after = self.before.spot_after(spot);
        let slope = match &self.before.after {
            After::Payoff => {
                if sign * (1.0 - after) > 0.0 {
                    -sign
                } else {
                    0.0
                }
            }
            After::Line(line) if line.contact.holds(index) => {
                self.by_later_strike += sign * weight;
                -sign
            }
            After::Line(line) => {
                let reading = line.reading(after, index);
                let own = &reading.weights[..reading.points];
                for (later, share) in self.later[reading.start..].iter_mut().zip(own) {
                    *later += weight * share;
                }
                if segment.drops() && after > 0.0 {
                    line.free(after, index)[1] * self.grid.sign / (self.grid.h * after)
                } else {
                    0.0
                }
            }
        };
        if after > 0.0 {
            self.by.amount -= weight * slope;
            self.by.fraction -= weight * slope * spot;
        }
    }
}
