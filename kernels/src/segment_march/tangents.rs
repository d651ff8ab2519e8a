//! The derivatives of the march by parameters, the contact set held fast: linear systems with the stage's own matrix.
//!
//! With the contact set and the place of the boundary in its cell as the stage found them, v is a smooth function of
//! every parameter. Its derivative v' satisfies (I - hL) v' = base' + h e' + h L' v on the free rows, and is g' in the
//! exercise region. The row of the last free node m reads the continuation G = J d^2 (1 - theta)^2/2 of the slack beyond
//! the boundary, where z = J d^2 theta^2/2 at m itself: G' = (1 - theta) d^2/2 J' - (1 - theta)/theta z'.

use super::boundary_cell::Placed;
use super::stage::Stage;
use super::{Segment, Tangent};
use crate::error::KernelError;

/// The number of parameters side by side.
const LANES: usize = 4;
/// The smallest theta: a boundary nearer to the node is at the node.
const SMALLEST_THETA: f64 = 1e-9;

type Lanes = [f64; LANES];

/// Up to four parameters, interleaved.
struct Block {
    /// v' at the interior nodes after the last stage.
    value: Vec<Lanes>,
    /// v' at the start of the step.
    start: Vec<Lanes>,
    lower: Vec<Lanes>,
    diagonal: Vec<Lanes>,
    upper: Vec<Lanes>,
    rate: Lanes,
    dividend_yield: Lanes,
    escrow: Lanes,
    lines: [[Lanes; 2]; 2],
}

/// All derivatives of a march, and the buffers of a stage.
pub(super) struct Tangents<'a> {
    segment: &'a Segment<'a>,
    blocks: Vec<Block>,
    rows: Vec<Lanes>,
    reciprocal: Vec<f64>,
    factor: Vec<f64>,
    pivots: Vec<f64>,
}

fn each(f: impl FnMut(usize) -> f64) -> Lanes {
    std::array::from_fn(f)
}

impl<'a> Tangents<'a> {
    pub fn new(segment: &'a Segment<'a>, tangents: &[Tangent]) -> Self {
        let size = segment.size();
        let any = if tangents.is_empty() { 0 } else { size };
        let blocks = tangents.chunks(LANES).map(|chunk| {
            let of =
                |column: &dyn Fn(&Tangent) -> f64| each(|lane| chunk.get(lane).map_or(0.0, column));
            let rows = |column: &dyn Fn(&Tangent, usize) -> f64| {
                (0..size).map(|i| of(&|t| column(t, i))).collect()
            };
            Block {
                value: rows(&|t, i| t.values[i + 1]),
                start: vec![[0.0; LANES]; size],
                lower: rows(&|t, i| t.lower[i]),
                diagonal: rows(&|t, i| t.diagonal[i]),
                upper: rows(&|t, i| t.upper[i]),
                rate: of(&|t| t.rate),
                dividend_yield: of(&|t| t.dividend_yield),
                escrow: of(&|t| t.escrow),
                lines: [0, 1].map(|end| [0, 1].map(|k| of(&|t| t.lines[end][k]))),
            }
        });
        Self {
            segment,
            blocks: blocks.collect(),
            rows: vec![[0.0; LANES]; any],
            reciprocal: vec![0.0; any],
            factor: vec![0.0; any],
            pivots: vec![0.0; any],
        }
    }

    /// Follow a stage of size h that ends at t, after it is solved. The base of a step's second stage is
    /// v + ahead (v1 - v), v1 what the first one found; `second` is that factor.
    pub fn follow(
        &mut self,
        stage: &Stage<'_>,
        t: f64,
        h: f64,
        second: Option<f64>,
    ) -> Result<(), KernelError> {
        if self.blocks.is_empty() {
            return Ok(());
        }
        self.factor_free(stage)?;
        for index in 0..self.blocks.len() {
            self.solve(index, stage, t, h, second);
        }
        Ok(())
    }

    /// Pivots of M on the free rows, the rows next to a boundary as they read its continuation.
    fn factor_free(&mut self, stage: &Stage<'_>) -> Result<(), KernelError> {
        let (bands, contact) = (&stage.bands, &stage.contact);
        self.pivots.copy_from_slice(&bands.diagonal);
        for placed in &stage.placed {
            let inward = if placed.contact < placed.free {
                bands.lower[placed.free]
            } else {
                bands.upper[placed.free]
            };
            self.pivots[placed.free] -= inward * steepness(placed.theta);
        }
        let mut factor = 0.0;
        for (row, &is_contact) in contact.iter().enumerate() {
            if is_contact {
                (self.reciprocal[row], self.factor[row]) = (1.0, 0.0);
                factor = 0.0;
                continue;
            }
            let below = if row > 0 { bands.lower[row] } else { 0.0 };
            let pivot = self.pivots[row] - below * factor;
            if pivot == 0.0 {
                return Err(KernelError::ZeroPivot { row });
            }
            self.reciprocal[row] = 1.0 / pivot;
            factor = bands.upper[row] / pivot;
            self.factor[row] = factor;
        }
        Ok(())
    }

