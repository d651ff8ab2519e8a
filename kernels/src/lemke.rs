//! Lemke's complementary pivoting with a covering vector and the lexicographic ratio test, dense.

use crate::error::{check_length, KernelError};
use crate::interrupt::Interrupt;

/// Smallest pivot, relative to the largest entry of the entering column.
const SMALLEST_PIVOT: f64 = 1e-10;
/// Largest difference of equal numbers, relative to the terms that make them up.
const ROUNDING: f64 = 1e-13;
/// Number of pivots after which the rounding error of the tableau is checked again.
const CHECKED_AFTER: u64 = 20;
/// Largest correction that leaves the tableau as it is, relative to the terms of a value.
const LARGEST_DRIFT: f64 = 1e-9;
/// Largest value that counts as zero, relative to its terms: 16 units of rounding.
const NOISE: f64 = 3.6e-15;
/// Number of rounds of correction of the last values.
const REFINEMENTS: usize = 2;

/// How the path ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathEnd {
    /// z0 has left the basis: the basic point is a solution.
    Solved,
    /// No row bounds the entering variable.
    Ray,
    /// The limit on pivots was reached.
    Limit,
    /// The question of the caller has ended the work.
    Interrupted,
}

/// The end of a path, and its last basis.
#[derive(Clone, Debug)]
pub struct Path {
    /// How it ended.
    pub end: PathEnd,
    /// z of the last basis, corrected by its residual; parts that are rounding alone are zero.
    pub z: Vec<f64>,
    /// Whether z is basic.
    pub basic_set: Vec<bool>,
    /// The number of pivots.
    pub pivots: u64,
}

/// Follow the path of w - M z - d z0 = q from z0 = infinity, M by rows, until z0 leaves the basis.
///
/// # Errors
/// `entries` or `covering` does not fit q.
pub fn lemke(
    entries: &[f64],
    q: &[f64],
    covering: &[f64],
    max_pivots: u64,
    interrupt: Interrupt<'_>,
) -> Result<Path, KernelError> {
    check_length("M", entries, q.len() * q.len())?;
    check_length("covering", covering, q.len())?;
    let data = Data {
        entries,
        q,
        covering,
    };
    let mut tableau = Tableau::new(data);
    let (end, pivots) = if q.iter().all(|value| *value >= 0.0) {
        (PathEnd::Solved, 0)
    } else {
        tableau.follow(max_pivots, interrupt)
    };
    if end == PathEnd::Solved {
        tableau.correct(interrupt);
    }
    let (z, basic_set) = tableau.point();
    Ok(Path {
        end,
        z,
        basic_set,
        pivots,
    })
}

#[derive(Clone, Copy)]
struct Data<'a> {
    entries: &'a [f64],
    q: &'a [f64],
    covering: &'a [f64],
}

/// `x[basic[r]] + sum_c a[r][c] x[nonbasic[c]] = b[r]`, for the variables w: 0..n, z: n..2n, z0: 2n.
struct Tableau<'a> {
    data: Data<'a>,
    n: usize,
    a: Vec<f64>, // (n, n + 1)
    b: Vec<f64>,
    basic: Vec<usize>,     // (n,)
    nonbasic: Vec<usize>,  // (n + 1,)
    column_of: Vec<usize>, // (2 n + 1,): of a nonbasic variable
    pivot_row: Vec<f64>,
}

impl<'a> Tableau<'a> {
    fn new(data: Data<'a>) -> Self {
        let n = data.q.len();
        let mut tableau = Self {
            data,
            n,
            a: vec![0.0; n * (n + 1)],
            b: vec![0.0; n],
            basic: vec![0; n],
            nonbasic: vec![0; n + 1],
            column_of: vec![0; 2 * n + 1],
            pivot_row: vec![0.0; n + 1],
        };
        tableau.restart();
        tableau
    }

    /// The first tableau: all w basic.
    fn restart(&mut self) {
        let n = self.n;
        for i in 0..n {
            let row = &mut self.a[i * (n + 1)..(i + 1) * (n + 1)];
            for (entry, value) in row.iter_mut().zip(&self.data.entries[i * n..(i + 1) * n]) {
                *entry = -value;
            }
            row[n] = -self.data.covering[i];
            self.basic[i] = i;
        }
        self.b.copy_from_slice(self.data.q);
        for c in 0..=n {
            self.nonbasic[c] = n + c;
            self.column_of[n + c] = c;
        }
    }

