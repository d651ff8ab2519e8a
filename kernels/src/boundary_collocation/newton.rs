//! Newton's method for the two boundaries, up to now or up to where they meet.

use super::integrand::Parameters;
use super::nodes::Nodes;
use super::put::Put;
use super::start::Guess;
use super::system::{Curves, Matching, MatchingWork};
use crate::lanes::vector::Vector;
use crate::linear_system::eliminate;

/// The largest number of Newton's steps; chosen.
pub const MOST_STEPS: usize = 40;
/// The same from a guess; chosen: where the boundaries reach so far, about six are enough.
const FIRST_STEPS: usize = 10;
/// The largest relative move of the last step; chosen: its square is below rounding.
const SETTLED: f64 = 1e-8;
/// The smallest share of a step that is tried; chosen.
const SMALLEST_STEP: f64 = 1e-3;
/// The smallest share of a distance that one step leaves; chosen.
const SMALLEST_LEFT: f64 = 0.1;
/// The largest relative change of the time in one step; chosen.
const LARGEST_CHANGE: f64 = 0.3;
/// The factor by which the time is shortened where the boundaries are not found up to there; chosen.
const SHORTER: f64 = 0.6;
/// The number of times that it is; 0.6^60 is 5e-14.
const MOST_TRIES: usize = 60;
/// The distance of the boundaries where they count as met, as a share of their distance at expiry; chosen: what is left
/// out is the square of it, as a share of the premium.
pub const MET: f64 = 1e-4;
/// The smallest distance of the boundaries in a guess, as a share of that at expiry, over 1 - z; chosen.
const SMALLEST_SLOPE: f64 = 0.1;

/// Solved boundaries.
#[derive(Clone)]
pub struct Boundaries {
    pub level: usize,
    pub curves: Curves,
    /// Whether they meet before now; else they reach up to now.
    pub meet: bool,
}

/// The derivatives of solved boundaries by rate, dividend and spread, at fixed times.
pub struct BoundaryTangents {
    /// Those of the two curves at the nodes 0 to m.
    pub upper_squared: [Vec<f64>; 3],
    pub lower: [Vec<f64>; 3],
    /// Those of the share of the time up to which they reach.
    pub share: [f64; 3],
}

impl Put {
    /// The boundaries of the coarsest level: up to `latest`, a share of the time, or where that fails, because they meet
    /// before, to there.
    #[inline(always)]
    pub(super) fn first_boundaries<V: Vector>(&self, latest: f64) -> Option<Boundaries> {
        let mut share = latest;
        for _ in 0..MOST_TRIES {
            let mut found = Boundaries {
                level: 0,
                curves: V::call(Guess {
                    put: self,
                    nodes: Nodes::of_level(0),
                    share,
                }),
                meet: false,
            };
            if self.settle::<V>(&mut found, FIRST_STEPS) {
                if share < 1.0 {
                    found.meet = true;
                    if !self.settle::<V>(&mut found, MOST_STEPS) || found.curves.share >= 1.0 {
                        return None;
                    }
                }
                return Some(found);
            }
            share *= SHORTER;
        }
        None
    }

    /// The boundaries of the next level, from these.
    #[inline(always)]
    pub(super) fn next_boundaries<V: Vector>(&self, last: &Boundaries) -> Option<Boundaries> {
        let (from, to) = (Nodes::of_level(last.level), Nodes::of_level(last.level + 1));
        let refined =
            |values: &[f64]| -> Vec<f64> { to.z.iter().map(|&z| from.value(values, z)).collect() };
        let mut found = Boundaries {
            level: last.level + 1,
            curves: Curves {
                upper_squared: refined(&last.curves.upper_squared),
                lower: refined(&last.curves.lower),
                share: last.curves.share,
            },
            meet: last.meet,
        };
        // Where they meet the interpolated curves may cross too early.
        for (k, z) in to.z.iter().enumerate() {
            let apart = (MET + SMALLEST_SLOPE * (1.0 - z)) * -found.curves.lower[0];
            found.curves.lower[k] = found.curves.lower[k].min(found.curves.upper(k) - apart);
        }
        (self.settle::<V>(&mut found, MOST_STEPS) && found.curves.share <= 1.0).then_some(found)
    }

