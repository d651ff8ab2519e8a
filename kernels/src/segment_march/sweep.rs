//! A whole schedule at one resolution: backward in time, segment by segment, event by event.

use std::ops::Range;
use std::rc::Rc;

use super::event::{Before, Derivatives, Event};
use super::grid_function::{GridFunction, SlopeWeights, ValueFunction, STENCIL};
use super::operator::{Coefficients, Differences, Rows};
use super::region::EMPTY;
use super::{larger, march_segment, Scheme, Segment, Tangent};
use crate::error::{check_length, KernelError};
use crate::interrupt::Interrupt;

/// What a schedule says of one segment, amounts in units of the strike, per year.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Terms<'a> {
    /// Continuously compounded.
    pub rate: f64,
    /// Continuously compounded.
    pub dividend_yield: f64,
    /// Per root of a year.
    pub volatility: f64,
    /// What the spot drops by at the end.
    pub amount: f64,
    /// At the end.
    pub escrow: f64,
    /// Where the volatility depends on the spot.
    pub surface: Option<Surface<'a>>,
}

/// A local volatility on the n interior nodes of a grid, what it exceeds the `volatility` of the terms by.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    /// Variances per year at the nodes, n for each of its times.
    pub variances: &'a [f64],
    /// The number of its times.
    pub times: usize,
    /// What each time counts for: a row for all steps of the segment, or one for each step, in the order of the times.
    pub weights: &'a [f64],
    /// Per root of a year: the excess is the root of the weighted variance less this.
    pub reference: f64,
}

impl PartialEq for Surface<'_> {
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self.variances, other.variances)
            && self.weights == other.weights
            && self.reference.to_bits() == other.reference.to_bits()
    }
}

impl Surface<'_> {
    /// The surface with the weights of one step.
    fn of_step(self, step: usize) -> Self {
        let first = if self.weights.len() > self.times {
            step * self.times
        } else {
            0
        };
        let weights = &self.weights[first..first + self.times];
        Self { weights, ..self }
    }

    /// What the volatility at the nodes exceeds the terms' by, in the step that the weights are of.
    fn excess(self) -> Vec<f64> {
        let mut excess = vec![0.0; self.variances.len() / self.times];
        let rows = self.variances.chunks_exact(excess.len());
        for (weight, variances) in self.weights.iter().zip(rows) {
            if *weight != 0.0 {
                for (sum, variance) in excess.iter_mut().zip(variances) {
                    *sum += weight * variance;
                }
            }
        }
        for sum in &mut excess {
            *sum = sum.sqrt() - self.reference;
        }
        excess
    }
}

/// One segment of a schedule.
#[derive(Clone, Copy, Debug)]
pub struct Part<'a> {
    /// Its numbers.
    pub terms: Terms<'a>,
    /// The share of the spot that is paid at its end.
    pub fraction: f64,
    /// Whether the holder may exercise throughout.
    pub exercisable: bool,
    /// Whether the holder may exercise at its end, just before the event.
    pub exercise_at_end: bool,
    /// Years before its end, from 0 to its length: a step leads from each to the next.
    pub times: &'a [f64],
}

/// A parameter: every segment's numbers with a little more and a little less of it, and half of what these differ by.
#[derive(Clone, Debug)]
pub struct Direction<'a> {
    /// With more and with less.
    pub terms: Vec<[Terms<'a>; 2]>,
    /// Half of the difference of the parameter.
    pub step: f64,
}

/// A schedule to be solved.
#[derive(Clone, Copy, Debug)]
pub struct Schedule<'a> {
    /// 1 for a put, -1 for a call.
    pub sign: f64,
    /// The segments from now to expiry.
    pub parts: &'a [Part<'a>],
    /// The parameters whose derivatives are carried along.
    pub directions: &'a [Direction<'a>],
}

/// A schedule solved, in units of the strike.
#[derive(Clone, Debug)]
pub struct Sweep {
    /// v now at all nodes.
    pub values: Vec<f64>,
    /// v now at s = 0.
    pub at_zero: f64,
    /// Whether an interior node lies in the exercise region now.
    pub contact: Vec<bool>,
    /// The ends of the exercise region in s after every step, for every segment.
    pub regions: Vec<Vec<[f64; 2]>>,
    /// The same just before the event at every segment's end.
    pub before_events: Vec<[f64; 2]>,
    /// The largest natural residual at the end of a step.
    pub residual: f64,
    /// Whether the diffusion was raised at a watched place.
    pub raised: bool,
    /// The derivatives of v by the parameters, at all nodes.
    pub derivatives: Vec<Vec<f64>>,
}