    fn follow(&mut self, max_pivots: u64, interrupt: Interrupt<'_>) -> (PathEnd, u64) {
        let n = self.n;
        let artificial = 2 * n;
        // The lexicographic minimum of (q_i, e_i) / d_i: among equal q_i / d_i the last row.
        let ratio = |i: usize| self.data.q[i] / self.data.covering[i];
        let mut row = (0..n).fold(0, |best, i| if ratio(i) <= ratio(best) { i } else { best });
        let mut entering = artificial;
        for pivot in 1..=max_pivots {
            let leaving = self.basic[row];
            self.exchange(row, self.column_of[entering]);
            if leaving == artificial {
                return (PathEnd::Solved, pivot);
            }
            if interrupt() {
                return (PathEnd::Interrupted, pivot);
            }
            if pivot % CHECKED_AFTER == 0 && self.refine() > LARGEST_DRIFT {
                self.refactor(interrupt);
            }
            entering = if leaving < n {
                leaving + n
            } else {
                leaving - n
            };
            match self.leaving_row(self.column_of[entering]) {
                Some(next) => row = next,
                None => return (PathEnd::Ray, pivot),
            }
        }
        (PathEnd::Limit, max_pivots)
    }

    /// Exchange the basic variable of row r for the nonbasic one of column c.
    fn exchange(&mut self, r: usize, c: usize) {
        let width = self.n + 1;
        let reciprocal = 1.0 / self.a[r * width + c];
        for (copy, entry) in self
            .pivot_row
            .iter_mut()
            .zip(&mut self.a[r * width..(r + 1) * width])
        {
            *entry *= reciprocal;
            *copy = *entry;
        }
        self.a[r * width + c] = reciprocal;
        self.pivot_row[c] = 0.0;
        self.b[r] *= reciprocal;
        let value = self.b[r];
        for (i, row) in self.a.chunks_exact_mut(width).enumerate() {
            let factor = row[c];
            if i == r || factor == 0.0 {
                continue;
            }
            for (entry, part) in row.iter_mut().zip(&self.pivot_row) {
                *entry -= factor * part;
            }
            row[c] = -factor * reciprocal;
            self.b[i] -= factor * value;
        }
        let (left, entered) = (self.basic[r], self.nonbasic[c]);
        self.basic[r] = entered;
        self.nonbasic[c] = left;
        self.column_of[left] = c;
    }

    /// The entry (r, k) of the inverse basis, which stands in the columns of the slacks.
    fn inverse(&self, r: usize, k: usize) -> f64 {
        let c = self.column_of[k];
        if self.nonbasic[c] == k {
            self.a[r * (self.n + 1) + c]
        } else {
            f64::from(u8::from(self.basic[r] == k))
        }
    }

    /// The sum over k of |entry (r, k) of the inverse basis| weights[k].
    fn terms(&self, r: usize, weights: &[f64]) -> f64 {
        (0..self.n)
            .map(|k| self.inverse(r, k).abs() * weights[k].abs())
            .sum()
    }

    /// The row of the lexicographically smallest ratio, that of z0 if it ties; None where there is none.
    fn leaving_row(&self, c: usize) -> Option<usize> {
        let width = self.n + 1;
        let slope = |r: usize| self.a[r * width + c];
        let largest = (0..self.n).fold(0.0_f64, |most, r| most.max(slope(r).abs()));
        let least_slope = (SMALLEST_PIVOT * largest).max(1e-300);
        let value = |r: usize| self.b[r].max(0.0);
        let mut rows: Vec<usize> = (0..self.n).filter(|&r| slope(r) > least_slope).collect();
        let ratio = |r: usize| value(r) / slope(r);
        let with_noise = |r: usize| (value(r) + ROUNDING * self.terms(r, self.data.q)) / slope(r);
        let first = rows
            .iter()
            .copied()
            .min_by(|&r, &s| ratio(r).total_cmp(&ratio(s)))?;
        let bound = with_noise(first);
        rows.retain(|&r| ratio(r) <= bound);
        let bound = rows
            .iter()
            .fold(bound, |least, &r| least.min(with_noise(r)));
        rows.retain(|&r| ratio(r) <= bound);
        let artificial = rows.iter().copied().find(|&r| self.basic[r] == 2 * self.n);
        if artificial.is_some() || rows.len() == 1 {
            return artificial.or(Some(rows[0]));
        }
        Some(self.lexicographic_minimum(rows, c))
    }

