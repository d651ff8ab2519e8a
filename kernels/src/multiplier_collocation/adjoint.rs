//! The derivatives of the value now, and of its slope, by the numbers of all segments: the adjoint of the recursion.
//!
//! The recursion goes from expiry to now; its adjoint goes from now to expiry and carries the derivatives of the functionals by
//! every value that the recursion went through, their adjoint weights. In the continuum these are the density of the spot that
//! has not been exercised yet, started as a point mass at the spot now. One walk gives the derivatives by every number of every
//! segment, however many there are.
//!
//! Between two events the value is seen from viewpoints: the nodes of the profile at the segment's beginning (`viewpoint`),
//! which also see the contact sets (`contact_adjoint`), and the stages of the boundary (`boundary_adjoint`). The ends of
//! pieces and panels have no weight, for the value has no jump there, and where the holder is indifferent exercise and waiting
//! are worth the same.

use super::boundary::Boundary;
use super::boundary_adjoint::see_boundary;
use super::contact_adjoint::see_contact_sets;
use super::event_transfer::NARROWEST_LINE;
use super::gradient::{add, SegmentGradient, Weights, FUNCTIONALS};
use super::points_seen::{see_from_points, PointsSeen};
use super::profile::{Piece, PieceKind};
use super::schedule::Schedule;
use super::segment::Segment;
use super::segment_value::SegmentValue;
use super::solved_part::SolvedPart;
use super::spot_drop::SpotDrop;
use super::unsettled::Unsettled;
use super::viewpoint::{see_profile, weight_of_piece, Coefficient, Viewpoint};
use crate::gauss_legendre::legendre;

/// The relative distance within which a place is that of the onset; chosen.
const SAME_PLACE: f64 = 1e-12;

/// Which of its degrees every boundary is taken from.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Degrees {
    /// The one that gave the value.
    Own,
    /// The other one that was solved; a boundary without one does not count. How far the derivatives are apart tells their
    /// errors.
    Other,
}

/// The derivatives of the value now and of its slope by the numbers of each segment: from the boundaries' own degrees and, with
/// two walks, from the other ones. `parts` are in the order of the
/// recursion.
pub fn differentiate<const WALKS: usize>(
    parts: &[SolvedPart],
    schedule: &Schedule,
) -> Result<[Vec<SegmentGradient>; WALKS], Unsettled> {
    let mut walks: [Walk; WALKS] =
        std::array::from_fn(|k| Walk::new([Degrees::Own, Degrees::Other][k], schedule));
    for k in (0..parts.len()).rev() {
        if (schedule.interrupt)() {
            return Err(Unsettled);
        }
        let part = &parts[k];
        let now = &part.value;
        let mut passages = Vec::with_capacity(WALKS);
        for walk in &mut walks {
            passages.push(walk.see_boundary(now)?);
        }
        if let Some(before) = parts.get(k + 1) {
            let points = walks.each_ref().map(|walk| walk.points.as_slice());
            let seen = see_from_points(&now.profile, &now.segment, points);
            for ((walk, passage), seen) in walks.iter_mut().zip(&mut passages).zip(seen) {
                walk.take_in_points(passage, seen, (before.index, part.index));
            }
        } else {
            for (walk, passage) in walks.iter().zip(&mut passages) {
                walk.see_from_now(passage, now);
            }
        }
        for (walk, passage) in walks.iter_mut().zip(passages) {
            walk.leave(passage, part, &parts[..k]);
        }
    }
    Ok(walks.map(|walk| walk.gradients))
}

/// The adjoint weights of the value at the beginning of a part.
struct Walk {
    degrees: Degrees,
    points: Vec<Viewpoint>,
    /// The adjoint weights of the boundary at the beginning.
    boundary: Weights,
    gradients: Vec<SegmentGradient>,
}

/// What a walk has found on its way through a part.
#[derive(Default)]
struct Passage {
    gradient: SegmentGradient,
    /// The viewpoints inside the part: the boundary's.
    views: Vec<Viewpoint>,
    /// The adjoint weights of the place of the onset, and those of the amount of the event before the part by the contact sets.
    place: Weights,
    by_amount: Weights,
    /// The derivative of each functional by the profile's value at its nodes, per unit of x.
    densities: [Vec<f64>; FUNCTIONALS],
}

impl Walk {
    fn new(degrees: Degrees, schedule: &Schedule) -> Walk {
        Walk {
            degrees,
            points: vec![Viewpoint {
                x: schedule.x,
                s: 0.0,
                value: [1.0, 0.0],
                slope: [0.0, 1.0],
            }],
            boundary: [0.0; FUNCTIONALS],
            gradients: vec![SegmentGradient::default(); schedule.segments.len()],
        }
    }

