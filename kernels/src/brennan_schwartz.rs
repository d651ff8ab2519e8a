//! Brennan and Schwartz's direct solution: one elimination, one projected substitution.

use crate::error::{check_length, KernelError};
use crate::positive_part;
use crate::tridiagonal::Tridiagonal;

/// Return z of 0 <= z, 0 <= M z + q, complementary, for an M-matrix M.
///
/// Exact iff z = 0 on one run of rows that starts at the first row (`contact_first`) or ends at the
/// last one (otherwise), or nowhere. NaN in the data stays NaN. Cost O(n).
///
/// # Errors
/// `q` is not as long as the diagonal, or a pivot is zero, which it cannot be for an M-matrix.
pub fn brennan_schwartz(
    matrix: Tridiagonal<'_>,
    q: &[f64],
    contact_first: bool,
) -> Result<Vec<f64>, KernelError> {
    check_length("q", q, matrix.size())?;
    let (mut z, slope) = eliminate(matrix, q, contact_first)?;
    substitute(&mut z, &slope, contact_first);
    Ok(z)
}

/// Eliminate toward the contact end and return (a, b) with `z[i] = max(0, a[i] + b[i] z[neighbour])`,
/// where the neighbour of a row is the next one on its contact side (b is 0 at the end itself).
fn eliminate(
    matrix: Tridiagonal<'_>,
    q: &[f64],
    contact_first: bool,
) -> Result<(Vec<f64>, Vec<f64>), KernelError> {
    let size = matrix.size();
    let (mut intercept, mut slope) = (vec![0.0; size], vec![0.0; size]);
    // `inward` couples row k + 1 to row k, `outward` row k to row k + 1, counted from the contact end.
    let (inward, outward) = if contact_first {
        (matrix.lower, matrix.upper)
    } else {
        (matrix.upper, matrix.lower)
    };
    let last = at(size - 1, size, contact_first);
    let (mut pivot, mut rest) = (matrix.diagonal[last], q[last]);
    for k in (1..size).rev() {
        let (row, next) = (at(k, size, contact_first), at(k - 1, size, contact_first));
        let coupling = at(k - 1, size - 1, contact_first);
        let (inner, outer) = (inward[coupling], outward[coupling]);
        if pivot == 0.0 {
            return Err(KernelError::ZeroPivot { row });
        }
        let reciprocal = 1.0 / pivot;
        intercept[row] = -rest * reciprocal;
        slope[row] = -inner * reciprocal;
        rest = q[next] - outer * reciprocal * rest;
        // Its own division keeps the chain from pivot to pivot short: a division and a subtraction.
        pivot = matrix.diagonal[next] - outer * inner / pivot;
    }
    let row = at(0, size, contact_first);
    if pivot == 0.0 {
        return Err(KernelError::ZeroPivot { row });
    }
    intercept[row] = -rest / pivot;
    Ok((intercept, slope))
}

fn substitute(z: &mut [f64], slope: &[f64], contact_first: bool) {
    let size = z.len();
    let mut neighbour = 0.0;
    for k in 0..size {
        let row = at(k, size, contact_first);
        neighbour = positive_part(z[row] + slope[row] * neighbour);
        z[row] = neighbour;
    }
}

/// The index of the k-th entry of a vector of length `size`, counted from the contact end.
#[inline]
fn at(k: usize, size: usize, contact_first: bool) -> usize {
    if contact_first {
        k
    } else {
        size - 1 - k
    }
}

#[cfg(test)]
mod tests {
    use super::{brennan_schwartz, KernelError, Tridiagonal};

    const LOWER: [f64; 2] = [-1.0, -1.0];
    const DIAGONAL: [f64; 3] = [2.0, 2.0, 2.0];
    const UPPER: [f64; 2] = [-1.0, -1.0];

    fn solve(q: [f64; 3], contact_first: bool) -> Vec<f64> {
        let matrix = Tridiagonal::new(&LOWER, &DIAGONAL, &UPPER).unwrap();
        brennan_schwartz(matrix, &q, contact_first).unwrap()
    }

    fn assert_close(found: &[f64], expected: &[f64]) {
        assert_eq!(found.len(), expected.len());
        for (a, b) in found.iter().zip(expected) {
            assert!((a - b).abs() <= 1e-14, "{found:?} is not {expected:?}");
        }
    }

    #[test]
    fn contact_at_either_end_is_found_from_that_end() {
        // z = (0, 1, 2): M z = (-1, 0, 3), so q = (5, 0, -3) gives w = (4, 0, 0).
        assert_close(&solve([5.0, 0.0, -3.0], true), &[0.0, 1.0, 2.0]);
        assert_close(&solve([-3.0, 0.0, 5.0], false), &[2.0, 1.0, 0.0]);
    }

    #[test]
    fn without_contact_both_directions_solve_the_linear_system() {
        // M (1, 2, 3) = (0, 0, 4).
        for contact_first in [true, false] {
            assert_close(&solve([0.0, 0.0, -4.0], contact_first), &[1.0, 2.0, 3.0]);
        }
    }

    #[test]
    fn full_contact_gives_zero() {
        for contact_first in [true, false] {
            assert_close(&solve([1.0, 1.0, 1.0], contact_first), &[0.0; 3]);
        }
    }

    #[test]
    fn an_unsymmetric_matrix_is_not_transposed() {
        // [[3, -2], [-1, 4]] z = (4, 2) has z = (2, 1).
        let matrix = Tridiagonal::new(&[-1.0], &[3.0, 4.0], &[-2.0]).unwrap();
        for contact_first in [true, false] {
            let z = brennan_schwartz(matrix, &[-4.0, -2.0], contact_first).unwrap();
            assert_close(&z, &[2.0, 1.0]);
        }
    }

    #[test]
    fn one_row_is_a_projected_division() {
        let matrix = Tridiagonal::new(&[], &[2.0], &[]).unwrap();
        assert_close(&brennan_schwartz(matrix, &[-3.0], true).unwrap(), &[1.5]);
        assert_close(&brennan_schwartz(matrix, &[3.0], false).unwrap(), &[0.0]);
    }

    #[test]
    fn a_wrong_length_is_an_error_and_nan_is_not_hidden() {
        let matrix = Tridiagonal::new(&LOWER, &DIAGONAL, &UPPER).unwrap();
        let error = brennan_schwartz(matrix, &[1.0], true).unwrap_err();
        assert_eq!(error.to_string(), "q has length 1: must be 3");
        assert!(solve([0.0, f64::NAN, 0.0], true)[1].is_nan());
    }

    #[test]
    fn a_zero_pivot_is_named_by_its_row() {
        let zero = |lower, diagonal, upper, contact_first| {
            let bands: ([f64; 1], [f64; 2], [f64; 1]) = (lower, diagonal, upper);
            let matrix = Tridiagonal::new(&bands.0, &bands.1, &bands.2).unwrap();
            brennan_schwartz(matrix, &[1.0, 1.0], contact_first).unwrap_err()
        };
        let outer = zero([-1.0], [2.0, 0.0], [-1.0], true);
        assert_eq!(outer, KernelError::ZeroPivot { row: 1 });
        let singular = zero([-1.0], [1.0, 1.0], [-1.0], false);
        assert_eq!(singular.to_string(), "pivot 1 is zero");
    }
}
