//! The march of as many contracts as a vector has lanes, from expiry to now: each lane has its own grid, its own segments
//! and its own steps, and all do the same in a step.

use super::contract::Contract;
use super::event::{After, Before, Kinks};
use super::line::{Contact, Line};
use super::local_terms::LocalTerms;
use super::mesh::Grid;
use super::newton::{Newton, System};
use super::record::{clear_before, Record, Start};
use super::settings::Settings;
use super::stage::{mass_of, Elimination, Obstacle, Rows, Stage};
use super::start::start_values;
use super::steps::{steps_of, LaneSteps, Step};
use super::tableau::GAMMA;
use super::terms::{EvenTerms, Terms};
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
    /// Where exercise begins over time.
    pub ends: Vec<End>,
    /// Whether every stage was solved.
    pub settled: bool,
    /// Where they are wanted, `V_tau` at the nodes, and the derivatives by the numbers of each segment.
    pub rates: Vec<f64>,
    pub by_segment: Vec<BySegment>,
}

/// Where the contact set ends at a time, ln S; not a number where it does not.
#[derive(Clone, Copy, Debug)]
pub struct End {
    /// The number of the segment.
    pub segment: usize,
    /// Years to the end of the segment: 0 is just before what happens there.
    pub years: f64,
    /// The end next to the strike.
    pub near: f64,
    /// That further from it.
    pub far: f64,
    /// How far the former may move unseen: a cell where it is at a node, as where a step is too short for the grid.
    pub unseen: f64,
}

impl End {
    /// The ends of a contact set; what comes nearer to an end of the grid than it resolves goes on beyond it.
    #[allow(clippy::cast_precision_loss)]
    pub(super) fn of(grid: &Grid, segment: usize, years: f64, contact: Contact) -> Self {
        let place = |index: f64| {
            if grid.resolves(index) {
                grid.spot_at(index).ln()
            } else {
                f64::NAN
            }
        };
        Self {
            segment,
            years,
            near: place(contact.end),
            far: place(contact.begin),
            unseen: if contact.end.fract() == 0.0 {
                grid.h
            } else {
                0.0
            },
        }
    }

    /// The end nearest to a place; not a number where there is none.
    pub(super) fn nearest(&self, x: f64) -> f64 {
        if (self.far - x).abs() < (self.near - x).abs() || self.near.is_nan() {
            self.far
        } else {
            self.near
        }
    }
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

/// Contracts that are marched side by side on grids of one number of cells, all with a local volatility or none.
pub struct Group<'a> {
    pub contracts: Vec<Contract<'a>>,
    pub cells: usize,
    pub settings: Settings,
    /// The number of contracts, the first ones, whose derivatives by the coefficients and by what happens are wanted.
    pub walked: usize,
    pub interrupt: Interrupt<'a>,
}

impl Work for Group<'_> {
    type Result = Option<Vec<Marched>>;

    #[inline(always)]
    fn run<V: Vector>(self) -> Self::Result {
        if self.contracts.len() <= V::Narrow::WIDTH {
            return V::Narrow::call(Marching(&self));
        }
        let mut found = Vec::with_capacity(self.contracts.len());
        for part in self.contracts.chunks(V::Roomy::WIDTH) {
            let walked = self.walked.saturating_sub(found.len()).min(part.len());
            let contracts = part.to_vec();
            found.extend(V::Roomy::call(Marching(&Group {
                contracts,
                walked,
                ..self
            }))?);
        }
        Some(found)
    }
}

/// The march of a group, as wide as it needs.
struct Marching<'g, 'a>(&'g Group<'a>);

impl<V: Vector> Part<V> for Marching<'_, '_> {
    type Result = Option<Vec<Marched>>;

    #[inline(always)]
    fn run(self) -> Self::Result {
        let group = self.0;
        let grids: Vec<Grid> = (0..LANES)
            .map(|l| {
                let contract = &group.contracts[l.min(group.contracts.len() - 1)];
                Grid::new(contract, group.cells, &group.settings)
            })
            .collect();
        let march = March::<V>::new(group, grids);
        if group.contracts[0].local.is_none() {
            let terms = EvenTerms::new(&march.grids);
            V::call(Run { march, terms })
        } else {
            let terms = LocalTerms::<V>::new(&group.contracts, &march.grids);
            V::call(Run { march, terms })
        }
    }
}

