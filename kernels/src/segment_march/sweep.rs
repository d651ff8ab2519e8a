//! A whole schedule at one resolution: backward in time, segment by segment, event by event.

use super::event::{Before, Derivatives, Event};
use super::grid_function::{GridFunction, SlopeWeights, ValueFunction, STENCIL};
use super::operator::{Coefficients, Differences, Rows};
use super::region::EMPTY;
use super::{larger, march_segment, March, Scheme, Segment, Tangent};
use crate::error::{check_length, KernelError};
use crate::interrupt::Interrupt;

/// What a schedule says of one segment, amounts in units of the strike, per year.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Terms {
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
}

/// One segment of a schedule.
#[derive(Clone, Copy, Debug)]
pub struct Part<'a> {
    /// Its numbers.
    pub terms: Terms,
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
pub struct Direction {
    /// With more and with less.
    pub terms: Vec<[Terms; 2]>,
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
    pub directions: &'a [Direction],
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

impl Terms {
    fn coefficients(&self) -> Coefficients {
        Coefficients {
            rate: self.rate,
            dividend_yield: self.dividend_yield,
            volatility: self.volatility,
        }
    }
}

impl Direction {
    /// The derivative of a number of segment `part`.
    fn change(&self, part: usize, of: impl Fn(&Terms) -> f64) -> f64 {
        let [up, down] = &self.terms[part];
        (of(up) - of(down)) / (2.0 * self.step)
    }
}

impl Part<'_> {
    fn duration(&self) -> f64 {
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

    /// The segment with its operator, and lines at the ends of the grid through the values at its end.
    fn segment<'a>(
        &self,
        sign: f64,
        nodes: &'a [f64],
        rows: &'a Rows,
        values: &[f64],
    ) -> Segment<'a> {
        let mut segment = Segment {
            nodes,
            lower: &rows.lower,
            diagonal: &rows.diagonal,
            upper: &rows.upper,
            sign,
            escrow: self.terms.escrow,
            rate: self.terms.rate,
            dividend_yield: self.terms.dividend_yield,
            exercisable: self.exercisable,
            lines: end_lines(nodes, values),
            contact_at: [false; 2],
        };
        segment.contact_at = [0, 1].map(|end| {
            let (held, exercised) = segment.held_and_exercised_at(end, 0.5 * self.duration());
            self.exercisable && held <= exercised
        });
        segment
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
    let (parts, sign) = (schedule.parts, schedule.sign);
    check_length("nodes", nodes, nodes.len().max(STENCIL))?;
    for direction in schedule.directions {
        check_length("directions", &direction.terms, parts.len())?;
    }
    let (differences, weights) = (Differences::new(nodes), SlopeWeights::new(nodes));
    let mut operators = Operators::default();
    let mut derivatives = Derivatives {
        values: vec![vec![0.0; nodes.len()]; schedule.directions.len()],
        at_zero: vec![0.0; schedule.directions.len()],
    };
    let mut sweep = Sweep {
        values: Vec::new(),
        at_zero: sign.max(0.0),
        contact: Vec::new(),
        regions: vec![Vec::new(); parts.len()],
        before_events: vec![EMPTY; parts.len()],
        residual: 0.0,
        raised: false,
        derivatives: Vec::new(),
    };
    for (number, part) in parts.iter().enumerate().rev() {
        let at_expiry = number + 1 == parts.len();
        let after = if at_expiry {
            ValueFunction::Payoff(sign)
        } else {
            let zero = sweep.at_zero;
            ValueFunction::Grid(GridFunction::monotone(nodes, &sweep.values, zero, &weights))
        };
        let event = part.event(sign);
        let before = event.before(&after, sweep.at_zero, nodes);
        if !schedule.directions.is_empty() {
            let by = |d: &Direction| {
                let amount = d.change(number, |terms| terms.amount);
                [amount, d.change(number, |terms| terms.escrow)]
            };
            let changes: Vec<[f64; 2]> = schedule.directions.iter().map(by).collect();
            event.derivatives_before(&mut derivatives, &after, &before, &changes, nodes, &weights);
        }
        let coefficients = part.terms.coefficients();
        sweep.raised |= differences.is_raised_at(coefficients, watched);
        let rows = operators.of(coefficients, &differences);
        let segment = part.segment(sign, nodes, rows, &before.values);
        let tangents = tangents_of(schedule, number, &differences, &derivatives);
        let Some(march) = march_part(&segment, part, scheme, &before, &tangents, interrupt)? else {
            return Ok(None);
        };
        let at_end = before.at_zero;
        derivatives.at_start(march.tangents, &tangents, &segment, part.duration(), at_end);
        let held = at_end * (-part.terms.rate * part.duration()).exp();
        let exercised = sign * segment.strike_left(part.duration());
        sweep.at_zero = if part.exercisable {
            held.max(exercised)
        } else {
            held
        };
        sweep.values = march.values;
        if nodes[0] == 0.0 {
            sweep.values[0] = sweep.at_zero;
        }
        sweep.contact = march.contact;
        sweep.residual = larger(sweep.residual, march.residual);
        sweep.regions[number] = march.regions;
        sweep.before_events[number] = before.region;
    }
    sweep.derivatives = derivatives.values;
    Ok(Some(sweep))
}

/// The operator of the last segment asked for: neighbours often share it.
#[derive(Default)]
struct Operators {
    known: Option<(Coefficients, Rows)>,
}

impl Operators {
    fn of(&mut self, coefficients: Coefficients, differences: &Differences<'_>) -> &Rows {
        let known = self.known.take().filter(|(of, _)| *of == coefficients);
        let fresh = || (coefficients, differences.operator(coefficients));
        &self.known.insert(known.unwrap_or_else(fresh)).1
    }
}

fn march_part(
    segment: &Segment<'_>,
    part: &Part<'_>,
    scheme: Scheme,
    before: &Before,
    tangents: &[Tangent],
    interrupt: Interrupt<'_>,
) -> Result<Option<March>, KernelError> {
    let (inside, left) = (&segment.nodes[1..=segment.size()], segment.strike_left(0.0));
    let is_in_contact = |(v, s): (&f64, &f64)| {
        let slack = v - segment.sign * (left - s);
        part.exercisable && slack <= 0.0
    };
    let contact: Vec<bool> = before.values[1..]
        .iter()
        .zip(inside)
        .map(is_in_contact)
        .collect();
    let values = &before.values;
    march_segment(
        segment, part.times, scheme, values, &contact, tangents, interrupt,
    )
}

fn tangents_of(
    schedule: &Schedule<'_>,
    number: usize,
    differences: &Differences<'_>,
    derivatives: &Derivatives,
) -> Vec<Tangent> {
    let of = |(direction, values): (&Direction, &Vec<f64>)| {
        let [up, down] = direction.terms[number].map(|terms| terms.coefficients());
        let rows = differences.derivative(up, down, direction.step);
        Tangent {
            values: values.clone(),
            lower: rows.lower,
            diagonal: rows.diagonal,
            upper: rows.upper,
            rate: direction.change(number, |terms| terms.rate),
            dividend_yield: direction.change(number, |terms| terms.dividend_yield),
            escrow: direction.change(number, |terms| terms.escrow),
            lines: end_lines(differences.nodes, values),
        }
    };
    let pairs = schedule.directions.iter().zip(&derivatives.values);
    pairs.map(of).collect()
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
