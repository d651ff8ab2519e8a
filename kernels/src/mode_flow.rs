//! The flow of one mode of a complementarity system over one Taylor step, up to the first output that becomes negative.

use crate::error::{check_length, KernelError};
use crate::first_crossing::{first_crossing, Polynomial, DEGREE, SAME_TIME};

/// The least size of the terms of an output.
const LEAST_SIZE: f64 = 1e-290;
/// Largest output, in tolerances, that counts as zero and touches nothing.
const FLAT: f64 = 1e3;
/// Share of an output's size above zero that is rounding.
const LOW: f64 = 64.0 * f64::EPSILON;
/// Share of its terms below which the slope of an output is rounding or tangency.
const SLOW: f64 = 1e-9;
/// Shares of the way at which the height of a flight is evaluated.
const FLIGHT: [f64; 3] = [0.25, 0.5, 0.75];

/// The rows of a matrix without their zeros.
struct SparseRows {
    entries: Vec<(usize, f64)>,
    starts: Vec<usize>,
}

impl SparseRows {
    fn new(matrix: &[f64], columns: usize) -> Self {
        let (mut entries, mut starts) = (Vec::with_capacity(matrix.len()), vec![0]);
        if columns > 0 {
            for row in matrix.chunks_exact(columns) {
                let present = row.iter().copied().enumerate();
                entries.extend(present.filter(|&(_, entry)| entry != 0.0));
                starts.push(entries.len());
            }
        }
        Self { entries, starts }
    }

    fn row(&self, i: usize) -> &[(usize, f64)] {
        &self.entries[self.starts[i]..self.starts[i + 1]]
    }

    fn product(&self, i: usize, vector: &[f64]) -> f64 {
        self.row(i)
            .iter()
            .map(|&(j, entry)| entry * vector[j])
            .sum()
    }

    fn size(&self, i: usize, sizes: &[f64]) -> f64 {
        let terms = self.row(i).iter();
        terms.map(|&(j, entry)| entry.abs() * sizes[j]).sum()
    }
}

/// Where a Taylor step ends.
pub struct StepEnd {
    /// The place, in units of the step: where outputs cross zero, or its reach.
    pub place: f64,
    /// The outputs that cross zero there.
    pub crossed: Vec<usize>,
    /// The coordinates there.
    pub coordinates: Vec<f64>,
    /// The sizes of their terms.
    pub sizes: Vec<f64>,
    /// Whether what crosses had not risen by more than rounding, or does so with next to no slope.
    pub is_low: (bool, bool),
    /// Whether an output may touch zero on the way without crossing it.
    pub may_touch: bool,
}

/// Follow c' = R c, outputs C c >= 0, over `reach` units of time, at most one in which the Taylor series converges.
///
/// `rate` is R in that unit, shape (d, d), `outputs` is C, shape (k, d), both by rows; an output is negative where it is
/// below minus `share` of its terms' sizes, which are those of the coordinates in `sizes`, or larger on the way.
///
/// # Errors
/// The lengths do not fit.
pub fn taylor_step(
    rate: &[f64],
    outputs: &[f64],
    coordinates: &[f64],
    sizes: &[f64],
    reach: f64,
    share: f64,
) -> Result<StepEnd, KernelError> {
    let d = coordinates.len();
    check_length("rate", rate, d * d)?;
    check_length("sizes", sizes, d)?;
    let k = outputs.len().checked_div(d).unwrap_or(0);
    check_length("outputs", outputs, k * d)?;
    let (rate, outputs) = (SparseRows::new(rate, d), SparseRows::new(outputs, d));
    let terms = expansion(&rate, coordinates);
    let swept = sum_of_sizes(&terms, d, reach);
    let mut end = StepEnd {
        place: reach,
        crossed: Vec::new(),
        coordinates: value(&terms, d, reach),
        sizes: swept,
        is_low: (false, false),
        may_touch: false,
    };
    if !end.sizes.iter().all(|size| size.is_finite()) {
        return Ok(end);
    }
    let largest: Vec<f64> = sizes
        .iter()
        .zip(&end.sizes)
        .map(|(&a, &b)| a.max(b))
        .collect();
    let tolerances: Vec<f64> = (0..k)
        .map(|i| share * outputs.size(i, &largest).max(LEAST_SIZE))
        .collect();
    let polynomials: Vec<Polynomial> = (0..k).map(|i| polynomial(&outputs, i, &terms, d)).collect();
    let bounds: Vec<_> = polynomials.iter().map(|p| p.bernstein(reach)).collect();
    if bounds.iter().zip(&tolerances).all(|(b, &t)| b.least() > t) {
        return Ok(end);
    }
    let mut found: Vec<(f64, usize)> = Vec::new();
    for i in 0..k {
        if bounds[i].least() < -tolerances[i] {
            let place = first_crossing(&polynomials[i], bounds[i], reach, tolerances[i]);
            found.extend(place.map(|place| (place, i)));
        }
    }
    let first = found
        .iter()
        .map(|&(place, _)| place)
        .fold(f64::INFINITY, f64::min);
    if first.is_finite() {
        let together = found
            .iter()
            .filter(|&&(place, _)| place <= first + SAME_TIME);
        end.crossed = together.map(|&(_, i)| i).collect();
        end.place = first;
        end.coordinates = value(&terms, d, first);
        end.sizes = sum_of_sizes(&terms, d, first);
        end.is_low = (
            is_flat(&polynomials, &outputs, &end),
            is_slow(&rate, &outputs, &end),
        );
    }
    end.may_touch = (0..k).any(|i| {
        let b = polynomials[i].bernstein(end.place);
        b.least() <= tolerances[i]
            && b.largest() > FLAT * tolerances[i]
            && polynomials[i].turns(end.place)
    });
    Ok(end)
}

