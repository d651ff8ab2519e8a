//! Many schedules, each at one resolution, up to sixteen at a time in the lanes of one march.
//!
//! A lane takes the next schedule when it is done with one, and goes from segment to segment on its own. Its result does
//! not depend on its neighbours, and is what `sweep_schedule` gives, bit for bit. A step in which one elimination does
//! not settle the exercise region is done by `march_segment`.

use std::rc::Rc;

use super::boundary_cell::{place, Edge, PASSES};
use super::lane_rows::{Column, Correct, Factor, Found, Placed, Row, Solve, Terms};
use super::operator::Rows;
use super::region::{boundary, EMPTY};
use super::stage::Measured;
use super::sweep::{Arrival, GridNumbers, Leg, Progress};
use super::{larger, Schedule, Scheme, Segment, Sweep, SDIRK2_THETA};
use crate::error::KernelError;
use crate::interrupt::Interrupt;
use crate::lanes::vector::LANES;

/// The smallest number of marches for which lanes pay; measured.
const FEWEST: usize = 3;
/// The largest number of interior nodes of a march in lanes, which take 2 kB a node; chosen, so that a step, before which
/// the interrupt is asked, takes a few milliseconds.
const MOST_NODES: usize = 6000;

/// A schedule to be solved on a grid.
#[derive(Clone, Copy, Debug)]
pub struct Task<'a> {
    /// What is solved.
    pub schedule: &'a Schedule<'a>,
    /// s = S/K, increasing, at least five numbers.
    pub nodes: &'a [f64],
    /// The one-step method.
    pub scheme: Scheme,
    /// The places in s at which it is told whether the diffusion was raised.
    pub watched: &'a [f64],
}

type Solved = Result<Sweep, KernelError>;

/// Solve every schedule from expiry to now, see `sweep_schedule`; None where interrupted.
#[must_use]
pub fn sweep_schedules(tasks: &[Task<'_>], interrupt: Interrupt<'_>) -> Option<Vec<Solved>> {
    let key = |index: &usize| (tasks[*index].nodes.len(), tasks[*index].scheme as u8);
    let mut order: Vec<usize> = (0..tasks.len()).collect();
    order.sort_by_key(key);
    let mut results: Vec<Option<Solved>> = tasks.iter().map(|_| None).collect();
    for alike in order.chunk_by(|a, b| key(a) == key(b)) {
        let mut group = Group::new(tasks, alike);
        while group.fill(&mut results, interrupt)? {
            group.step(&mut results, interrupt)?;
        }
    }
    results.into_iter().collect()
}

/// Marches with the same number of nodes and the same scheme.
struct Group<'a> {
    tasks: &'a [Task<'a>],
    /// The tasks that no lane has taken.
    waiting: std::slice::Iter<'a, usize>,
    known: Option<Rc<GridNumbers<'a>>>,
    /// The operator of a step that was formed last, and what it is made of: neighbours often share it.
    formed: Option<Formed<'a>>,
    lanes: [Option<Box<Lane<'a>>>; LANES],
    rows: Vec<Row>,
}

struct Formed<'a> {
    grid: Rc<GridNumbers<'a>>,
    terms: super::Terms<'a>,
    rows: Rc<Rows>,
}

/// One march.
struct Lane<'a> {
    task: usize,
    progress: Progress<'a>,
    leg: Leg<'a>,
    /// The operator of the step under way.
    operator: Rc<Rows>,
    /// The number of steps done in the segment.
    step: usize,
    /// Row 0 is the last interior node.
    reversed: bool,
    contact: Contact,
    residual: f64,
    regions: Vec<[f64; 2]>,
    /// The state of the step under way.
    stage: StageState,
}

/// The exercise region at the start of a step.
enum Contact {
    /// So many rows from row 0 on.
    Rows(usize),
    /// Whether each interior node belongs to it.
    Nodes(Vec<bool>),
}

#[derive(Clone, Copy, Default)]
struct StageState {
    failed: bool,
    /// The number of rows in contact after the last stage.
    contact: usize,
    /// That after the correction under way.
    placed: Option<usize>,
    residual: f64,
}

