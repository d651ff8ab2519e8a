//! The march of as many contracts as a vector has lanes, from expiry to now: each lane has its own grid, its own segments
//! and its own steps, and all do the same in a step.

use super::contract::Contract;
use super::event::{hat_weights, sums_over_hats, After, Before, Kinks};
use super::line::{Contact, Line};
use super::mesh::Grid;
use super::newton::{Newton, Rows};
use super::record::{Record, Start};
use super::settings::Settings;
use super::stage::{Elimination, Stage};
use super::steps::{steps_of, LaneSteps, Step};
use super::tableau::GAMMA;
use super::terms::Terms;
use super::walk_back::{BySegment, Course, Functional, WalkBack};
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
    /// Where they are wanted, `V_tau` at the nodes, and the derivatives by the numbers of each segment.
    pub rates: Vec<f64>,
    pub by_segment: Vec<BySegment>,
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
    /// Whether derivatives by the coefficients and by what happens are wanted.
    pub record: bool,
    pub interrupt: Interrupt<'a>,
}

impl Work for Group<'_> {
    type Result = Option<Vec<Marched>>;

    #[inline(always)]
    fn run<V: Vector>(self) -> Self::Result {
        if self.contracts.len() <= V::Narrow::WIDTH {
            V::Narrow::call(Marching(&self))
        } else {
            V::call(Marching(&self))
        }
    }
}

/// The march of a group, as wide as it needs.
struct Marching<'g, 'a>(&'g Group<'a>);

impl<V: Vector> Part<V> for Marching<'_, '_> {
    type Result = Option<Vec<Marched>>;

    #[inline(always)]
    fn run(self) -> Self::Result {
        March::<V>::new(self.0).run()
    }
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
    elimination: Elimination<V>,
    /// The first node that is looked at: those before it are in contact in every lane, and stay so.
    first: usize,
    /// The first node behind the last where exercise brings something in any lane.
    last_kink: usize,
    last_kinks: [usize; LANES],
    newton: Newton<V>,
    contact: [Contact; LANES],
    record: Option<Record>,
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
        let last_kinks: [usize; LANES] =
            std::array::from_fn(|l| last_gain(&group.contracts[lane(l)], &grids[l]));
        let last_kink = last_kinks.iter().copied().max().unwrap_or(0);
        let terms = Terms::new(&grids);
        let segments = group.contracts.iter().map(|one| one.segments.len());
        let record = group.record.then(|| Record::new(nodes, segments));
        Self {
            group,
            grids,
            steps,
            spots,
            terms,
            signed,
            values: vec![[0.0; LANES]; nodes],
            mass: vec![[0.0; LANES]; nodes],
            rates: [array(), array(), array(), array()],
            left: array(),
            found: array(),
            next_mass: vec![[0.0; LANES]; nodes],
            elimination: Elimination::new(nodes),
            first: 1,
            last_kink,
            last_kinks,
            newton: Newton::new(nodes),
            record,
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
        let mut found: Vec<Marched> = found.into_iter().collect::<Option<_>>()?;
        self.walk_back(&mut found)?;
        Some(found)
    }

    /// Give a lane that holds no contract the numbers of another.
    fn copy_lane(&mut self, from: usize, to: usize) {
        for array in [&mut self.values, &mut self.mass] {
            for row in array {
                row[to] = row[from];
            }
        }
        self.terms.copy_lane(from, to);
    }

    /// The value of a lane now.
    fn marched(&self, lane: usize) -> Marched {
        let contract = &self.group.contracts[lane];
        Marched {
            grid: self.grids[lane],
            values: self.values.iter().map(|row| row[lane]).collect(),
            contact: self.contact[lane],
            strike: contract.segments[0].strike_at_beginning(),
            steps: self.steps[lane].len(),
            settled: self.settled[lane],
            rates: self
                .record
                .as_ref()
                .map_or_else(Vec::new, |_| self.nodal_rates(lane)),
            by_segment: Vec::new(),
        }
    }