/// The march with one kind of coefficients: work of its own, which keeps the stack of either small.
struct Run<'a, T, V: 'static> {
    march: March<'a, V>,
    terms: T,
}

impl<T: Terms<V>, V: Vector> Part<V> for Run<'_, T, V> {
    type Result = Option<Vec<Marched>>;

    #[inline(always)]
    fn run(self) -> Self::Result {
        self.march.run(self.terms)
    }
}

struct March<'a, V: 'static> {
    group: &'a Group<'a>,
    grids: Vec<Grid>,
    steps: Vec<Vec<Step>>,
    spots: Vec<Vec<f64>>,
    /// The spot times the sign, at the nodes.
    signed: Vec<V>,
    /// V at the nodes, at the step's start and at the last stage.
    begun: Vec<V>,
    values: Vec<V>,
    /// The rates at the step's start and of its stages.
    rates: [Vec<V>; 4],
    /// What a stage starts from, and M times that without the far nodes, by elimination.
    base: Vec<V>,
    left: Vec<V>,
    elimination: Elimination<V>,
    /// The first node that is looked at: those before it are in contact in every lane, and stay so.
    first: usize,
    /// The same of each lane, 1 where the holder may not exercise; and the first one that may leave a contact set.
    own_first: [usize; LANES],
    leaving: usize,
    /// The first node behind the last where exercise brings something in any lane.
    last_kink: usize,
    last_kinks: [usize; LANES],
    newton: Newton<V>,
    contact: [Contact; LANES],
    ends: Vec<Vec<End>>,
    record: Option<Record<V>>,
    /// Whether a lane's contract has not come to now yet.
    active: [bool; LANES],
    settled: [bool; LANES],
}

impl<'a, V: Vector> March<'a, V> {
    fn new(group: &'a Group<'a>, grids: Vec<Grid>) -> Self {
        let nodes = group.cells + 1;
        let lane = |l: usize| l.min(group.contracts.len() - 1);
        let steps: Vec<Vec<Step>> = (0..group.contracts.len())
            .map(|l| steps_of(&group.contracts[l], &grids[l], &group.settings))
            .collect();
        let spots: Vec<Vec<f64>> = grids
            .iter()
            .map(|grid| (0..nodes).map(|node| grid.spot(node)).collect())
            .collect();
        let signed = (0..nodes)
            .map(|node| V::from_lanes(std::array::from_fn(|l| grids[l].sign * spots[l][node])))
            .collect();
        let array = || vec![V::zero(); nodes];
        let last_kinks: [usize; LANES] =
            std::array::from_fn(|l| last_gain(&group.contracts[lane(l)], &grids[l]));
        let segments = group.contracts.iter().map(|one| one.segments.len());
        let most = steps.iter().map(Vec::len).max().unwrap_or(0);
        let record = (group.walked > 0).then(|| Record::new(nodes, most, segments));
        Self {
            group,
            grids,
            steps,
            spots,
            signed,
            begun: array(),
            values: array(),
            rates: [array(), array(), array(), array()],
            base: array(),
            left: array(),
            elimination: Elimination::new(nodes),
            first: 1,
            own_first: [1; LANES],
            leaving: 1,
            last_kink: last_kinks.iter().copied().max().unwrap_or(0),
            last_kinks,
            newton: Newton::new(nodes),
            record,
            contact: [Contact::NONE; LANES],
            ends: vec![Vec::new(); group.contracts.len()],
            active: [false; LANES],
            settled: [true; LANES],
        }
    }