impl<'a> Group<'a> {
    fn new(tasks: &'a [Task<'a>], alike: &'a [usize]) -> Self {
        let size = tasks[alike[0]].nodes.len().saturating_sub(2);
        Self {
            tasks,
            waiting: alike.iter(),
            known: None,
            formed: None,
            lanes: [const { None }; LANES],
            rows: if alike.len() < FEWEST || size > MOST_NODES {
                Vec::new()
            } else {
                vec![Row::IDLE; size]
            },
        }
    }

    /// Give every free lane a march; False once none is left.
    fn fill(&mut self, results: &mut [Option<Solved>], interrupt: Interrupt<'_>) -> Option<bool> {
        for lane in 0..LANES {
            while !self.rows.is_empty() && self.lanes[lane].is_none() {
                let Some(&task) = self.waiting.next() else {
                    break;
                };
                let progress = self.begin(task);
                match progress {
                    Ok(progress) => self.proceed(lane, task, progress, results, interrupt)?,
                    Err(error) => results[task] = Some(Err(error)),
                }
            }
        }
        let active = self.lanes.iter().flatten().count();
        if active >= FEWEST {
            return Some(true);
        }
        for lane in 0..LANES {
            self.end_alone(lane, results, interrupt)?;
        }
        while let Some(&task) = self.waiting.next() {
            let solved = match self.begin(task) {
                Ok(progress) => progress.run_out(self.tasks[task].scheme, interrupt),
                Err(error) => Err(error),
            };
            results[task] = Some(solved.transpose()?);
        }
        Some(false)
    }

    fn begin(&mut self, task: usize) -> Result<Progress<'a>, KernelError> {
        let Task {
            schedule,
            nodes,
            watched,
            ..
        } = self.tasks[task];
        let known = self.known.take();
        let grid = match known.filter(|grid| std::ptr::eq(grid.nodes(), nodes)) {
            Some(grid) => grid,
            None => Rc::new(GridNumbers::new(nodes)?),
        };
        self.known = Some(Rc::clone(&grid));
        Progress::new(schedule, grid, watched)
    }

    /// Load the next segment into a lane, after those that need none; keep the result where none is left.
    fn proceed(
        &mut self,
        lane: usize,
        task: usize,
        mut progress: Progress<'a>,
        results: &mut [Option<Solved>],
        interrupt: Interrupt<'_>,
    ) -> Option<()> {
        let scheme = self.tasks[task].scheme;
        while let Some(leg) = progress.next_leg() {
            if interrupt() {
                return None;
            }
            if leg.fits_lanes() {
                let loaded = Box::new(Lane::new(task, progress, leg));
                loaded.load(lane, &mut self.rows);
                self.lanes[lane] = Some(loaded);
                return Some(());
            }
            match leg.march(scheme, interrupt) {
                Ok(arrival) => progress.arrive(&leg, arrival?),
                Err(error) => {
                    results[task] = Some(Err(error));
                    return Some(());
                }
            }
        }
        results[task] = Some(Ok(progress.finish()));
        Some(())
    }

    /// Do what is left of a march without lanes.
    fn end_alone(
        &mut self,
        lane: usize,
        results: &mut [Option<Solved>],
        interrupt: Interrupt<'_>,
    ) -> Option<()> {
        let Some(mut march) = self.lanes[lane].take() else {
            return Some(());
        };
        let (task, steps) = (march.task, march.steps_left());
        let scheme = self.tasks[task].scheme;
        let values = march.column(lane, &self.rows, |row| &row.value);
        let rest = match march.alone(steps, scheme, &values, interrupt) {
            Ok(values) => values?,
            Err(error) => {
                results[task] = Some(Err(error));
                return Some(());
            }
        };
        let solved = march.arrive(rest).run_out(scheme, interrupt);
        results[task] = Some(solved.transpose()?);
        Some(())
    }

    /// Take one step in every lane.
    fn step(&mut self, results: &mut [Option<Solved>], interrupt: Interrupt<'_>) -> Option<()> {
        if interrupt() {
            return None;
        }
        let scheme = self
            .lanes
            .iter()
            .flatten()
            .next()
            .map(|lane| self.tasks[lane.task].scheme)?;
        let stages: &[f64] = match scheme {
            Scheme::ImplicitEuler => &[1.0],
            Scheme::Sdirk2 => &[SDIRK2_THETA, 1.0],
        };
        self.form_operators();
        let mut terms = self.terms_of_step(stages[0]);
        let smallest = Factor(&mut self.rows, &terms.h).done();
        for (lane, march) in self.marches() {
            march.stage = StageState {
                // A pivot that is not positive, or NaN, which no M-matrix has.
                failed: smallest[lane].is_nan() || smallest[lane] <= 0.0,
                ..StageState::default()
            };
        }
        for (number, share) in stages.iter().enumerate() {
            self.stage(number > 0, *share, &mut terms);
        }
        for lane in 0..LANES {
            self.end_step(lane, scheme, results, interrupt)?;
        }
        Some(())
    }

    /// Load the operators of the lanes in which it changes from step to step.
    fn form_operators(&mut self) {
        for (lane, march) in self.lanes.iter_mut().enumerate() {
            let Some(march) = march.as_deref_mut() else {
                continue;
            };
            if march.step == 0 || !march.leg.is_varying() {
                continue; // loaded with the segment
            }
            let terms = march.leg.part.terms.of_step(march.step);
            let known = self.formed.take().filter(|formed| {
                Rc::ptr_eq(&formed.grid, &march.leg.grid) && formed.terms == terms
            });
            let formed = self.formed.insert(known.unwrap_or_else(|| Formed {
                grid: Rc::clone(&march.leg.grid),
                terms,
                rows: march.leg.rows_of(march.step),
            }));
            march.operator = Rc::clone(&formed.rows);
            march.load_operator(lane, &mut self.rows);
        }
    }

    fn marches(&mut self) -> impl Iterator<Item = (usize, &mut Lane<'a>)> {
        let lanes = self.lanes.iter_mut().enumerate();
        lanes.filter_map(|(lane, march)| march.as_deref_mut().map(|march| (lane, march)))
    }

    fn terms_of_step(&mut self, weight: f64) -> Terms {
        let mut terms = Terms {
            h: [0.0; LANES],
            sign: [0.0; LANES],
            floor: [f64::NEG_INFINITY; LANES],
            strike_left: [0.0; LANES],
            ends: [[0.0; LANES]; 2],
        };
        for (lane, march) in self.marches() {
            let [start, end] = march.times();
            terms.h[lane] = if weight < 1.0 {
                weight * (end - start)
            } else {
                end - start
            };
            if march.leg.part.exercisable {
                terms.sign[lane] = march.leg.segment().sign;
                terms.floor[lane] = 0.0;
            }
        }
        terms
    }

    /// Solve one stage, which ends at a share of the step.
    fn stage(&mut self, second: bool, share: f64, terms: &mut Terms) {
        for (lane, march) in self.marches() {
            march.set_terms(lane, share, terms);
        }
        let found = Solve(&mut self.rows, terms, second).done();
        let mut placed = Placed {
            contact: [-1.0; LANES],
            missing: [0.0; LANES],
        };
        let mut any = false;
        let rows = &mut self.rows;
        for (lane, march) in self.lanes.iter_mut().enumerate() {
            if let Some(march) = march {
                march.check_contact(lane, &found, rows, terms.h[lane], &mut placed);
                any |= march.stage.placed.is_some();
            }
        }
        if any {
            let [residual, largest] = Correct(&mut self.rows, terms, &placed).done();
            for (lane, march) in self.marches() {
                let measured = Measured {
                    residual: residual[lane],
                    largest: largest[lane],
                };
                march.take_correction(measured);
            }
        }
    }

    /// Take over what a lane's step gave, and go on to the next segment after the last one.
    fn end_step(
        &mut self,
        lane: usize,
        scheme: Scheme,
        results: &mut [Option<Solved>],
        interrupt: Interrupt<'_>,
    ) -> Option<()> {
        let Some(mut march) = self.lanes[lane].take() else {
            return Some(());
        };
        if march.stage.failed || march.is_elsewhere() {
            let start = march.column(lane, &self.rows, |row| &row.start);
            match march.alone(1, scheme, &start, interrupt) {
                Ok(values) => march.store(lane, &values?, &mut self.rows),
                Err(error) => {
                    results[march.task] = Some(Err(error));
                    return Some(());
                }
            }
        } else {
            march.take_step(lane, &self.rows);
        }
        if march.steps_left() > 0 {
            self.lanes[lane] = Some(march);
            return Some(());
        }
        let values = march.column(lane, &self.rows, |row| &row.value);
        let task = march.task;
        let progress = march.arrive(values);
        self.proceed(lane, task, progress, results, interrupt)
    }
}

