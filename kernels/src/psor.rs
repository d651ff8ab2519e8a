//! Projected successive over-relaxation (Cryer 1971).

use crate::error::{check_length, KernelError};
use crate::interrupt::Interrupt;
use crate::positive_part;
use crate::tridiagonal::Tridiagonal;

/// How the sweeps are weighted and when they stop.
#[derive(Clone, Copy, Debug)]
pub struct Sweeping {
    /// The factor on each correction; convergence for an M-matrix needs 0 < relaxation < 2.
    pub relaxation: f64,
    /// Stop when no entry of z changes by more than this in a sweep.
    pub tolerance: f64,
    /// The largest number of sweeps.
    pub limit: u32,
}

/// Improve z in place and return the number of sweeps: `limit + 1` where it was reached, or the work ended, in vain.
///
/// # Errors
/// `q` or `z` is not as long as the diagonal, or a diagonal entry is zero.
pub fn projected_sor(
    matrix: Tridiagonal<'_>,
    q: &[f64],
    z: &mut [f64],
    sweeping: Sweeping,
    interrupt: Interrupt<'_>,
) -> Result<u64, KernelError> {
    check_length("q", q, matrix.size())?;
    check_length("z", z, matrix.size())?;
    if let Some(row) = matrix.diagonal.iter().position(|pivot| *pivot == 0.0) {
        return Err(KernelError::ZeroPivot { row });
    }
    let weights: Vec<f64> = matrix
        .diagonal
        .iter()
        .map(|pivot| sweeping.relaxation / pivot)
        .collect();
    for sweeps in 1..=u64::from(sweeping.limit) {
        if sweep(matrix, q, &weights, z, sweeping.tolerance) {
            return Ok(sweeps);
        }
        if interrupt() {
            break;
        }
    }
    Ok(u64::from(sweeping.limit) + 1)
}

/// Run through the rows once; return whether every entry stayed within the tolerance.
fn sweep(matrix: Tridiagonal<'_>, q: &[f64], weights: &[f64], z: &mut [f64], within: f64) -> bool {
    let size = z.len();
    let mut settled = true;
    let mut before = 0.0;
    for i in 0..size {
        // The freshest value comes last, which keeps the chain from row to row short.
        let mut slack = q[i] + matrix.diagonal[i] * z[i];
        if i + 1 < size {
            slack += matrix.upper[i] * z[i + 1];
        }
        if i > 0 {
            slack += matrix.lower[i - 1] * before;
        }
        before = positive_part(z[i] - weights[i] * slack);
        settled &= (before - z[i]).abs() <= within; // false for NaN
        z[i] = before;
    }
    settled
}

#[cfg(test)]
mod tests {
    use super::{projected_sor, Sweeping, Tridiagonal};
    use crate::interrupt::never;

    const ONCE: Sweeping = Sweeping {
        relaxation: 1.0,
        tolerance: 1e-13,
        limit: 1,
    };

    #[test]
    fn the_first_sweep_is_gauss_seidel_with_projection() {
        // By hand: max(0, 2/2) = 1, then max(0, (-5 + 1)/2) = 0, then max(0, (2 + 0)/2) = 1.
        let matrix = Tridiagonal::new(&[-1.0; 2], &[2.0; 3], &[-1.0; 2]).unwrap();
        let mut z = [0.0; 3];
        let sweeps = projected_sor(matrix, &[-2.0, 5.0, -2.0], &mut z, ONCE, &never).unwrap();
        assert_eq!(sweeps, 2);
        assert_eq!(z.map(f64::to_bits), [1.0, 0.0, 1.0].map(f64::to_bits));
    }

    #[test]
    fn it_converges_to_the_solution_with_contact_in_the_middle() {
        // z = (1, 0, 1): M z = (2, -2, 2), so q = (-2, 5, -2) gives w = (0, 3, 0).
        let matrix = Tridiagonal::new(&[-1.0; 2], &[2.0; 3], &[-1.0; 2]).unwrap();
        let sweeping = Sweeping {
            relaxation: 1.2,
            tolerance: 1e-13,
            limit: 200,
        };
        let mut z = [7.0, 7.0, 7.0];
        let sweeps = projected_sor(matrix, &[-2.0, 5.0, -2.0], &mut z, sweeping, &never).unwrap();
        assert!(sweeps <= 200);
        for (found, expected) in z.iter().zip([1.0, 0.0, 1.0]) {
            assert!((found - expected).abs() <= 1e-12, "{z:?}");
        }
    }

    #[test]
    fn one_row_settles_in_the_second_sweep() {
        let matrix = Tridiagonal::new(&[], &[2.0], &[]).unwrap();
        let mut z = [0.0];
        let twice = Sweeping { limit: 2, ..ONCE };
        assert_eq!(projected_sor(matrix, &[-3.0], &mut z, twice, &never), Ok(2));
        assert_eq!(z[0].to_bits(), 1.5_f64.to_bits());
    }

    #[test]
    fn no_sweeps_and_nan_are_reported_as_the_limit() {
        let matrix = Tridiagonal::new(&[], &[2.0], &[]).unwrap();
        let none = Sweeping { limit: 0, ..ONCE };
        assert_eq!(
            projected_sor(matrix, &[-3.0], &mut [4.0], none, &never),
            Ok(1)
        );
        assert_eq!(
            projected_sor(matrix, &[f64::NAN], &mut [0.0], ONCE, &never),
            Ok(2)
        );
    }

    #[test]
    fn wrong_lengths_and_zero_pivots_are_named() {
        let matrix = Tridiagonal::new(&[], &[2.0], &[]).unwrap();
        let q = projected_sor(matrix, &[], &mut [0.0], ONCE, &never).unwrap_err();
        assert_eq!(q.to_string(), "q has length 0: must be 1");
        let z = projected_sor(matrix, &[1.0], &mut [], ONCE, &never).unwrap_err();
        assert_eq!(z.to_string(), "z has length 0: must be 1");
        let matrix = Tridiagonal::new(&[1.0], &[2.0, 0.0], &[1.0]).unwrap();
        let pivot = projected_sor(matrix, &[1.0; 2], &mut [0.0; 2], ONCE, &never).unwrap_err();
        assert_eq!(pivot.to_string(), "pivot 1 is zero");
    }
}
