//! Small dense linear systems.

/// The number added to each diagonal entry, as a share of the largest; chosen: it lifts a zero and changes nothing else.
const LIFT: f64 = 1e-12;
/// The number added where all entries are zero.
const SMALLEST_LIFT: f64 = 1e-300;

/// Keep the diagonal of an m x m matrix away from zero.
pub fn lift_diagonal(matrix: &mut [f64], m: usize) {
    let most = (0..m).fold(0.0_f64, |most, k| most.max(matrix[k * m + k].abs()));
    let lift = LIFT * most + SMALLEST_LIFT;
    for k in 0..m {
        let entry = &mut matrix[k * m + k];
        *entry += if *entry < 0.0 { -lift } else { lift };
    }
}

/// Solve the system in place by elimination with row exchanges; false where it is singular or not finite.
pub fn eliminate(matrix: &mut [f64], rhs: &mut [f64]) -> bool {
    let n = rhs.len();
    for k in 0..n {
        let mut pivot = k;
        for i in k + 1..n {
            if matrix[i * n + k].abs() > matrix[pivot * n + k].abs() {
                pivot = i;
            }
        }
        let diagonal = matrix[pivot * n + k];
        if !diagonal.is_finite() || diagonal.abs() == 0.0 {
            return false;
        }
        if pivot != k {
            for j in 0..n {
                matrix.swap(k * n + j, pivot * n + j);
            }
            rhs.swap(k, pivot);
        }
        for i in k + 1..n {
            let factor = matrix[i * n + k] / diagonal;
            for j in k..n {
                matrix[i * n + j] -= factor * matrix[k * n + j];
            }
            rhs[i] -= factor * rhs[k];
        }
    }
    for k in (0..n).rev() {
        let mut sum = rhs[k];
        for j in k + 1..n {
            sum -= matrix[k * n + j] * rhs[j];
        }
        rhs[k] = sum / matrix[k * n + k];
    }
    rhs.iter().all(|x| x.is_finite())
}

#[cfg(test)]
mod tests {
    use super::eliminate;

    #[test]
    fn rows_are_exchanged_where_the_pivot_is_zero() {
        // [[0, 2], [1, 1]] x = (4, 3) has x = (1, 2).
        let mut rhs = [4.0, 3.0];
        assert!(eliminate(&mut [0.0, 2.0, 1.0, 1.0], &mut rhs));
        assert!((rhs[0] - 1.0).abs() + (rhs[1] - 2.0).abs() < 1e-15);
    }

    #[test]
    fn a_singular_matrix_is_refused() {
        assert!(!eliminate(&mut [1.0, 2.0, 2.0, 4.0], &mut [1.0, 1.0]));
    }
}
