//! The collocation nodes of one degree, and the quadrature of the integrals up to each of them.

use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::OnceLock;

use crate::gauss_legendre::legendre;

/// The degrees of the boundaries' polynomials, by level; chosen: each is about half as much again as the one before.
pub const DEGREES: [usize; 6] = [4, 6, 9, 13, 19, 28];
/// The numbers of points of the quadrature, by level, multiples of the lanes; chosen: the error of the integrals is below
/// that of the polynomials.
const POINTS: [usize; DEGREES.len()] = [32, 32, 48, 64, 96, 128];

/// The distance below which a place is a node.
const SAME: f64 = 1e-15;

/// Nodes and quadrature of one degree.
///
/// The boundaries are polynomials of z, the square root of time to expiry as a share of the time that they are sought for.
/// The nodes z are Chebyshev's with both ends, from 0 to 1. The integral up to node i runs over the time s to expiry of the
/// exercise, s = (z sin phi)^2: in phi the square roots of s and of the time z^2 - s since then are both smooth.
pub struct Nodes {
    /// The degree m.
    pub degree: usize,
    /// The nodes, (m + 1,), increasing.
    pub z: Vec<f64>,
    /// The weights of barycentric interpolation, (m + 1,).
    weights: Vec<f64>,
    /// The number of points of the quadrature.
    pub points: usize,
    /// cos phi and sin phi, (points,).
    pub cosines: Vec<f64>,
    pub sines: Vec<f64>,
    /// The weights of the integral over s up to z = 1, (points,).
    pub quadrature: Vec<f64>,
    /// The values at the points of the polynomials that are 1 at one node and 0 at the others: by node from 1, then by
    /// polynomial, then by point, (m x (m + 1) x points,).
    pub basis: Vec<f64>,
}

impl Nodes {
    /// The nodes of a level.
    pub fn of_level(level: usize) -> &'static Self {
        static ALL: [OnceLock<Nodes>; DEGREES.len()] = [const { OnceLock::new() }; DEGREES.len()];
        ALL[level].get_or_init(|| Self::new(DEGREES[level], POINTS[level]))
    }

    #[allow(clippy::cast_precision_loss)]
    fn new(degree: usize, points: usize) -> Self {
        let angle = |k: usize| PI * k as f64 / degree as f64;
        let z: Vec<f64> = (0..=degree).map(|k| 0.5 * (1.0 - angle(k).cos())).collect();
        let weight = |k: usize| {
            let sign = if k.is_multiple_of(2) { 1.0 } else { -1.0 };
            if k == 0 || k == degree {
                0.5 * sign
            } else {
                sign
            }
        };
        let mut nodes = Self {
            degree,
            z,
            weights: (0..=degree).map(weight).collect(),
            points,
            cosines: Vec::with_capacity(points),
            sines: Vec::with_capacity(points),
            quadrature: Vec::with_capacity(points),
            basis: vec![0.0; degree * (degree + 1) * points],
        };
        for (x, weight) in legendre(points) {
            let (sine, cosine) = (FRAC_PI_2 * 0.5 * (x + 1.0)).sin_cos();
            nodes.sines.push(sine);
            nodes.cosines.push(cosine);
            nodes.quadrature.push(PI * 0.5 * weight * sine * cosine);
        }
        for i in 1..=degree {
            for point in 0..points {
                let row = nodes.interpolation(nodes.z[i] * nodes.sines[point]);
                for (k, value) in row.into_iter().enumerate() {
                    nodes.basis[((i - 1) * (degree + 1) + k) * points + point] = value;
                }
            }
        }
        nodes
    }

    /// The values at z of the polynomials that are 1 at one node and 0 at the others, (m + 1,).
    pub fn interpolation(&self, z: f64) -> Vec<f64> {
        if let Some(at) = self.z.iter().position(|node| (node - z).abs() < SAME) {
            return (0..=self.degree).map(|k| f64::from(k == at)).collect();
        }
        let terms = self.z.iter().zip(&self.weights);
        let mut row: Vec<f64> = terms.map(|(node, weight)| weight / (z - node)).collect();
        let sum: f64 = row.iter().sum();
        for value in &mut row {
            *value /= sum;
        }
        row
    }

    /// The weight of a node in barycentric interpolation.
    #[inline(always)]
    pub fn weight(&self, node: usize) -> f64 {
        self.weights[node]
    }

    /// The polynomial with these values at the nodes, at z.
    pub fn value(&self, values: &[f64], z: f64) -> f64 {
        let row = self.interpolation(z);
        row.iter().zip(values).map(|(a, b)| a * b).sum()
    }

    /// The derivatives at the nodes of the polynomial with these values there.
    pub fn derivatives(&self, values: &[f64]) -> Vec<f64> {
        let term = |i: usize, k: usize| {
            self.weights[k] / self.weights[i] / (self.z[i] - self.z[k]) * (values[k] - values[i])
        };
        let others = |i: usize| (0..=self.degree).filter(move |&k| k != i);
        (0..=self.degree)
            .map(|i| others(i).map(|k| term(i, k)).sum())
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::{Nodes, DEGREES};

    #[test]
    fn polynomials_of_the_degree_are_interpolated_differentiated_and_integrated_exactly() {
        for (level, &degree) in DEGREES.iter().enumerate() {
            let nodes = Nodes::of_level(level);
            let power = i32::try_from(degree).unwrap();
            let values: Vec<f64> = nodes.z.iter().map(|z| z.powi(power)).collect();
            assert!((nodes.value(&values, 0.3) - 0.3_f64.powi(power)).abs() < 1e-14);
            for (slope, z) in nodes.derivatives(&values).iter().zip(&nodes.z) {
                assert!((slope - f64::from(power) * z.powi(power - 1)).abs() < 1e-10);
            }
            // The integral over s from 0 to 1 of s^(m/2) is 1/(m/2 + 1).
            let (points, m) = (nodes.points, nodes.degree);
            let sum: f64 = (0..points)
                .map(|j| {
                    let at = |k: usize| nodes.basis[((m - 1) * (m + 1) + k) * points + j];
                    let there: f64 = (0..=m).map(|k| at(k) * values[k]).sum();
                    nodes.quadrature[j] * there
                })
                .sum();
            assert!(
                (sum - 2.0 / f64::from(power + 2)).abs() < 1e-13,
                "{degree}: {sum}"
            );
        }
    }
}
