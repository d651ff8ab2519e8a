//! Jumps into a mode of a complementarity system, and the signs of its outputs just after.

use crate::error::{check_length, KernelError};

/// Share of its terms below which a sum is rounding.
const ROUNDING: f64 = 1e-13;

/// Shares of its terms' sizes below which an output, and one of its derivatives, counts as zero.
#[derive(Clone, Copy)]
pub struct SignShares {
    /// The output's own.
    pub value: f64,
    /// That of its derivatives.
    pub derivative: f64,
}

/// Return W z, zero where that is no more than rounding, and |W| sizes: W is (d, n), by rows.
///
/// # Errors
/// The lengths do not fit.
pub fn enter(
    matrix: &[f64],
    z: &[f64],
    sizes: &[f64],
) -> Result<(Vec<f64>, Vec<f64>), KernelError> {
    check_length("sizes", sizes, z.len())?;
    if z.is_empty() {
        return Ok((Vec::new(), Vec::new()));
    }
    check_length("matrix", matrix, matrix.len() / z.len() * z.len())?;
    let rows = matrix.chunks_exact(z.len());
    Ok(rows
        .map(|row| {
            let (mut sum, mut terms, mut size) = (0.0, 0.0, 0.0);
            for ((entry, value), own) in row.iter().zip(z).zip(sizes) {
                let term = entry * value;
                sum += term;
                terms += term.abs();
                size += entry.abs() * own;
            }
            (
                if f64::abs(sum) <= ROUNDING * terms {
                    0.0
                } else {
                    sum
                },
                size,
            )
        })
        .unzip())
}

/// Return the sign of each output just after the coordinates are c: of its first derivative that is not zero.
///
/// `derivatives` are the outputs as functions of c and their first derivatives, shape (orders, k, d), in a unit of time in
/// which `rate` is c' as a function of c, shape (d, d). `sizes` are those of the terms of c. What is tangential leaves a
/// slope of the order of the root of rounding: so the shares of values and derivatives differ.
///
/// # Errors
/// The lengths do not fit.
pub fn initial_signs(
    derivatives: &[f64],
    rate: &[f64],
    coordinates: &[f64],
    sizes: &[f64],
    pairs: usize,
    shares: SignShares,
) -> Result<Vec<f64>, KernelError> {
    let (d, block) = (coordinates.len(), pairs * coordinates.len());
    check_length("rate", rate, d * d)?;
    check_length("sizes", sizes, d)?;
    let mut signs = vec![0.0; pairs];
    if block == 0 {
        return Ok(signs);
    }
    let orders = derivatives.len() / block;
    check_length("derivatives", derivatives, orders * block)?;
    let outputs = &derivatives[..block];
    let rounding = ROUNDING.min(shares.derivative);
    let (mut vector, mut terms) = (coordinates.to_vec(), sizes.to_vec());
    for order in 0..=d.max(orders - 1) {
        let rows = if order < orders {
            &derivatives[order * block..(order + 1) * block]
        } else {
            outputs
        };
        for (i, sign) in signs.iter_mut().enumerate() {
            if *sign != 0.0 {
                continue;
            }
            let row = &rows[i * d..(i + 1) * d];
            // Up to the last tabulated derivative its row meets c, from there on the output meets the derivative of c.
            let value = product(row, if order < orders { coordinates } else { &vector });
            let size = size(row, sizes);
            let level = if order == 0 {
                shares.value * size
            } else {
                let own = self::size(&outputs[i * d..(i + 1) * d], &terms);
                (shares.derivative * size).max(rounding * own)
            };
            if value.abs() > level {
                *sign = value.signum();
            }
        }
        if signs.iter().all(|&sign| sign != 0.0) {
            break;
        }
        vector = rate
            .chunks_exact(d)
            .map(|row| product(row, &vector))
            .collect();
        terms = rate.chunks_exact(d).map(|row| size(row, &terms)).collect();
        if order + 1 >= orders && vector.iter().all(|&entry| entry == 0.0) {
            break;
        }
    }
    Ok(signs)
}

/// Return the sign of each output's leading impulse, 0 without one: `impulses` is (r, k, n), the highest order first.
///
/// # Errors
/// The lengths do not fit.
pub fn leading_signs(
    impulses: &[f64],
    z: &[f64],
    sizes: &[f64],
    pairs: usize,
    share: f64,
) -> Result<Vec<f64>, KernelError> {
    check_length("sizes", sizes, z.len())?;
    let mut signs = vec![0.0; pairs];
    let block = pairs * z.len();
    if block == 0 {
        return Ok(signs);
    }
    check_length("impulses", impulses, impulses.len() / block * block)?;
    for order in impulses.chunks_exact(block) {
        for (sign, row) in signs.iter_mut().zip(order.chunks_exact(z.len())) {
            let value = product(row, z);
            if *sign == 0.0 && value.abs() > share * size(row, sizes) {
                *sign = value.signum();
            }
        }
    }
    Ok(signs)
}

fn product(row: &[f64], vector: &[f64]) -> f64 {
    row.iter().zip(vector).map(|(a, b)| a * b).sum()
}

fn size(row: &[f64], sizes: &[f64]) -> f64 {
    row.iter().zip(sizes).map(|(a, b)| a.abs() * b).sum()
}

#[cfg(test)]
mod tests {
    use super::{enter, initial_signs, leading_signs, SignShares};

    const SHARES: SignShares = SignShares {
        value: 1e-11,
        derivative: 1e-9,
    };

    #[test]
    fn the_first_derivative_that_is_not_zero_decides() {
        // c' = (c_2, c_3, 0), and three outputs that all are c_1.
        let rate = [0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
        let value = [1.0, 0.0, 0.0];
        for (c, sign) in [
            ([0.0, 0.0, -3.0], -1.0),
            ([0.0, 2.0, -3.0], 1.0),
            ([1e-12, -2.0, 0.0], -1.0),
            ([0.0, 0.0, 0.0], 0.0),
        ] {
            let found = initial_signs(&value, &rate, &c, &[1.0; 3], 1, SHARES).unwrap();
            assert_eq!(found, [sign]);
        }
    }

    #[test]
    fn what_cancels_is_zero() {
        let (c, sizes) = enter(&[1.0, -1.0, 2.0, 1.0], &[0.1 + 0.2, 0.3], &[1.0, 3.0]).unwrap();
        assert_eq!(c[..1], [0.0]);
        assert_eq!(sizes, [4.0, 5.0]);
    }

    #[test]
    fn the_highest_impulse_leads() {
        let impulses = [1.0, 0.0, 0.0, 0.0, -1.0, -1.0, -1.0, 0.0];
        let signs = leading_signs(&impulses, &[2.0, 3.0], &[2.0, 3.0], 2, 1e-11).unwrap();
        assert_eq!(signs, [1.0, -1.0]);
    }
}
