//! The adjoint weights of the boundary of a segment, and by its equations those of the profile.
//!
//! The coefficients c of the boundary meet F(c; profile, parameters) = 0 (`collocation_system`). With the adjoint weights g of
//! the coefficients, a change dF of the equations changes the functionals by -g J^{-1} dF, J being the Jacobian that Newton's
//! method ends with: the stages are viewpoints with the weights -J^{-T} g. The place and the time of the onset and the payoff
//! crossings, from which boundaries are measured, have weights as well; with the time of the onset all nodes move, each at its
//! eta.

use super::boundary::{dot, Boundary};
use super::collocation_nodes::CollocationNodes;
use super::collocation_system::CollocationSystem;
use super::contact_adjoint::{see_contact_sets, BoundaryWeights};
use super::contact_onset::{ContactOnset, Representation};
use super::degree_control::value_nodes;
use super::gradient::{add, SegmentGradient, Weights, FUNCTIONALS};
use super::multiplier::ContactBlock;
use super::payoff_crossing::Gap;
use super::profile::Profile;
use super::segment::{Dynamics, Segment};
use super::unsettled::Unsettled;
use super::viewpoint::{see_profile, Viewpoint};
use crate::lanes::vector::LANES;
use crate::linear_system::eliminate;

/// The largest distance in time of an onset that was found to that where value and payoff meet, as a share of the duration;
/// chosen: ten times that of the search.
const CLOSE: f64 = 1e-6;

/// The smallest weight of a payoff crossing that counts; chosen: far away the gap's slope, by which it is divided, may be zero.
const SMALLEST_WEIGHT: f64 = 1e-30;

/// The adjoint of one boundary.
struct BoundaryAdjoint<'a> {
    boundary: &'a Boundary,
    profile: &'a Profile,
    /// The adjoint weights of the coefficients of each end, (ends x (degree + 1),).
    coefficients: Vec<Weights>,
    /// The adjoint weights of the place of the onset of the near end, and of the time of the onset.
    place: Weights,
    time: Weights,
    /// The adjoint weights of the payoff crossings, as (s, x, weights).
    crossings: Vec<(f64, f64, Weights)>,
}

/// Add the viewpoints that stand for the boundary, and return the adjoint weights of the place of its onset.
///
/// `contact_sets` are the adjoint weights of the contact sets as seen from the segment's beginning, and `at_beginning` those
/// of the boundary there.
pub fn see_boundary(
    boundary: &Boundary,
    profile: &Profile,
    contact_sets: &[BoundaryWeights],
    at_beginning: &Weights,
    views: &mut Vec<Viewpoint>,
    gradient: &mut SegmentGradient,
) -> Result<Weights, Unsettled> {
    let mut adjoint = BoundaryAdjoint {
        boundary,
        profile,
        coefficients: vec![[0.0; FUNCTIONALS]; boundary.ends.len() * (boundary.nodes.degree + 1)],
        place: [0.0; FUNCTIONALS],
        time: [0.0; FUNCTIONALS],
        crossings: Vec::new(),
    };
    adjoint.count_ages(gradient);
    adjoint.count_contact_sets(contact_sets);
    adjoint.count_stages(at_beginning, views, gradient)?;
    adjoint.count_crossings(views, gradient);
    adjoint.count_time(views, gradient);
    Ok(adjoint.place)
}