impl Leg<'_> {
    /// Whether its march can be done in a lane: it has steps, no derivatives, and nothing infinite.
    fn fits_lanes(&self) -> bool {
        let segment = self.segment();
        let finite = |numbers: &[f64]| numbers.iter().all(|x| x.is_finite());
        self.part.times.len() > 1
            && !self.has_tangents()
            && finite(&self.before.values)
            && [segment.lower, segment.diagonal, segment.upper].map(finite) == [true; 3]
    }
}

impl<'a> Lane<'a> {
    fn new(task: usize, progress: Progress<'a>, leg: Leg<'a>) -> Self {
        Self {
            task,
            progress,
            step: 0,
            reversed: leg.segment().expected_end() > 0,
            contact: Contact::Nodes(leg.first_contact()),
            residual: 0.0,
            regions: Vec::with_capacity(leg.part.times.len()),
            stage: StageState::default(),
            operator: Rc::clone(&leg.rows),
            leg,
        }
    }

    fn segment(&self) -> Segment<'_> {
        self.leg.segment_with(&self.operator)
    }

    /// The interior node of a row, and the row of an interior node.
    fn node(&self, row: usize) -> usize {
        if self.reversed {
            self.leg.segment().size() - 1 - row
        } else {
            row
        }
    }

    fn times(&self) -> [f64; 2] {
        let times = self.leg.part.times;
        [times[self.step], times[self.step + 1]]
    }

    fn steps_left(&self) -> usize {
        self.leg.part.times.len() - 1 - self.step
    }

    fn load(&self, lane: usize, rows: &mut [Row]) {
        let segment = self.segment();
        for (index, row) in rows.iter_mut().enumerate() {
            let s = segment.nodes[self.node(index) + 1];
            row.s[lane] = s;
            row.weight[lane] = 1.0 / larger(s, 1.0);
        }
        self.load_operator(lane, rows);
        self.store(lane, &self.leg.before.values, rows);
    }

    fn load_operator(&self, lane: usize, rows: &mut [Row]) {
        let Rows {
            lower,
            diagonal,
            upper,
        } = &*self.operator;
        let last = rows.len() - 1;
        let (inward, outward) = if self.reversed {
            (upper, lower)
        } else {
            (lower, upper)
        };
        for (index, row) in rows.iter_mut().enumerate() {
            let node = self.node(index);
            row.lower[lane] = inward[node];
            row.diagonal[lane] = diagonal[node];
            row.upper[lane] = outward[node];
        }
        rows[0].lower[lane] = 0.0;
        rows[last].upper[lane] = 0.0;
    }

    /// Write v, given at all nodes.
    fn store(&self, lane: usize, values: &[f64], rows: &mut [Row]) {
        for (index, row) in rows.iter_mut().enumerate() {
            row.value[lane] = values[self.node(index) + 1];
        }
    }

    /// A column at all nodes, of which the two at the ends are not known.
    fn column(&self, lane: usize, rows: &[Row], column: impl Fn(&Row) -> &Column) -> Vec<f64> {
        let mut values = vec![0.0; rows.len() + 2];
        for (index, row) in rows.iter().enumerate() {
            values[self.node(index) + 1] = column(row)[lane];
        }
        values
    }

    /// Write what a stage that ends at a share of the step needs to know.
    fn set_terms(&self, lane: usize, share: f64, terms: &mut Terms) {
        let [start, end] = self.times();
        let t = if share < 1.0 {
            start + share * (end - start)
        } else {
            end
        };
        let (segment, h) = (self.segment(), terms.h[lane]);
        let (size, [low, high]) = (segment.size(), segment.ends(t));
        let mut ends = [
            h * (segment.lower[0] * low),
            h * (segment.upper[size - 1] * high),
        ];
        if self.reversed {
            ends.reverse();
        }
        terms.ends[0][lane] = ends[0];
        terms.ends[1][lane] = ends[1];
        terms.strike_left[lane] = segment.strike_left(t);
    }

    /// See whether one elimination was enough, and place the boundary inside its cell.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_precision_loss,
        clippy::cast_sign_loss
    )]
    fn check_contact(
        &mut self,
        lane: usize,
        found: &Found,
        rows: &mut [Row],
        h: f64,
        placed: &mut Placed,
    ) {
        self.stage.placed = None;
        if !self.leg.part.exercisable || self.stage.failed {
            return;
        }
        let measured = Measured {
            residual: found.residual[lane],
            largest: found.largest[lane],
        };
        let is_run = found.contact[lane].to_bits() == found.up_to[lane].to_bits();
        if !(measured.residual <= measured.rounding() && is_run) {
            self.stage.failed = true;
            return;
        }
        self.stage.residual = measured.residual;
        self.stage.contact = found.contact[lane] as usize; // a count of rows
        if self.stage.contact == 0 {
            return;
        }
        match self.placed(lane, rows, h) {
            Err(Elsewhere) => self.stage.failed = true,
            Ok(None) => {}
            Ok(Some((contact, missing))) => {
                self.stage.placed = Some(contact);
                placed.contact[lane] = contact as f64;
                placed.missing[lane] = missing;
                rows[contact].q[lane] -= missing;
            }
        }
    }

    /// The number of rows in contact, and what the next one lacks; None where they do not settle or nothing is lacking.
    fn placed(&self, lane: usize, rows: &[Row], h: f64) -> Result<Option<(usize, f64)>, Elsewhere> {
        let (segment, mut contact) = (self.segment(), self.stage.contact);
        for pass in 0..PASSES {
            if contact == 0 || (contact == rows.len() && pass > 0) {
                return Err(Elsewhere);
            }
            if contact == rows.len() {
                return Ok(None);
            }
            let edge = Edge {
                free: self.node(contact),
                contact: self.node(contact - 1),
            };
            if segment.curvature(edge.contact) <= 0.0 {
                return Ok((pass > 0).then_some((contact, 0.0)));
            }
            let (z, response) = (rows[contact].intercept[lane], rows[contact].pivot[lane]);
            let (theta, missing) = place(&segment, h, edge, z, response);
            if theta > 1.0 {
                contact -= 1;
            } else if theta < 0.0 {
                contact += 1;
            } else {
                return Ok(Some((contact, missing)));
            }
        }
        Ok(None)
    }

    /// Take the corrected slack, if there is one; a step in which it makes the residual larger is done again.
    fn take_correction(&mut self, measured: Measured) {
        let Some(contact) = self.stage.placed else {
            return;
        };
        if measured.residual > self.stage.residual + measured.rounding() {
            self.stage.failed = true;
        }
        self.stage.residual = measured.residual;
        self.stage.contact = contact;
    }

    /// Whether the exercise region at the start of the step is not where lanes look for it.
    fn is_elsewhere(&self) -> bool {
        let segment = self.leg.segment();
        match &self.contact {
            Contact::Nodes(contact) if segment.exercisable => {
                segment.seed(contact) != segment.expected_end()
            }
            _ => false,
        }
    }

    /// Take over what the step gave.
    fn take_step(&mut self, lane: usize, rows: &[Row]) {
        let count = self.stage.contact;
        self.contact = Contact::Rows(count);
        self.residual = larger(self.residual, self.stage.residual);
        self.regions.push(self.region(lane, rows, count));
        self.step += 1;
    }

    /// Whether each interior node lies in the exercise region.
    fn contact_nodes(&self) -> Vec<bool> {
        match &self.contact {
            Contact::Rows(count) => {
                let size = self.leg.segment().size();
                (0..size).map(|node| self.node(node) < *count).collect()
            }
            Contact::Nodes(contact) => contact.clone(),
        }
    }

    /// The exercise region: so many rows, the boundary inside its cell.
    fn region(&self, lane: usize, rows: &[Row], count: usize) -> [f64; 2] {
        if count == 0 {
            return EMPTY;
        }
        let mut region = [f64::NEG_INFINITY, f64::INFINITY];
        if count < rows.len() {
            let far = (count + 1 < rows.len()).then(|| self.node(count + 1));
            let slack = |node: usize| rows[self.node(node)].slack[lane];
            let [contact, near] = [count - 1, count].map(|row| self.node(row));
            region[usize::from(!self.reversed)] =
                boundary(&self.segment(), slack, contact, near, far);
        }
        region
    }

    /// Take steps without lanes, from `values` at all nodes; return the values after them.
    fn alone(
        &mut self,
        steps: usize,
        scheme: Scheme,
        values: &[f64],
        interrupt: Interrupt<'_>,
    ) -> Result<Option<Vec<f64>>, KernelError> {
        let state = Arrival {
            values: values.to_vec(),
            contact: self.contact_nodes(),
            residual: self.residual,
            regions: std::mem::take(&mut self.regions),
            tangents: Vec::new(),
        };
        let whole = self.step..self.step + steps;
        let Some(state) = self.leg.march_steps(whole, state, scheme, interrupt)? else {
            return Ok(None);
        };
        self.contact = Contact::Nodes(state.contact);
        self.residual = state.residual;
        self.regions = state.regions;
        self.step += steps;
        Ok(Some(state.values))
    }

    /// End the segment with these values, of which those at the two ends do not matter.
    fn arrive(mut self: Box<Self>, mut values: Vec<f64>) -> Progress<'a> {
        let (duration, last) = (self.leg.part.duration(), values.len() - 1);
        [values[0], values[last]] = self.leg.segment().ends(duration);
        let arrival = Arrival {
            values,
            contact: self.contact_nodes(),
            residual: self.residual,
            regions: std::mem::take(&mut self.regions),
            tangents: Vec::new(),
        };
        self.progress.arrive(&self.leg, arrival);
        self.progress
    }
}

/// The exercise region is not one run of rows at the expected end.
struct Elsewhere;
