//! The meshes of a march, which all options of a group share.

use std::sync::OnceLock;

/// The numbers of time steps, by level; two levels up they double.
pub const STEPS: [usize; 16] = [
    2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384,
];
/// Beyond the labels whose number grows like sqrt(t).
const EXTRA_NODES: usize = 6;

/// One time step, whatever the distance of the labels.
struct Moment {
    /// sqrt(t) at its end.
    root: f64,
    /// How often dx has been halved towards expiry.
    exponent: u32,
    /// Extrapolation in ln sqrt(t) from the last values, newest first.
    prediction: [f64; 3],
    /// The derivative by ln sqrt(t) at the newest of the values, newest first.
    slope: [f64; 3],
}

/// M steps equally long in sqrt(t), and labels whose distance is halved each time sqrt(t) is, towards expiry.
pub struct Plan {
    moments: &'static [Moment],
    width: f64,
    /// Labels that are free now.
    pub nodes: usize,
    halvings: u32,
}

/// One time step.
pub struct Step<'a> {
    /// n.
    pub number: usize,
    /// Whether n = M.
    pub last: bool,
    /// sqrt(t) at its end.
    pub root: f64,
    /// The distance of the labels.
    pub dx: f64,
    /// Labels that are free.
    pub active: usize,
    /// Whether every second label is dropped before the step.
    pub coarsens: bool,
    /// Extrapolation in ln sqrt(t) from the last values, newest first.
    pub prediction: &'a [f64; 3],
    /// The derivative by ln sqrt(t) at the newest of the values, newest first.
    pub slope: &'a [f64; 3],
}

impl Plan {
    /// `STEPS[level]` steps; `width` is dx at the end where `halvings` is 0; dx never exceeds width / 2^halvings.
    pub fn new(level: usize, width: f64, nodes: usize, halvings: u32) -> Self {
        static MOMENTS: [OnceLock<Vec<Moment>>; STEPS.len()] =
            [const { OnceLock::new() }; STEPS.len()];
        Self {
            moments: MOMENTS[level].get_or_init(|| moments(STEPS[level])),
            width,
            nodes,
            halvings,
        }
    }

    /// M.
    pub fn count(&self) -> usize {
        self.moments.len()
    }

    /// The step that ends at sqrt(t) = n/M, 1 <= n <= M.
    #[inline(always)]
    pub fn step(&self, n: usize) -> Step<'static> {
        let here = &self.moments[n - 1];
        let exponent = here.exponent.max(self.halvings);
        let before = self.moments[n.max(2) - 2].exponent.max(self.halvings);
        let reach = (self.nodes * n) << (exponent - self.halvings);
        Step {
            number: n,
            last: n == self.count(),
            root: here.root,
            dx: self.spacing(exponent),
            active: self.nodes.min(reach / self.count() + EXTRA_NODES),
            coarsens: exponent < before,
            prediction: &here.prediction,
            slope: &here.slope,
        }
    }

    /// The distance of the labels now.
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
fn moments(steps: usize) -> Vec<Moment> {
    let logarithm = |n: usize| (n as f64 / steps as f64).ln();
    let moment = |n: usize| Moment {
        root: n as f64 / steps as f64,
        exponent: (steps / n).ilog2(),
        prediction: prediction(n, &logarithm),
        slope: slope(n, &logarithm),
    };
    (1..=steps).map(moment).collect()
}

/// Lagrange's weights of the steps n - 1, n - 2, n - 3 (those there are) at step n.
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

/// Weights of the steps n, n - 1, n - 2 for the derivative at n.
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
    use super::{Plan, STEPS};

    fn plan(steps: usize, halvings: u32) -> Plan {
        let level = STEPS.iter().position(|&s| s == steps).unwrap_or(0);
        Plan::new(level, 0.2, 40, halvings)
    }

    #[test]
    fn cells_halve_with_the_root_of_time() {
        let plan = plan(12, 0);
        let widths: Vec<f64> = (1..=12).map(|n| plan.step(n).dx).collect();
        assert_eq!(widths[..7], [0.025, 0.05, 0.05, 0.1, 0.1, 0.1, 0.2]);
        let coarsens: Vec<bool> = (1..=7).map(|n| plan.step(n).coarsens).collect();
        assert_eq!(coarsens, [false, true, false, true, false, false, true]);
        assert_eq!(plan.step(12).active, 40);
        assert!((1..=12).all(|n| self::plan(12, 2).step(n).dx <= 0.05));
    }

    #[test]
    fn the_weights_are_exact_for_quadratics() {
        let f = |n: usize| {
            let l = (f64::from(u32::try_from(n).unwrap_or(0)) / 8.0).ln();
            1.0 + l * (2.0 - 3.0 * l)
        };
        let plan = plan(8, 0);
        let step = plan.step(7);
        let found: f64 = (0..3).map(|j| step.prediction[j] * f(6 - j)).sum();
        assert!((found - f(7)).abs() < 1e-12);
        let slope: f64 = (0..3).map(|j| step.slope[j] * f(7 - j)).sum();
        assert!((slope - (2.0 - 6.0 * (7.0_f64 / 8.0).ln())).abs() < 1e-12);
    }
}
