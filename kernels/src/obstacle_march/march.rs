//! The march of as many contracts as a vector has lanes, from expiry to now: each lane has its own grid, its own segments
//! and its own steps, and all do the same in a step.

use super::contract::{Contract, Segment};
use super::event::{hat_weights, payoff, Before, Kinks};
use super::line::{Contact, Line};
use super::mesh::{step_count, Grid};
use super::newton::{Newton, Rows};
use super::settings::Settings;
use super::stage::{Obstacle, Stage};
use super::tableau::{FIRST, GAMMA, LATER};
use crate::interrupt::Interrupt;
use crate::lanes::dispatch::Work;
use crate::lanes::vector::{Part, Vector, LANES};

/// The nodes next to the end of a contact set that are looked at; where it moves further in a step, all are.
const SKIPPED: f64 = 8.0;
/// What a contact set's check may miss by rounding, in strikes.
const ROUNDING: f64 = 1e-11;

/// One contract's value now.
#[derive(Clone, Debug)]
pub struct Marched {
    pub grid: Grid,
    /// At the nodes.
    pub values: Vec<f64>,
    pub contact: Contact,
    /// The strike less what is escrowed.
    pub strike: f64,
    pub steps: usize,
    /// Whether every stage was solved.
    pub settled: bool,
}

impl Marched {
    /// The value as a function of the spot.
    pub fn line(&self) -> Line<'_> {
        Line {
            grid: self.grid,
            values: &self.values,
            contact: self.contact,
            strike: self.strike,
        }
    }
}

/// One step of a lane.
#[derive(Clone, Copy)]
struct Step {
    segment: usize,
    dt: f64,
    /// Years from the step's start, which is later, to the segment's end.
    elapsed: f64,
    is_first: bool,
    is_last: bool,
}

/// The steps of a contract, from expiry to now.
#[allow(clippy::cast_precision_loss)]
fn steps_of(contract: &Contract, grid: &Grid, settings: &Settings) -> Vec<Step> {
    let mut steps = Vec::new();
    for (number, segment) in contract.segments.iter().enumerate().rev() {
        let count = step_count(segment, grid.h, settings);
        let time = |n: usize| segment.duration * (n as f64 / count as f64).powi(2);
        for n in 1..=count {
            steps.push(Step {
                segment: number,
                dt: time(n) - time(n - 1),
                elapsed: time(n - 1),
                is_first: n == 1,
                is_last: n == count,
            });
        }
    }
    steps
}

/// The node behind the last at which exercise brings something.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
fn last_gain(contract: &Contract, grid: &Grid) -> usize {
    let escrow = contract
        .segments
        .iter()
        .map(|one| one.escrow)
        .fold(0.0, f64::max);
    let strike = if contract.sign > 0.0 {
        1.0
    } else {
        1.0 - escrow
    };
    let index = grid.index(strike.max(f64::MIN_POSITIVE)).ceil();
    (index.max(1.0) as usize + 1).min(grid.cells)
}

/// Contracts that are marched side by side on grids of one number of cells.
pub struct Group<'a> {
    pub contracts: Vec<Contract<'a>>,
    pub cells: usize,
    pub settings: Settings,
    pub interrupt: Interrupt<'a>,
}

impl Work for Group<'_> {
    type Result = Option<Vec<Marched>>;

    #[inline(always)]
    fn run<V: Vector>(self) -> Self::Result {
        March::<V>::new(&self).run()
    }
}

/// The numbers of a segment in each lane.
#[derive(Clone, Copy)]
struct Terms {
    diffusion: [f64; LANES],
    peclet: [f64; LANES],
    rate: [f64; LANES],
    /// c = `rate_part` - `yield_part` T, T the signed spot; below 0 where the holder may not exercise.
    rate_part: [f64; LANES],
    yield_part: [f64; LANES],
}

