//! The steps of the contracts that are marched side by side: every lane has its own.

use super::contract::Contract;
use super::mesh::{steps_wanted, Grid};
use super::settings::Settings;
use super::tableau::{FIRST, LATER};
use crate::lanes::vector::{Vector, LANES};

/// What a time may miss another by, as a share of a segment, and yet be the same.
const SAME_TIME: f64 = 1e-9;

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
pub fn steps_of(contract: &Contract, grid: &Grid, settings: &Settings) -> Vec<Step> {
    let mut steps = Vec::new();
    for (number, segment) in contract.mesh.iter().enumerate().rev() {
        let wanted = steps_wanted(contract, number, grid, settings);
        let ends = step_ends(
            segment.duration,
            wanted,
            &breaks(contract, number),
            settings.rounded,
        );
        for (n, pair) in ends.windows(2).enumerate() {
            steps.push(Step {
                segment: number,
                dt: pair[1] - pair[0],
                elapsed: pair[0],
                is_first: n == 0,
                is_last: n + 2 == ends.len(),
            });
        }
    }
    steps
}

/// The times within a segment, in years before its end, at which a local volatility's rate of change jumps.
fn breaks(contract: &Contract, number: usize) -> Vec<f64> {
    let Some(local) = contract.local.filter(|local| local.surface.times.len() > 1) else {
        return Vec::new();
    };
    let (end, duration) = (contract.end_of(number), contract.segments[number].duration);
    let times = local.surface.times.iter().rev().map(|time| end - time);
    let margin = SAME_TIME * duration;
    times
        .filter(|years| *years > margin && *years < duration - margin)
        .collect()
}

/// The ends of the steps, in years before the segment's end: squares of even numbers, in the pieces between given times.
///
/// A time that lies nearer to another than the first step is long is left out: far shorter steps than the grid resolves
/// cost more than a coefficient whose rate of change jumps within a step. Pieces take powers of two, which double with the
/// cells as the whole does.
#[allow(
    clippy::cast_precision_loss,
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss
)]
fn step_ends(duration: f64, wanted: f64, times: &[f64], rounded: f64) -> Vec<f64> {
    let shortest = duration / (wanted * wanted).max(4.0);
    let mut given = Vec::new();
    for &time in times {
        let last = given.last().copied().unwrap_or(0.0);
        if time - last >= shortest && duration - time >= shortest {
            given.push(time);
        }
    }
    given.push(duration);
    let is_whole = given.len() == 1;
    let mut ends = vec![0.0];
    let mut from = 0.0;
    for time in given {
        let to = (time / duration).sqrt();
        let part = wanted * (to - from);
        let count = if is_whole {
            rounded_count(part, rounded).max(2)
        } else {
            (rounded * part).max(1.0).log2().floor().exp2() as usize
        };
        for n in 1..=count {
            let share = n as f64 / count as f64;
            let root: f64 = share.mul_add(to - from, from);
            ends.push(duration * root * root);
        }
        from = to;
    }
    ends
}

/// A number of steps near to what is wanted: from 4 on 4 to 7 times a power of two, so that it doubles exactly where the
/// cells are halved.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
fn rounded_count(wanted: f64, rounded: f64) -> usize {
    let power = (wanted.max(4.0) / 4.0).log2().floor().exp2();
    ((rounded * wanted / power).floor() * power) as usize
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
            strikes: [
                V::from_lanes(strikes[0]),
                V::from_lanes(strikes[1]),
                V::from_lanes(strikes[2]),
            ],
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
