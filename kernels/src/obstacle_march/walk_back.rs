//! The march transposed: the derivatives of a value now by all coefficients and by all that happens, in one walk back.
//!
//! The walk carries what a change of each number of the march would do to the value, from now to expiry. At each stage
//! it solves the transposed system, in which a node's row is s times that of the equation and 1 - s times the identity,
//! s its distance from the contact set in cells, 0 in it and 1 from one cell on. What is held fixed are the grid and the
//! steps.

use super::contract::{Contract, Segment};
use super::event::{hat, hat_weights, indices_after, points_of_hat, tilt, After, Before};
use super::line::{Line, Reading};
use super::mesh::Grid;
use super::record::{Record, Start};
use super::stage::{Elimination, Obstacle, Stage};
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
}

impl BySegment {
    /// How many there are.
    pub const COUNT: usize = 6;

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
pub struct Course<'w, 'a> {
    pub contracts: &'w [Contract<'a>],
    pub cells: usize,
    pub grids: &'w [Grid],
    pub steps: &'w [Vec<Step>],
    pub spots: &'w [Vec<f64>],
    pub signed: &'w [[f64; LANES]],
    pub terms: Terms,
    pub last_kink: usize,
    pub interrupt: Interrupt<'w>,
}

/// A walk back, and what each number of the march is worth.
pub struct WalkBack<'w, 'a> {
    pub march: Course<'w, 'a>,
    pub record: &'w Record,
    /// What is asked of each lane.
    pub functionals: &'w [Functional],
}

impl<V: Vector> Part<V> for WalkBack<'_, '_> {
    type Result = Option<Vec<Vec<BySegment>>>;

    #[inline(always)]
    fn run(self) -> Self::Result {
        Walk::<V>::new(&self).run()
    }
}

/// Sums over nodes at a stage, of the weights of its rows with the values.
struct Sums<V> {
    /// With M V, the second and the first differences.
    mass: V,
    second: V,
    first: V,
    /// The sum of the weights of M V with the first differences.
    of_mass: V,
    /// What a change of the obstacle, of c, of c's part by the spot, and of the rise in the first cell does.
    obstacle: V,
    cost: V,
    cost_by_spot: V,
    rise: V,
}

struct Walk<'w, 'a, V> {
    march: Course<'w, 'a>,
    record: &'w Record,
    functionals: &'w [Functional],
    terms: Terms,
    /// The weights of V at the nodes, of M V, and of M times the rate at the step's start and of its stages.
    direct: Vec<[f64; LANES]>,
    mass: Vec<[f64; LANES]>,
    rates: [Vec<[f64; LANES]>; 4],
    /// The weights of M V at a stage, and of its rows.
    of_mass: Vec<V>,
    of_rows: Vec<V>,
    elimination: Elimination<V>,
    /// The recursion e - f `nu_before` for the weights of the rows.
    known: Vec<V>,
    factor: Vec<V>,
    /// How far the nodes are from the contact set, in cells.
    distance: Vec<V>,
    found: Vec<Vec<BySegment>>,
}

impl<'w, 'a, V: Vector> Walk<'w, 'a, V> {
    fn new(part: &WalkBack<'w, 'a>) -> Self {
        let nodes = part.march.cells + 1;
        let lanes = || vec![[0.0; LANES]; nodes];
        let array = || vec![V::zero(); nodes];
        let contracts = &part.march.contracts;
        Self {
            march: part.march,
            record: part.record,
            functionals: part.functionals,
            terms: part.march.terms,
            direct: lanes(),
            mass: lanes(),
            rates: [lanes(), lanes(), lanes(), lanes()],
            of_mass: array(),
            of_rows: array(),
            elimination: Elimination::new(nodes),
            known: array(),
            factor: array(),
            distance: array(),
            found: contracts
                .iter()
                .map(|one| vec![BySegment::default(); one.segments.len()])
                .collect(),
        }
    }

