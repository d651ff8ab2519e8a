//! Howard's policy iteration, the primal-dual active set method: any contact set.

use crate::error::{check_length, KernelError};
use crate::interrupt::Interrupt;
use crate::positive_part;
use crate::tridiagonal::Tridiagonal;

/// When a row changes sides, and how many systems may be solved.
#[derive(Clone, Copy, Debug)]
pub struct Settling {
    /// A row changes sides where its z or w is more negative than this share of the row's terms.
    pub tolerance: f64,
    /// The largest number of linear systems.
    pub limit: u32,
}

/// Write z of 0 <= z, 0 <= M z + q, complementary, and return the number of linear systems solved.
///
/// Each of them has M z + q = 0 on the basic set and z = 0 elsewhere; then rows with z < 0 leave the set
/// and rows with M z + q < 0 enter it. The set is a guess on entry, that of z on return. For an
/// M-matrix z never falls from the second system on, so that n + 1 are enough. The number is
/// `limit + 1` where that was reached in vain, and one more than were solved where `interrupt` ended the work. NaN in the data stays NaN. Cost O(n) per system.
///
/// # Errors
/// `q`, `basic_set` or `z` is not as long as the diagonal, or a pivot is zero, which it cannot be for
/// an M-matrix.
pub fn policy_iteration(
    matrix: Tridiagonal<'_>,
    q: &[f64],
    basic_set: &mut [bool],
    z: &mut [f64],
    settling: Settling,
    interrupt: Interrupt<'_>,
) -> Result<u64, KernelError> {
    check_length("q", q, matrix.size())?;
    check_length("basic_set", basic_set, matrix.size())?;
    check_length("z", z, matrix.size())?;
    let mut multiplier = vec![0.0; matrix.size()];
    iterate(
        matrix,
        q,
        basic_set,
        z,
        &mut multiplier,
        settling,
        interrupt,
    )
}

/// `policy_iteration` on slices that fit the matrix, with a buffer as long as z.
pub(crate) fn iterate(
    matrix: Tridiagonal<'_>,
    q: &[f64],
    basic_set: &mut [bool],
    z: &mut [f64],
    multiplier: &mut [f64],
    settling: Settling,
    interrupt: Interrupt<'_>,
) -> Result<u64, KernelError> {
    let mut systems = 0;
    let mut settled = false;
    while !settled && systems < u64::from(settling.limit) && (systems == 0 || !interrupt()) {
        solve_on(matrix, q, basic_set, z, multiplier)?;
        settled = !exchange(matrix, q, z, settling.tolerance, basic_set);
        systems += 1;
    }
    for value in z.iter_mut() {
        *value = positive_part(*value);
    }
    Ok(if settled { systems } else { systems + 1 })
}

/// Solve M z + q = 0 on the basic set, z = 0 elsewhere: elimination downwards, substitution upwards.
fn solve_on(
    matrix: Tridiagonal<'_>,
    q: &[f64],
    basic_set: &[bool],
    z: &mut [f64],
    multiplier: &mut [f64],
) -> Result<(), KernelError> {
    let size = z.len();
    let (mut before, mut factor) = (0.0, 0.0);
    for i in 0..size {
        if basic_set[i] {
            let below = if i > 0 { matrix.lower[i - 1] } else { 0.0 };
            let above = if i + 1 < size { matrix.upper[i] } else { 0.0 };
            let pivot = matrix.diagonal[i] - below * factor;
            if pivot == 0.0 {
                return Err(KernelError::ZeroPivot { row: i });
            }
            before = (-q[i] - below * before) / pivot;
            factor = above / pivot;
        } else {
            (before, factor) = (0.0, 0.0);
        }
        (z[i], multiplier[i]) = (before, factor);
    }
    for i in (1..size).rev() {
        if basic_set[i - 1] {
            z[i - 1] -= multiplier[i - 1] * z[i];
        }
    }
    Ok(())
}

/// Move the rows with a wrong sign to the other side; return whether there were any.
fn exchange(
    matrix: Tridiagonal<'_>,
    q: &[f64],
    z: &[f64],
    tolerance: f64,
    basic_set: &mut [bool],
) -> bool {
    let size = z.len();
    let mut moved = false;
    for i in 0..size {
        let own = matrix.diagonal[i].abs() * z[i];
        let below = if i > 0 {
            matrix.lower[i - 1] * z[i - 1]
        } else {
            0.0
        };
        let above = if i + 1 < size {
            matrix.upper[i] * z[i + 1]
        } else {
            0.0
        };
        let terms = own.abs() + below.abs() + above.abs() + q[i].abs();
        let slack = below + above + q[i];
        let wrong = if basic_set[i] {
            own < -tolerance * terms
        } else {
            slack < -tolerance * terms || slack.is_nan() // a basic row shows it in z
        };
        basic_set[i] ^= wrong;
        moved |= wrong;
    }
    moved
}

#[cfg(test)]
mod tests {
    use super::{policy_iteration, KernelError, Settling, Tridiagonal};
    use crate::interrupt::never;

    const SETTLING: Settling = Settling {
        tolerance: 1e-14,
        limit: 20,
    };

    /// Solve with the string's matrix, bands (-1, 2, -1); return z and the number of systems.
    fn solve(q: &[f64], basic_set: &mut [bool], settling: Settling) -> (Vec<f64>, u64) {
        let (coupling, diagonal) = (vec![-1.0; q.len() - 1], vec![2.0; q.len()]);
        let matrix = Tridiagonal::new(&coupling, &diagonal, &coupling).unwrap();
        let mut z = vec![7.0; q.len()];
        let systems = policy_iteration(matrix, q, basic_set, &mut z, settling, &never).unwrap();
        (z, systems)
    }

