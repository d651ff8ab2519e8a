//! The meshes of a march, which all options of a group share.

/// Beyond the labels whose number grows like sqrt(t).
const EXTRA_NODES: usize = 6;

/// One time step.
pub struct Step {
    /// sqrt(t) at its end.
    pub root: f64,
    /// The distance of the labels.
    pub dx: f64,
    /// Labels that are free.
    pub active: usize,
    /// Whether every second label is dropped before the step.
    pub coarsens: bool,
    /// Extrapolation in ln sqrt(t) from the last values, newest first.
    pub prediction: [f64; 3],
    /// The derivative by ln sqrt(t) at the newest of the values, newest first.
    pub slope: [f64; 3],
}

/// M steps equally long in sqrt(t); dx is halved each time sqrt(t) is, towards expiry.
pub struct Plan {
    pub nodes: usize,
    pub steps: Vec<Step>,
}

impl Plan {
    /// `halvings`: dx never exceeds width / 2^halvings.
    #[allow(clippy::cast_precision_loss)]
    pub fn new(steps: usize, width: f64, nodes: usize, halvings: u32) -> Self {
        let exponent = |n: usize| {
            let mut e = 0;
            while n << (e + 1) <= steps {
                e += 1;
            }
            e.max(halvings)
        };
        let logarithm = |n: usize| (n as f64 / steps as f64).ln();
        let step = |n: usize| Step {
            root: n as f64 / steps as f64,
            dx: width / 2.0_f64.powi(i32::try_from(exponent(n)).unwrap_or(i32::MAX)),
            active: nodes.min(((nodes * n) << (exponent(n) - halvings)) / steps + EXTRA_NODES),
            coarsens: n > 1 && exponent(n) < exponent(n - 1),
            prediction: prediction(n, &logarithm),
            slope: slope(n, &logarithm),
        };
        Self {
            nodes,
            steps: (1..=steps).map(step).collect(),
        }
    }
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
    use super::Plan;

    #[test]
    fn cells_halve_with_the_root_of_time() {
        let plan = Plan::new(12, 0.2, 40, 0);
        let widths: Vec<f64> = plan.steps.iter().map(|s| s.dx).collect();
        assert_eq!(widths[..7], [0.025, 0.05, 0.05, 0.1, 0.1, 0.1, 0.2]);
        assert!(plan.steps[1].coarsens && !plan.steps[2].coarsens && plan.steps[6].coarsens);
        assert_eq!(plan.steps[11].active, 40);
        assert!(Plan::new(12, 0.2, 40, 2).steps.iter().all(|s| s.dx <= 0.05));
    }

    #[test]
    fn the_weights_are_exact_for_quadratics() {
        let plan = Plan::new(9, 0.2, 40, 0);
        let f = |n: usize| {
            let l = (f64::from(u32::try_from(n).unwrap_or(0)) / 9.0).ln();
            1.0 + l * (2.0 - 3.0 * l)
        };
        let step = &plan.steps[6];
        let found: f64 = (0..3).map(|j| step.prediction[j] * f(6 - j)).sum();
        assert!((found - f(7)).abs() < 1e-12);
        let slope: f64 = (0..3).map(|j| step.slope[j] * f(7 - j)).sum();
        assert!((slope - (2.0 - 6.0 * (7.0_f64 / 9.0).ln())).abs() < 1e-12);
    }
}