    /// `V_tau` at the nodes of a lane, from M times it; at the ends as the values go, linearly in the spot.
    fn nodal_rates(&self, lane: usize) -> Vec<f64> {
        let last = self.group.cells - 1;
        let [lower, middle, upper] = hat_weights(self.terms.peclet[lane]);
        let ratio = (self.grids[lane].sign * self.grids[lane].h).exp();
        let (near, far) = (1.0 / ratio, ratio);
        let mut rates = vec![0.0; last + 2];
        let mut factors = vec![0.0; last + 2];
        for i in 1..=last {
            let (mut low, mut diagonal, mut up) = (lower, middle, upper);
            if i == 1 {
                (diagonal, up, low) = (diagonal + lower * (1.0 + near), up - lower * near, 0.0);
            }
            if i == last {
                (diagonal, low) = (diagonal + upper * (1.0 + far), low - upper * far);
            }
            let pivot = diagonal - low * factors[i - 1];
            factors[i] = up / pivot;
            rates[i] = (self.rates[0][i].lane(lane) - low * rates[i - 1]) / pivot;
        }
        for i in (1..last).rev() {
            rates[i] -= factors[i] * rates[i + 1];
        }
        rates[0] = (1.0 + near) * rates[1] - near * rates[2];
        rates[last + 1] = (1.0 + far) * rates[last] - far * rates[last - 1];
        rates
    }

    /// Walk back from the values at the contracts' spots.
    #[inline(always)]
    fn walk_back(&self, found: &mut [Marched]) -> Option<()> {
        let Some(record) = &self.record else {
            return Some(());
        };
        let functionals: Vec<Functional> = found
            .iter()
            .zip(&self.group.contracts)
            .map(|(marched, contract)| Functional::of(&marched.line(), contract.x.exp()))
            .collect();
        let derivatives = V::call(WalkBack {
            march: Course {
                contracts: &self.group.contracts,
                cells: self.group.cells,
                grids: &self.grids,
                steps: &self.steps,
                spots: &self.spots,
                signed: &self.signed,
                terms: self.terms,
                last_kink: self.last_kink,
                interrupt: self.group.interrupt,
            },
            record,
            functionals: &functionals,
        })?;
        for (marched, own) in found.iter_mut().zip(derivatives) {
            marched.by_segment = own;
        }
        Some(())
    }

    /// Take a lane to the end of a segment: what happens there, and what its first step starts from.
    #[inline(always)]
    fn start(&mut self, lane: usize, number: usize, at_expiry: bool) {
        let contract = self.group.contracts[lane];
        let (segment, grid) = (&contract.segments[number], self.grids[lane]);
        let peclet = self.terms.enter(lane, segment, &grid);
        let mut kinks = Kinks::default();
        let later: Vec<f64> = self.values.iter().map(|row| row[lane]).collect();
        let contact = self.contact[lane];
        let after = if at_expiry {
            kinks.push(grid.index(segment.before_drop(1.0)));
            After::Payoff
        } else {
            for end in [contact.begin, contact.end] {
                kinks.push(grid.index(segment.before_drop(grid.spot_at(end))));
            }
            After::Line(Line::after(&contract, number, &grid, &later, contact))
        };
        let before = Before::new(&contract, number, after);
        let mut values = vec![0.0; grid.cells + 1];
        before.fill::<V>(&grid, &self.spots[lane], &mut values, &mut kinks);
        sums_over_hats::<V>(peclet, &values, |node, sum| self.mass[node][lane] = sum);
        before.whole_rows(&grid, &kinks, peclet, |row, x| self.mass[row][lane] = x);
        for (row, value) in self.values.iter_mut().zip(&values) {
            row[lane] = *value;
        }
        if let Some(record) = &mut self.record {
            record.starts[lane][number] = Some(Start {
                values,
                kinks,
                later: (!at_expiry).then_some((later, contact)),
            });
        }
    }