impl Terms<'_> {
    /// The numbers of one step that the operator knows.
    pub(super) fn of_step(&self, step: usize) -> Self {
        Self {
            amount: 0.0,
            escrow: 0.0,
            surface: self.surface.map(|surface| surface.of_step(step)),
            ..*self
        }
    }

    fn excess(&self) -> Vec<f64> {
        self.surface.map_or_else(Vec::new, Surface::excess)
    }

    fn coefficients<'b>(&self, excess: &'b [f64]) -> Coefficients<'b> {
        Coefficients {
            rate: self.rate,
            dividend_yield: self.dividend_yield,
            volatility: self.volatility,
            excess,
        }
    }
}

impl Direction<'_> {
    /// The derivative of a number of segment `part`.
    fn change(&self, part: usize, of: impl Fn(&Terms<'_>) -> f64) -> f64 {
        let [up, down] = &self.terms[part];
        (of(up) - of(down)) / (2.0 * self.step)
    }
}

impl Part<'_> {
    pub(super) fn duration(&self) -> f64 {
        self.times.last().copied().unwrap_or(0.0)
    }

    fn event(&self, sign: f64) -> Event {
        Event {
            sign,
            fraction: self.fraction,
            amount: self.terms.amount,
            escrow: self.terms.escrow,
            exercisable: self.exercise_at_end,
        }
    }
}

/// Solve a schedule from expiry to now on a grid in s = S/K; None where interrupted.
///
/// The exercise region is that of the spot that diffuses. `watched` are the places at which it is told whether the
/// diffusion was raised (`operator`). The interrupt is asked before every step.
///
/// # Errors
/// A grid has fewer than five nodes, a direction does not have the schedule's segments, or a pivot is zero.
pub fn sweep_schedule(
    schedule: &Schedule<'_>,
    nodes: &[f64],
    scheme: Scheme,
    watched: &[f64],
    interrupt: Interrupt<'_>,
) -> Result<Option<Sweep>, KernelError> {
    let progress = Progress::new(schedule, Rc::new(GridNumbers::new(nodes)?), watched)?;
    progress.run_out(scheme, interrupt)
}

/// What is computed of a grid once.
pub(super) struct GridNumbers<'a> {
    differences: Differences<'a>,
    weights: SlopeWeights,
}

impl<'a> GridNumbers<'a> {
    pub fn new(nodes: &'a [f64]) -> Result<Self, KernelError> {
        check_length("nodes", nodes, nodes.len().max(STENCIL))?;
        Ok(Self {
            differences: Differences::new(nodes),
            weights: SlopeWeights::new(nodes),
        })
    }

    pub fn nodes(&self) -> &'a [f64] {
        self.differences.nodes
    }
}

/// A sweep under way: it hands out one segment after the other, from expiry to now, and takes what was marched.
pub(super) struct Progress<'a> {
    schedule: &'a Schedule<'a>,
    grid: Rc<GridNumbers<'a>>,
    watched: &'a [f64],
    /// The operator of the first step that was formed last, and the numbers that it is made of.
    operator: Option<(Terms<'a>, Rc<Rows>)>,
    /// The directions that a segment so far depends on; the derivatives by all others are still zero.
    joined: Vec<usize>,
    /// Those by these directions.
    derivatives: Derivatives,
    sweep: Sweep,
    /// The number of segments that are still to be marched.
    left: usize,
}

/// A segment to be marched: the value at its end, and what holds throughout.
pub(super) struct Leg<'a> {
    pub part: &'a Part<'a>,
    number: usize,
    directions: Vec<&'a Direction<'a>>,
    pub grid: Rc<GridNumbers<'a>>,
    nodes: &'a [f64],
    pub rows: Rc<Rows>,
    sign: f64,
    lines: [[f64; 2]; 2],
    contact_at: [bool; 2],
    pub before: Before,
    tangents: Vec<Tangent>,
}

/// The option at the start of a segment.
pub(super) struct Arrival {
    pub values: Vec<f64>,
    pub contact: Vec<bool>,
    pub residual: f64,
    pub regions: Vec<[f64; 2]>,
    pub tangents: Vec<Vec<f64>>,
}

