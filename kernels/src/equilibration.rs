//! Row and column factors that bring the largest entries of a matrix near one (Ruiz 2001).

use crate::error::{check_length, KernelError};

/// Largest number of rounds: each halves the logarithm of what is left, so that 1e24 is within 2 % of 1 after twelve.
const ROUNDS: u32 = 12;
/// Largest distance from one, of all factors of a round, at which the rounds end.
const CLOSE: f64 = 0.01;
/// Largest binary exponent of a factor: products of two factors stay inside the range of a double.
const LARGEST_EXPONENT: f64 = 400.0;

/// Return the diagonals of R and C, powers of two, for which R M C has its largest entries near one; M by rows.
///
/// The factor of an empty row or column is one. A symmetric M stays symmetric. Cost O(n^2).
///
/// # Errors
/// `entries` does not have `size` squared entries.
pub fn equilibrate(entries: &[f64], size: usize) -> Result<(Vec<f64>, Vec<f64>), KernelError> {
    check_length("M", entries, size * size)?;
    let (mut row, mut column) = (vec![1.0_f64; size], vec![1.0_f64; size]);
    let (mut by_row, mut by_column) = (vec![0.0_f64; size], vec![0.0_f64; size]);
    for _ in 0..ROUNDS {
        by_column.fill(0.0);
        for (i, values) in entries.chunks_exact(size.max(1)).enumerate() {
            by_row[i] = 0.0;
            for (j, value) in values.iter().enumerate() {
                let magnitude = (row[i] * value * column[j]).abs();
                by_row[i] = by_row[i].max(magnitude);
                by_column[j] = by_column[j].max(magnitude);
            }
        }
        let mut settled = true;
        let factors = row.iter_mut().chain(column.iter_mut());
        for (factor, largest) in factors.zip(by_row.iter().chain(&by_column)) {
            let change = inverse_root(*largest);
            *factor *= change;
            settled &= (change - 1.0).abs() <= CLOSE;
        }
        if settled {
            break;
        }
    }
    for factor in row.iter_mut().chain(column.iter_mut()) {
        let exponent = factor.log2().round_ties_even();
        *factor = exponent.clamp(-LARGEST_EXPONENT, LARGEST_EXPONENT).exp2();
    }
    Ok((row, column))
}

fn inverse_root(largest: f64) -> f64 {
    if largest > 0.0 {
        1.0 / largest.sqrt()
    } else {
        1.0
    }
}

#[cfg(test)]
mod tests {
    use super::equilibrate;

    #[test]
    fn a_diagonal_becomes_ones() {
        let (row, column) = equilibrate(&[4.0, 0.0, 0.0, 64.0], 2).unwrap();
        assert_eq!(row, [0.5, 0.125]);
        assert_eq!(column, [0.5, 0.125]);
    }

    #[test]
    fn empty_rows_keep_their_size_and_extremes_stay_finite() {
        let (row, column) = equilibrate(&[0.0, 0.0, 0.0, 1e-200], 2).unwrap();
        assert_eq!((row[0], column[0]), (1.0, 1.0));
        assert!((row[1] * 1e-200 * column[1] - 1.0).abs() < 0.5);
        assert_eq!(equilibrate(&[], 0).unwrap(), (vec![], vec![]));
    }

    #[test]
    fn a_wrong_length_is_named() {
        let error = equilibrate(&[1.0; 3], 2).unwrap_err();
        assert_eq!(error.to_string(), "M has length 3: must be 4");
    }
}