    /// The boundary that the walk takes.
    fn boundary_of<'a>(&self, now: &'a SegmentValue) -> Option<&'a Boundary> {
        let own = now.boundary.as_ref()?;
        match self.degrees {
            Degrees::Own => Some(own),
            Degrees::Other => own.other.as_deref(),
        }
    }

    /// Come to the beginning of a part, and take in its contact sets and their boundary.
    fn see_boundary(&mut self, now: &SegmentValue) -> Result<Passage, Unsettled> {
        let segment = &now.segment;
        for point in &mut self.points {
            point.s = segment.duration;
        }
        let mut passage = Passage::default();
        if let Some(boundary) = self.boundary_of(now) {
            let blocks = &boundary.contact_blocks;
            let (seen, by_amount) = see_contact_sets(
                segment.sign,
                &segment.dynamics,
                blocks,
                &self.points,
                &mut passage.gradient,
            );
            passage.by_amount = by_amount;
            passage.place = see_boundary(
                boundary,
                &now.profile,
                &seen,
                &self.boundary,
                &mut passage.views,
                &mut passage.gradient,
            )?;
        }
        Ok(passage)
    }

    /// See the profile of the first part from now.
    fn see_from_now(&self, passage: &mut Passage, now: &SegmentValue) {
        let (dynamics, gradient) = (&now.segment.dynamics, &mut passage.gradient);
        passage.densities = see_profile(&now.profile, dynamics, &self.points, gradient);
    }

    /// Take in what the viewpoints at the beginning see of the profile; `before` and `here` are the segments of the part that
    /// was gone through before and of this one.
    fn take_in_points(
        &mut self,
        passage: &mut Passage,
        seen: PointsSeen,
        (before, here): (usize, usize),
    ) {
        passage.gradient.increase(&seen.gradient);
        passage.densities = seen.densities;
        if before != here {
            let amount = &mut self.gradients[before].amount;
            add(amount, -1.0, &passage.by_amount);
            add(amount, -1.0, &seen.by_amount);
        }
    }

    /// Go to the last of the parts that are `later`.
    fn leave(&mut self, passage: Passage, part: &SolvedPart, all_later: &[SolvedPart]) {
        let later = all_later.last();
        let (now, mut gradient) = (&part.value, passage.gradient);
        let (mut views, mut densities) = (passage.views, passage.densities);
        if !views.is_empty() {
            let dynamics = &now.segment.dynamics;
            let seen = see_profile(&now.profile, dynamics, &views, &mut gradient);
            for (total, part) in densities.iter_mut().zip(&seen) {
                for (total, part) in total.iter_mut().zip(part) {
                    *total += part;
                }
            }
        }
        views.append(&mut self.points);
        let drop = SpotDrop {
            keep: 1.0 - now.segment.fraction,
            amount: now.segment.amount,
        };
        self.points = nodes_seen(now, &densities, drop);
        self.count_pieces((part, all_later), drop, &views, &mut gradient);
        self.boundary = [0.0; FUNCTIONALS];
        self.count_place(part, later, drop, &passage.place, &mut gradient);
        self.take_in(part, &gradient);
    }

    /// Add the adjoint weights of the lines of the profile.
    fn count_pieces(
        &mut self,
        (part, all_later): (&SolvedPart, &[SolvedPart]),
        drop: SpotDrop,
        views: &[Viewpoint],
        gradient: &mut SegmentGradient,
    ) {
        let later = all_later.last();
        let segment = &part.value.segment;
        for piece in &part.value.profile.pieces {
            if piece.kind == PieceKind::Other {
                continue;
            }
            let weight = |of| weight_of_piece(piece, &segment.dynamics, views, of);
            let weights = weight(Coefficient::Constant);
            if piece.kind == PieceKind::Waiting {
                let by_slope = weight(Coefficient::Slope);
                let seen = line_seen(piece, segment, (&weights, &by_slope), drop);
                self.points.extend(seen);
                continue;
            }
            if piece.kind == PieceKind::AtZero {
                self.count_at_zero(all_later, &weights);
                continue;
            }
            if piece.kind == PieceKind::Payoff {
                add(&mut gradient.escrow, -segment.sign, &weights);
                continue;
            }
            if part.offset <= 0.0 {
                add(&mut gradient.amount, segment.sign, &weights);
            }
            if let Some(later) = later {
                let after = &later.value.segment;
                let by_escrow = -segment.sign * (-after.dynamics.rate * after.duration).exp();
                let mut beyond = SegmentGradient::default();
                add(&mut beyond.escrow, by_escrow, &weights);
                add(
                    &mut beyond.rate,
                    -by_escrow * after.escrow * after.duration,
                    &weights,
                );
                self.take_in(later, &beyond);
            }
        }
    }

    /// Add the adjoint weights of the value at a spot of zero: what is paid at the next exercise, discounted.
    fn count_at_zero(&mut self, all_later: &[SolvedPart], weights: &Weights) {
        let at_zero = all_later.last().map_or(0.0, |part| part.value.at_zero);
        for (k, part) in all_later.iter().enumerate().rev() {
            let (value, segment) = (&part.value, &part.value.segment);
            if value.is_exercised_at_zero() {
                return;
            }
            let by_rate = -segment.duration * at_zero;
            add(&mut self.gradients[part.index].rate, by_rate, weights);
            let waits = |next: &SolvedPart| next.value.at_zero > segment.strike(0.0);
            let goes_on = k.checked_sub(1).is_some_and(|k| waits(&all_later[k]));
            if segment.exercise_at_end && !goes_on {
                return;
            }
        }
    }

    /// Add the adjoint weights of the place of the onset: it is the zero of the multiplier, or where the contact set ended at the
    /// part's end.
    fn count_place(
        &mut self,
        part: &SolvedPart,
        later: Option<&SolvedPart>,
        drop: SpotDrop,
        weights: &Weights,
        gradient: &mut SegmentGradient,
    ) {
        let Some(boundary) = &part.value.boundary else {
            return;
        };
        let (segment, place) = (&part.value.segment, boundary.near().onset.place);
        let is_same = |other: f64| (place - other).abs() <= SAME_PLACE * place.abs().max(1.0);
        if is_same(segment.zero_of_multiplier()) {
            add(&mut gradient.rate, 1.0 / segment.dynamics.rate, weights);
            add(
                &mut gradient.dividend,
                -1.0 / segment.dynamics.dividend,
                weights,
            );
            return;
        }
        let Some(later) = later.filter(|_| is_same(part.contact)) else {
            return;
        };
        let after = drop.after(place);
        if segment.is_continuous() && is_same(later.value.boundary_now()) {
            self.boundary = *weights;
            return;
        }
        let [_, by_x, _] = later.value.value(after);
        let by_spot = drop.keep * by_x * (-after).exp() + segment.sign;
        let value = weights.map(|weight| -weight / (by_spot * place.exp()));
        add(&mut gradient.escrow, segment.sign, &value);
        self.points.push(Viewpoint::of_value(after, 0.0, value));
    }

    /// Add the derivatives by a part's numbers to those of its segment.
    fn take_in(&mut self, part: &SolvedPart, gradient: &SegmentGradient) {
        // The part's escrow is that of its segment, discounted.
        let segment = &part.value.segment;
        let mut own = *gradient;
        let share = (-segment.dynamics.rate * part.offset).exp();
        own.escrow = gradient.escrow.map(|weight| share * weight);
        add(
            &mut own.rate,
            -part.offset * segment.escrow,
            &gradient.escrow,
        );
        self.gradients[part.index].increase(&own);
    }
}