    fn solve(&mut self, index: usize, stage: &Stage<'_>, t: f64, h: f64, second: Option<f64>) {
        let (segment, size) = (self.segment, stage.value.len());
        let block = &mut self.blocks[index];
        let (by_ends, by_obstacle) = (block.ends(segment, t), block.obstacle(segment, t));
        let ends = segment.ends(t);
        if second.is_none() {
            block.start.copy_from_slice(&block.value);
        }
        let ahead = second.unwrap_or(0.0);
        for row in 0..size {
            let below = if row > 0 {
                stage.value[row - 1]
            } else {
                ends[0]
            };
            let above = if row + 1 < size {
                stage.value[row + 1]
            } else {
                ends[1]
            };
            let own = stage.value[row];
            let (lower, diagonal) = (&block.lower[row], &block.diagonal[row]);
            let (upper, start, value) = (&block.upper[row], &block.start[row], &block.value[row]);
            self.rows[row] = each(|k| {
                let base = start[k] + ahead * (value[k] - start[k]);
                base + h * (lower[k] * below + diagonal[k] * own + upper[k] * above)
            });
        }
        let last = size - 1;
        let (low, high) = (h * segment.lower[0], h * segment.upper[last]);
        self.rows[0] = each(|k| self.rows[0][k] + low * by_ends[0][k]);
        self.rows[last] = each(|k| self.rows[last][k] + high * by_ends[1][k]);
        for placed in &stage.placed {
            let Placed {
                free,
                contact,
                theta,
            } = *placed;
            let (entry, changed) = if contact < free {
                (segment.lower[free], block.lower[free])
            } else {
                (segment.upper[free], block.upper[free])
            };
            let rest = 1.0 - theta;
            let half = 0.5 * (segment.nodes[contact + 1] - segment.nodes[free + 1]).powi(2);
            let bent = block.curvature(segment, contact);
            let beyond = half * segment.curvature(contact) * rest * rest;
            let steep = steepness(theta);
            self.rows[free] = each(|k| {
                self.rows[free][k]
                    + h * (changed[k] * beyond
                        + entry * (rest * half * bent[k] + steep * by_obstacle[k]))
            });
        }
        // Elimination upwards, substitution downwards; a row in contact is g_p.
        let bands = &stage.bands;
        let mut carried = [0.0; LANES];
        for row in 0..size {
            carried = if stage.contact[row] {
                by_obstacle
            } else {
                let below = if row > 0 { bands.lower[row] } else { 0.0 };
                let (r, reciprocal) = (&self.rows[row], self.reciprocal[row]);
                each(|k| (r[k] - below * carried[k]) * reciprocal)
            };
            self.rows[row] = carried;
        }
        let mut above = [0.0; LANES];
        for row in (0..size).rev() {
            let (r, factor) = (&self.rows[row], self.factor[row]);
            above = each(|k| r[k] - factor * above[k]);
            self.rows[row] = above;
        }
        std::mem::swap(&mut block.value, &mut self.rows);
    }

    /// The derivatives at all nodes at t, parameter by parameter.
    pub fn values(&self, count: usize, t: f64) -> Vec<Vec<f64>> {
        let ends: Vec<[Lanes; 2]> = self
            .blocks
            .iter()
            .map(|b| b.ends(self.segment, t))
            .collect();
        let of = |p: usize| {
            let (block, end, lane) = (&self.blocks[p / LANES], &ends[p / LANES], p % LANES);
            let inside = block.value.iter().map(|v| v[lane]);
            std::iter::once(end[0][lane])
                .chain(inside)
                .chain(std::iter::once(end[1][lane]))
                .collect()
        };
        (0..count).map(of).collect()
    }
}

/// (1 - theta)/theta, which ties the value beyond the boundary to that of the last free node.
fn steepness(theta: f64) -> f64 {
    (1.0 - theta) / theta.max(SMALLEST_THETA)
}

impl Block {
    /// The derivatives of g, of g = sign (1 - A e^{-rt} - s), which do not depend on s.
    fn obstacle(&self, segment: &Segment<'_>, t: f64) -> Lanes {
        let left = segment.sign * (-segment.rate * t).exp();
        each(|k| -left * (self.escrow[k] - segment.escrow * t * self.rate[k]))
    }

    /// The derivatives of v at the two end nodes.
    fn ends(&self, segment: &Segment<'_>, t: f64) -> [Lanes; 2] {
        let (bond, stock) = (
            (-segment.rate * t).exp(),
            (-segment.dividend_yield * t).exp(),
        );
        let obstacle = self.obstacle(segment, t);
        let last = segment.nodes[segment.size() + 1];
        [(0, segment.nodes[0]), (1, last)].map(|(end, s)| {
            if segment.is_exercised_at(end, t) {
                return obstacle;
            }
            let [a, b] = segment.lines[end];
            let [by_a, by_b] = self.lines[end];
            each(|k| {
                bond * (by_a[k] - a * t * self.rate[k])
                    + s * stock * (by_b[k] - b * t * self.dividend_yield[k])
            })
        })
    }

    /// The derivatives of J at a contact node.
    fn curvature(&self, segment: &Segment<'_>, node: usize) -> Lanes {
        let s = segment.nodes[node + 1];
        let (left, right) = (
            (s - segment.nodes[node]).powi(2),
            (segment.nodes[node + 2] - s).powi(2),
        );
        let twice = segment.lower[node] * left + segment.upper[node] * right;
        let bent = segment.curvature(node);
        each(|k| {
            let by_twice = self.lower[node][k] * left + self.upper[node][k] * right;
            (2.0 * segment.sign * (self.rate[k] - self.dividend_yield[k] * s) - bent * by_twice)
                / twice
        })
    }
}