    fn assert_close(found: &[f64], expected: &[f64]) {
        assert_eq!(found.len(), expected.len());
        for (a, b) in found.iter().zip(expected) {
            assert!((a - b).abs() <= 1e-14, "{found:?} is not {expected:?}");
        }
    }

    #[test]
    fn contact_in_the_middle_is_found_from_any_start() {
        // z = (1, 0, 2): M z = (2, -3, 4), so q = (-2, 5, -4) gives w = (0, 2, 0).
        for start in 0..8_u8 {
            let mut basic_set = [start & 1 > 0, start & 2 > 0, start & 4 > 0];
            let (z, systems) = solve(&[-2.0, 5.0, -4.0], &mut basic_set, SETTLING);
            assert_close(&z, &[1.0, 0.0, 2.0]);
            assert_eq!(basic_set, [true, false, true]);
            assert!(systems <= 4);
        }
    }

    #[test]
    fn two_contact_runs_and_a_free_run_between_them_are_found() {
        // z = (0, 1, 2, 0, 1): M z = (-1, 0, 3, -3, 2).
        let q = [4.0, 0.0, -3.0, 5.0, -2.0];
        let (z, _) = solve(&q, &mut [false; 5], SETTLING);
        assert_close(&z, &[0.0, 1.0, 2.0, 0.0, 1.0]);
    }

    #[test]
    fn the_right_start_takes_one_system() {
        let (_, systems) = solve(&[-2.0, 5.0, -4.0], &mut [true, false, true], SETTLING);
        assert_eq!(systems, 1);
    }

    #[test]
    fn no_contact_and_full_contact_are_found() {
        assert_close(
            &solve(&[0.0, 0.0, -4.0], &mut [false; 3], SETTLING).0,
            &[1.0, 2.0, 3.0],
        );
        assert_close(
            &solve(&[1.0, 1.0, 1.0], &mut [true; 3], SETTLING).0,
            &[0.0; 3],
        );
        assert_close(&solve(&[-3.0], &mut [false], SETTLING).0, &[1.5]);
    }

    #[test]
    fn an_unsymmetric_matrix_is_not_transposed() {
        // [[3, -2], [-1, 4]] z = (4, 2) has z = (2, 1).
        let matrix = Tridiagonal::new(&[-1.0], &[3.0, 4.0], &[-2.0]).unwrap();
        let mut z = [0.0; 2];
        policy_iteration(
            matrix,
            &[-4.0, -2.0],
            &mut [true; 2],
            &mut z,
            SETTLING,
            &never,
        )
        .unwrap();
        assert_close(&z, &[2.0, 1.0]);
    }

    #[test]
    fn a_limit_that_is_too_small_is_reported() {
        for limit in 0..2 {
            let settling = Settling { limit, ..SETTLING };
            let (z, systems) = solve(&[-2.0, 5.0, -4.0], &mut [false; 3], settling);
            assert_eq!(systems, u64::from(limit) + 1);
            assert!(z.iter().all(|value| *value >= 0.0));
        }
    }

    #[test]
    fn a_matrix_that_goes_round_is_stopped() {
        // [[1, -2], [-2, 1]] z = (1, 1) has z = (-1, -1): both rows leave, then both enter.
        let matrix = Tridiagonal::new(&[-2.0], &[1.0, 1.0], &[-2.0]).unwrap();
        let (mut z, mut basic_set) = ([0.0; 2], [true; 2]);
        let systems = policy_iteration(
            matrix,
            &[-1.0, -1.0],
            &mut basic_set,
            &mut z,
            SETTLING,
            &never,
        );
        assert_eq!(systems, Ok(21));
    }

    #[test]
    fn rounding_does_not_move_a_row() {
        // w of row 1 is -1e-16 beside terms of 1.
        let (z, systems) = solve(
            &[-1.0, 0.5 - 1e-16, 1.0],
            &mut [true, false, false],
            SETTLING,
        );
        assert_close(&z, &[0.5, 0.0, 0.0]);
        assert_eq!(systems, 1);
    }

    #[test]
    fn nan_is_not_hidden() {
        for start in [true, false] {
            let (z, _) = solve(&[-1.0, f64::NAN, -1.0], &mut [start; 3], SETTLING);
            assert!(z[1].is_nan());
        }
    }

    #[test]
    fn wrong_lengths_and_zero_pivots_are_named() {
        let matrix = Tridiagonal::new(&[-1.0], &[1.0, 1.0], &[-1.0]).unwrap();
        let message = |q: &[f64], basic_set: &mut [bool], z: &mut [f64]| {
            let error = policy_iteration(matrix, q, basic_set, z, SETTLING, &never).unwrap_err();
            error.to_string()
        };
        assert_eq!(
            message(&[1.0], &mut [true; 2], &mut [0.0; 2]),
            "q has length 1: must be 2"
        );
        let start = message(&[1.0; 2], &mut [true; 3], &mut [0.0; 2]);
        assert_eq!(start, "basic_set has length 3: must be 2");
        assert_eq!(
            message(&[1.0; 2], &mut [true; 2], &mut []),
            "z has length 0: must be 2"
        );
        assert_eq!(
            message(&[-1.0; 2], &mut [true; 2], &mut [0.0; 2]),
            "pivot 1 is zero"
        );
        assert_eq!(
            policy_iteration(
                matrix,
                &[-1.0; 2],
                &mut [true; 2],
                &mut [0.0; 2],
                SETTLING,
                &never
            ),
            Err(KernelError::ZeroPivot { row: 1 })
        );
    }
}
