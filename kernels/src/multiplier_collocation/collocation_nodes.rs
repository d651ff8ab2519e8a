//! The nodes of the collocation and of its integrals, for polynomials in eta = sqrt(s/h), 0 <= eta <= 1.
//!
//! Both ends of the integral over s', the onset of the contact set and the own place of the boundary, have root
//! singularities: the substitution s' = s sin^2(angle) removes them.

use std::f64::consts::{FRAC_PI_4, PI};
use std::sync::Mutex;

use super::chebyshev::{chebyshev_points, interpolation};
use crate::gauss_legendre::legendre;

/// The nodes for one degree m and n nodes in every integral.
pub struct CollocationNodes {
    /// m.
    pub degree: usize,
    /// n.
    pub points: usize,
    /// The Chebyshev points, 0 and 1 among them, (m + 1,).
    pub eta: Vec<f64>,
    /// The integral over 0 < s' < s has its nodes at the ages s - s' = s `cosine`^2 and times s' = s `sine`^2, (n,), with
    /// the weights s `weight`, (n,).
    pub cosine: Vec<f64>,
    pub sine: Vec<f64>,
    pub weight: Vec<f64>,
    /// The weights that take values at `eta` to those at the eta of a stage times a sine, (m, n, m + 1).
    at_nodes: Vec<f64>,
}

impl CollocationNodes {
    fn new(degree: usize, points: usize) -> Self {
        let eta = chebyshev_points(degree);
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
        CollocationNodes {
            degree,
            points,
            eta,
            cosine,
            sine,
            weight,
            at_nodes,
        }
    }

    /// The age and the weight of every node of the integral over a time `span`, years.
    pub fn ages(&self, span: f64) -> impl Iterator<Item = (f64, f64)> + '_ {
        let nodes = self.cosine.iter().zip(&self.weight);
        nodes.map(move |(cosine, weight)| (span * cosine * cosine, span * weight))
    }

    /// The weights that take values at `eta` to that at node `l` of stage `k` (both from 0), (m + 1,).
    pub fn row(&self, k: usize, l: usize) -> &[f64] {
        let width = self.degree + 1;
        let start = (k * self.points + l) * width;
        &self.at_nodes[start..start + width]
    }
}

/// The nodes for a degree and a number of nodes in every integral, computed once.
pub fn collocation_nodes(degree: usize, points: usize) -> &'static CollocationNodes {
    static KNOWN: Mutex<Vec<&'static CollocationNodes>> = Mutex::new(Vec::new());
    let mut known = KNOWN
        .lock()
        .unwrap_or_else(std::sync::PoisonError::into_inner);
    let found = known
        .iter()
        .find(|nodes| nodes.degree == degree && nodes.points == points);
    if let Some(found) = found {
        return found;
    }
    let made: &'static CollocationNodes =
        Box::leak(Box::new(CollocationNodes::new(degree, points)));
    known.push(made);
    made
}