struct March<'a, V> {
    group: &'a Group<'a>,
    grids: Vec<Grid>,
    steps: Vec<Vec<Step>>,
    spots: Vec<Vec<f64>>,
    terms: Terms,
    /// The spot times the sign, at the nodes.
    signed: Vec<[f64; LANES]>,
    /// V at the nodes, and M V less what its sums miss.
    values: Vec<[f64; LANES]>,
    mass: Vec<[f64; LANES]>,
    /// M times the rates at the step's start and of its stages.
    rates: [Vec<V>; 4],
    /// The right-hand side without the far nodes, by elimination.
    left: Vec<V>,
    /// M times the rates of the stage.
    found: Vec<V>,
    /// M times the values of the last stage.
    next_mass: Vec<[f64; LANES]>,
    /// The factors of the elimination: what the row above is multiplied by, the pivots, and one over these.
    factor: Vec<V>,
    pivot: Vec<V>,
    inverse: Vec<V>,
    /// The first node that is looked at: those before it are in contact in every lane, and stay so.
    first: usize,
    /// The first node behind the last where exercise brings something in any lane.
    last_kink: usize,
    newton: Newton<V>,
    contact: [Contact; LANES],
    /// Whether a lane's contract has not come to now yet.
    active: [bool; LANES],
    settled: [bool; LANES],
}

impl<'a, V: Vector> March<'a, V> {
    fn new(group: &'a Group<'a>) -> Self {
        let nodes = group.cells + 1;
        let lane = |l: usize| l.min(group.contracts.len() - 1);
        let grids: Vec<Grid> = (0..LANES)
            .map(|l| Grid::new(&group.contracts[lane(l)], group.cells, &group.settings))
            .collect();
        let steps = (0..group.contracts.len())
            .map(|l| steps_of(&group.contracts[l], &grids[l], &group.settings))
            .collect();
        let mut signed = vec![[0.0; LANES]; nodes];
        let mut spots = Vec::new();
        for l in 0..LANES {
            let (grid, sign) = (&grids[l], group.contracts[lane(l)].sign);
            let own: Vec<f64> = (0..nodes).map(|node| grid.spot(node)).collect();
            for (signed, spot) in signed.iter_mut().zip(&own) {
                signed[l] = sign * spot;
            }
            spots.push(own);
        }
        let array = || vec![V::zero(); nodes];
        let last_kink = (0..group.contracts.len())
            .map(|l| last_gain(&group.contracts[l], &grids[l]))
            .max()
            .unwrap_or(0);
        Self {
            group,
            grids,
            steps,
            spots,
            terms: Terms {
                diffusion: [1.0; LANES],
                peclet: [0.0; LANES],
                rate: [0.0; LANES],
                rate_part: [-1.0; LANES],
                yield_part: [0.0; LANES],
            },
            signed,
            values: vec![[0.0; LANES]; nodes],
            mass: vec![[0.0; LANES]; nodes],
            rates: [array(), array(), array(), array()],
            left: array(),
            found: array(),
            next_mass: vec![[0.0; LANES]; nodes],
            factor: array(),
            pivot: array(),
            inverse: array(),
            first: 1,
            last_kink,
            newton: Newton::new(nodes),
            contact: [Contact::NONE; LANES],
            active: [false; LANES],
            settled: [true; LANES],
        }
    }

    #[inline(always)]
    fn run(mut self) -> Option<Vec<Marched>> {
        let count = self.group.contracts.len();
        let most = self.steps.iter().map(Vec::len).max().unwrap_or(0);
        let mut found: Vec<Option<Marched>> = vec![None; count];
        for lane in 0..count {
            self.start(lane, self.group.contracts[lane].segments.len() - 1, true);
        }
        for l in count..LANES {
            self.copy_lane(count - 1, l);
        }
        for n in 0..most {
            if (self.group.interrupt)() {
                return None;
            }
            for (active, steps) in self.active.iter_mut().zip(&self.steps) {
                *active = n < steps.len();
            }
            self.step(n);
            for (lane, found) in found.iter_mut().enumerate() {
                let Some(step) = self.steps[lane].get(n).copied() else {
                    continue;
                };
                if step.is_last && step.segment > 0 {
                    self.start(lane, step.segment - 1, false);
                } else if step.is_last {
                    *found = Some(self.marched(lane));
                }
            }
        }
        found.into_iter().collect()
    }