impl<'a> Progress<'a> {
    pub fn new(
        schedule: &'a Schedule<'a>,
        grid: Rc<GridNumbers<'a>>,
        watched: &'a [f64],
    ) -> Result<Self, KernelError> {
        let parts = schedule.parts.len();
        for direction in schedule.directions {
            check_length("directions", &direction.terms, parts)?;
        }
        Ok(Self {
            schedule,
            grid,
            watched,
            operator: None,
            joined: Vec::new(),
            derivatives: Derivatives {
                values: Vec::new(),
                at_zero: Vec::new(),
            },
            sweep: Sweep {
                values: Vec::new(),
                at_zero: schedule.sign.max(0.0),
                contact: Vec::new(),
                regions: vec![Vec::new(); parts],
                before_events: vec![EMPTY; parts],
                residual: 0.0,
                raised: false,
                derivatives: Vec::new(),
            },
            left: parts,
        })
    }

    /// The next segment towards now, after the event at its end; None where none is left.
    pub fn next_leg(&mut self) -> Option<Leg<'a>> {
        let number = self.left.checked_sub(1)?;
        self.join(number);
        let directions: Vec<&'a Direction<'a>> = self
            .joined
            .iter()
            .map(|&place| &self.schedule.directions[place])
            .collect();
        let (schedule, nodes) = (self.schedule, self.grid.nodes());
        let (part, sign) = (&schedule.parts[number], schedule.sign);
        let (weights, zero) = (&self.grid.weights, self.sweep.at_zero);
        let after = if self.left == schedule.parts.len() {
            ValueFunction::Payoff(sign)
        } else {
            let values = &self.sweep.values;
            ValueFunction::Grid(GridFunction::monotone(nodes, values, zero, weights))
        };
        let event = part.event(sign);
        let before = event.before(&after, zero, nodes);
        if !directions.is_empty() {
            let by = |d: &&Direction<'_>| {
                let amount = d.change(number, |terms| terms.amount);
                [amount, d.change(number, |terms| terms.escrow)]
            };
            let changes: Vec<[f64; 2]> = directions.iter().map(by).collect();
            let derivatives = &mut self.derivatives;
            event.derivatives_before(derivatives, &after, &before, &changes, nodes, weights);
        }
        let differences = &self.grid.differences;
        let terms = part.terms.of_step(0);
        let excess = terms.excess();
        let coefficients = terms.coefficients(&excess);
        self.sweep.raised |= differences.is_raised_at(coefficients, self.watched);
        let known = self.operator.take().filter(|(of, _)| *of == terms);
        let fresh = || (terms, Rc::new(differences.operator(coefficients)));
        let (_, rows) = self.operator.insert(known.unwrap_or_else(fresh));
        let mut leg = Leg {
            part,
            number,
            grid: Rc::clone(&self.grid),
            nodes,
            rows: Rc::clone(rows),
            sign,
            lines: end_lines(nodes, &before.values),
            contact_at: [false; 2],
            tangents: tangents_of(&directions, number, differences, &self.derivatives),
            directions,
            before,
        };
        leg.contact_at = leg.exercised_ends();
        Some(leg)
    }

    /// Join the directions that this segment is the first to depend on.
    fn join(&mut self, number: usize) {
        let nodes = self.grid.nodes().len();
        for (place, direction) in self.schedule.directions.iter().enumerate() {
            let [up, down] = &direction.terms[number];
            if up != down && !self.joined.contains(&place) {
                self.joined.push(place);
                self.derivatives.values.push(vec![0.0; nodes]);
                self.derivatives.at_zero.push(0.0);
            }
        }
    }

    /// Take what was marched over a segment.
    pub fn arrive(&mut self, leg: &Leg<'_>, arrival: Arrival) {
        self.left -= 1;
        let (part, segment) = (leg.part, leg.segment());
        let (at_end, duration) = (leg.before.at_zero, part.duration());
        self.derivatives
            .at_start(arrival.tangents, &leg.tangents, &segment, duration, at_end);
        let held = at_end * (-part.terms.rate * duration).exp();
        let exercised = leg.sign * segment.strike_left(duration);
        let sweep = &mut self.sweep;
        sweep.at_zero = if part.exercisable {
            held.max(exercised)
        } else {
            held
        };
        sweep.values = arrival.values;
        if leg.nodes[0] == 0.0 {
            sweep.values[0] = sweep.at_zero;
        }
        sweep.contact = arrival.contact;
        sweep.residual = larger(sweep.residual, arrival.residual);
        sweep.regions[self.left] = arrival.regions;
        sweep.before_events[self.left] = leg.before.region;
    }

    /// March over all segments that are left, one on its own after the other.
    pub fn run_out(
        mut self,
        scheme: Scheme,
        interrupt: Interrupt<'_>,
    ) -> Result<Option<Sweep>, KernelError> {
        while let Some(leg) = self.next_leg() {
            let Some(arrival) = leg.march(scheme, interrupt)? else {
                return Ok(None);
            };
            self.arrive(&leg, arrival);
        }
        Ok(Some(self.finish()))
    }

    pub fn finish(mut self) -> Sweep {
        let nothing = vec![0.0; self.grid.nodes().len()];
        self.sweep.derivatives = vec![nothing; self.schedule.directions.len()];
        for (place, values) in self.joined.into_iter().zip(self.derivatives.values) {
            self.sweep.derivatives[place] = values;
        }
        self.sweep
    }
}

