//! Projected Gauss-Seidel sweeps over the rows of a sparse matrix, between bounds.

use crate::error::{check_length, KernelError};
use crate::interrupt::Interrupt;

/// A square matrix by rows: row i has the entries `first[i]..first[i + 1]` of `columns` and `entries`.
#[derive(Clone, Copy, Debug)]
pub struct SparseRows<'a> {
    first: &'a [usize],
    columns: &'a [usize],
    entries: &'a [f64],
}

impl<'a> SparseRows<'a> {
    /// Check that the parts make a square matrix.
    ///
    /// # Errors
    /// `entries` is not as long as `columns`, or an index is too large for its array.
    pub fn new(
        first: &'a [usize],
        columns: &'a [usize],
        entries: &'a [f64],
    ) -> Result<Self, KernelError> {
        check_length("data", entries, columns.len())?;
        let size = first.len().saturating_sub(1);
        let rising = first.windows(2).all(|pair| pair[0] <= pair[1]);
        if !rising || first.last() != Some(&columns.len()) || columns.iter().any(|&j| j >= size) {
            return Err(KernelError::Length {
                name: "indices",
                found: columns.len(),
                required: first.last().copied().unwrap_or(0),
            });
        }
        Ok(Self {
            first,
            columns,
            entries,
        })
    }

    /// The number of rows.
    #[must_use]
    pub fn size(&self) -> usize {
        self.first.len() - 1
    }
}

/// Where every entry of the solution must lie; either bound may be infinite.
#[derive(Clone, Copy, Debug)]
pub struct Bounds<'a> {
    /// The lower bounds.
    pub lower: &'a [f64],
    /// The upper bounds.
    pub upper: &'a [f64],
}

/// How the sweeps are weighted and directed, and when they stop.
#[derive(Clone, Copy, Debug)]
pub struct SparseSweeping {
    /// The factor on each correction.
    pub relaxation: f64,
    /// Stop when no entry of z changes by more than this in a sweep.
    pub tolerance: f64,
    /// The largest number of sweeps.
    pub limit: u32,
    /// Whether every second sweep runs from the last row to the first.
    pub alternating: bool,
}

/// Improve z in place and return the number of sweeps: `limit + 1` where it was reached, or the work ended, in vain.
///
/// # Errors
/// A vector is not as long as the matrix has rows, or a diagonal entry is zero or missing.
pub fn sparse_sweeps(
    matrix: SparseRows<'_>,
    q: &[f64],
    bounds: Bounds<'_>,
    z: &mut [f64],
    sweeping: SparseSweeping,
    interrupt: Interrupt<'_>,
) -> Result<u64, KernelError> {
    let size = matrix.size();
    check_length("q", q, size)?;
    check_length("lower", bounds.lower, size)?;
    check_length("upper", bounds.upper, size)?;
    check_length("z", z, size)?;
    for sweeps in 1..=u64::from(sweeping.limit) {
        let mut settled = true;
        let backward = sweeping.alternating && sweeps % 2 == 0;
        for k in 0..size {
            let i = if backward { size - 1 - k } else { k };
            let (mut slack, mut pivot) = (q[i], 0.0);
            for p in matrix.first[i]..matrix.first[i + 1] {
                let (j, entry) = (matrix.columns[p], matrix.entries[p]);
                slack += entry * z[j];
                if j == i {
                    pivot += entry;
                }
            }
            if pivot == 0.0 {
                return Err(KernelError::ZeroPivot { row: i });
            }
            let moved = z[i] - sweeping.relaxation * (slack / pivot);
            let next = between(moved, bounds.lower[i], bounds.upper[i]);
            settled &= (next - z[i]).abs() <= sweeping.tolerance; // false for NaN
            z[i] = next;
        }
        if settled {
            return Ok(sweeps);
        }
        if interrupt() {
            break;
        }
    }
    Ok(u64::from(sweeping.limit) + 1)
}