    #[inline(always)]
    fn run<T: Terms<V>>(mut self, mut terms: T) -> Option<Vec<Marched>> {
        let count = self.group.contracts.len();
        let most = self.steps.iter().map(Vec::len).max().unwrap_or(0);
        let mut found: Vec<Option<Marched>> = vec![None; count];
        for lane in 0..count {
            let last = self.group.contracts[lane].segments.len() - 1;
            self.start(&mut terms, lane, last, true);
        }
        for l in count..LANES {
            for row in &mut self.begun {
                *row = row.with_lane(l, row.lane(count - 1));
            }
            terms.copy_lane(count - 1, l);
        }
        for n in 0..most {
            if (self.group.interrupt)() {
                return None;
            }
            for (active, steps) in self.active.iter_mut().zip(&self.steps) {
                *active = n < steps.len();
            }
            self.step(&mut terms, n);
            for (lane, found) in found.iter_mut().enumerate() {
                let Some(step) = self.steps[lane].get(n).copied() else {
                    continue;
                };
                let (grid, years) = (&self.grids[lane], step.elapsed + step.dt);
                self.ends[lane].push(End::of(grid, step.segment, years, self.contact[lane]));
                if step.is_last && step.segment > 0 {
                    self.start(&mut terms, lane, step.segment - 1, false);
                } else if step.is_last {
                    *found = Some(self.marched(lane));
                }
            }
        }
        let mut found: Vec<Marched> = found.into_iter().collect::<Option<_>>()?;
        self.walk_back(terms, &mut found)?;
        Some(found)
    }

    /// The value of a lane now.
    fn marched(&mut self, lane: usize) -> Marched {
        let contract = &self.group.contracts[lane];
        let of = |nodes: &[V]| nodes.iter().map(|node| node.lane(lane)).collect();
        Marched {
            grid: self.grids[lane],
            values: of(&self.values),
            contact: self.contact[lane],
            strike: contract.segments[0].strike_at_beginning(),
            steps: self.steps[lane].len(),
            ends: std::mem::take(&mut self.ends[lane]),
            settled: self.settled[lane],
            rates: of(&self.rates[0]),
            by_segment: Vec::new(),
        }
    }

