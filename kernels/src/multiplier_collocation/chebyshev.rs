//! Chebyshev points of the second kind on [0, 1], and barycentric interpolation between them.

use std::f64::consts::PI;

/// The distance from a node within which a place is the node; chosen: the weights are infinite at it.
const SAME_NODE: f64 = 1e-14;

/// The degree + 1 points, 0 and 1 among them, in increasing order.
#[allow(clippy::cast_precision_loss)]
pub fn chebyshev_points(degree: usize) -> Vec<f64> {
    (0..=degree)
        .map(|k| 0.5 * (1.0 - (PI * k as f64 / degree as f64).cos()))
        .collect()
}

/// Fill in the weights that take values at the Chebyshev points `eta` to the value of their polynomial at `wanted`.
pub fn interpolation(eta: &[f64], wanted: f64, weights: &mut [f64]) {
    let last = eta.len() - 1;
    let mut sum = 0.0;
    for (j, &node) in eta.iter().enumerate() {
        let distance = wanted - node;
        if distance.abs() < SAME_NODE {
            weights.fill(0.0);
            weights[j] = 1.0;
            return;
        }
        let sign = if j % 2 == 0 { 1.0 } else { -1.0 };
        let half = if j == 0 || j == last { 0.5 } else { 1.0 };
        weights[j] = sign * half / distance;
        sum += weights[j];
    }
    for weight in weights {
        *weight /= sum;
    }
}

#[cfg(test)]
mod tests {
    use super::{chebyshev_points, interpolation};

    #[test]
    fn interpolation_reproduces_polynomials() {
        let eta = chebyshev_points(6);
        let mut weights = vec![0.0; 7];
        interpolation(&eta, 0.37, &mut weights);
        let value: f64 = eta.iter().zip(&weights).map(|(e, w)| w * e.powi(6)).sum();
        assert!((value - 0.37f64.powi(6)).abs() < 1e-15);
    }
}
