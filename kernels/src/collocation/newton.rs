//! Newton's method for the boundary's coefficients, with halved steps.

use super::boundary::{Form, System};

const MOST_ITERATIONS: usize = 40;
const LEAST_STEP: f64 = 0.01;
const SMALLEST_COEFFICIENT: f64 = 1e-10;
const LEAST_SHARE: f64 = 1e-9;
const LIFT: f64 = 1e-12;
const NOTHING_LEFT: f64 = 1e-14;

/// A full step leaves so many times what the one before it lets expect, at the most.
const CAUTION: f64 = 10.0;

/// Replace the coefficients behind the first by a zero of the residual; return what is left of it.
///
/// The iteration ends after a step that moves the boundary by less than `settled`, or once the residual is `enough`. A
/// full step leaves the residual's square times `curvature`, which is measured at every such step and handed on from
/// degree to degree, infinite while unknown: where that is enough, the residual is not evaluated any more.
pub fn newton(
    system: &mut System,
    coefficients: &mut [f64],
    (settled, enough): (f64, f64),
    curvature: &mut f64,
) -> f64 {
    let m = system.nodes.degree;
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
        let furthest = furthest_move(system, coefficients, &step);
        let mut length = (system.stretch.spread() / furthest).min(1.0);
        let small = if matches!(system.start.form, Form::Tail { .. }) {
            largest(&step) <= settled
        } else {
            furthest <= settled
        };
        loop {
            for k in 0..m {
                trial[k + 1] = coefficients[k + 1] + length * step[k];
                match system.start.form {
                    Form::Tail { .. } => {
                        trial[k + 1] =
                            trial[k + 1].clamp(SMALLEST_COEFFICIENT, 1.0 - SMALLEST_COEFFICIENT);
                    }
                    Form::Root => trial[k + 1] = trial[k + 1].max(0.1 * coefficients[k + 1]),
                    _ => {}
                }
            }
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
            if left <= (1.0 - 0.2 * length) * norm
                || length < LEAST_STEP
                || small
                || left < NOTHING_LEFT
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

/// Keep the diagonal away from zero.
fn lift_diagonal(jacobian: &mut [f64], m: usize) {
    let most = (0..m).fold(0.0_f64, |most, k| most.max(jacobian[k * m + k].abs()));
    let lift = LIFT * most + 1e-300;
    for k in 0..m {
        let entry = &mut jacobian[k * m + k];
        *entry += if *entry < 0.0 { -lift } else { lift };
    }
}

/// How far the step moves the boundary at most.
fn furthest_move(system: &System, coefficients: &[f64], step: &[f64]) -> f64 {
    let moves = step.iter().zip(&coefficients[1..]).map(|(step, c)| {
        let c = if matches!(system.start.form, Form::Tail { .. }) {
            c.clamp(LEAST_SHARE, 1.0 - LEAST_SHARE)
        } else {
            *c
        };
        (step * system.start.place_of(system.stretch.sign, c, 0.0).1).abs()
    });
    moves.fold(0.0, f64::max)
}

/// Solve the system in place by elimination with row exchanges; false where it is singular or not finite.
fn eliminate(matrix: &mut [f64], rhs: &mut [f64]) -> bool {
    let n = rhs.len();
    for k in 0..n {
        let mut pivot = k;
        for i in k + 1..n {
            if matrix[i * n + k].abs() > matrix[pivot * n + k].abs() {
                pivot = i;
            }
        }
        let diagonal = matrix[pivot * n + k];
        if !diagonal.is_finite() || diagonal.abs() == 0.0 {
            return false;
        }
        if pivot != k {
            for j in 0..n {
                matrix.swap(k * n + j, pivot * n + j);
            }
            rhs.swap(k, pivot);
        }
        for i in k + 1..n {
            let factor = matrix[i * n + k] / diagonal;
            for j in k..n {
                matrix[i * n + j] -= factor * matrix[k * n + j];
            }
            rhs[i] -= factor * rhs[k];
        }
    }
    for k in (0..n).rev() {
        let mut sum = rhs[k];
        for j in k + 1..n {
            sum -= matrix[k * n + j] * rhs[j];
        }
        rhs[k] = sum / matrix[k * n + k];
    }
    rhs.iter().all(|x| x.is_finite())
}