    /// Among rows with equal ratios the one whose row of the inverse basis is smallest, divided by its slope.
    fn lexicographic_minimum(&self, mut rows: Vec<usize>, c: usize) -> usize {
        let slope = |r: usize| self.a[r * (self.n + 1) + c];
        let mut noise: Vec<f64> = rows
            .iter()
            .map(|&r| {
                let largest =
                    (0..self.n).fold(0.0_f64, |most, k| most.max(self.inverse(r, k).abs()));
                ROUNDING * largest / slope(r)
            })
            .collect();
        for k in 0..self.n {
            if rows.len() == 1 {
                break;
            }
            let ratios: Vec<f64> = rows
                .iter()
                .map(|&r| self.inverse(r, k) / slope(r))
                .collect();
            let bound = ratios
                .iter()
                .zip(&noise)
                .fold(f64::INFINITY, |least, (ratio, doubt)| {
                    least.min(ratio + doubt)
                });
            let kept: Vec<bool> = ratios.iter().map(|ratio| *ratio <= bound).collect();
            let mut keep = kept.iter();
            rows.retain(|_| *keep.next().unwrap_or(&true));
            let mut keep = kept.iter();
            noise.retain(|_| *keep.next().unwrap_or(&true));
        }
        rows[0]
    }

    /// Correct the basic values by their residual; return the largest correction relative to the terms of its value.
    fn refine(&mut self) -> f64 {
        let (residual, sizes) = self.residual();
        let mut drift = 0.0_f64;
        for r in 0..self.n {
            let mut correction = 0.0;
            for (k, part) in residual.iter().enumerate() {
                correction += self.inverse(r, k) * part;
            }
            self.b[r] += correction;
            let terms = self.terms(r, &sizes);
            if terms > 0.0 {
                drift = drift.max(correction.abs() / terms);
            } else if correction.is_nan() {
                drift = f64::INFINITY;
            }
        }
        if drift.is_nan() {
            f64::INFINITY
        } else {
            drift
        }
    }

    /// q - w + M z + d z0 for the basic values, and the sizes of the terms of each row.
    fn residual(&self) -> (Vec<f64>, Vec<f64>) {
        let n = self.n;
        let mut residual = self.data.q.to_vec();
        let mut sizes: Vec<f64> = residual.iter().map(|value| value.abs()).collect();
        let (mut z, mut z0) = (Vec::new(), 0.0);
        for (r, &variable) in self.basic.iter().enumerate() {
            if variable < n {
                residual[variable] -= self.b[r];
            } else if variable < 2 * n {
                z.push((variable - n, self.b[r]));
            } else {
                z0 = self.b[r];
            }
        }
        for i in 0..n {
            let row = &self.data.entries[i * n..(i + 1) * n];
            for &(j, value) in &z {
                residual[i] += row[j] * value;
                sizes[i] += (row[j] * value).abs();
            }
            residual[i] += self.data.covering[i] * z0;
            sizes[i] += (self.data.covering[i] * z0).abs();
        }
        (residual, sizes)
    }

    /// Make the tableau of this basis afresh from the data, with the largest pivots.
    ///
    /// It stays as it was where a pivot is zero, or where the work shall end: there are up to n exchanges.
    fn refactor(&mut self, interrupt: Interrupt<'_>) {
        let n = self.n;
        let kept = (
            self.a.clone(),
            self.b.clone(),
            self.basic.clone(),
            self.nonbasic.clone(),
            self.column_of.clone(),
        );
        let mut wanted = vec![false; 2 * n + 1];
        for &variable in &self.basic {
            wanted[variable] = true;
        }
        self.restart();
        for variable in (n..=2 * n).filter(|&v| wanted[v]) {
            let c = self.column_of[variable];
            let size = |r: usize| self.a[r * (n + 1) + c].abs();
            let free = (0..n).filter(|&r| !wanted[self.basic[r]]);
            match free.max_by(|&r, &s| size(r).total_cmp(&size(s))) {
                Some(r) if size(r) > 1e-300 && !interrupt() => self.exchange(r, c),
                _ => {
                    (self.a, self.b, self.basic, self.nonbasic, self.column_of) = kept;
                    return;
                }
            }
        }
        self.refine();
    }

    /// Bring the last values to rounding level, and set to zero what is rounding alone.
    fn correct(&mut self, interrupt: Interrupt<'_>) {
        for round in 0..REFINEMENTS {
            if self.refine() > LARGEST_DRIFT && round == 0 {
                self.refactor(interrupt);
            }
        }
        let (_, sizes) = self.residual();
        let kept = self.b.clone();
        for r in 0..self.n {
            if self.basic[r] >= self.n && self.b[r].abs() <= NOISE * self.terms(r, &sizes) {
                self.b[r] = 0.0;
            }
        }
        if self.b != kept && !self.is_consistent() {
            self.b = kept;
        }
    }

