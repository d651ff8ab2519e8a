//! Newton's method for the coefficients of a boundary, with halved steps.

use super::collocation_system::CollocationSystem;
use super::contact_onset::{ContactOnset, Representation};
use crate::linear_system::{eliminate, lift_diagonal};

/// The largest number of Newton's steps; chosen.
const MOST_ITERATIONS: usize = 40;
/// The smallest share of a step that is tried; chosen.
const SMALLEST_STEP: f64 = 0.01;
/// The share of the residual that a step must take away, times its length; chosen.
const SMALLEST_GAIN: f64 = 0.2;
/// The smallest share of a squared distance that one step leaves; chosen.
const SMALLEST_LEFT: f64 = 0.1;
/// The residual below which there is nothing but rounding, in strikes.
const ROUNDING: f64 = 1e-14;
/// The factor by which a full step may leave more than the step before it lets expect; chosen.
const CAUTION: f64 = 10.0;

/// When the iteration ends.
#[derive(Clone, Copy)]
pub struct Stopping {
    /// The largest move of the boundary in the last step, x.
    pub settled: f64,
    /// The largest residual, in strikes, with which no further step is taken.
    pub enough: f64,
}

/// Replace the coefficients behind the first by a zero of the residual; return what is left of it, in strikes.
///
/// A full step leaves the square of the residual times `curvature`, which is measured at every such step and handed on
/// from degree to degree, infinite while unknown: where that is `enough`, the residual is not evaluated any more.
pub fn newton(
    system: &mut CollocationSystem,
    coefficients: &mut [f64],
    stopping: Stopping,
    curvature: &mut f64,
) -> f64 {
    let Stopping { settled, enough } = stopping;
    let m = system.onsets.len() * system.nodes.degree;
    let (mut residual, mut jacobian) = (vec![0.0; m], vec![0.0; m * m]);
    let (mut trial, mut step) = (coefficients.to_vec(), vec![0.0; m]);
    system.residual(coefficients, &mut residual, &mut jacobian);
    for _ in 0..MOST_ITERATIONS {
        let norm = largest(&residual);
        for (step, left) in step.iter_mut().zip(&residual) {
            *step = -left;
        }
        lift_diagonal(&mut jacobian, m);
        if !eliminate(&mut jacobian, &mut step) {
            return f64::NAN;
        }
        let largest_move = largest_move(system, coefficients, &step);
        let mut length = (system.segment.spread() / largest_move).min(1.0);
        let small = largest_move <= settled;
        loop {
            try_step(system, coefficients, &step, length, &mut trial);
            let expected = CAUTION * *curvature * norm * norm;
            if length >= 1.0 && expected <= enough {
                coefficients.copy_from_slice(&trial);
                return expected;
            }
            system.residual(&trial, &mut residual, &mut jacobian);
            let left = largest(&residual);
            if length >= 1.0 {
                *curvature = left / (norm * norm);
            }
            if left <= (1.0 - SMALLEST_GAIN * length) * norm
                || length < SMALLEST_STEP
                || small
                || left < ROUNDING
            {
                break;
            }
            length *= 0.5;
        }
        coefficients.copy_from_slice(&trial);
        let left = largest(&residual);
        if small || left <= enough || !left.is_finite() {
            break;
        }
    }
    largest(&residual)
}

/// Fill in the coefficients after a share of the step, inside their limits.
fn try_step(
    system: &CollocationSystem,
    coefficients: &[f64],
    step: &[f64],
    length: f64,
    trial: &mut [f64],
) {
    for (k, step) in step.iter().enumerate() {
        let (place, onset) = of_unknown(system, k);
        trial[place] = coefficients[place] + length * step;
        if onset.representation == Representation::SquaredDistance {
            trial[place] = trial[place].max(SMALLEST_LEFT * coefficients[place]);
        }
    }
}

/// The place of unknown k among the coefficients, and the onset of its end.
fn of_unknown<'a>(system: &CollocationSystem<'a>, k: usize) -> (usize, &'a ContactOnset) {
    let end = k / system.nodes.degree;
    (k + end + 1, &system.onsets[end])
}

/// The largest absolute value; NaN if there is one.
fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most: f64, v| {
        if v.abs() > most || v.is_nan() {
            v.abs()
        } else {
            most
        }
    })
}

/// The largest distance by which the step moves the boundary, in x.
fn largest_move(system: &CollocationSystem, coefficients: &[f64], step: &[f64]) -> f64 {
    let moves = step.iter().enumerate().map(|(k, step)| {
        let (place, onset) = of_unknown(system, k);
        let boundary = onset.boundary_of(system.segment.sign, coefficients[place], 0.0);
        (step * boundary.1).abs()
    });
    moves.fold(0.0, f64::max)
}