impl Leg<'_> {
    pub fn segment(&self) -> Segment<'_> {
        self.segment_with(&self.rows)
    }

    /// The segment with the operator of a step.
    pub fn segment_with<'b>(&'b self, rows: &'b Rows) -> Segment<'b> {
        let terms = &self.part.terms;
        Segment {
            nodes: self.nodes,
            lower: &rows.lower,
            diagonal: &rows.diagonal,
            upper: &rows.upper,
            sign: self.sign,
            escrow: terms.escrow,
            rate: terms.rate,
            dividend_yield: terms.dividend_yield,
            exercisable: self.part.exercisable,
            lines: self.lines,
            contact_at: self.contact_at,
        }
    }

    /// Whether the operator is another one in every step.
    pub fn is_varying(&self) -> bool {
        let surface = self.part.terms.surface;
        surface.is_some_and(|surface| surface.weights.len() > surface.times)
    }

    pub fn has_tangents(&self) -> bool {
        !self.tangents.is_empty()
    }

    /// Whether the ends of the grid lie in the exercise region, half-way through the segment.
    fn exercised_ends(&self) -> [bool; 2] {
        let segment = self.segment();
        [0, 1].map(|end| {
            let (held, exercised) = segment.held_and_exercised_at(end, 0.5 * self.part.duration());
            self.part.exercisable && held <= exercised
        })
    }

    /// The interior nodes at which the option is exercised at the segment's end.
    pub fn first_contact(&self) -> Vec<bool> {
        let segment = self.segment();
        let left = segment.strike_left(0.0);
        let is_in_contact = |(v, s): (&f64, &f64)| {
            let slack = v - segment.sign * (left - s);
            self.part.exercisable && slack <= 0.0
        };
        let inside = &self.nodes[1..=segment.size()];
        let values = &self.before.values[1..];
        values.iter().zip(inside).map(is_in_contact).collect()
    }

    /// March over the segment on its own.
    pub fn march(
        &self,
        scheme: Scheme,
        interrupt: Interrupt<'_>,
    ) -> Result<Option<Arrival>, KernelError> {
        let steps = self.part.times.len().saturating_sub(1);
        let start = Arrival {
            values: self.before.values.clone(),
            contact: self.first_contact(),
            residual: 0.0,
            regions: Vec::with_capacity(steps),
            tangents: Vec::new(),
        };
        self.march_steps(0..steps, start, scheme, interrupt)
    }

    /// March on its own over some of the steps, from the state before the first of them.
    pub fn march_steps(
        &self,
        steps: Range<usize>,
        mut state: Arrival,
        scheme: Scheme,
        interrupt: Interrupt<'_>,
    ) -> Result<Option<Arrival>, KernelError> {
        let mut tangents = self.tangents.clone();
        let portion = if self.is_varying() { 1 } else { steps.len() };
        for first in steps.clone().step_by(portion.max(1)) {
            let rows = self.rows_of(first);
            self.set_tangents(first, &mut tangents);
            let (segment, last) = (self.segment_with(&rows), steps.end.min(first + portion));
            let times = &self.part.times[first..=last];
            let (values, contact) = (&state.values, &state.contact);
            let found = march_segment(
                &segment, times, scheme, values, contact, &tangents, interrupt,
            )?;
            let Some(march) = found else {
                return Ok(None);
            };
            state.values = march.values;
            state.contact = march.contact;
            state.residual = larger(state.residual, march.residual);
            state.regions.extend(march.regions);
            for (tangent, values) in tangents.iter_mut().zip(march.tangents) {
                tangent.values = values;
            }
        }
        state.tangents = tangents.into_iter().map(|tangent| tangent.values).collect();
        Ok(Some(state))
    }

    /// The operator of a step.
    pub fn rows_of(&self, step: usize) -> Rc<Rows> {
        if step == 0 || !self.is_varying() {
            return Rc::clone(&self.rows);
        }
        let terms = self.part.terms.of_step(step);
        let excess = terms.excess();
        let operator = self.grid.differences.operator(terms.coefficients(&excess));
        Rc::new(operator)
    }

    /// Set the operator of every tangent to that of a step.
    fn set_tangents(&self, step: usize, tangents: &mut [Tangent]) {
        if step == 0 || !self.is_varying() {
            return;
        }
        let differences = &self.grid.differences;
        let changes = changes_of(&self.directions, self.number, differences, step);
        for (tangent, rows) in tangents.iter_mut().zip(changes) {
            tangent.lower = rows.lower;
            tangent.diagonal = rows.diagonal;
            tangent.upper = rows.upper;
        }
    }
}