    /// Solve the equations from the boundaries as they are, in so many steps; false where that fails.
    #[inline(always)]
    pub(super) fn settle<V: Vector>(&self, boundaries: &mut Boundaries, most: usize) -> bool {
        let nodes = Nodes::of_level(boundaries.level);
        let m = nodes.degree;
        if !(1..=m).all(|k| {
            let curves = &boundaries.curves;
            curves.upper_squared[k] > 0.0 && curves.width(k) > 0.0
        }) {
            return false;
        }
        for _ in 0..most {
            let equations = Equations::new::<V>(self, boundaries);
            let Some(step) = equations.solve(&equations.residual) else {
                return false;
            };
            let Some((length, moved)) = take_step(&mut boundaries.curves, &step, m) else {
                return false;
            };
            if length >= 1.0 && moved <= SETTLED {
                return true;
            }
        }
        false
    }

    /// The derivatives of solved boundaries by the parameters.
    #[inline(always)]
    pub(super) fn tangents<V: Vector>(&self, boundaries: &Boundaries) -> Option<BoundaryTangents> {
        let nodes = Nodes::of_level(boundaries.level);
        let (m, curves) = (nodes.degree, &boundaries.curves);
        let equations = Equations::new::<V>(self, boundaries);
        let slope_upper = nodes.derivatives(&curves.upper_squared);
        let slope_lower = nodes.derivatives(&curves.lower);
        let mut found = BoundaryTangents {
            upper_squared: [const { Vec::new() }; 3],
            lower: [const { Vec::new() }; 3],
            share: [0.0; 3],
        };
        for j in 0..3 {
            let by = equations.solve(&equations.by_parameters[j])?;
            if boundaries.meet {
                found.share[j] = by[2 * m];
            }
            // A node at z stands for the time z^2 share: where the share moves, the time is held.
            let moved = |z: f64| -0.5 * z * found.share[j] / curves.share;
            found.upper_squared[j] = (0..=m)
                .map(|k| {
                    let own = if k == 0 { 0.0 } else { by[k - 1] };
                    own + moved(nodes.z[k]) * slope_upper[k]
                })
                .collect();
            found.lower[j] = (0..=m)
                .map(|k| {
                    let own = if k == 0 {
                        self.lower_at_expiry_by()[j]
                    } else {
                        by[m + k - 1]
                    };
                    own + moved(nodes.z[k]) * slope_lower[k]
                })
                .collect();
        }
        Some(found)
    }
}

/// The equations of the unknowns: the upper curve at the nodes 1 to m, the lower one, and where the boundaries meet, the
/// share of the time. At each node they are value matching at the upper boundary, and its divided difference between the two:
/// where the boundaries fall together, the second says that the slopes match as well, so that they do not fall together
/// for nothing.
struct Equations {
    residual: Vec<f64>,
    /// The sizes of the unknowns.
    sizes: Vec<f64>,
    /// (n x n,), n being 2 m, or 2 m + 1 where the boundaries meet.
    matrix: Vec<f64>,
    /// The derivatives by rate, dividend and spread of the whole time.
    by_parameters: [Vec<f64>; 3],
}