    /// Give a lane that holds no contract the numbers of another.
    fn copy_lane(&mut self, from: usize, to: usize) {
        for array in [&mut self.values, &mut self.mass] {
            for row in array {
                row[to] = row[from];
            }
        }
        for column in [
            &mut self.terms.diffusion,
            &mut self.terms.peclet,
            &mut self.terms.rate,
            &mut self.terms.rate_part,
            &mut self.terms.yield_part,
        ] {
            column[to] = column[from];
        }
    }

    /// The value of a lane now.
    fn marched(&self, lane: usize) -> Marched {
        let contract = &self.group.contracts[lane];
        let first = &contract.segments[0];
        Marched {
            grid: self.grids[lane],
            values: self.values.iter().map(|row| row[lane]).collect(),
            contact: self.contact[lane],
            strike: 1.0 - first.escrow_before_end(first.duration),
            steps: self.steps[lane].len(),
            settled: self.settled[lane],
        }
    }

    /// Take a lane to the end of a segment: what happens there, and what its first step starts from.
    fn start(&mut self, lane: usize, number: usize, at_expiry: bool) {
        let contract = self.group.contracts[lane];
        let (segment, grid) = (&contract.segments[number], self.grids[lane]);
        let peclet = self.enter(lane, segment, &grid);
        let mut kinks = Kinks::default();
        if at_expiry {
            kinks.push(grid.index(segment.before_drop(1.0)));
            let after = |spot: f64| payoff(&contract, spot);
            self.start_from(lane, segment, after, kinks, peclet);
            return;
        }
        let later = &contract.segments[number + 1];
        let values: Vec<f64> = self.values.iter().map(|row| row[lane]).collect();
        let line = Line {
            grid,
            values: &values,
            contact: self.contact[lane],
            strike: 1.0 - later.escrow_before_end(later.duration),
        };
        for end in [line.contact.begin, line.contact.end] {
            kinks.push(grid.index(segment.before_drop(grid.spot_at(end))));
        }
        self.start_from(lane, segment, |spot| line.at(spot), kinks, peclet);
    }

    /// Leave in a lane what the first step of a segment starts from, given the value after what happens at its end.
    fn start_from(
        &mut self,
        lane: usize,
        segment: &Segment,
        after: impl Fn(f64) -> f64,
        mut kinks: Kinks,
        peclet: f64,
    ) {
        let grid = self.grids[lane];
        let before = Before {
            after,
            segment,
            sign: grid.sign,
            exercise: segment.exercise_at_end || segment.exercisable,
        };
        let mut values = vec![0.0; grid.cells + 1];
        before.fill(&grid, &self.spots[lane], &mut values, &mut kinks);
        let [lower, middle, upper] = hat_weights(peclet);
        for (node, around) in (1..).zip(values.windows(3)) {
            self.mass[node][lane] = lower * around[0] + middle * around[1] + upper * around[2];
        }
        before.add_missing(&grid, &values, &kinks, peclet, |row, x| {
            self.mass[row][lane] += x;
        });
        for (row, value) in self.values.iter_mut().zip(values) {
            row[lane] = value;
        }
    }

    /// Take over the coefficients of a segment; return the cell Peclet number.
    fn enter(&mut self, lane: usize, segment: &Segment, grid: &Grid) -> f64 {
        let sign = grid.sign;
        let diffusion = 0.5 * segment.volatility * segment.volatility;
        let peclet = sign * segment.drift() * grid.h / diffusion;
        let terms = &mut self.terms;
        terms.diffusion[lane] = diffusion / (grid.h * grid.h);
        terms.peclet[lane] = peclet;
        terms.rate[lane] = segment.rate;
        let may = segment.exercisable;
        terms.rate_part[lane] = if may { sign * segment.rate } else { -1.0 };
        terms.yield_part[lane] = if may { segment.dividend_yield } else { 0.0 };
        peclet
    }