fn tangents_of(
    directions: &[&Direction<'_>],
    number: usize,
    differences: &Differences<'_>,
    derivatives: &Derivatives,
) -> Vec<Tangent> {
    let changes = changes_of(directions, number, differences, 0);
    let of = |((direction, values), rows): ((&&Direction<'_>, &Vec<f64>), Rows)| Tangent {
        values: values.clone(),
        lower: rows.lower,
        diagonal: rows.diagonal,
        upper: rows.upper,
        rate: direction.change(number, |terms| terms.rate),
        dividend_yield: direction.change(number, |terms| terms.dividend_yield),
        escrow: direction.change(number, |terms| terms.escrow),
        lines: end_lines(differences.nodes, values),
    };
    let pairs = directions.iter().zip(&derivatives.values);
    pairs.zip(changes).map(of).collect()
}

/// The derivatives of the operator of a step by the parameters; most of these share one surface.
fn changes_of<'a>(
    directions: &[&Direction<'a>],
    number: usize,
    differences: &Differences<'_>,
    step: usize,
) -> Vec<Rows> {
    let mut known: Option<(Option<Surface<'a>>, Rc<[f64]>)> = None;
    let mut excess_of = |terms: &Terms<'a>| {
        let same = known
            .take()
            .filter(|(surface, _)| *surface == terms.surface);
        let fresh = || (terms.surface, Rc::from(terms.excess()));
        Rc::clone(&known.insert(same.unwrap_or_else(fresh)).1)
    };
    let of = |direction: &&Direction<'a>| {
        let [up, down] = direction.terms[number].map(|terms| terms.of_step(step));
        let [more, less] = [&up, &down].map(&mut excess_of);
        let (up, down) = (up.coefficients(&more), down.coefficients(&less));
        differences.derivative(up, down, direction.step)
    };
    directions.iter().map(of).collect()
}

impl Derivatives {
    /// Take those at the start of a segment, `values` at the nodes, and follow those at s = 0 there, where the option
    /// has the value `at_end` at the segment's end.
    fn at_start(
        &mut self,
        values: Vec<Vec<f64>>,
        tangents: &[Tangent],
        segment: &Segment<'_>,
        duration: f64,
        at_end: f64,
    ) {
        let bond = (-segment.rate * duration).exp();
        let exercised = segment.sign * segment.strike_left(duration);
        let is_exercised = segment.exercisable && exercised > at_end * bond;
        self.values = values;
        for ((zero, row), by) in self.at_zero.iter_mut().zip(&mut self.values).zip(tangents) {
            *zero = if is_exercised {
                -segment.sign * bond * (by.escrow - segment.escrow * duration * by.rate)
            } else {
                bond * (*zero - at_end * duration * by.rate)
            };
            if segment.nodes[0] == 0.0 {
                row[0] = *zero;
            }
        }
    }
}

/// (a, b) of the lines a + b s through the two first and the two last values.
fn end_lines(nodes: &[f64], values: &[f64]) -> [[f64; 2]; 2] {
    let last = nodes.len() - 1;
    [(0, 1), (last, last - 1)].map(|(end, next)| {
        let slope = (values[next] - values[end]) / (nodes[next] - nodes[end]);
        [values[end] - slope * nodes[end], slope]
    })
}
