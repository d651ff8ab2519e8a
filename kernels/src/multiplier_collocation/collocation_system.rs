//! The equations of one degree: at every stage the value with the multiplier's part meets the payoff at the boundary,
//! smoothly.

use super::boundary::dot;
use super::collocation_nodes::CollocationNodes;
use super::contact_onset::{crossing_at, ContactOnset, Representation};
use super::degree_control::LARGEST_DEGREE;
use super::profile::Profile;
use super::propagation::Transition;
use super::segment::Segment;
use super::stage_integrals::StageIntegrals;

/// The distance from the onset to the first guess of a `Direct` boundary, in standard deviations of ln S since; chosen.
const FIRST_GUESS: f64 = 0.8;
/// The same for a `SquaredDistance`, as long as it is far from the perpetual boundary; chosen.
const FIRST_SQUARED_GUESS: f64 = 2.0;

/// The equations for the coefficients behind the first.
pub struct CollocationSystem<'a> {
    pub segment: &'a Segment,
    pub onset: &'a ContactOnset,
    pub nodes: &'static CollocationNodes,
    profile: &'a Profile,
    /// s at the stages, (m,).
    pub times: Vec<f64>,
    /// The transitions from the segment's end to the stages, (m,).
    transitions: Vec<Transition>,
    /// The payoff crossings at the stages, (m,), and at the nodes of their integrals, (m x n,); empty without need.
    pub stage_crossings: Vec<f64>,
    pub node_crossings: Vec<f64>,
    integrals: StageIntegrals,
    /// The derivatives of the boundary by the coefficient at the nodes of the integrals, (m x n,).
    by_coefficient: Vec<f64>,
    /// The derivatives of the last residuals by the places of their stages, (m,).
    pub by_place: Vec<f64>,
}

/// The boundary at a stage.
#[derive(Clone, Copy)]
struct StagePlace {
    x: f64,
    /// e^x.
    spot: f64,
    /// The derivative of x by the coefficient.
    by_coefficient: f64,
}

impl<'a> CollocationSystem<'a> {
    /// The equations at these nodes.
    pub fn new(
        profile: &'a Profile,
        segment: &'a Segment,
        onset: &'a ContactOnset,
        nodes: &'static CollocationNodes,
    ) -> Self {
        let span = segment.duration - onset.time;
        let times: Vec<f64> = nodes.eta[1..]
            .iter()
            .map(|eta| onset.time + span * eta * eta)
            .collect();
        let node_times = nodes.eta[1..]
            .iter()
            .flat_map(|eta| nodes.sine.iter().map(move |sine| eta * sine))
            .map(|eta| onset.time + span * eta * eta);
        let every: Vec<f64> = times.iter().copied().chain(node_times).collect();
        let mut stage_crossings = onset.crossings(profile, segment, &every);
        let node_crossings = stage_crossings.split_off(times.len().min(stage_crossings.len()));
        let ages = times.iter().flat_map(|s| nodes.ages(s - onset.time));
        let ages: Vec<(f64, f64)> = ages.collect();
        CollocationSystem {
            segment,
            onset,
            nodes,
            profile,
            transitions: times
                .iter()
                .map(|&s| Transition::new(&segment.dynamics, s))
                .collect(),
            times,
            stage_crossings,
            node_crossings,
            integrals: StageIntegrals::new(&segment.dynamics, &ages),
            by_coefficient: vec![0.0; nodes.degree * nodes.points],
            by_place: vec![0.0; nodes.degree],
        }
    }

    /// The boundary at stage k (from 0) for a coefficient, and its derivative by it.
    pub fn stage_boundary(&self, k: usize, coefficient: f64) -> (f64, f64) {
        let crossing = crossing_at(&self.stage_crossings, k);
        self.onset
            .boundary_of(self.segment.sign, coefficient, crossing)
    }

