//! A march of American and European options of all strikes side by side, which share the matrix of every step.

use crate::error::{check_length, KernelError};

/// The steps of a march: what multiplies the values of the last two times, and the matrix of each step.
#[derive(Clone, Copy, Debug)]
pub struct StrikeSteps<'a> {
    /// The factors of the values now and before them, two for each step: (`steps`, 2).
    pub factors: &'a [f64],
    /// The lower, middle and upper diagonal of each step: (`steps`, 3, `nodes`).
    pub matrices: &'a [f64],
    /// How many nodes there are; the exercise region is at the first ones.
    pub nodes: usize,
}

/// Return the values after all steps, (`nodes`, `columns`): A v = f values - b before in each step, and for the first
/// columns, as many as `obstacle` has, the complementarity problem v >= obstacle, A v >= f values - b before.
///
/// Brennan and Schwartz (1977): after elimination towards the first node the solution leaves the obstacle where the right
/// side exceeds what contact up to there would give. At the last node it does at the latest.
///
/// # Errors
/// Arrays whose lengths do not fit.
pub fn march_strikes(
    steps: StrikeSteps<'_>,
    values: &[f64],
    obstacle: &[f64],
) -> Result<Vec<f64>, KernelError> {
    let nodes = steps.nodes;
    let (columns, american) = (values.len() / nodes.max(1), obstacle.len() / nodes.max(1));
    check_length("values", values, nodes * columns)?;
    check_length("obstacle", obstacle, nodes * american)?;
    let count = steps.factors.len() / 2;
    check_length("matrices", steps.matrices, 3 * nodes * count)?;
    if nodes == 0 || american > columns {
        return Err(KernelError::Empty);
    }
    let (mut now, mut before) = (values.to_vec(), values.to_vec());
    let (mut pivots, mut held) = (vec![0.0; nodes], vec![false; american]);
    for (factors, matrix) in steps
        .factors
        .chunks_exact(2)
        .zip(steps.matrices.chunks_exact(3 * nodes))
    {
        let (lower, rest) = matrix.split_at(nodes);
        let (middle, upper) = rest.split_at(nodes);
        for (old, new) in before.iter_mut().zip(&now) {
            *old = factors[0] * new - factors[1] * *old;
        }
        std::mem::swap(&mut now, &mut before);
        eliminate((lower, middle, upper), &mut pivots, &mut now, columns);
        substitute((lower, &pivots), obstacle, &mut now, &mut held, columns);
    }
    Ok(now)
}

/// Eliminate from the last node to the first, in place.
fn eliminate(
    (lower, middle, upper): (&[f64], &[f64], &[f64]),
    pivots: &mut [f64],
    values: &mut [f64],
    columns: usize,
) {
    let last = pivots.len() - 1;
    pivots[last] = middle[last];
    for node in (0..last).rev() {
        let share = upper[node] / pivots[node + 1];
        pivots[node] = middle[node] - share * lower[node + 1];
        let (here, next) = values[node * columns..].split_at_mut(columns);
        for (value, beyond) in here.iter_mut().zip(next.iter()) {
            *value -= share * beyond;
        }
    }
}

/// Substitute from the first node to the last, in place, holding columns to the obstacle until they leave it.
fn substitute(
    (lower, pivots): (&[f64], &[f64]),
    obstacle: &[f64],
    values: &mut [f64],
    held: &mut [bool],
    columns: usize,
) {
    let (last, american) = (pivots.len() - 1, held.len());
    held.fill(true);
    for (node, pivot) in pivots.iter().enumerate() {
        let coupling = if node == 0 { 0.0 } else { lower[node] };
        let inner = node.saturating_sub(1);
        let (before, here) = values.split_at_mut(node * columns);
        let here = &mut here[..columns];
        if node > 0 {
            for (value, previous) in here.iter_mut().zip(&before[inner * columns..]) {
                *value -= coupling * previous;
            }
        }
        let payoff = &obstacle[node * american..(node + 1) * american];
        for ((value, floor), is_held) in here.iter_mut().zip(payoff).zip(held.iter_mut()) {
            // Where the column was held up to here, the value before is the obstacle: the right side less its share.
            *is_held &= node < last && *value <= pivot * floor;
            let free = *value / pivot;
            *value = if *is_held || free < *floor {
                *floor
            } else {
                free
            };
        }
        for value in &mut here[american..] {
            *value /= pivot;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{march_strikes, StrikeSteps};

    const STEP: StrikeSteps<'_> = StrikeSteps {
        factors: &[1.0, 0.0],
        matrices: &[0.0, -1.0, -1.0, 2.0, 2.0, 2.0, -1.0, -1.0, 0.0],
        nodes: 3,
    };

    fn assert_close(found: &[f64], expected: &[f64]) {
        assert_eq!(found.len(), expected.len());
        for (a, b) in found.iter().zip(expected) {
            assert!((a - b).abs() <= 1e-14, "{found:?} is not {expected:?}");
        }
    }

    #[test]
    fn a_column_without_an_obstacle_solves_the_linear_system() {
        // A (1, 2, 3) = (0, 0, 4).
        let found = march_strikes(STEP, &[0.0, 0.0, 4.0], &[]).unwrap();
        assert_close(&found, &[1.0, 2.0, 3.0]);
    }

    #[test]
    fn a_column_with_an_obstacle_is_held_at_the_first_nodes() {
        // A (5, 3, 2) = (7, -1, 1): contact at the first node, where A v exceeds the right side, 0.
        let both = [0.0, 0.0, -1.0, -1.0, 1.0, 1.0];
        let found = march_strikes(STEP, &both, &[5.0, 0.0, 0.0]).unwrap();
        let american: Vec<f64> = found.iter().step_by(2).copied().collect();
        assert_close(&american, &[5.0, 3.0, 2.0]);
    }

    #[test]
    fn lengths_that_do_not_fit_are_named() {
        let wrong = march_strikes(STEP, &[0.0; 4], &[]).unwrap_err();
        assert!(wrong.to_string().starts_with("values has length 4"));
        let wrong = march_strikes(STEP, &[0.0; 3], &[0.0; 4]).unwrap_err();
        assert!(wrong.to_string().starts_with("obstacle has length 4"));
        assert!(march_strikes(STEP, &[0.0; 3], &[0.0; 6]).is_err());
    }
}
