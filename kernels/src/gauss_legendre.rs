//! Gauss-Legendre quadrature rules.

use std::f64::consts::PI;
use std::sync::OnceLock;

/// The largest number of nodes of a rule; chosen: no integral here has more.
const LARGEST_RULE: usize = 128;
/// The largest number of Newton's steps for a node; chosen: five are enough.
const MOST_STEPS: usize = 100;
/// The step of Newton's method after which a node is known to rounding.
const ROUNDING: f64 = 1e-16;

/// The nodes on (-1, 1), in increasing order, and the weights.
pub fn legendre(points: usize) -> &'static [(f64, f64)] {
    static RULES: [OnceLock<Vec<(f64, f64)>>; LARGEST_RULE + 1] =
        [const { OnceLock::new() }; LARGEST_RULE + 1];
    RULES[points].get_or_init(|| compute_legendre(points))
}

/// Newton's method on the recurrence of Legendre polynomials.
#[allow(clippy::cast_precision_loss)]
fn compute_legendre(points: usize) -> Vec<(f64, f64)> {
    let n = points as f64;
    (0..points)
        .map(|i| {
            let mut x = -(PI * (i as f64 + 0.75) / (n + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..MOST_STEPS {
                let (mut p, mut before) = (1.0, 0.0);
                for k in 0..points {
                    let k = k as f64;
                    (p, before) = (((2.0 * k + 1.0) * x * p - k * before) / (k + 1.0), p);
                }
                slope = n * (x * p - before) / (x * x - 1.0);
                let step = p / slope;
                x -= step;
                if step.abs() < ROUNDING {
                    break;
                }
            }
            (x, 2.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::legendre;

    #[test]
    fn gauss_rules_integrate_polynomials_exactly() {
        for points in 2..=24 {
            let order = i32::try_from(2 * points - 2).unwrap();
            let sum: f64 = legendre(points)
                .iter()
                .map(|(x, w)| w * x.powi(order))
                .sum();
            let exact = 2.0 / f64::from(order + 1);
            assert!((sum - exact).abs() < 1e-14, "{points}: {sum} {exact}");
        }
    }
}
