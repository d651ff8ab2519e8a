//! The steps of the contracts that are marched side by side: every lane has its own.

use super::contract::Contract;
use super::mesh::{step_count, Grid};
use super::settings::Settings;
use super::tableau::{FIRST, LATER};
use crate::lanes::vector::{Vector, LANES};

/// One step of a lane.
#[derive(Clone, Copy)]
pub struct Step {
    pub segment: usize,
    pub dt: f64,
    /// Years from the step's start, which is later, to the segment's end.
    pub elapsed: f64,
    pub is_first: bool,
    pub is_last: bool,
}

/// The steps of a contract, from expiry to now.
#[allow(clippy::cast_precision_loss)]
pub fn steps_of(contract: &Contract, grid: &Grid, settings: &Settings) -> Vec<Step> {
    let mut steps = Vec::new();
    for (number, segment) in contract.mesh.iter().enumerate().rev() {
        let count = step_count(segment, grid.h, settings);
        let time = |n: usize| segment.duration * (n as f64 / count as f64).powi(2);
        for n in 1..=count {
            steps.push(Step {
                segment: number,
                dt: time(n) - time(n - 1),
                elapsed: time(n - 1),
                is_first: n == 1,
                is_last: n == count,
            });
        }
    }
    steps
}

/// A step of every lane; one that has come to now repeats its last.
pub struct LaneSteps<V> {
    pub dt: V,
    /// Below 0 where it is the first after something has happened.
    first: V,
    /// The signed strike less what is escrowed, at the stages.
    pub strikes: [V; 3],
    /// Years from the stages to the segment's end.
    pub years: [[f64; LANES]; 3],
}

impl<V: Vector> LaneSteps<V> {
    /// The step of this number.
    #[inline(always)]
    pub fn at(n: usize, contracts: &[Contract], steps: &[Vec<Step>]) -> Self {
        let (mut dt, mut first) = ([1.0; LANES], [0.0; LANES]);
        let (mut strikes, mut years) = ([[1.0; LANES]; 3], [[0.0; LANES]; 3]);
        for l in 0..LANES {
            let lane = l.min(contracts.len() - 1);
            let own = &steps[lane];
            let step = own[n.min(own.len() - 1)];
            let contract = &contracts[lane];
            let segment = &contract.segments[step.segment];
            dt[l] = step.dt;
            first[l] = if step.is_first { -1.0 } else { 1.0 };
            let tableau = if step.is_first { &FIRST } else { &LATER };
            for (k, time) in tableau.times.iter().enumerate() {
                years[k][l] = time.mul_add(step.dt, step.elapsed);
                strikes[k][l] = contract.sign * (1.0 - segment.escrow_before_end(years[k][l]));
            }
        }
        Self {
            dt: V::from_lanes(dt),
            first: V::from_lanes(first),
            strikes: strikes.map(V::from_lanes),
            years,
        }
    }

    /// The weights of the rates before a stage, in years.
    #[inline(always)]
    pub fn weights(&self, stage: usize) -> [V; 3] {
        let mut weights = [V::zero(); 3];
        for (k, weight) in weights.iter_mut().enumerate() {
            let (early, late) = (FIRST.weights[stage][k], LATER.weights[stage][k]);
            *weight = self.first.negative(V::all(early), V::all(late)) * self.dt;
        }
        weights
    }
}