impl Equations {
    #[inline(always)]
    fn new<V: Vector>(put: &Put, boundaries: &Boundaries) -> Self {
        let nodes = Nodes::of_level(boundaries.level);
        let (m, curves, meet) = (nodes.degree, &boundaries.curves, boundaries.meet);
        let n = 2 * m + usize::from(meet);
        let share = curves.share;
        let Matching {
            mut residual,
            by_curves,
            by_parameters,
        } = V::call(MatchingWork {
            parameters: put.parameters.within(share),
            nodes,
            curves,
        });
        // From the parameters of the share to those of the whole time, on which the limit at expiry depends as well.
        let scales = [share, share, share.sqrt()];
        let at_expiry = put.lower_at_expiry_by();
        let mut by_whole: [Vec<f64>; 3] = std::array::from_fn(|j| {
            let rows = by_parameters[j].iter().enumerate();
            rows.map(|(row, by)| {
                by * scales[j] + by_curves[row * 2 * (m + 1) + m + 1] * at_expiry[j]
            })
            .collect()
        });
        let mut matrix = vec![0.0; n * n];
        for row in 0..2 * m {
            let from = &by_curves[row * 2 * (m + 1)..(row + 1) * 2 * (m + 1)];
            let own = &mut matrix[row * n..(row + 1) * n];
            own[..m].copy_from_slice(&from[1..=m]);
            own[m..2 * m].copy_from_slice(&from[m + 2..]);
            if meet {
                let Parameters {
                    rate,
                    dividend,
                    spread,
                } = put.parameters;
                own[2 * m] = by_parameters[0][row] * rate
                    + by_parameters[1][row] * dividend
                    + by_parameters[2][row] * spread * 0.5 / share.sqrt();
            }
        }
        for node in 1..=m {
            let (upper, lower) = (node - 1, m + node - 1);
            let width = curves.width(node);
            residual[lower] = (residual[upper] - residual[lower]) / width;
            for by in &mut by_whole {
                by[lower] = (by[upper] - by[lower]) / width;
            }
            for column in 0..n {
                let entry = matrix[upper * n + column] - matrix[lower * n + column];
                matrix[lower * n + column] = entry / width;
            }
            let by_width = residual[lower] / width;
            matrix[lower * n + upper] -= by_width * 0.5 / curves.upper(node);
            matrix[lower * n + lower] += by_width;
        }
        if meet {
            residual.push(curves.width(m) - MET * -put.lower_at_expiry());
            let last = &mut matrix[2 * m * n..];
            last[m - 1] = 0.5 / curves.upper(m);
            last[2 * m - 1] = -1.0;
            for (by, at_expiry) in by_whole.iter_mut().zip(at_expiry) {
                by.push(MET * at_expiry);
            }
        }
        let mut sizes = curves.upper_squared[1..].to_vec();
        sizes.resize(2 * m, -put.lower_at_expiry());
        sizes.resize(n, share);
        Self {
            residual,
            sizes,
            matrix,
            by_parameters: by_whole,
        }
    }

    /// The change of the unknowns that makes up for a change of the residual; each row is scaled by its largest entry, and
    /// each unknown by its size.
    #[inline(always)]
    fn solve(&self, change: &[f64]) -> Option<Vec<f64>> {
        let n = self.sizes.len();
        let mut matrix = self.matrix.clone();
        let mut found: Vec<f64> = change.iter().map(|r| -r).collect();
        for (row, right) in matrix.chunks_exact_mut(n).zip(&mut found) {
            let mut largest = f64::MIN_POSITIVE;
            for (entry, size) in row.iter_mut().zip(&self.sizes) {
                *entry *= size;
                largest = largest.max(entry.abs());
            }
            for entry in row {
                *entry /= largest;
            }
            *right /= largest;
        }
        if !eliminate(&mut matrix, &mut found) {
            return None;
        }
        for (entry, size) in found.iter_mut().zip(&self.sizes) {
            *entry *= size;
        }
        Some(found)
    }
}

/// Take as much of a step as keeps the boundaries apart; return how much, and the largest relative move.
fn take_step(curves: &mut Curves, step: &[f64], m: usize) -> Option<(f64, f64)> {
    let by_share = step.get(2 * m).copied().unwrap_or(0.0);
    let mut length = 1.0_f64;
    if by_share.abs() > LARGEST_CHANGE * curves.share {
        length = LARGEST_CHANGE * curves.share / by_share.abs();
    }
    while length >= SMALLEST_STEP {
        let mut trial = curves.clone();
        for k in 1..=m {
            trial.upper_squared[k] += length * step[k - 1];
            trial.lower[k] += length * step[m + k - 1];
        }
        trial.share += length * by_share;
        // Where the boundaries are to meet they may come as close at once.
        let closest = if step.len() > 2 * m {
            0.5 * MET * -curves.lower[0]
        } else {
            f64::INFINITY
        };
        let is_apart = (1..=m).all(|k| {
            let least = SMALLEST_LEFT * curves.width(k);
            let least = if k == m { least.min(closest) } else { least };
            trial.upper_squared[k] > SMALLEST_LEFT * curves.upper_squared[k]
                && trial.width(k) > least
        });
        if is_apart {
            let scale = -trial.lower[0];
            let moved = (1..=m).fold(by_share.abs() / curves.share, |moved, k| {
                let upper = (trial.upper(k) - curves.upper(k)).abs();
                let lower = (trial.lower[k] - curves.lower[k]).abs();
                moved.max(upper.max(lower) / scale)
            });
            *curves = trial;
            return Some((length, moved));
        }
        length *= 0.5;
    }
    None
}