    #[inline(always)]
    fn step(&mut self, n: usize) {
        let count = self.group.contracts.len();
        let (mut dt, mut first) = ([1.0; LANES], [0.0; LANES]);
        let mut strikes = [[1.0; LANES]; 3];
        for l in 0..LANES {
            let lane = l.min(count - 1);
            let steps = &self.steps[lane];
            let step = steps[n.min(steps.len() - 1)];
            let segment = &self.group.contracts[lane].segments[step.segment];
            dt[l] = step.dt;
            first[l] = if step.is_first { -1.0 } else { 1.0 };
            let times = if step.is_first {
                &FIRST.times
            } else {
                &LATER.times
            };
            for (strike, time) in strikes.iter_mut().zip(times) {
                strike[l] = 1.0 - segment.escrow_before_end(time.mul_add(step.dt, step.elapsed));
            }
        }
        self.skip(n);
        let (dt, first) = (V::from_lanes(dt), V::from_lanes(first));
        let stage = self.stage(dt.times(GAMMA));
        self.factorise(&stage);
        let signs: [f64; LANES] = std::array::from_fn(|l| self.grids[l].sign);
        for (number, strike) in strikes.iter().enumerate() {
            let mut weights = [V::zero(); 3];
            for (k, weight) in weights.iter_mut().enumerate() {
                let (early, late) = (FIRST.weights[number][k], LATER.weights[number][k]);
                *weight = first.negative(V::all(early), V::all(late)) * dt;
            }
            let strike: [f64; LANES] = std::array::from_fn(|l| signs[l] * strike[l]);
            let strike = V::from_lanes(strike);
            match number {
                0 => self.solve::<1, false>(&stage, weights, strike),
                1 => self.solve::<2, false>(&stage, weights, strike),
                _ => self.solve::<3, true>(&stage, weights, strike),
            }
        }
        self.rates.swap(0, 3);
    }