    /// Whether w = 0 holds to rounding in the rows where z is basic.
    fn is_consistent(&self) -> bool {
        let (residual, sizes) = self.residual();
        let mut is_slack = vec![false; self.n];
        for &variable in self.basic.iter().filter(|&&v| v < self.n) {
            is_slack[variable] = true;
        }
        (0..self.n).all(|i| is_slack[i] || residual[i].abs() <= NOISE * sizes[i])
    }

    fn point(&self) -> (Vec<f64>, Vec<bool>) {
        let n = self.n;
        let (mut z, mut basic_set) = (vec![0.0; n], vec![false; n]);
        for (r, &variable) in self.basic.iter().enumerate() {
            if (n..2 * n).contains(&variable) {
                z[variable - n] = self.b[r];
                basic_set[variable - n] = true;
            }
        }
        (z, basic_set)
    }
}

#[cfg(test)]
mod tests {
    use super::{lemke, Data, PathEnd, Tableau};
    use crate::interrupt::never;

    fn path(entries: &[f64], q: &[f64]) -> super::Path {
        lemke(entries, q, &vec![1.0; q.len()], 1000, &never).unwrap()
    }

    #[test]
    fn two_unknowns_by_hand() {
        // [[2, 1], [1, 2]] (1, 2) = (4, 5).
        let found = path(&[2.0, 1.0, 1.0, 2.0], &[-4.0, -5.0]);
        assert_eq!((found.end, found.pivots), (PathEnd::Solved, 3));
        for (z, expected) in found.z.iter().zip([1.0, 2.0]) {
            assert!((z - expected).abs() < 1e-15);
        }
        assert_eq!(found.basic_set, [true, true]);
    }

    #[test]
    fn a_problem_that_zero_solves_takes_no_pivot() {
        let found = path(&[-1.0], &[0.0]);
        assert_eq!((found.end, found.pivots), (PathEnd::Solved, 0));
        assert_eq!(path(&[], &[]).end, PathEnd::Solved);
    }

    #[test]
    fn a_tableau_made_afresh_has_the_same_values_and_an_interrupted_one_is_left_alone() {
        let data = Data {
            entries: &[2.0, 1.0, 1.0, 2.0],
            q: &[-4.0, -5.0],
            covering: &[1.0, 1.0],
        };
        let mut tableau = Tableau::new(data);
        tableau.follow(10, &never);
        tableau.a[0] += 0.5;
        let spoilt = tableau.a.clone();
        tableau.refactor(&|| true);
        assert_eq!(tableau.a, spoilt);
        tableau.refactor(&never);
        assert_ne!(tableau.a, spoilt);
        let (z, _) = tableau.point();
        assert!((z[0] - 1.0).abs() + (z[1] - 2.0).abs() < 1e-15);
    }

    #[test]
    fn rays_limits_and_interrupts_are_told_apart() {
        assert_eq!(path(&[-1.0], &[-1.0]).end, PathEnd::Ray);
        let problem = ([2.0, 1.0, 1.0, 2.0], [-4.0, -5.0]);
        let limited = lemke(&problem.0, &problem.1, &[1.0; 2], 1, &never).unwrap();
        assert_eq!(limited.end, PathEnd::Limit);
        let ended = lemke(&problem.0, &problem.1, &[1.0; 2], 9, &|| true).unwrap();
        assert_eq!(ended.end, PathEnd::Interrupted);
    }

    #[test]
    fn a_basic_value_that_is_rounding_alone_is_zero() {
        let entries = [0.7, 0.2, 2.3, -0.2, 0.0, -1.9, -2.3, 1.9, 0.7];
        let found = path(&entries, &[-0.7, 0.0, 0.6]);
        assert_eq!(found.end, PathEnd::Solved);
        assert_eq!(found.z[0].to_bits(), 0.0_f64.to_bits());
        assert!((found.z[1] - 3.5).abs() < 1e-14);
    }

    #[test]
    fn wrong_lengths_are_named() {
        let message = |entries: &[f64], covering: &[f64]| {
            let error = lemke(entries, &[1.0], covering, 9, &never).unwrap_err();
            error.to_string()
        };
        assert_eq!(message(&[1.0; 2], &[1.0]), "M has length 2: must be 1");
        assert_eq!(message(&[1.0], &[]), "covering has length 0: must be 1");
    }
}
