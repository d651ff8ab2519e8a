//! The nodes of the collocation and of its integrals, and the interpolation between them.

use std::f64::consts::{FRAC_PI_4, PI};
use std::sync::{Mutex, OnceLock};

const MOST_POINTS: usize = 40;
const SAME_NODE: f64 = 1e-14;

/// Gauss-Legendre nodes on (-1, 1) and weights, in increasing order.
pub fn legendre(points: usize) -> &'static [(f64, f64)] {
    static RULES: [OnceLock<Vec<(f64, f64)>>; MOST_POINTS + 1] =
        [const { OnceLock::new() }; MOST_POINTS + 1];
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
            for _ in 0..100 {
                let (mut p, mut before) = (1.0, 0.0);
                for k in 0..points {
                    let k = k as f64;
                    (p, before) = (((2.0 * k + 1.0) * x * p - k * before) / (k + 1.0), p);
                }
                slope = n * (x * p - before) / (x * x - 1.0);
                let step = p / slope;
                x -= step;
                if step.abs() < 1e-16 {
                    break;
                }
            }
            (x, 2.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

/// For polynomials in eta = sqrt(s/h), 0 <= eta <= 1.
pub struct Table {
    pub degree: usize,
    pub points: usize,
    /// The Chebyshev points, 0 and 1 among them, (m + 1).
    pub eta: Vec<f64>,
    /// Age `s cosine^2` and time `s sine^2` of the integrals' nodes at stage time `s`, and their weights of `s`.
    pub cosine: Vec<f64>,
    pub sine: Vec<f64>,
    pub weight: Vec<f64>,
    /// Values at the stages' eta times the sine from those at eta: (m, n, m + 1).
    at_nodes: Vec<f64>,
}

impl Table {
    fn new(degree: usize, points: usize) -> Self {
        let eta = chebyshev(degree);
        let angles: Vec<(f64, f64)> = legendre(points)
            .iter()
            .map(|&(x, w)| (FRAC_PI_4 * (x + 1.0), w))
            .collect();
        let cosine: Vec<f64> = angles.iter().map(|(angle, _)| angle.cos()).collect();
        let sine: Vec<f64> = angles.iter().map(|(angle, _)| angle.sin()).collect();
        let weight = angles
            .iter()
            .map(|(angle, w)| 0.5 * PI * w * angle.sin() * angle.cos())
            .collect();
        let mut at_nodes = vec![0.0; degree * points * (degree + 1)];
        for k in 0..degree {
            for (l, sine) in sine.iter().enumerate() {
                let start = (k * points + l) * (degree + 1);
                interpolation(
                    &eta,
                    eta[k + 1] * sine,
                    &mut at_nodes[start..=start + degree],
                );
            }
        }
        Table {
            degree,
            points,
            eta,
            cosine,
            sine,
            weight,
            at_nodes,
        }
    }

    /// Age and weight of every node of the integral over a time `span`.
    pub fn ages(&self, span: f64) -> impl Iterator<Item = (f64, f64)> + '_ {
        let nodes = self.cosine.iter().zip(&self.weight);
        nodes.map(move |(cosine, weight)| (span * cosine * cosine, span * weight))
    }

    /// The weights of the values at eta for node `l` of stage `k` (from 0), (m + 1).
    pub fn row(&self, k: usize, l: usize) -> &[f64] {
        let width = self.degree + 1;
        let start = (k * self.points + l) * width;
        &self.at_nodes[start..start + width]
    }
}

/// The table of a degree and a number of nodes in every integral; computed once.
pub fn table(degree: usize, points: usize) -> &'static Table {
    static TABLES: Mutex<Vec<&'static Table>> = Mutex::new(Vec::new());
    let mut tables = TABLES
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner);
    let known = tables
        .iter()
        .find(|t| t.degree == degree && t.points == points);
    if let Some(found) = known {
        return found;
    }
    let made: &'static Table = Box::leak(Box::new(Table::new(degree, points)));
    tables.push(made);
    made
}

/// The Chebyshev points of the second kind on [0, 1].
#[allow(clippy::cast_precision_loss)]
fn chebyshev(degree: usize) -> Vec<f64> {
    (0..=degree)
        .map(|k| 0.5 * (1.0 - (PI * k as f64 / degree as f64).cos()))
        .collect()
}

/// Fill in the weights that take values at the Chebyshev points to that at `wanted`.
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
    use super::{interpolation, legendre, table};

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

    #[test]
    fn interpolation_reproduces_polynomials() {
        let eta = &table(6, 8).eta;
        let mut weights = vec![0.0; 7];
        interpolation(eta, 0.37, &mut weights);
        let value: f64 = eta.iter().zip(&weights).map(|(e, w)| w * e.powi(6)).sum();
        assert!((value - 0.37f64.powi(6)).abs() < 1e-15);
    }
}