/// Two places on a line of the value of waiting as viewpoints after the event, with the adjoint weights that follow from those of
/// its constant and its slope.
fn line_seen(
    line: &Piece,
    segment: &Segment,
    (by_constant, by_slope): (&Weights, &Weights),
    drop: SpotDrop,
) -> [Viewpoint; 2] {
    let apart = 0.5 * NARROWEST_LINE * segment.spread();
    let places = if segment.sign > 0.0 {
        [line.upper, line.upper - apart]
    } else {
        [line.lower, line.lower + apart]
    };
    let [near, far] = places.map(f64::exp);
    let shares: Weights =
        std::array::from_fn(|k| (by_slope[k] - near * by_constant[k]) / (near - far));
    let weights = [
        std::array::from_fn(|k| by_constant[k] + shares[k]),
        shares.map(|share| -share),
    ];
    std::array::from_fn(|k| Viewpoint::of_value(drop.after(places[k]), 0.0, weights[k]))
}

/// The nodes of a profile as viewpoints after the event, with their adjoint weights.
fn nodes_seen(
    now: &SegmentValue,
    densities: &[Vec<f64>; FUNCTIONALS],
    drop: SpotDrop,
) -> Vec<Viewpoint> {
    let profile = &now.profile;
    let rule = legendre(now.points);
    let places = drop.after_all(&profile.nodes[..profile.panels.len() * now.points]);
    let weighted = places.iter().enumerate().map(|(j, x)| {
        let weight = profile.panels[j / now.points].half * rule[j % now.points].1;
        Viewpoint::of_value(*x, 0.0, [0, 1].map(|k| weight * densities[k][j]))
    });
    weighted.collect()
}