/// The nearest number between the bounds; NaN stays NaN.
fn between(x: f64, lower: f64, upper: f64) -> f64 {
    if x < lower {
        lower
    } else if x > upper {
        upper
    } else {
        x
    }
}

#[cfg(test)]
mod tests {
    use super::{sparse_sweeps, Bounds, SparseRows, SparseSweeping};
    use crate::interrupt::never;
    use crate::KernelError;

    const FIRST: [usize; 4] = [0, 2, 5, 7];
    const COLUMNS: [usize; 7] = [0, 1, 0, 1, 2, 1, 2];
    const ENTRIES: [f64; 7] = [2.0, -1.0, -1.0, 2.0, -1.0, -1.0, 2.0];
    const INFINITE: f64 = f64::INFINITY;

    fn swept(q: [f64; 3], upper: f64, limit: u32, alternating: bool) -> ([f64; 3], u64) {
        let matrix = SparseRows::new(&FIRST, &COLUMNS, &ENTRIES).unwrap();
        let (lower, upper) = ([0.0; 3], [upper; 3]);
        let sweeping = SparseSweeping {
            relaxation: 1.0,
            tolerance: 1e-14,
            limit,
            alternating,
        };
        let bounds = Bounds {
            lower: &lower,
            upper: &upper,
        };
        let mut z = [0.0; 3];
        let sweeps = sparse_sweeps(matrix, &q, bounds, &mut z, sweeping, &never).unwrap();
        (z, sweeps)
    }

    #[test]
    fn the_first_sweep_is_gauss_seidel_with_projection() {
        // By hand: max(0, 2/2) = 1, then max(0, (-5 + 1)/2) = 0, then max(0, (2 + 0)/2) = 1.
        let (z, sweeps) = swept([-2.0, 5.0, -2.0], INFINITE, 1, false);
        assert_eq!(z.map(f64::to_bits), [1.0, 0.0, 1.0].map(f64::to_bits));
        assert_eq!(sweeps, 2);
    }

    #[test]
    fn every_second_sweep_may_run_backward() {
        // q = (-2, 0, -8): forward (1, 1/2, 17/4); backward z2 = 17/4, z1 = 21/8, z0 = 37/16.
        let (z, _) = swept([-2.0, 0.0, -8.0], INFINITE, 2, true);
        for (found, expected) in z.iter().zip([37.0 / 16.0, 21.0 / 8.0, 17.0 / 4.0]) {
            assert!((found - expected).abs() < 1e-15);
        }
    }

    #[test]
    fn bounds_hold_and_the_solution_is_met() {
        // Without bounds z = (1, 2, 3) for q = (0, 0, -4); below 2: z = (2/3, 4/3, 2).
        let (z, sweeps) = swept([0.0, 0.0, -4.0], 2.0, 200, true);
        assert!(sweeps <= 200);
        for (found, expected) in z.iter().zip([2.0 / 3.0, 4.0 / 3.0, 2.0]) {
            assert!((found - expected).abs() < 1e-13);
        }
    }

    #[test]
    fn what_is_no_matrix_is_refused() {
        assert!(SparseRows::new(&FIRST, &COLUMNS, &ENTRIES[1..]).is_err());
        assert!(SparseRows::new(&[0, 2, 1, 7], &COLUMNS, &ENTRIES).is_err());
        assert!(SparseRows::new(&FIRST, &[0, 1, 0, 1, 3, 1, 2], &ENTRIES).is_err());
        let matrix = SparseRows::new(&[0, 0], &[], &[]).unwrap();
        let bounds = Bounds {
            lower: &[0.0],
            upper: &[1.0],
        };
        let sweeping = SparseSweeping {
            relaxation: 1.0,
            tolerance: 0.0,
            limit: 1,
            alternating: false,
        };
        let found = sparse_sweeps(matrix, &[1.0], bounds, &mut [0.0], sweeping, &never);
        assert_eq!(found, Err(KernelError::ZeroPivot { row: 0 }));
    }
}