impl BoundaryAdjoint<'_> {
    /// Add the adjoint weights of the contact sets that the segment's beginning sees.
    fn count_contact_sets(&mut self, contact_sets: &[BoundaryWeights]) {
        let (boundary, degree) = (self.boundary, self.boundary.nodes.degree);
        let nodes = (value_nodes(degree), degree - 1);
        let blocks = &boundary.contact_blocks;
        self.count_nodes(nodes, boundary.segment.duration, blocks, contact_sets, true);
    }

    /// The segment and the time of the onset.
    fn start(&self) -> (&Segment, f64) {
        (&self.boundary.segment, self.boundary.onset_time())
    }

    /// Add the adjoint weights of the nodes of an integral until time `end`, by all of their coefficients or the first alone.
    fn count_nodes(
        &mut self,
        (nodes, stage): (&CollocationNodes, usize),
        end: f64,
        blocks: &[ContactBlock],
        contact_sets: &[BoundaryWeights],
        all: bool,
    ) {
        let onset_time = self.boundary.onset_time();
        let blocks_of_end = blocks.len() / self.boundary.ends.len();
        let both = blocks
            .chunks(blocks_of_end)
            .zip(contact_sets.chunks(blocks_of_end));
        for (of, (blocks, contact_sets)) in both.enumerate() {
            for (l, sine) in nodes.sine.iter().enumerate() {
                let weights = [0, 1].map(|k| contact_sets[l / LANES][k][l % LANES]);
                let place = blocks[l / LANES].boundary[l % LANES];
                let s = onset_time + (end - onset_time) * sine * sine;
                self.count_node((nodes, stage, l), (of, s, place), &weights, all);
            }
        }
    }

    /// Add the adjoint weights of a node of an integral, whose contact set had end `of` at `place` at time s; its coefficients
    /// behind the first count only where that is asked for.
    fn count_node(
        &mut self,
        (nodes, stage, l): (&CollocationNodes, usize, usize),
        (of, s, place): (usize, f64, f64),
        weights: &Weights,
        all: bool,
    ) {
        let row = nodes.row(stage, l);
        let coefficient = dot(row, &self.boundary.ends[of].coefficients);
        let by_coefficient = self.measured(coefficient, (of, s, place), weights);
        let first = of * row.len();
        let counted = first..first + if all { row.len() } else { 1 };
        for (total, share) in self.coefficients[counted].iter_mut().zip(row) {
            add(total, by_coefficient * share, weights);
        }
    }

    /// Add the adjoint weights of what end `of` at `place` is measured from; return its derivative by the coefficient.
    fn measured(
        &mut self,
        coefficient: f64,
        (of, s, place): (usize, f64, f64),
        weights: &Weights,
    ) -> f64 {
        let (segment, onset) = (&self.boundary.segment, &self.boundary.ends[of].onset);
        match onset.representation {
            Representation::SquaredDistance => add(&mut self.place, 1.0, weights),
            Representation::FromCrossing => {
                self.crossings.push((s, place - coefficient, *weights));
            }
            Representation::Direct => {}
        }
        onset.boundary_of(segment.sign, coefficient, 0.0).1
    }

    /// Take in that a later onset takes the ages and the weights of contact sets down in proportion; `gradient` holds what
    /// their contributions change by the parameters.
    fn count_ages(&mut self, gradient: &SegmentGradient) {
        let (segment, onset_time) = self.start();
        if onset_time > 0.0 {
            let span = segment.duration - onset_time;
            let by_scale = by_scale_of_time(&segment.dynamics, gradient);
            add(&mut self.time, -1.0 / span, &by_scale);
        }
    }

    /// The share of a move of the onset's time by which a time s moves.
    fn moved(&self, s: f64) -> f64 {
        let (segment, onset_time) = self.start();
        (segment.duration - s) / (segment.duration - onset_time)
    }

    /// Solve for the adjoint weights of the equations of the stages, and add those of the stages.
    fn count_stages(
        &mut self,
        at_beginning: &Weights,
        views: &mut Vec<Viewpoint>,
        gradient: &mut SegmentGradient,
    ) -> Result<(), Unsettled> {
        let boundary = self.boundary;
        let (segment, nodes) = (&boundary.segment, boundary.nodes);
        let (m, onset_time) = (nodes.degree, boundary.onset_time());
        let onsets: Vec<ContactOnset> = boundary.ends.iter().map(|end| end.onset).collect();
        let coefficients: Vec<f64> = boundary
            .ends
            .iter()
            .flat_map(|end| end.coefficients.iter().copied())
            .collect();
        let mut system = CollocationSystem::new(self.profile, segment, &onsets, nodes);
        let count = m * onsets.len();
        let (mut residual, mut jacobian) = (vec![0.0; count], vec![0.0; count * count]);
        system.residual(&coefficients, &mut residual, &mut jacobian);
        let last = (0, segment.duration, boundary.near().at_beginning);
        let by_last = self.measured(coefficients[m], last, at_beginning);
        add(&mut self.coefficients[m], by_last, at_beginning);

        let equations = self.transposed_solve(&jacobian, m)?;
        for (index, weights) in equations.iter().enumerate() {
            add(&mut gradient.last_step, residual[index], weights);
            let (end, k) = (index / m, index % m);
            let of_value = onsets[end].is_from_crossing();
            let s = system.times[k];
            let coefficient = boundary.ends[end].coefficients[k + 1];
            let (x, _) = system.stage_boundary(end, k, coefficient);
            let nothing = [0.0; FUNCTIONALS];
            let view = Viewpoint {
                x,
                s,
                value: if of_value { *weights } else { nothing },
                slope: if of_value { nothing } else { *weights },
            };
            let span = s - onset_time;
            let each = system.crossings.iter();
            let crossings: Vec<&[f64]> = each
                .map(|own| own.nodes.chunks(nodes.points).nth(k).unwrap_or(&[]))
                .collect();
            let blocks = boundary.contact_sets(nodes, k, span, &crossings);
            let mut own = SegmentGradient::default();
            let views_here = std::slice::from_ref(&view);
            let (seen, _) = see_contact_sets(
                segment.sign,
                &segment.dynamics,
                &blocks,
                views_here,
                &mut own,
            );
            self.count_ages(&own);
            own.exercise = [0.0; FUNCTIONALS]; // an equation's, and not the value's
            gradient.increase(&own);
            if onset_time > 0.0 {
                let mut own = SegmentGradient::default();
                see_profile(self.profile, &segment.dynamics, views_here, &mut own);
                let by_scale = by_scale_of_time(&segment.dynamics, &own);
                let moved = self.moved(s);
                add(&mut self.time, moved / s, &by_scale);
                if of_value {
                    add(&mut self.time, -moved * payoff_by_time(segment, s), weights);
                }
            }
            self.count_nodes((nodes, k), s, &blocks, &seen, false);
            if of_value {
                add_payoff(segment, s, weights, gradient);
            }
            let at_stage = weights.map(|weight| weight * system.by_place[index]);
            self.measured(coefficient, (end, s, x), &at_stage);
            views.push(view);
        }
        if onsets[0].representation == Representation::Direct {
            let first = self.coefficients[0];
            add(&mut self.place, 1.0, &first);
        }
        Ok(())
    }

    /// The adjoint weights of the equations: minus the inverse of the transposed Jacobian times those of the coefficients.
    fn transposed_solve(&self, jacobian: &[f64], m: usize) -> Result<Vec<Weights>, Unsettled> {
        let count = m * self.boundary.ends.len();
        let mut equations = vec![[0.0; FUNCTIONALS]; count];
        for functional in 0..FUNCTIONALS {
            let mut transposed: Vec<f64> = (0..count * count)
                .map(|i| jacobian[i % count * count + i / count])
                .collect();
            let unknown = self.coefficients.chunks(m + 1).flat_map(|own| &own[1..]);
            let mut rhs: Vec<f64> = unknown.map(|weights| -weights[functional]).collect();
            if !eliminate(&mut transposed, &mut rhs) {
                return Err(Unsettled);
            }
            for (equation, found) in equations.iter_mut().zip(rhs) {
                equation[functional] = found;
            }
        }
        Ok(equations)
    }

    /// Add the viewpoint that stands for the time of the onset, when the value without exercise is the payoff at its place.
    fn count_time(&self, views: &mut Vec<Viewpoint>, gradient: &mut SegmentGradient) {
        let (segment, onset) = (&self.boundary.segment, &self.boundary.near().onset);
        if onset.time <= 0.0 {
            return;
        }
        let gap = Gap::at(self.profile, segment, onset.place, onset.time);
        if gap.value.abs() > CLOSE * segment.duration * gap.by_s.abs() {
            return; // the onset is as early as the search looks
        }
        let value = self.time.map(|weight| -weight / gap.by_s);
        add_payoff(segment, onset.time, &value, gradient);
        views.push(Viewpoint::of_value(onset.place, onset.time, value));
    }

    /// Add the viewpoints that stand for the payoff crossings, where the value without exercise is the payoff.
    fn count_crossings(&mut self, views: &mut Vec<Viewpoint>, gradient: &mut SegmentGradient) {
        let segment = self.boundary.segment;
        for (s, x, weights) in std::mem::take(&mut self.crossings) {
            if weights.iter().all(|weight| weight.abs() < SMALLEST_WEIGHT) {
                continue;
            }
            let gap = Gap::at(self.profile, &segment, x, s);
            let value = weights.map(|weight| -weight / gap.by_x);
            if self.boundary.onset_time() > 0.0 {
                let moved = self.moved(s);
                add(&mut self.time, moved * gap.by_s, &value);
            }
            add_payoff(&segment, s, &value, gradient);
            views.push(Viewpoint::of_value(x, s, value));
        }
    }
}

/// What the functionals change if all times grow in proportion, from what they change by the parameters: that is as if
/// sigma^2, r and q grew.
fn by_scale_of_time(dynamics: &Dynamics, gradient: &SegmentGradient) -> Weights {
    let mut total = [0.0; FUNCTIONALS];
    add(&mut total, 0.5 * dynamics.volatility, &gradient.volatility);
    add(&mut total, dynamics.rate, &gradient.rate);
    add(&mut total, dynamics.dividend, &gradient.dividend);
    total
}

/// The derivative of the payoff by the time s to the segment's end.
fn payoff_by_time(segment: &Segment, s: f64) -> f64 {
    let rate = segment.dynamics.rate;
    segment.sign * segment.escrow * rate * (-rate * s).exp()
}

/// Add what minus the payoff at time s changes by the parameters: the strike less the escrow is part of it.
fn add_payoff(segment: &Segment, s: f64, weights: &Weights, gradient: &mut SegmentGradient) {
    let by_escrow = segment.sign * (-segment.dynamics.rate * s).exp();
    add(&mut gradient.escrow, by_escrow, weights);
    add(&mut gradient.rate, -by_escrow * segment.escrow * s, weights);
}