    /// Walk back from the values at the contracts' first spots.
    #[inline(always)]
    fn walk_back<T: Terms<V>>(&self, terms: T, found: &mut [Marched]) -> Option<()> {
        let Some(record) = &self.record else {
            return Some(());
        };
        let contracts = &self.group.contracts[..self.group.walked];
        let functionals: Vec<Functional> = found
            .iter()
            .zip(contracts)
            .map(|(marched, contract)| Functional::of(&marched.line(), contract.places[0].exp()))
            .collect();
        let derivatives = V::call(WalkBack {
            march: Course {
                contracts,
                cells: self.group.cells,
                grids: &self.grids,
                steps: &self.steps[..contracts.len()],
                spots: &self.spots,
                signed: &self.signed,
                last_kink: self.last_kink,
                interrupt: self.group.interrupt,
            },
            terms,
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
    fn start<T: Terms<V>>(&mut self, terms: &mut T, lane: usize, number: usize, at_expiry: bool) {
        let contract = self.group.contracts[lane];
        let (segment, grid) = (&contract.segments[number], self.grids[lane]);
        terms.enter(lane, &contract, number, &grid);
        let mut kinks = Kinks::default();
        let later: Vec<f64> = self.values.iter().map(|node| node.lane(lane)).collect();
        let mut contact = self.contact[lane];
        let after = if at_expiry {
            kinks.push(grid.index(segment.before_drop(1.0)));
            After::Payoff
        } else {
            let mut line = Line::after(&contract, number, &grid, &later, contact);
            contact = line.contact_below(contract.segments[number + 1].exercisable);
            line.contact = contact;
            for end in [contact.begin, contact.end] {
                kinks.push(grid.index(segment.before_drop(grid.spot_at(end))));
            }
            After::Line(line)
        };
        let before = Before::new(&contract, number, after);
        let mut values = vec![0.0; grid.cells + 1];
        let mut held = before.fill::<V>(&grid, &self.spots[lane], &mut values, &mut kinks);
        if !at_expiry && held.end == f64::NEG_INFINITY && contract.goes_on(number) {
            held = contact;
        }
        self.ends[lane].push(End::of(&grid, number, 0.0, held));
        let begun = start_values(&before, &grid, &kinks, &values, &terms.at_end(lane));
        for (row, value) in self.begun.iter_mut().zip(&begun) {
            *row = row.with_lane(lane, *value);
        }
        if let Some(record) = &mut self.record {
            record.starts[lane][number] = Some(Start {
                values,
                begun,
                kinks,
                later: (!at_expiry).then_some((later, contact)),
            });
        }
    }

    #[inline(always)]
    fn step<T: Terms<V>>(&mut self, terms: &mut T, n: usize) {
        let steps = LaneSteps::<V>::at(n, &self.group.contracts, &self.steps);
        self.skip(n);
        if let Some(record) = &mut self.record {
            record.begin(&self.rates[0]);
        }
        self.solve::<T, 1>(terms, &steps);
        self.solve::<T, 2>(terms, &steps);
        self.solve::<T, 3>(terms, &steps);
        if let Some(record) = &mut self.record {
            record.first.push(self.own_first);
        }
        let first = self.first - 1;
        self.begun[first..].copy_from_slice(&self.values[first..]);
        self.rates.swap(0, 3);
    }

    /// Choose the first node to look at: those well inside all contact sets stay what they are.
    ///
    /// In a lane that could begin later the rates before that are 0 as well, so that it does not depend on the others.
    #[inline(always)]
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    fn skip(&mut self, n: usize) {
        let cells = self.group.cells;
        let mut own = [cells; LANES];
        self.leaving = cells;
        for (lane, contract) in self.group.contracts.iter().enumerate() {
            let Some(step) = self.steps[lane].get(n) else {
                continue;
            };
            let Contact { begin, end } = self.contact[lane];
            let segment = &contract.segments[step.segment];
            let stays = segment.exercisable && segment.escrow == 0.0;
            let known = !step.is_first && stays && begin.is_infinite() && end > SKIPPED;
            own[lane] = if known { (end - SKIPPED) as usize } else { 1 }.max(1);
            if segment.exercisable {
                self.leaving = self.leaving.min(own[lane]);
            }
        }
        let first = own.into_iter().min().unwrap_or(1);
        if first > self.first {
            for rates in &mut self.rates {
                rates[self.first - 1..first].fill(V::zero());
            }
        }
        clear_before(&mut self.rates[0], first, &own, cells);
        (self.first, self.own_first) = (first, own);
    }

    /// Look at every node of the lanes whose contact set ends before the first node that was looked at, or is wrong; return
    /// whether there are any.
    #[allow(clippy::cast_precision_loss)]
    fn looks_again(&mut self, wrong: [bool; LANES], ends: [f64; LANES]) -> bool {
        let mut any = false;
        for l in 0..LANES {
            let known = self.active[l] && self.own_first[l] > 1;
            let stays = !wrong[l] && ends[l] >= self.own_first[l] as f64;
            if known && !stays {
                self.own_first[l] = 1;
                any = true;
            }
        }
        if any {
            (self.first, self.leaving) = (1, 1);
        }
        any
    }

    /// Solve stage N of three: the right-hand side and the elimination from the far end, then the substitution from the
    /// near one, which settles at each node whether it is in contact.
    ///
    /// Where the contact set is not one interval from the near end on, Newton's method does.
    #[inline(always)]
    fn solve<T: Terms<V>, const N: usize>(&mut self, terms: &mut T, steps: &LaneSteps<V>) {
        let is_other = terms.set(N - 1, steps, N == 1);
        let stage = terms.stage(steps.dt.times(GAMMA));
        let strike = steps.strikes[N - 1];
        let obstacle = terms.exercise().obstacle(strike);
        if is_other {
            self.elimination.of(&stage, self.first);
        }
        let weights = steps.weights(N - 1);
        let (swept, wrong) = loop {
            self.eliminate::<_, N>(&stage, weights);
            let swept = self.substitute::<_, N>(&stage, &obstacle);
            let mut wrong = self.active;
            for (wrong, worst) in wrong.iter_mut().zip(swept.worst.lanes()) {
                *wrong &= worst <= -ROUNDING || worst.is_nan();
            }
            if !self.looks_again(wrong, swept.contact.lanes()) {
                break (swept, wrong);
            }
            self.elimination.of(&stage, self.first);
        };
        self.newton.forget(wrong);
        if wrong.contains(&true) {
            V::call(Correction {
                march: self,
                stage: &stage,
                obstacle: &obstacle,
                number: N,
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
        if N == 3 {
            for (l, end) in swept.contact.lanes().into_iter().enumerate() {
                if !wrong[l] {
                    self.contact[l] = Contact::from_near_end(end);
                }
            }
        }
    }

    /// What a stage starts from, and the elimination of M times that from the far end.
    #[inline(always)]
    fn eliminate<R: Rows<V>, const N: usize>(&mut self, stage: &Stage<R, V>, weights: [V; 3]) {
        let last = self.group.cells - 1;
        let begun = &self.begun[..last + 2];
        let known: [&[V]; 3] = std::array::from_fn(|k| &self.rates[k.min(N - 1)][..last + 2]);
        let base = &mut self.base[..last + 2];
        let (factor, eliminated) = (&self.elimination.factor[..=last], &mut self.left[..=last]);
        for i in self.first - 1..last + 2 {
            let mut f = known[0][i].times_plus(weights[0], begun[i]);
            if N > 1 {
                f = known[1][i].times_plus(weights[1], f);
            }
            if N > 2 {
                f = known[2][i].times_plus(weights[2], f);
            }
            base[i] = f;
        }
        let mut left = V::zero();
        for i in (self.first..=last).rev() {
            let right = mass_of(stage.rows.at(i).mass, [base[i - 1], base[i], base[i + 1]]);
            left = factor[i].times_plus(left, right); // the last factor is 0
            eliminated[i] = left;
        }
    }

    /// Substitute from the near end, or from `first`; each lane is in contact up to the first node that it looks at.
    #[inline(always)]
    fn substitute<R: Rows<V>, const N: usize>(
        &mut self,
        stage: &Stage<R, V>,
        obstacle: &Obstacle<V>,
    ) -> Swept<V> {
        let (last, begin) = (self.group.cells - 1, self.first);
        let leaving = self.leaving.min(last);
        let strike = obstacle.strike;
        let (left, signed) = (&self.left[..=last], &self.signed[..last + 2]);
        let (pivot, inverse) = (
            &self.elimination.pivot[..=last],
            &self.elimination.inverse[..=last],
        );
        let (base, rates) = (&self.base[..last + 2], &mut self.rates[N][..last + 2]);
        let values = &mut self.values[..last + 2];
        let (zero, one) = (V::zero(), V::all(1.0));
        // The first node that a lane looks at, or 0; and below 0 where what lies before it is known to be in contact.
        let is_known = |l: usize| self.active[l] && self.own_first[l] > 1;
        #[allow(clippy::cast_precision_loss)]
        let looked_at = V::from_lanes(std::array::from_fn(|l| {
            if is_known(l) {
                self.own_first[l] as f64
            } else {
                0.0
            }
        }));
        let known = -looked_at;
        let mut before;
        let mut contact = zero;
        let mut held = V::all(-1.0); // below 0 where the last node was in contact
        if begin > 1 {
            before = strike - signed[begin - 1];
        } else {
            // The near end, as if nothing touched there.
            let (q, lower) = (stage.near_rule, stage.rows.at(1).lower);
            let second_lower = stage.rows.at(2).lower;
            let coupled = lower * q * inverse[2];
            let diagonal = pivot[1] + lower * q.plus(1.0) + coupled * second_lower;
            let free = coupled.times_plus(left[2], left[1]) / diagonal;
            let (gain, rise) = obstacle.at(signed[1], stage.rows.at(1).half_inverse);
            // below 0 where the near end is in contact
            let touching = gain.min(rise).negative(one, free - gain - rise);
            let touching = known.negative(known, touching);
            let free_second = (left[2] - second_lower * free) * inverse[2];
            let free_end = free * q.plus(1.0) - q * free_second;
            before = touching.negative(strike - signed[0], free_end);
            contact = touching.negative(zero, V::all(f64::NEG_INFINITY));
            held = touching.negative(held, one);
        }
        values[begin - 1] = before;
        rates[begin - 1] = (before - base[begin - 1]) * stage.inverse;
        let mut worst = zero;
        let mut i = begin;
        if leaving > 1 {
            contact = known.negative(zero, V::all(f64::NEG_INFINITY));
            held = known;
            while i < leaving {
                let share = -(stage.lower_of(i, last) * inverse[i]);
                let free = share.times_plus(before, left[i] * inverse[i]);
                before = known.negative(strike - signed[i], free);
                values[i] = before;
                rates[i] = (before - base[i]) * stage.inverse;
                i += 1;
            }
        }
        while i <= last && held.lanes().iter().any(|x| *x < 0.0) {
            let lower = stage.lower_of(i, last);
            let rest = left[i] - lower * before;
            let free = (-(lower * inverse[i])).times_plus(before, left[i] * inverse[i]);
            let (gain, rise) = obstacle.at(signed[i], stage.rows.at(i).half_inverse);
            let may = gain.min(rise);
            worst = worst.min(held.negative(zero, may.negative(zero, free - gain)));
            // below 0 where the node is known to be in contact, and where it is, or its cell
            #[allow(clippy::cast_precision_loss)]
            let inside = V::all(i as f64) - looked_at;
            let near = held.negative(may.negative(one, free - gain - rise), one);
            let near = inside.negative(inside, near);
            let cell = stage.cell(i, pivot[i], rest, (gain, rise), near);
            before = near.negative(inside.negative(gain, cell.value), free);
            values[i] = before;
            rates[i] = (before - base[i]) * stage.inverse;
            #[allow(clippy::cast_precision_loss)]
            let end = V::all(i as f64) - inside.negative(zero, cell.distance);
            contact = near.negative(end, contact);
            held = near.negative(inside.negative(inside, cell.held), one);
            i += 1;
        }
        while i <= last {
            // One operation from node to node: what each waits for is the one before it.
            let share = -(stage.lower_of(i, last) * inverse[i]);
            before = share.times_plus(before, left[i] * inverse[i]);
            if i < self.last_kink {
                let (gain, rise) = obstacle.at(signed[i], stage.rows.at(i).half_inverse);
                worst = worst.min(gain.min(rise).negative(zero, before - gain));
            }
            values[i] = before;
            rates[i] = (before - base[i]) * stage.inverse;
            i += 1;
        }
        let end = before * stage.far_rule.plus(1.0) - stage.far_rule * values[last - 1];
        values[last + 1] = end;
        rates[last + 1] = (end - base[last + 1]) * stage.inverse;
        Swept { contact, worst }
    }

    /// Solve the stage by Newton's method in the lanes where the sweep's contact set was wrong.
    #[inline(always)]
    fn correct<R: Rows<V>>(
        &mut self,
        stage: &Stage<R, V>,
        obstacle: &Obstacle<V>,
        number: usize,
        wrong: [bool; LANES],
    ) {
        let last = self.group.cells - 1;
        let top = |kink: usize| (kink - 1).clamp(3, last);
        #[allow(clippy::cast_precision_loss)]
        let tops = self.last_kinks.map(|kink| top(kink) as f64);
        let system = System {
            tops: V::from_lanes(tops),
            top: top(self.last_kink),
            signed: &self.signed,
            base: &self.base,
            left: &self.left,
            pivot: &self.elimination.pivot,
            inverse: &self.elimination.inverse,
        };
        let solved = self
            .newton
            .solve(stage, obstacle, &system, &self.values, wrong);
        for l in (0..LANES).filter(|l| wrong[*l]) {
            self.settled[l] &= solved[l];
            self.contact[l] = self.newton.contact(l);
        }
        let mask = V::from_lanes(wrong.map(|wrong| if wrong { -1.0 } else { 1.0 }));
        let rows = self.values.iter_mut().zip(&mut self.rates[number]);
        for ((value, rate), (found, base)) in rows.zip(self.newton.values.iter().zip(&self.base)) {
            *value = mask.negative(*found, *value);
            *rate = mask.negative((*found - *base) * stage.inverse, *rate);
        }
    }
}

/// The correction of a stage: work of its own, for it is rare and long.
struct Correction<'m, 'a, R, V: 'static> {
    march: &'m mut March<'a, V>,
    stage: &'m Stage<R, V>,
    obstacle: &'m Obstacle<V>,
    number: usize,
    wrong: [bool; LANES],
}

impl<R: Rows<V>, V: Vector> Part<V> for Correction<'_, '_, R, V> {
    type Result = ();

    #[inline(always)]
    fn run(self) {
        self.march
            .correct(self.stage, self.obstacle, self.number, self.wrong);
    }
}

/// What a sweep says: where the contact set ends, and by how much V lies below the obstacle beyond it.
struct Swept<V> {
    contact: V,
    worst: V,
}