    /// Put the contact sets where stage k sees them.
    fn place_contact_sets(&mut self, k: usize, stage: StagePlace, coefficients: &[f64]) {
        let (nodes, points) = (self.nodes, self.nodes.points);
        for l in 0..points {
            let coefficient = dot(nodes.row(k, l), coefficients);
            let index = k * points + l;
            let crossing = crossing_at(&self.node_crossings, index);
            let (place, by_coefficient) =
                self.onset
                    .boundary_of(self.segment.sign, coefficient, crossing);
            self.by_coefficient[index] = by_coefficient;
            self.integrals.place(index, stage.x, stage.spot, place);
        }
    }

    /// Fill in m residuals, in strikes, and their m x m derivatives by the coefficients behind the first.
    ///
    /// The slope of V - g is a Volterra equation of the second kind for the boundary, and the better equation. Where
    /// the contact set grows faster than diffusion follows, the slope jumps in a layer that the integrals do not see,
    /// and V - g itself is taken.
    pub fn residual(&mut self, coefficients: &[f64], residual: &mut [f64], jacobian: &mut [f64]) {
        let (segment, onset, degree) = (self.segment, self.onset, self.nodes.degree);
        let points = self.nodes.points;
        let mut stages = [StagePlace {
            x: 0.0,
            spot: 0.0,
            by_coefficient: 0.0,
        }; LARGEST_DEGREE];
        for k in 0..degree {
            let (x, by_coefficient) = self.stage_boundary(k, coefficients[k + 1]);
            stages[k] = StagePlace {
                x,
                spot: x.exp(),
                by_coefficient,
            };
            self.place_contact_sets(k, stages[k], coefficients);
        }
        let of_value = onset.representation == Representation::FromCrossing;
        self.integrals
            .integrate(segment.sign, &segment.dynamics, of_value);
        for k in 0..degree {
            let stage = stages[k];
            let row = &mut jacobian[k * degree..(k + 1) * degree];
            row.fill(0.0);
            let [mut value, mut slope, mut second] =
                self.profile
                    .propagate_through(&self.transitions[k], stage.x, stage.spot);
            for l in 0..points {
                let node = self.integrals.node(k * points + l);
                value += node.value;
                slope += node.by_x;
                second += node.by_xx;
                let by_boundary = if of_value {
                    node.value_by_boundary
                } else {
                    node.slope_by_boundary
                };
                let by_coefficient = by_boundary * self.by_coefficient[k * points + l];
                for (entry, weight) in row.iter_mut().zip(&self.nodes.row(k, l)[1..]) {
                    *entry += by_coefficient * weight;
                }
            }
            let paid = segment.sign * stage.spot;
            slope += paid;
            let (left, by_place) = if of_value {
                (value - segment.payoff(stage.x, self.times[k]), slope)
            } else {
                (slope, second + paid)
            };
            residual[k] = left;
            self.by_place[k] = by_place;
            row[k] += by_place * stage.by_coefficient;
        }
    }

    /// Coefficients to start Newton's method from, (m + 1,).
    pub fn guess(&self) -> Vec<f64> {
        let (segment, onset) = (self.segment, self.onset);
        let first = onset.first_coefficient();
        let mut coefficients = vec![first; self.nodes.eta.len()];
        match onset.representation {
            Representation::FromCrossing => {}
            Representation::Direct => {
                let step = if self.profile.continues(segment) {
                    0.0
                } else {
                    FIRST_GUESS
                };
                let spread = segment.dynamics.volatility * (segment.duration - onset.time).sqrt();
                for (coefficient, eta) in coefficients.iter_mut().zip(&self.nodes.eta) {
                    *coefficient -= segment.sign * step * spread * eta;
                }
            }
            Representation::SquaredDistance => {
                let largest = segment.sign * (onset.place - segment.perpetual_boundary());
                for (coefficient, eta) in coefficients.iter_mut().zip(&self.nodes.eta) {
                    let free = FIRST_SQUARED_GUESS * segment.spread() * eta;
                    let distance = if largest < f64::INFINITY {
                        -largest * (-free / largest).exp_m1()
                    } else {
                        free
                    };
                    *coefficient = distance * distance;
                }
            }
        }
        coefficients
    }
}
