//! The equations of one degree: at every stage the value with the multiplier's part meets the payoff at the boundary,
//! smoothly. Where the contact set has two ends, each has its own stages, in one system.

use super::boundary::{dot, FACTORS};
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

/// The payoff crossings of one end: at the stages, (m,), and at the nodes of their integrals, (m x n,); empty without need.
pub struct Crossings {
    pub stages: Vec<f64>,
    pub nodes: Vec<f64>,
}

/// The equations for the coefficients of all e ends behind the first of each.
pub struct CollocationSystem<'a> {
    pub segment: &'a Segment,
    /// The onsets of the ends, (e,).
    pub onsets: &'a [ContactOnset],
    pub nodes: &'static CollocationNodes,
    profile: &'a Profile,
    /// s at the stages, (m,).
    pub times: Vec<f64>,
    /// The transitions from the segment's end to the stages, (m,).
    transitions: Vec<Transition>,
    /// Those of each end, (e,).
    pub crossings: Vec<Crossings>,
    /// The integrals that each stage of each end sees over the contact sets up to each end, (e x m x e x n,).
    integrals: StageIntegrals,
    /// The derivatives of the boundary by the coefficient at the nodes of the integrals, in the same order.
    by_coefficient: Vec<f64>,
    /// The derivatives of the last residuals by the places of their stages, (e x m,).
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
        onsets: &'a [ContactOnset],
        nodes: &'static CollocationNodes,
    ) -> Self {
        let onset_time = onsets[0].time;
        let span = segment.duration - onset_time;
        let times: Vec<f64> = nodes.eta[1..]
            .iter()
            .map(|eta| onset_time + span * eta * eta)
            .collect();
        let node_times = nodes.eta[1..]
            .iter()
            .flat_map(|eta| nodes.sine.iter().map(move |sine| eta * sine))
            .map(|eta| onset_time + span * eta * eta);
        let every: Vec<f64> = times.iter().copied().chain(node_times).collect();
        let each = onsets.iter().map(|onset| {
            let mut stages = onset.crossings(profile, segment, &every);
            let nodes = stages.split_off(times.len().min(stages.len()));
            Crossings { stages, nodes }
        });
        let crossings: Vec<Crossings> = each.collect();
        let mut ages = Vec::with_capacity(onsets.len().pow(2) * times.len() * nodes.points);
        for s in onsets.iter().flat_map(|_| &times) {
            for factor in &FACTORS[..onsets.len()] {
                let seen = nodes.ages(s - onset_time);
                ages.extend(seen.map(|(age, weight)| (age, factor * weight)));
            }
        }
        CollocationSystem {
            segment,
            onsets,
            nodes,
            profile,
            transitions: times
                .iter()
                .map(|&s| Transition::new(&segment.dynamics, s))
                .collect(),
            times,
            crossings,
            integrals: StageIntegrals::new(&segment.dynamics, &ages),
            by_coefficient: vec![0.0; ages.len()],
            by_place: vec![0.0; onsets.len() * nodes.degree],
        }
    }

    /// The boundary at stage k (from 0) of an end for a coefficient, and its derivative by it.
    pub fn stage_boundary(&self, end: usize, k: usize, coefficient: f64) -> (f64, f64) {
        let crossing = crossing_at(&self.crossings[end].stages, k);
        self.onsets[end].boundary_of(self.segment.sign, coefficient, crossing)
    }

    /// The first node, in the integrals, of the contact sets up to end `of` as seen from a stage, counted over all ends.
    fn first_node(&self, stage: usize, of: usize) -> usize {
        (stage * self.onsets.len() + of) * self.nodes.points
    }

    /// Put the contact sets where stage k of an end sees them.
    fn place_contact_sets(
        &mut self,
        (end, k): (usize, usize),
        stage: StagePlace,
        coefficients: &[f64],
    ) {
        let (nodes, points) = (self.nodes, self.nodes.points);
        for (of, own) in coefficients.chunks(nodes.degree + 1).enumerate() {
            let first = self.first_node(end * nodes.degree + k, of);
            for l in 0..points {
                let coefficient = dot(nodes.row(k, l), own);
                let crossing = crossing_at(&self.crossings[of].nodes, k * points + l);
                let (place, by_coefficient) =
                    self.onsets[of].boundary_of(self.segment.sign, coefficient, crossing);
                self.by_coefficient[first + l] = by_coefficient;
                self.integrals.place(first + l, stage.x, stage.spot, place);
            }
        }
    }

    /// Fill in the residuals of all stages, e m in strikes, and their derivatives by the coefficients behind the first of
    /// each end, (e m x e m,).
    ///
    /// The slope of V - g is a Volterra equation of the second kind for the boundary, and the better equation. Where
    /// the contact set grows faster than diffusion follows, the slope jumps in a layer that the integrals do not see,
    /// and V - g itself is taken.
    pub fn residual(&mut self, coefficients: &[f64], residual: &mut [f64], jacobian: &mut [f64]) {
        let (segment, degree, points) = (self.segment, self.nodes.degree, self.nodes.points);
        let count = self.onsets.len() * degree;
        let mut stages = [StagePlace {
            x: 0.0,
            spot: 0.0,
            by_coefficient: 0.0,
        }; 2 * LARGEST_DEGREE];
        for (stage, place) in stages[..count].iter_mut().enumerate() {
            let (end, k) = (stage / degree, stage % degree);
            let coefficient = coefficients[end * (degree + 1) + k + 1];
            let (x, by_coefficient) = self.stage_boundary(end, k, coefficient);
            *place = StagePlace {
                x,
                spot: x.exp(),
                by_coefficient,
            };
            self.place_contact_sets((end, k), *place, coefficients);
        }
        let any_value = self.onsets.iter().any(ContactOnset::is_from_crossing);
        self.integrals
            .integrate(segment.sign, &segment.dynamics, any_value);
        for (index, stage) in stages[..count].iter().enumerate() {
            let (end, k) = (index / degree, index % degree);
            let of_value = self.onsets[end].is_from_crossing();
            let row = &mut jacobian[index * count..(index + 1) * count];
            row.fill(0.0);
            let [mut value, mut slope, mut second] =
                self.profile
                    .propagate_through(&self.transitions[k], stage.x, stage.spot);
            for of in 0..self.onsets.len() {
                let first = self.first_node(index, of);
                let row = &mut row[of * degree..(of + 1) * degree];
                for l in 0..points {
                    let node = self.integrals.node(first + l);
                    value += node.value;
                    slope += node.by_x;
                    second += node.by_xx;
                    let by_boundary = if of_value {
                        node.value_by_boundary
                    } else {
                        node.slope_by_boundary
                    };
                    let by_coefficient = by_boundary * self.by_coefficient[first + l];
                    for (entry, weight) in row.iter_mut().zip(&self.nodes.row(k, l)[1..]) {
                        *entry += by_coefficient * weight;
                    }
                }
            }
            let paid = segment.sign * stage.spot;
            slope += paid;
            let (left, by_place) = if of_value {
                (value - segment.payoff(stage.x, self.times[k]), slope)
            } else {
                (slope, second + paid)
            };
            residual[index] = left;
            self.by_place[index] = by_place;
            row[index] += by_place * stage.by_coefficient;
        }
    }

    /// Coefficients to start Newton's method from, (e x (m + 1),).
    pub fn guess(&self) -> Vec<f64> {
        let onsets = self.onsets.iter();
        onsets.flat_map(|onset| self.guess_of(onset)).collect()
    }

    /// Those of one end, (m + 1,).
    fn guess_of(&self, onset: &ContactOnset) -> Vec<f64> {
        let segment = self.segment;
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
