//! The time steps and the nodes of a march, which all options of a group share.
//!
//! There are M steps equally long in sqrt(t). The nodes are dx apart, and dx is halved each time sqrt(t) is, towards
//! expiry: the premium there is as narrow as sqrt(t).

use std::sync::OnceLock;

/// The numbers M of time steps, by level; chosen such that they double two levels up.
pub const STEPS: [usize; 16] = [
    2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384,
];
/// The number of nodes beyond those whose number grows like sqrt(t); chosen.
const EXTRA_NODES: usize = 6;

/// The last step whose place is predicted from implicit Euler's boundary in marches with many steps; chosen: later ones are
/// short enough. With few steps, of which it would take most of the time, it is the second.
const MOST_EULER_STEPS: usize = 8;

/// What a time step needs of M and of its number alone.
struct StepWeights {
    /// sqrt(t) at the end of the step.
    root: f64,
    /// How often dx has been halved towards expiry.
    exponent: u32,
    /// See `TimeStep`.
    prediction: [f64; 3],
    /// See `TimeStep`.
    slope: [f64; 3],
}

/// The time steps and the nodes of one march.
pub struct Mesh {
    steps: &'static [StepWeights],
    /// The distance of the nodes now where `halvings` is 0, in xi.
    width: f64,
    /// The number of free nodes now; the premium is zero beyond.
    pub nodes: usize,
    /// The distance of the nodes never exceeds `width` / 2^halvings.
    halvings: u32,
}

/// One time step, from sqrt(t) = (n - 1)/M to n/M.
pub struct TimeStep<'a> {
    /// n, from 1.
    pub number: usize,
    /// Whether n = M.
    pub last: bool,
    /// sqrt(t) at the end of the step.
    pub root: f64,
    /// The last step whose place is predicted from implicit Euler's boundary.
    pub euler_steps: usize,
    /// The distance of the nodes, in xi.
    pub dx: f64,
    /// The number of free nodes.
    pub active: usize,
    /// Whether every second node is dropped before the step.
    pub coarsens: bool,
    /// The weights, newest first, that extrapolate the values of the last three steps to this one in ln sqrt(t).
    pub prediction: &'a [f64; 3],
    /// The weights, newest first, of the values of this step and the two before in the derivative by ln sqrt(t) here.
    pub slope: &'a [f64; 3],
}

impl TimeStep<'_> {
    /// sqrt(t) at the end of the step over that at its start.
    #[inline(always)]
    #[allow(clippy::cast_precision_loss)]
    pub fn growth(&self) -> f64 {
        self.number as f64 / (self.number - 1) as f64
    }
}

impl Mesh {
    /// The mesh with `STEPS[level]` steps; for the other arguments see the fields.
    pub fn new(level: usize, width: f64, nodes: usize, halvings: u32) -> Self {
        static WEIGHTS: [OnceLock<Vec<StepWeights>>; STEPS.len()] =
            [const { OnceLock::new() }; STEPS.len()];
        Self {
            steps: WEIGHTS[level].get_or_init(|| step_weights(STEPS[level])),
            width,
            nodes,
            halvings,
        }
    }

    /// M.
    pub fn step_count(&self) -> usize {
        self.steps.len()
    }

    /// The step that ends at sqrt(t) = n/M, 1 <= n <= M.
    #[inline(always)]
    pub fn step(&self, n: usize) -> TimeStep<'static> {
        let here = &self.steps[n - 1];
        let exponent = here.exponent.max(self.halvings);
        let before = self.steps[n.max(2) - 2].exponent.max(self.halvings);
        let reach = (self.nodes * n) << (exponent - self.halvings);
        TimeStep {
            number: n,
            last: n == self.step_count(),
            root: here.root,
            euler_steps: MOST_EULER_STEPS.min(2 + self.step_count() / 12),
            dx: self.spacing(exponent),
            active: self.nodes.min(reach / self.step_count() + EXTRA_NODES),
            coarsens: exponent < before,
            prediction: &here.prediction,
            slope: &here.slope,
        }
    }

    /// The distance of the nodes at the end of the last step, in xi.
    #[inline(always)]
    pub fn last_spacing(&self) -> f64 {
        self.spacing(self.halvings)
    }

    #[inline(always)]
    fn spacing(&self, exponent: u32) -> f64 {
        self.width / f64::from(1_u32 << exponent)
    }
}

#[allow(clippy::cast_precision_loss)]
fn step_weights(steps: usize) -> Vec<StepWeights> {
    let logarithm = |n: usize| (n as f64 / steps as f64).ln();
    let weights = |n: usize| StepWeights {
        root: n as f64 / steps as f64,
        exponent: (steps / n).ilog2(),
        prediction: prediction(n, &logarithm),
        slope: slope(n, &logarithm),
    };
    (1..=steps).map(weights).collect()
}

/// Lagrange's weights at step n of the values of steps n - 1, n - 2, n - 3 (as far as there are any).
fn prediction(n: usize, logarithm: &impl Fn(usize) -> f64) -> [f64; 3] {
    let known = (n - 1).min(3);
    let mut weights = [0.0; 3];
    for j in 1..=known {
        weights[j - 1] = (1..=known)
            .filter(|&k| k != j)
            .map(|k| (logarithm(n) - logarithm(n - k)) / (logarithm(n - j) - logarithm(n - k)))
            .product();
    }
    weights
}

/// The weights of the values of steps n, n - 1, n - 2 in the derivative at n.
fn slope(n: usize, logarithm: &impl Fn(usize) -> f64) -> [f64; 3] {
    match n {
        1 => [0.0; 3],
        2 => {
            let a = 1.0 / (logarithm(2) - logarithm(1));
            [a, -a, 0.0]
        }
        _ => {
            let a = logarithm(n) - logarithm(n - 1);
            let b = logarithm(n) - logarithm(n - 2);
            let c = logarithm(n - 1) - logarithm(n - 2);
            [(a + b) / (a * b), -b / (a * c), a / (b * c)]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{Mesh, STEPS};

    fn mesh(steps: usize, halvings: u32) -> Mesh {
        let level = STEPS.iter().position(|&s| s == steps).unwrap_or(0);
        Mesh::new(level, 0.2, 40, halvings)
    }

    #[test]
    fn cells_halve_with_the_root_of_time() {
        let mesh = mesh(12, 0);
        let widths: Vec<f64> = (1..=12).map(|n| mesh.step(n).dx).collect();
        assert_eq!(widths[..7], [0.025, 0.05, 0.05, 0.1, 0.1, 0.1, 0.2]);
        let coarsens: Vec<bool> = (1..=7).map(|n| mesh.step(n).coarsens).collect();
        assert_eq!(coarsens, [false, true, false, true, false, false, true]);
        assert_eq!(mesh.step(12).active, 40);
        assert!((1..=12).all(|n| self::mesh(12, 2).step(n).dx <= 0.05));
    }

    #[test]
    fn the_weights_are_exact_for_quadratics() {
        let f = |n: usize| {
            let l = (f64::from(u32::try_from(n).unwrap_or(0)) / 8.0).ln();
            1.0 + l * (2.0 - 3.0 * l)
        };
        let mesh = mesh(8, 0);
        let step = mesh.step(7);
        let found: f64 = (0..3).map(|j| step.prediction[j] * f(6 - j)).sum();
        assert!((found - f(7)).abs() < 1e-12);
        let slope: f64 = (0..3).map(|j| step.slope[j] * f(7 - j)).sum();
        assert!((slope - (2.0 - 6.0 * (7.0_f64 / 8.0).ln())).abs() < 1e-12);
    }
}
