//! The exercise boundary of a segment, and what exercise on the segment is worth.

use super::chebyshev::interpolation;
use super::collocation_nodes::CollocationNodes;
use super::contact_onset::{crossing_at, ContactOnset};
use super::degree_control::{DegreeControl, CELL, CELLS};
use super::multiplier::{age_blocks, contribution, ContactBlock};
use super::profile::Profile;
use super::segment::Segment;
use crate::lanes::vector::LANES;

/// The distance from the boundary into the contact set at which value and payoff are compared, in standard deviations of
/// ln S over the segment; chosen.
const CHECKED: f64 = 0.5;

/// The end of the contact set at every time of a segment since its onset.
pub struct Boundary {
    pub segment: Segment,
    pub onset: ContactOnset,
    pub nodes: &'static CollocationNodes,
    /// The represented quantity at the nodes, (degree + 1,).
    pub coefficients: Vec<f64>,
    /// The contact sets as seen from the segment's beginning.
    pub contact_blocks: Vec<ContactBlock>,
    /// The boundary at the segment's beginning, x.
    pub at_beginning: f64,
    /// What is left of the equations, in strikes, and the largest residual with which they are met.
    pub residual: f64,
    pub enough: f64,
    /// What exercise on the segment is worth at the middles of the cells, in strikes.
    pub exercise_values: [f64; CELLS],
    /// How far value and payoff are apart inside the contact set, at the segment's beginning, in strikes.
    pub violation: f64,
    /// The error estimate of the value now, in strikes; 0 where it was not asked for.
    pub error: f64,
    /// The same boundary by the degree before, if there was one, or by the next one, which brought nothing.
    pub other: Option<Box<Boundary>>,
}

impl Boundary {
    /// The boundary x at time s to the segment's end, NaN before the onset of the contact set.
    pub fn at(&self, profile: &Profile, s: f64) -> f64 {
        if s < self.onset.time {
            return f64::NAN;
        }
        let span = self.segment.duration - self.onset.time;
        let eta = ((s - self.onset.time) / span).min(1.0).sqrt();
        if eta <= 0.0 {
            return self.onset.place;
        }
        let mut weights = vec![0.0; self.coefficients.len()];
        interpolation(&self.nodes.eta, eta, &mut weights);
        let coefficient = dot(&weights, &self.coefficients);
        let crossings = self.onset.crossings(profile, &self.segment, &[s]);
        let crossing = crossing_at(&crossings, 0);
        let sign = self.segment.sign;
        self.onset.boundary_of(sign, coefficient, crossing).0
    }

    /// Whether every equation is met.
    pub fn is_found(&self) -> bool {
        self.residual <= self.enough && self.at_beginning.is_finite()
    }

    /// Whether the error estimate is beyond the budget.
    pub fn exceeds_budget(&self, control: &DegreeControl) -> bool {
        let is_beyond = |budget| self.error.is_nan() || self.error > budget;
        control.budget.is_some_and(is_beyond)
    }

    /// Evaluate the contact sets as seen from the segment's beginning, at `nodes`.
    pub fn sample_contact_sets(&mut self, profile: &Profile, nodes: &CollocationNodes) {
        let (segment, onset) = (&self.segment, &self.onset);
        let span = segment.duration - onset.time;
        let times: Vec<f64> = nodes
            .sine
            .iter()
            .map(|sine| onset.time + span * sine * sine)
            .collect();
        let crossings = onset.crossings(profile, segment, &times);
        self.contact_blocks = self.contact_sets(nodes, nodes.degree - 1, span, &crossings);
    }

    /// The contact sets that stage `stage` of the nodes sees a time `span` after the onset; `crossings` are the payoff
    /// crossings there, empty without need.
    pub fn contact_sets(
        &self,
        nodes: &CollocationNodes,
        stage: usize,
        span: f64,
        crossings: &[f64],
    ) -> Vec<ContactBlock> {
        let (segment, onset) = (&self.segment, &self.onset);
        let ages: Vec<(f64, f64)> = nodes.ages(span).collect();
        let blocks = age_blocks(&segment.dynamics, &ages).into_iter().enumerate();
        let contact_blocks = blocks.map(|(block, ages)| {
            let mut boundary = [onset.place; LANES];
            let nodes_here = (block * LANES..nodes.points).zip(&mut boundary);
            for (l, place) in nodes_here {
                let coefficient = dot(nodes.row(stage, l), &self.coefficients);
                let crossing = crossing_at(crossings, l);
                *place = onset.boundary_of(segment.sign, coefficient, crossing).0;
            }
            ContactBlock {
                ages,
                boundary,
                boundary_spot: boundary.map(f64::exp),
            }
        });
        contact_blocks.collect()
    }

    /// How far value and payoff are apart inside the contact set, where they should be equal, in strikes.
    pub fn violation_inside(&self, profile: &Profile) -> f64 {
        let (segment, s) = (&self.segment, self.segment.duration);
        let x = self.at_beginning - segment.sign * CHECKED * segment.spread();
        let value = profile.propagate(&segment.dynamics, x, s)[0] + self.contribution(x)[0];
        (value - segment.payoff(x, s)).abs()
    }

    /// Evaluate what exercise is worth at the middles of the cells from `origin` outwards.
    pub fn sample_exercise_values(&mut self, origin: f64) {
        let outwards = self.segment.sign * self.segment.spread() * CELL;
        #[allow(clippy::cast_precision_loss)]
        let places: [f64; CELLS] =
            std::array::from_fn(|cell| origin + outwards * (cell as f64 + 0.5));
        self.exercise_values = places.map(|x| self.contribution(x)[0]);
    }

    /// The value, slope and second derivative at x of what exercise on the segment contributes, at its beginning.
    pub fn contribution(&self, x: f64) -> [f64; 3] {
        contribution(
            self.segment.sign,
            &self.segment.dynamics,
            &self.contact_blocks,
            x,
        )
    }
}

/// The scalar product.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}