    /// Choose the first node to look at: those well inside all contact sets stay what they are.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    fn skip(&mut self, n: usize) {
        let mut first = self.group.cells;
        for (lane, contract) in self.group.contracts.iter().enumerate() {
            let Some(step) = self.steps[lane].get(n) else {
                continue;
            };
            let Contact { begin, end } = self.contact[lane];
            let stays = contract.segments[step.segment].escrow == 0.0;
            let known = !step.is_first && stays && begin.is_infinite() && end > SKIPPED;
            let own = if known { (end - SKIPPED) as usize } else { 1 };
            first = first.min(own.max(1));
        }
        for i in self.first..first {
            self.next_mass[i] = self.mass[i];
            self.found[i] = V::zero();
            for rates in &mut self.rates {
                rates[i] = V::zero();
            }
        }
        self.first = first;
    }

    /// The rows of a stage with this implicit weight in years.
    #[inline(always)]
    fn stage(&self, a: V) -> Stage<V> {
        let diffusion = V::from_lanes(self.terms.diffusion);
        let peclet = V::from_lanes(self.terms.peclet);
        let one = V::all(1.0);
        let spread = a * diffusion;
        let second = (peclet * peclet).times(1.0 / 12.0).plus(1.0) * spread;
        let half = peclet.times(0.5) * spread;
        let growth = V::from_lanes(self.terms.rate).times_plus(a, one);
        let mass_lower = peclet.times(-1.0 / 24.0).plus(1.0 / 12.0);
        let mass_upper = peclet.times(1.0 / 24.0).plus(1.0 / 12.0);
        let mass_middle = V::all(10.0 / 12.0);
        let lower = growth * mass_lower - (second - half);
        let diagonal = growth * mass_middle + second.times(2.0);
        let upper = growth * mass_upper - (second + half);
        let step: [f64; LANES] = std::array::from_fn(|l| self.grids[l].sign * self.grids[l].h);
        let near_rule: [f64; LANES] = std::array::from_fn(|l| (-step[l]).exp());
        let far_rule: [f64; LANES] = std::array::from_fn(|l| step[l].exp());
        let (near_rule, far_rule) = (V::from_lanes(near_rule), V::from_lanes(far_rule));
        Stage {
            lower,
            diagonal,
            upper,
            mass_lower,
            mass_middle,
            mass_upper,
            inverse: one / a,
            diffusion,
            spread,
            near_rule,
            far_rule,
            last_lower: lower - upper * far_rule,
            last_diagonal: far_rule.plus(1.0).times_plus(upper, diagonal),
        }
    }

    /// Eliminate from the far end.
    #[inline(always)]
    fn factorise(&mut self, stage: &Stage<V>) {
        let last = self.group.cells - 1;
        let one = V::all(1.0);
        self.factor[last] = V::zero();
        self.pivot[last] = stage.last_diagonal;
        self.inverse[last] = one / stage.last_diagonal;
        let mut lower = stage.last_lower;
        for i in (self.first..last).rev() {
            let factor = stage.upper * self.inverse[i + 1];
            let pivot = stage.diagonal - factor * lower;
            self.factor[i] = factor;
            self.pivot[i] = pivot;
            self.inverse[i] = one / pivot;
            lower = stage.lower;
        }
    }

    /// Solve stage N of three: the right-hand side and the elimination from the far end, then the substitution from the
    /// near one, which settles at each node whether it is in contact.
    ///
    /// Where the contact set is not one interval from the near end on, Newton's method does.
    #[inline(always)]
    fn solve<const N: usize, const LAST: bool>(
        &mut self,
        stage: &Stage<V>,
        weights: [V; 3],
        strike: V,
    ) {
        let (swept, wrong) = loop {
            self.eliminate::<N>(weights);
            if let Some(swept) = self.substitute::<N, LAST>(stage, strike) {
                let mut wrong = self.active;
                for (wrong, worst) in wrong.iter_mut().zip(swept.worst.lanes()) {
                    *wrong &= worst <= -ROUNDING || worst.is_nan();
                }
                if self.first == 1 || !wrong.contains(&true) {
                    break (swept, wrong);
                }
            }
            self.first = 1;
            self.factorise(stage);
        };
        self.newton.forget(wrong);
        if wrong.contains(&true) {
            V::call(Correction {
                march: self,
                stage,
                number: N - 1,
                strike,
                wrong,
            });
        }
        std::mem::swap(&mut self.rates[N], &mut self.found);
        if LAST {
            std::mem::swap(&mut self.mass, &mut self.next_mass);
            for (l, end) in swept.contact.lanes().into_iter().enumerate() {
                if !wrong[l] {
                    self.contact[l] = Contact::from_near_end(end);
                }
            }
        }
    }

    /// The right-hand side, left in the stage's rates, and its elimination from the far end.
    #[inline(always)]
    fn eliminate<const N: usize>(&mut self, weights: [V; 3]) {
        let last = self.group.cells - 1;
        let (known, rest) = self.rates.split_at_mut(N);
        let (mass, right) = (&self.mass[..=last], &mut rest[0][..=last]);
        let (factor, eliminated) = (&self.factor[..=last], &mut self.left[..=last]);
        let known: [&[V]; 3] = std::array::from_fn(|k| &known[k.min(N - 1)][..=last]);
        let mut left = V::zero();
        for i in (self.first..=last).rev() {
            let mut f = known[0][i].times_plus(weights[0], V::from_lanes(mass[i]));
            if N > 1 {
                f = known[1][i].times_plus(weights[1], f);
            }
            if N > 2 {
                f = known[2][i].times_plus(weights[2], f);
            }
            right[i] = f;
            left = f - factor[i] * left; // the last factor is 0
            eliminated[i] = left;
        }
    }

    /// Substitute from the near end, or from `first`; None where the nodes before it are not in contact.
    #[inline(always)]
    fn substitute<const N: usize, const LAST: bool>(
        &mut self,
        stage: &Stage<V>,
        strike: V,
    ) -> Option<Swept<V>> {
        let (last, begin) = (self.group.cells - 1, self.first);
        let obstacle = self.obstacle(stage, strike);
        let (left, signed) = (&self.left[..=last], &self.signed[..last + 2]);
        let (pivot, inverse) = (&self.pivot[..=last], &self.inverse[..=last]);
        let (zero, one) = (V::zero(), V::all(1.0));
        let before;
        let mut two_before = zero;
        let mut contact = zero;
        let mut held = V::all(-1.0); // below 0 where the last node was in contact
        if begin > 1 {
            before = strike - V::from_lanes(signed[begin - 1]);
            two_before = strike - V::from_lanes(signed[begin - 2]);
        } else {
            // The near end, as if nothing touched there.
            let q = stage.near_rule;
            let coupled = stage.lower * q * inverse[2];
            let diagonal = pivot[1] + stage.lower * q.plus(1.0) + coupled * stage.lower;
            let free = coupled.times_plus(left[2], left[1]) / diagonal;
            let (gain, rise) = obstacle.at(V::from_lanes(signed[1]));
            // below 0 where the near end is in contact
            let touching = gain.min(rise).negative(one, free - gain - rise);
            let free_second = (left[2] - stage.lower * free) * inverse[2];
            let free_end = free * q.plus(1.0) - q * free_second;
            before = touching.negative(strike - V::from_lanes(signed[0]), free_end);
            contact = touching.negative(zero, V::all(f64::NEG_INFINITY));
            held = touching.negative(held, one);
        }
        let mut rows = Substituted::<V, LAST> {
            stage,
            right: &self.rates[N][..=last],
            rates: &mut self.found[..=last],
            masses: &mut self.next_mass[..=last],
            values: &mut self.values[..last + 2],
            before,
            two_before,
        };
        if LAST && begin == 1 {
            rows.values[0] = before.lanes();
        }
        let mut worst = zero;
        let mut i = begin;
        while i <= last && held.lanes().iter().any(|x| *x < 0.0) {
            let lower = if i == last {
                stage.last_lower
            } else {
                stage.lower
            };
            let rest = left[i] - lower * rows.before;
            let free = rest * inverse[i];
            let (gain, rise) = obstacle.at(V::from_lanes(signed[i]));
            let may = gain.min(rise);
            worst = worst.min(held.negative(zero, may.negative(zero, free - gain)));
            // below 0 where the node is in contact, or its cell
            let near = held.negative(may.negative(one, free - gain - rise), one);
            let cell = stage.cell(pivot[i], rest, gain, rise, near);
            rows.take(i, near.negative(cell.value, free));
            #[allow(clippy::cast_precision_loss)]
            let end = V::all(i as f64) - cell.distance;
            contact = near.negative(end, contact);
            held = near.negative(cell.held, one);
            if i == begin && begin > 1 && held.lanes().iter().any(|x| *x >= 0.0) {
                return None;
            }
            i += 1;
        }
        while i <= last {
            let lower = if i == last {
                stage.last_lower
            } else {
                stage.lower
            };
            let value = (left[i] - lower * rows.before) * inverse[i];
            if i < self.last_kink {
                let (gain, rise) = obstacle.at(V::from_lanes(signed[i]));
                worst = worst.min(gain.min(rise).negative(zero, value - gain));
            }
            rows.take(i, value);
            i += 1;
        }
        let end = rows.before * stage.far_rule.plus(1.0) - stage.far_rule * rows.two_before;
        rows.take(last + 1, end);
        if begin > 1 {
            self.found[begin - 1] = zero;
        }
        Some(Swept { contact, worst })
    }

    /// What exercise brings at the nodes at a stage.
    #[inline(always)]
    fn obstacle(&self, stage: &Stage<V>, strike: V) -> Obstacle<V> {
        Obstacle {
            strike,
            rate_part: V::from_lanes(self.terms.rate_part),
            yield_part: V::from_lanes(self.terms.yield_part),
            half_inverse: V::all(0.5) / stage.diffusion,
        }
    }

    /// Solve the stage by Newton's method in the lanes where the sweep's contact set was wrong.
    #[inline(always)]
    fn correct(&mut self, stage: &Stage<V>, number: usize, strike: V, wrong: [bool; LANES]) {
        let obstacle = self.obstacle(stage, strike);
        let last = self.group.cells - 1;
        let right = &self.rates[number + 1];
        let rows = Rows {
            top: (self.last_kink - 1).clamp(3, last),
            signed: &self.signed,
            right,
            left: &self.left,
            pivot: &self.pivot,
            inverse: &self.inverse,
        };
        let solved = self
            .newton
            .solve(stage, &obstacle, &rows, &self.values, wrong);
        for l in (0..LANES).filter(|l| wrong[*l]) {
            self.settled[l] &= solved[l];
            self.contact[l] = self.newton.contact(l);
        }
        let mut mask = [1.0; LANES];
        for (mask, wrong) in mask.iter_mut().zip(wrong) {
            if wrong {
                *mask = -1.0;
            }
        }
        let mask = V::from_lanes(mask);
        for (own, found) in self.values.iter_mut().zip(&self.newton.values) {
            *own = mask.negative(*found, V::from_lanes(*own)).lanes();
        }
        for (i, right) in right.iter().enumerate().take(last + 1).skip(1) {
            let before = V::from_lanes(self.values[i - 1]);
            let at = V::from_lanes(self.values[i]);
            let after = V::from_lanes(self.values[i + 1]);
            let mass = stage.mass(before, at, after);
            self.found[i] = mask.negative((mass - *right) * stage.inverse, self.found[i]);
            self.next_mass[i] = mask
                .negative(mass, V::from_lanes(self.next_mass[i]))
                .lanes();
        }
    }
}