    #[inline(always)]
    fn run(mut self) -> Option<Vec<Vec<BySegment>>> {
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
                    self.through_start(lane, own[n + 1].segment);
                }
                if let Some(step) = own.get(n) {
                    let contract = &self.march.contracts[lane];
                    let grid = &self.march.grids[lane];
                    self.terms
                        .enter(lane, &contract.segments[step.segment], grid);
                }
            }
            self.step(n);
        }
        for (lane, own) in steps.iter().enumerate() {
            self.through_start(lane, own[0].segment);
        }
        Some(self.found)
    }

    /// Take in what is asked of a lane.
    fn begin(&mut self, lane: usize) {
        let [zero, one, two, three] = &mut self.rates;
        for array in [&mut self.direct, &mut self.mass, zero, one, two, three] {
            for row in array {
                row[lane] = 0.0;
            }
        }
        let asked = &self.functionals[lane];
        if let Some(reading) = &asked.reading {
            add(&mut self.direct, lane, reading, 1.0);
        }
        let contract = &self.march.contracts[lane];
        self.by_strike_now(lane, 0, &contract.segments[0], asked.by_strike);
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
    fn step(&mut self, n: usize) {
        let contracts = self.march.contracts;
        let steps = LaneSteps::<V>::at(n, contracts, self.march.steps);
        let a = steps.dt.times(GAMMA);
        let stage: Stage<V> = self.terms.stage(a);
        // The transposed elimination has the same pivots where nothing is in contact.
        self.elimination.of(&stage, 1);
        // The rate of the last stage is that of the next step's start.
        self.rates.swap(0, 3);
        for number in (0..3).rev() {
            let sums = self.stage(3 * n + number, number, &stage, &steps);
            self.add_up(n, number, &stage, &steps, &sums);
        }
    }

    /// Walk through one stage: from the weights of its rates, and of M V at the last one, to those before it.
    #[inline(always)]
    #[allow(clippy::too_many_lines)] // one pass each way
    fn stage(
        &mut self,
        index: usize,
        number: usize,
        stage: &Stage<V>,
        steps: &LaneSteps<V>,
    ) -> Sums<V> {
        let values = self.record.stage(index);
        let last = self.march.cells - 1;
        let (zero, one) = (V::zero(), V::all(1.0));
        let strike = steps.strikes[number];
        let obstacle = self.terms.obstacle(stage, strike);
        let signed = &self.march.signed;
        // The weights of M V.
        for i in 1..=last {
            let mut weight = V::from_lanes(self.rates[number + 1][i]) * stage.inverse;
            if number == 2 {
                weight = weight + V::from_lanes(self.mass[i]);
            }
            self.of_mass[i] = weight;
        }
        // The ends: linear in the spot, or in contact.
        let (q, p) = (stage.near_rule, stage.far_rule);
        let end = stage
            .mass_upper
            .times_plus(self.of_mass[last], V::from_lanes(self.direct[last + 1]));
        let near_end = stage
            .mass_lower
            .times_plus(self.of_mass[1], V::from_lanes(self.direct[0]));
        let gap = V::from_lanes(values[0]) - (strike - V::from_lanes(signed[0]));
        let touching = gap.abs().plus(-f64::MIN_POSITIVE).negative(one, zero);
        let loose = one - touching;
        let top = self.top_of_contact(index);
        // The weights of V, the elimination from the far end.
        let (mut after, mut factor) = (zero, zero);
        for i in (1..=last).rev() {
            let before = if i > 1 { self.of_mass[i - 1] } else { zero };
            let behind = if i < last { self.of_mass[i + 1] } else { zero };
            let mut weight = stage
                .mass_upper
                .times_plus(before, stage.mass_middle * self.of_mass[i]);
            weight = stage.mass_lower.times_plus(behind, weight) + V::from_lanes(self.direct[i]);
            if i == last {
                weight = p.plus(1.0).times_plus(end, weight);
            }
            if i + 1 == last {
                weight = weight - p * end;
            }
            if i == 1 {
                weight = q.plus(1.0).times_plus(loose * near_end, weight);
            }
            if i == 2 {
                weight = weight - q * (loose * near_end);
            }
            let [upper, diagonal, low] = stage.column(i, last, loose);
            let rest = weight - low * after;
            let mut pivot_inverse = self.elimination.inverse[i];
            if i <= top {
                let s = self.distance_of(index, i, &obstacle, V::from_lanes(values[i]));
                self.distance[i] = s;
                let pivot = s * (diagonal - low * factor) + stage.spread * (one - s);
                pivot_inverse = s / pivot;
            }
            after = rest * pivot_inverse;
            factor = upper * pivot_inverse;
            (self.known[i], self.factor[i]) = (after, factor);
            self.direct[i] = weight.lanes();
        }
        let mut sums = Sums {
            mass: zero,
            second: zero,
            first: zero,
            of_mass: zero,
            obstacle: zero,
            cost: zero,
            cost_by_spot: zero,
            rise: zero,
        };
        let weights = steps.weights(number);
        let mut found = zero;
        let mut at = V::from_lanes(values[0]);
        let mut behind = V::from_lanes(values[1]);
        for i in 1..=last {
            found = self.known[i] - self.factor[i] * found;
            self.of_rows[i] = found;
            let before = at;
            (at, behind) = (behind, V::from_lanes(values[i + 1]));
            let second = before + behind - at.times(2.0);
            let difference = (behind - before).times(0.5);
            let mass = stage.mass(before, at, behind);
            sums.mass = found.times_plus(mass, sums.mass);
            sums.second = found.times_plus(second, sums.second);
            sums.first = found.times_plus(difference, sums.first);
            sums.of_mass = self.of_mass[i].times_plus(difference, sums.of_mass);
            let right = found - V::from_lanes(self.rates[number + 1][i]) * stage.inverse;
            self.mass[i] = if number == 2 {
                right.lanes()
            } else {
                (right + V::from_lanes(self.mass[i])).lanes()
            };
            for (k, weight) in weights.iter().enumerate().take(number + 1) {
                let old = V::from_lanes(self.rates[k][i]);
                self.rates[k][i] = weight.times_plus(right, old).lanes();
            }
        }
        self.of_contact(stage, &obstacle, top, loose, &mut sums);
        let pinned = near_end - stage.lower * self.of_rows[1];
        sums.obstacle = touching.times_plus(pinned, sums.obstacle);
        for row in &mut self.direct {
            *row = [0.0; LANES];
        }
        self.rates[number + 1].fill([0.0; LANES]);
        sums
    }

    /// The last node whose cell may hold a part of the boundary at a stage, at least the first inner one.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss
    )]
    fn top_of_contact(&self, index: usize) -> usize {
        let reach = self.record.reach[index].iter().copied().fold(0.0, f64::max);
        (reach.min(self.march.last_kink as f64) as usize + 1)
            .min(self.march.last_kink)
            .max(1)
    }

    /// The distance of the contact set from a node, in cells: 0 in it, 1 from one cell on.
    #[inline(always)]
    #[allow(clippy::cast_precision_loss)]
    fn distance_of(&self, index: usize, node: usize, obstacle: &Obstacle<V>, value: V) -> V {
        let (zero, one) = (V::zero(), V::all(1.0));
        let (gain, rise) = obstacle.at(V::from_lanes(self.march.signed[node]));
        let may = gain.min(rise);
        let height = (value - gain) / rise.max(V::all(f64::MIN_POSITIVE));
        let inside = height.max(zero).min(one).sqrt();
        let reached = V::from_lanes(self.record.reach[index]).plus(1.0 - node as f64);
        may.negative(one, (-reached).negative(inside, one))
    }

    /// What the nodes in contact, and those whose cells hold its ends, have to do with the obstacle and with c.
    #[inline(always)]
    fn of_contact(
        &self,
        stage: &Stage<V>,
        obstacle: &Obstacle<V>,
        top: usize,
        loose: V,
        sums: &mut Sums<V>,
    ) {
        let last = self.march.cells - 1;
        let (zero, one) = (V::zero(), V::all(1.0));
        let half_a = (stage.spread / stage.diffusion).times(0.5);
        for i in 1..=top.min(last) {
            let signed = V::from_lanes(self.march.signed[i]);
            let rise = obstacle.at(signed).1;
            let s = self.distance[i];
            let [upper, diagonal, low] = stage.column(i, last, loose);
            let before = if i > 1 { self.of_rows[i - 1] } else { zero };
            let behind = if i < last { self.of_rows[i + 1] } else { zero };
            let rows = upper * before + diagonal * self.of_rows[i] + low * behind;
            let pushed = s
                .plus(-1.0)
                .negative(V::from_lanes(self.direct[i]) - rows, zero);
            let square = s * s * pushed;
            let short = one - s;
            let cost = short * short * half_a * self.of_rows[i] + square * obstacle.half_inverse;
            sums.obstacle = sums.obstacle + pushed;
            sums.cost = sums.cost + cost;
            sums.cost_by_spot = cost.times_plus(signed, sums.cost_by_spot);
            sums.rise = square.times_plus(rise, sums.rise);
        }
    }

    /// Make derivatives by the coefficients of the segments out of the sums of a stage.
    fn add_up(
        &mut self,
        n: usize,
        number: usize,
        stage: &Stage<V>,
        steps: &LaneSteps<V>,
        sums: &Sums<V>,
    ) {
        let [mass, second, first, of_mass] =
            [sums.mass, sums.second, sums.first, sums.of_mass].map(V::lanes);
        let [obstacle, cost, cost_by_spot, rise] =
            [sums.obstacle, sums.cost, sums.cost_by_spot, sums.rise].map(V::lanes);
        let a = steps.dt.times(GAMMA).lanes();
        let diffusion = stage.diffusion.lanes();
        for (lane, own) in self.march.steps.iter().enumerate() {
            let Some(step) = own.get(n) else { continue };
            let segment = &self.march.contracts[lane].segments[step.segment];
            let (a, diffusion) = (a[lane], diffusion[lane]);
            let (peclet, growth) = (self.terms.peclet[lane], 1.0 + a * segment.rate);
            let by_peclet = (of_mass[lane] - growth * first[lane]) / 12.0
                + a * diffusion * (peclet / 6.0 * second[lane] + first[lane]);
            let by_diffusion = a
                * ((1.0 + peclet * peclet / 12.0) * second[lane] + peclet * first[lane])
                - rise[lane] / diffusion;
            let found = &mut self.found[lane][step.segment];
            add_by_peclet(found, segment, &self.march.grids[lane], peclet, by_peclet);
            found.rate -= a * mass[lane];
            found.volatility += by_diffusion * 2.0 * diffusion / segment.volatility;
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
    fn through_start(&mut self, lane: usize, number: usize) {
        let Some(start) = &self.record.starts[lane][number] else {
            return;
        };
        let contract = self.march.contracts[lane];
        let grid = self.march.grids[lane];
        let segment = &contract.segments[number];
        let weights: Vec<f64> = self.mass.iter().map(|row| row[lane]).collect();
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
        let peclet = self.terms.peclet[lane];
        let spots = &self.march.spots[lane];
        let by_peclet = through.walk::<V>(start, spots, &weights, peclet);
        let found = &mut self.found[lane];
        add_by_peclet(&mut found[number], segment, &grid, peclet, by_peclet);
        let by = through.by;
        found[number].amount += by.amount;
        found[number].fraction += by.fraction;
        found[number].escrow += by.escrow;
        let by_later_strike = through.by_later_strike;
        for (row, weight) in self.direct.iter_mut().zip(&through.later) {
            row[lane] = *weight;
        }
        for row in &mut self.mass {
            row[lane] = 0.0;
        }
        if let Some(later) = contract.segments.get(number + 1) {
            self.by_strike_now(lane, number + 1, later, by_later_strike);
        }
    }
}

/// Add a reading's weights to those of the nodes.
fn add(weights: &mut [[f64; LANES]], lane: usize, reading: &Reading, factor: f64) {
    let own = &reading.weights[..reading.points];
    for (row, weight) in weights[reading.start..].iter_mut().zip(own) {
        row[lane] += factor * weight;
    }
}

/// Tell a derivative by the cell Peclet number as derivatives by the coefficients.
fn add_by_peclet(
    found: &mut BySegment,
    segment: &Segment,
    grid: &Grid,
    peclet: f64,
    by_peclet: f64,
) {
    let diffusion = 0.5 * segment.volatility * segment.volatility;
    let step = grid.sign * grid.h;
    found.rate += by_peclet * step / diffusion;
    found.dividend_yield -= by_peclet * step / diffusion;
    found.volatility -= by_peclet * (step + peclet) * segment.volatility / diffusion;
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
    /// Walk from the weights of M V at the start; return the derivative by the cell Peclet number.
    #[inline(always)]
    #[allow(clippy::cast_precision_loss)]
    fn walk<V: Vector>(
        &mut self,
        start: &Start,
        spots: &[f64],
        weights: &[f64],
        peclet: f64,
    ) -> f64 {
        let values = &start.values;
        let last = self.grid.cells - 1;
        let mut by_peclet = 0.0;
        let mut own = weights.to_vec();
        (own[0], own[last + 1]) = (0.0, 0.0);
        let mut points = Vec::new();
        start.kinks.each_row(self.grid, |row, kinks| {
            let weight = std::mem::take(&mut own[row]);
            points_of_hat(row, kinks, |u, share| {
                let (share, tilt) = (weight * share, tilt(u));
                points.push((
                    row as f64 + u,
                    share * (hat(u) + peclet * tilt),
                    share * tilt,
                ));
            });
        });
        let [lower, middle, upper] = hat_weights(peclet);
        let mut indices = [0.0; LANES];
        for node in 0..=last + 1 {
            if node % V::WIDTH == 0 {
                let some = &spots[node..spots.len().min(node + V::WIDTH)];
                if self.before.segment.drops() {
                    indices_after::<V>(self.grid, self.before.segment, some, &mut indices);
                } else {
                    indices = std::array::from_fn(|k| (node + k) as f64);
                }
            }
            let before = if node > 0 { own[node - 1] } else { 0.0 };
            let behind = if node <= last { own[node + 1] } else { 0.0 };
            if node > 0 && node <= last {
                by_peclet += own[node] * (values[node + 1] - values[node - 1]) / 24.0;
            }
            let weight = upper * before + middle * own[node] + lower * behind;
            let spot = spots[node];
            #[allow(clippy::float_cmp)] // it was taken over as it is
            let exercised = self.before.exercise && values[node] == self.before.obstacle(spot);
            self.take(spot, indices[node % V::WIDTH], weight, exercised);
        }
        for (index, weight, by) in points {
            let spot = self.grid.spot_at(index);
            let (value, exercised) = self.before.at(spot);
            by_peclet += by * value;
            let after = self.grid.index(self.before.spot_after(spot));
            self.take(spot, after, weight, exercised);
        }
        by_peclet
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
