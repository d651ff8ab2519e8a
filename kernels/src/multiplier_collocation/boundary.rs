//! The exercise boundary of a segment, and what exercise on the segment is worth.

use super::chebyshev::interpolation;
use super::collocation_nodes::CollocationNodes;
use super::contact_onset::{crossing_at, ContactOnset};
use super::degree_control::{value_nodes, DegreeControl, CELL, CELLS};
use super::multiplier::{age_blocks, contribution, ContactBlock};
use super::profile::Profile;
use super::propagation::LARGEST_DEVIATION;
use super::segment::Segment;
use crate::lanes::vector::LANES;

/// The distance from the boundary into the contact set at which value and payoff are compared, in standard deviations of
/// ln S over the segment; chosen.
const CHECKED: f64 = 0.5;

/// One end of the contact set at every time of a segment since its onset.
pub struct BoundaryEnd {
    pub onset: ContactOnset,
    /// The represented quantity at the nodes, (degree + 1,).
    pub coefficients: Vec<f64>,
    /// The end at the segment's beginning, x.
    pub at_beginning: f64,
}

/// The ends of the contact set at every time of a segment since its onset.
pub struct Boundary {
    pub segment: Segment,
    /// The end next to the strike, and the far one where the contact set does not reach to a spot of zero; both have one
    /// onset's time.
    pub ends: Vec<BoundaryEnd>,
    pub nodes: &'static CollocationNodes,
    /// The contact sets as seen from the segment's beginning; beyond a far end with negative weights.
    pub contact_blocks: Vec<ContactBlock>,
    /// What is left of the equations, in strikes, and the largest residual with which they are met.
    pub residual: f64,
    pub enough: f64,
    /// What exercise on the segment is worth at the middles of the cells next to each end, in strikes.
    pub exercise_values: Vec<f64>,
    /// How far value and payoff are apart inside the contact set, at the segment's beginning, in strikes.
    pub violation: f64,
    /// The error estimate of the value now, in strikes; 0 where it was not asked for.
    pub error: f64,
    /// The same boundary by the degree before, if there was one, or by the next one, which brought nothing.
    pub other: Option<Box<Boundary>>,
}

/// The factors of the contact sets up to each end: beyond a far one they are taken away.
pub const FACTORS: [f64; 2] = [1.0, -1.0];

impl Boundary {
    /// The end next to the strike.
    pub fn near(&self) -> &BoundaryEnd {
        &self.ends[0]
    }

    /// The end far from the strike, if there is one.
    pub fn far(&self) -> Option<&BoundaryEnd> {
        self.ends.get(1)
    }

    /// The time of the onset, s.
    pub fn onset_time(&self) -> f64 {
        self.near().onset.time
    }

    /// The end next to the strike, x, at time s to the segment's end, NaN before the onset of the contact set.
    pub fn at(&self, profile: &Profile, s: f64) -> f64 {
        let BoundaryEnd {
            onset,
            coefficients,
            ..
        } = self.near();
        if s < onset.time {
            return f64::NAN;
        }
        let span = self.segment.duration - onset.time;
        let eta = ((s - onset.time) / span).min(1.0).sqrt();
        if eta <= 0.0 {
            return onset.place;
        }
        let mut weights = vec![0.0; coefficients.len()];
        interpolation(&self.nodes.eta, eta, &mut weights);
        let coefficient = dot(&weights, coefficients);
        let crossings = onset.crossings(profile, &self.segment, &[s]);
        let crossing = crossing_at(&crossings, 0);
        let sign = self.segment.sign;
        onset.boundary_of(sign, coefficient, crossing).0
    }

    /// Whether every equation is met.
    pub fn is_found(&self) -> bool {
        let mut ends = self.ends.iter();
        self.residual <= self.enough && ends.all(|end| end.at_beginning.is_finite())
    }

    /// Whether the error estimate is beyond the budget.
    pub fn exceeds_budget(&self, control: &DegreeControl) -> bool {
        let is_beyond = |budget| self.error.is_nan() || self.error > budget;
        control.budget.is_some_and(is_beyond)
    }

