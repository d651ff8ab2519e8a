//! The basic set of a tridiagonal problem with an M-matrix, with any number of contact runs, in one pass.

use crate::error::{check_length, KernelError};
use crate::tridiagonal::Tridiagonal;

/// A run of rows with w = 0, as its end values depend on those of its neighbours:
/// the first value is `first[0]` + `first[1]` (the value before) + `first[2]` (the value after), the last one likewise.
#[derive(Clone, Copy)]
struct Run {
    from: usize,
    to: usize, // included
    first: [f64; 3],
    last: [f64; 3],
}

/// Return for each row whether it is basic (w = 0, z > 0) in the solution of 0 <= z, 0 <= M z + q, complementary.
///
/// The leading problems of order 1, 2, ... are solved in turn. For an M-matrix z grows with each further row, so that a
/// basic row remains basic: a new row with a negative slack starts a run or joins the last one, which then takes in the
/// contact rows before it as long as their slacks are negative. Every row joins a run once, in a few operations, since a
/// run is known by the dependence of its end values on its neighbours. Rounding may put rows on the wrong side where z
/// and w are both nearly zero, and for other matrices the set is a guess. Cost O(n).
///
/// Source: the idea of adding rows one by one is that of Cryer 1983, for tridiagonal Minkowski matrices.
///
/// # Errors
/// `q` is not as long as the diagonal.
pub fn growing_basic_set(matrix: Tridiagonal<'_>, q: &[f64]) -> Result<Vec<bool>, KernelError> {
    check_length("q", q, matrix.size())?;
    let mut runs: Vec<Run> = Vec::new();
    for k in 0..matrix.size() {
        let before = ending_at(&runs, k);
        if slack(matrix, q, k, before.map_or(0.0, |run| run.last[0]), 0.0) >= 0.0 {
            continue;
        }
        let mut run = single(matrix, q, k);
        if let Some(left) = before {
            runs.pop();
            run = joined(left, run);
        }
        while run.from > 0 {
            let contact = run.from - 1;
            let before = ending_at(&runs, contact);
            let end = before.map_or(0.0, |run| run.last[0]);
            if slack(matrix, q, contact, end, run.first[0]) >= 0.0 {
                break;
            }
            run = joined(single(matrix, q, contact), run);
            if let Some(left) = before {
                runs.pop();
                run = joined(left, run);
            }
        }
        runs.push(run);
    }
    let mut basic_set = vec![false; matrix.size()];
    for run in runs {
        basic_set[run.from..=run.to].fill(true);
    }
    Ok(basic_set)
}

/// The last run if it ends just before row k.
fn ending_at(runs: &[Run], k: usize) -> Option<Run> {
    runs.last().copied().filter(|run| run.to + 1 == k)
}

/// w of row k with z = 0 there, for the values of z before and after it.
fn slack(matrix: Tridiagonal<'_>, q: &[f64], k: usize, before: f64, after: f64) -> f64 {
    let (lower, upper) = couplings(matrix, k);
    q[k] + lower * before + upper * after
}

fn couplings(matrix: Tridiagonal<'_>, k: usize) -> (f64, f64) {
    let lower = if k > 0 { matrix.lower[k - 1] } else { 0.0 };
    let upper = if k + 1 < matrix.size() {
        matrix.upper[k]
    } else {
        0.0
    };
    (lower, upper)
}

fn single(matrix: Tridiagonal<'_>, q: &[f64], k: usize) -> Run {
    let (lower, upper) = couplings(matrix, k);
    let reciprocal = 1.0 / matrix.diagonal[k];
    let values = [-q[k] * reciprocal, -lower * reciprocal, -upper * reciprocal];
    Run {
        from: k,
        to: k,
        first: values,
        last: values,
    }
}

/// The run of two neighbouring ones: the values at their border are eliminated.
fn joined(left: Run, right: Run) -> Run {
    let (end, start) = (left.last, right.first);
    let reciprocal = 1.0 / (1.0 - end[2] * start[1]);
    // The last value of the left run and the first one of the right run.
    let at_end = [
        (end[0] + end[2] * start[0]) * reciprocal,
        end[1] * reciprocal,
        end[2] * start[2] * reciprocal,
    ];
    let at_start = [
        (start[0] + start[1] * end[0]) * reciprocal,
        start[1] * end[1] * reciprocal,
        start[2] * reciprocal,
    ];
    let (first, last) = (left.first, right.last);
    Run {
        from: left.from,
        to: right.to,
        first: [
            first[0] + first[2] * at_start[0],
            first[1] + first[2] * at_start[1],
            first[2] * at_start[2],
        ],
        last: [
            last[0] + last[1] * at_end[0],
            last[1] * at_end[1],
            last[2] + last[1] * at_end[2],
        ],
    }
}

#[cfg(test)]
mod tests {
    use super::{growing_basic_set, Tridiagonal};

    fn string(q: &[f64]) -> Vec<bool> {
        let (coupling, diagonal) = (vec![-1.0; q.len() - 1], vec![2.0; q.len()]);
        let matrix = Tridiagonal::new(&coupling, &diagonal, &coupling).unwrap();
        growing_basic_set(matrix, q).unwrap()
    }

    #[test]
    fn two_contact_runs_and_a_free_run_between_them_are_found() {
        // z = (0, 1, 2, 0, 1): M z = (-1, 0, 3, -3, 2).
        let found = string(&[4.0, 0.0, -3.0, 5.0, -2.0]);
        assert_eq!(found, [false, true, true, false, true]);
    }

    #[test]
    fn a_late_load_lifts_all_contacts_before_it() {
        // M (1, 2, 3, 4) = (0, 0, 0, 5), and with a hair less load on the rows before.
        assert_eq!(string(&[-1e-9, 1e-9, 1e-9, -5.0]), [true; 4]);
    }

    #[test]
    fn full_contact_and_one_row_are_found() {
        assert_eq!(string(&[1.0, 0.0, 1.0]), [false; 3]);
        assert_eq!(string(&[-1.0]), [true]);
    }

    #[test]
    fn a_wrong_length_is_named() {
        let matrix = Tridiagonal::new(&[-1.0], &[2.0, 2.0], &[-1.0]).unwrap();
        let error = growing_basic_set(matrix, &[1.0]).unwrap_err();
        assert_eq!(error.to_string(), "q has length 1: must be 2");
    }
}