    #[inline(always)]
    fn step(&mut self, n: usize) {
        let steps = LaneSteps::<V>::at(n, &self.group.contracts, &self.steps);
        self.skip(n);
        let stage = self.terms.stage(steps.dt.times(GAMMA));
        self.elimination.of(&stage, self.first);
        let [one, two, three] = [0, 1, 2].map(|k| (steps.weights(k), steps.strikes[k]));
        self.solve::<1, false>(&stage, one);
        self.solve::<2, false>(&stage, two);
        self.solve::<3, true>(&stage, three);
        self.rates.swap(0, 3);
    }

    /// Choose the first node to look at: those well inside all contact sets stay what they are.
    ///
    /// In a lane that could begin later the rates before that are 0 as well, so that it does not depend on the others.
    #[inline(always)]
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss
    )]
    fn skip(&mut self, n: usize) {
        let mut own = [self.group.cells; LANES];
        for (lane, contract) in self.group.contracts.iter().enumerate() {
            let Some(step) = self.steps[lane].get(n) else {
                continue;
            };
            let Contact { begin, end } = self.contact[lane];
            let stays = contract.segments[step.segment].escrow == 0.0;
            let known = !step.is_first && stays && begin.is_infinite() && end > SKIPPED;
            own[lane] = if known { (end - SKIPPED) as usize } else { 1 }.max(1);
        }
        let first = own.into_iter().min().unwrap_or(1);
        for i in self.first..first {
            self.next_mass[i] = self.mass[i];
            self.found[i] = V::zero();
            for rates in &mut self.rates {
                rates[i] = V::zero();
            }
        }
        self.first = first;
        let furthest = own.into_iter().filter(|own| *own < self.group.cells).max();
        let begins = V::from_lanes(own.map(|own| own as f64));
        for i in first..furthest.unwrap_or(first) {
            let is_before = -begins.plus(-(i as f64));
            self.rates[0][i] = is_before.negative(V::zero(), self.rates[0][i]);
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
        (weights, strike): ([V; 3], V),
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
            self.elimination.of(stage, self.first);
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
        if let Some(record) = &mut self.record {
            let mut reach = swept.contact.lanes();
            for (reach, wrong) in reach.iter_mut().zip(wrong) {
                if wrong {
                    *reach = f64::INFINITY;
                }
            }
            record.push(&self.values, reach);
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
        let (factor, eliminated) = (&self.elimination.factor[..=last], &mut self.left[..=last]);
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
        let obstacle = self.terms.obstacle(stage, strike);
        let (left, signed) = (&self.left[..=last], &self.signed[..last + 2]);
        let (pivot, inverse) = (
            &self.elimination.pivot[..=last],
            &self.elimination.inverse[..=last],
        );
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
        if begin == 1 {
            rows.values[0] = before.lanes();
        }
        let mut worst = zero;
        let mut i = begin;
        while i <= last && held.lanes().iter().any(|x| *x < 0.0) {
            let lower = stage.lower_of(i, last);
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
            let lower = stage.lower_of(i, last);
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

    /// Solve the stage by Newton's method in the lanes where the sweep's contact set was wrong.
    #[inline(always)]
    fn correct(&mut self, stage: &Stage<V>, number: usize, strike: V, wrong: [bool; LANES]) {
        let obstacle = self.terms.obstacle(stage, strike);
        let last = self.group.cells - 1;
        let right = &self.rates[number + 1];
        let top = |kink: usize| (kink - 1).clamp(3, last);
        #[allow(clippy::cast_precision_loss)]
        let tops = self.last_kinks.map(|kink| top(kink) as f64);
        let rows = Rows {
            tops: V::from_lanes(tops),
            top: top(self.last_kink),
            signed: &self.signed,
            right,
            left: &self.left,
            pivot: &self.elimination.pivot,
            inverse: &self.elimination.inverse,
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
    /// M times the rates, V, and in the last stage M V.
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
        self.values[node] = value.lanes();
        (self.two_before, self.before) = (self.before, value);
    }
}