    /// Evaluate the contact sets as seen from the segment's beginning.
    pub fn sample_contact_sets(&mut self, profile: &Profile) {
        let nodes = value_nodes(self.nodes.degree);
        let (segment, onset_time) = (&self.segment, self.onset_time());
        let span = segment.duration - onset_time;
        let times: Vec<f64> = nodes
            .sine
            .iter()
            .map(|sine| onset_time + span * sine * sine)
            .collect();
        let ends = self.ends.iter();
        let crossings: Vec<Vec<f64>> = ends
            .map(|end| end.onset.crossings(profile, segment, &times))
            .collect();
        let crossings: Vec<&[f64]> = crossings.iter().map(Vec::as_slice).collect();
        self.contact_blocks = self.contact_sets(nodes, nodes.degree - 1, span, &crossings);
    }

    /// The contact sets that stage `stage` of the nodes sees a time `span` after the onset, in as many blocks for each end;
    /// `crossings` are the payoff crossings of each end there, empty without need.
    pub fn contact_sets(
        &self,
        nodes: &CollocationNodes,
        stage: usize,
        span: f64,
        crossings: &[&[f64]],
    ) -> Vec<ContactBlock> {
        let segment = &self.segment;
        let mut contact_blocks = Vec::new();
        for ((end, crossings), factor) in self.ends.iter().zip(crossings).zip(FACTORS) {
            let onset = &end.onset;
            let ages = nodes.ages(span);
            let ages: Vec<(f64, f64)> = ages.map(|(age, weight)| (age, factor * weight)).collect();
            let blocks = age_blocks(&segment.dynamics, &ages).into_iter().enumerate();
            contact_blocks.extend(blocks.map(|(block, ages)| {
                let mut boundary = [onset.place; LANES];
                let nodes_here = (block * LANES..nodes.points).zip(&mut boundary);
                for (l, place) in nodes_here {
                    let coefficient = dot(nodes.row(stage, l), &end.coefficients);
                    let crossing = crossing_at(crossings, l);
                    *place = onset.boundary_of(segment.sign, coefficient, crossing).0;
                }
                ContactBlock {
                    ages,
                    boundary,
                    boundary_spot: boundary.map(f64::exp),
                }
            }));
        }
        contact_blocks
    }

    /// How far value and payoff are apart inside the contact set, where they should be equal, in strikes.
    pub fn violation_inside(&self, profile: &Profile) -> f64 {
        let (segment, s) = (&self.segment, self.segment.duration);
        let near = self.near().at_beginning;
        let mut x = near - segment.sign * CHECKED * segment.spread();
        if let Some(far) = self.far() {
            x = x.max(0.5 * (near + far.at_beginning));
        }
        let value = profile.propagate(&segment.dynamics, x, s)[0] + self.contribution(x)[0];
        (value - segment.payoff(x, s)).abs()
    }

    /// Evaluate what exercise is worth at the middles of the cells from the `origins` of the ends outwards.
    pub fn sample_exercise_values(&mut self, origins: &[f64]) {
        let width = self.segment.sign * self.segment.spread() * CELL;
        let mut values = Vec::with_capacity(CELLS * origins.len());
        for (origin, factor) in origins.iter().zip(FACTORS) {
            for cell in 0..CELLS {
                #[allow(clippy::cast_precision_loss)]
                let x = origin + factor * width * (cell as f64 + 0.5);
                values.push(self.contribution(x)[0]);
            }
        }
        self.exercise_values = values;
    }

    /// The x furthest outside the contact sets at which they contribute, at the segment's beginning, more than rounding.
    pub fn furthest_effect(&self) -> f64 {
        let sign = self.segment.sign;
        let effects = self.contact_blocks.iter().flat_map(|block| {
            let ages = &block.ages;
            let nodes = (0..LANES).filter(|&lane| ages.weight[lane] != 0.0);
            nodes.map(move |lane| {
                let away = (LARGEST_DEVIATION + ages.spread[lane]) * ages.spread[lane];
                sign * (block.boundary[lane] - ages.drift[lane]) + away
            })
        });
        sign * effects.fold(f64::NEG_INFINITY, f64::max)
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