/// The Taylor coefficients of the coordinates one after the other, up to the last that is not zero.
fn expansion(rate: &SparseRows, coordinates: &[f64]) -> Vec<f64> {
    let d = coordinates.len();
    let mut terms = Vec::with_capacity((DEGREE + 1) * d);
    terms.extend_from_slice(coordinates);
    for j in 0..DEGREE {
        #[allow(clippy::cast_precision_loss)]
        let factor = 1.0 / (j + 1) as f64;
        for i in 0..d {
            terms.push(rate.product(i, &terms[j * d..(j + 1) * d]) * factor);
        }
        if terms[(j + 1) * d..].iter().all(|&term| term == 0.0) {
            terms.truncate((j + 1) * d);
            break;
        }
    }
    terms
}

fn polynomial(outputs: &SparseRows, i: usize, terms: &[f64], d: usize) -> Polynomial {
    let mut coefficients = [0.0; DEGREE + 1];
    let orders = terms.len() / d;
    for (coefficient, term) in coefficients.iter_mut().zip(terms.chunks_exact(d)) {
        *coefficient = outputs.product(i, term);
    }
    Polynomial::new(&coefficients[..orders])
}

/// The sum of the terms with the powers of a place.
fn value(terms: &[f64], d: usize, place: f64) -> Vec<f64> {
    let mut sum = vec![0.0; d];
    for term in terms.chunks_exact(d.max(1)).rev() {
        for (s, t) in sum.iter_mut().zip(term) {
            *s = *s * place + t;
        }
    }
    sum
}

fn sum_of_sizes(terms: &[f64], d: usize, place: f64) -> Vec<f64> {
    let mut sum = vec![0.0; d];
    for term in terms.chunks_exact(d.max(1)).rev() {
        for (s, t) in sum.iter_mut().zip(term) {
            *s = *s * place + t.abs();
        }
    }
    sum
}

/// Whether the crossing outputs rose on the way by no more than rounding.
fn is_flat(polynomials: &[Polynomial], outputs: &SparseRows, end: &StepEnd) -> bool {
    end.crossed.iter().all(|&i| {
        let level = LOW * outputs.size(i, &end.sizes);
        let mut heights = FLIGHT
            .iter()
            .map(|share| polynomials[i].at(share * end.place).0);
        heights.all(|height| height <= level)
    })
}

/// Whether the slopes of the crossing outputs are next to nothing beside the terms that they consist of.
fn is_slow(rate: &SparseRows, outputs: &SparseRows, end: &StepEnd) -> bool {
    let d = end.coordinates.len();
    end.crossed.iter().all(|&i| {
        let mut row = vec![0.0; d];
        for &(j, gain) in outputs.row(i) {
            for &(l, entry) in rate.row(j) {
                row[l] += gain * entry;
            }
        }
        let (mut slope, mut level) = (0.0, 0.0);
        for ((entry, c), size) in row.iter().zip(&end.coordinates).zip(&end.sizes) {
            slope += entry * c;
            level += entry.abs() * size;
        }
        slope.abs() <= SLOW * level
    })
}

#[cfg(test)]
mod tests {
    use super::taylor_step;

    #[test]
    fn a_ball_falls_to_the_floor() {
        // q' = v, v' = -w, w' = 0 from q = 1/2: 0 = 1/2 - t^2/2.
        let rate = [0.0, 1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0];
        let end = taylor_step(
            &rate,
            &[1.0, 0.0, 0.0],
            &[0.5, 0.0, 1.0],
            &[0.5, 0.0, 1.0],
            2.0,
            1e-11,
        )
        .unwrap();
        assert!((end.place - 1.0).abs() < 1e-15);
        assert_eq!(end.crossed, [0]);
        assert!((end.coordinates[1] + 1.0).abs() < 1e-15);
        assert_eq!(end.is_low, (false, false));
    }

    #[test]
    fn lengths_are_checked() {
        assert!(taylor_step(&[0.0], &[1.0], &[1.0, 2.0], &[1.0, 1.0], 1.0, 1e-11).is_err());
        assert!(taylor_step(&[0.0], &[1.0], &[1.0], &[], 1.0, 1e-11).is_err());
    }

    #[test]
    fn no_coordinates_no_crossing() {
        let end = taylor_step(&[], &[], &[], &[], 1.0, 1e-11).unwrap();
        assert!(end.crossed.is_empty() && !end.may_touch);
    }
}