/// The correction of a stage: work of its own, for it is rare and long.
struct Correction<'m, 'a, V> {
    march: &'m mut March<'a, V>,
    stage: &'m Stage<V>,
    number: usize,
    strike: V,
    wrong: [bool; LANES],
}

impl<V: Vector> Part<V> for Correction<'_, '_, V> {
    type Result = ();

    #[inline(always)]
    fn run(self) {
        self.march
            .correct(self.stage, self.number, self.strike, self.wrong);
    }
}

/// What a sweep says: where the contact set ends, and by how much V lies below the obstacle beyond it.
struct Swept<V> {
    contact: V,
    worst: V,
}

/// The values that a substitution has come to, and what it leaves at each node.
struct Substituted<'m, V, const LAST: bool> {
    stage: &'m Stage<V>,
    right: &'m [V],
    /// M times the rates; in the last stage also M V and V.
    rates: &'m mut [V],
    masses: &'m mut [[f64; LANES]],
    values: &'m mut [[f64; LANES]],
    before: V,
    two_before: V,
}

impl<V: Vector, const LAST: bool> Substituted<'_, V, LAST> {
    /// Take in the value at a node: the row of the one before it is complete.
    #[inline(always)]
    fn take(&mut self, node: usize, value: V) {
        if node > 1 {
            let mass = self.stage.mass(self.two_before, self.before, value);
            self.rates[node - 1] = (mass - self.right[node - 1]) * self.stage.inverse;
            if LAST {
                self.masses[node - 1] = mass.lanes();
            }
        }
        if LAST {
            self.values[node] = value.lanes();
        }
        (self.two_before, self.before) = (self.before, value);
    }
}
