//! One implicit stage: the rows of its matrix, what exercise brings, and the cell next to a contact set.

use crate::lanes::vector::Vector;

/// A row of a stage's matrix, A = (1 + a r) M - a L.
#[derive(Clone, Copy)]
pub struct Row<V> {
    /// What it takes of the node before it, of its own and of the one behind.
    pub lower: V,
    pub diagonal: V,
    pub upper: V,
    /// The same of M, all three.
    pub mass: [V; 3],
    /// a D, D in cells^2 a year, and 1/(2 D).
    pub spread: V,
    pub half_inverse: V,
}

/// The rows of a stage, one for each inner node.
pub trait Rows<V>: Copy {
    /// Whether all are alike.
    const EVEN: bool;

    /// One of them.
    fn at(&self, row: usize) -> &Row<V>;
}

/// The rows of coefficients that do not depend on the place: all are alike.
#[derive(Clone, Copy)]
pub struct EvenRows<V>(pub Row<V>);

impl<V: Copy> Rows<V> for EvenRows<V> {
    const EVEN: bool = true;

    #[inline(always)]
    fn at(&self, _row: usize) -> &Row<V> {
        &self.0
    }
}

/// Rows of their own for each node.
#[derive(Clone, Copy)]
pub struct LocalRows<'t, V>(pub &'t [Row<V>]);

impl<V: Copy> Rows<V> for LocalRows<'_, V> {
    const EVEN: bool = false;

    #[inline(always)]
    fn at(&self, row: usize) -> &Row<V> {
        &self.0[row]
    }
}

/// A stage: the rows of its matrix, and what else it needs.
#[derive(Clone, Copy)]
pub struct Stage<R, V> {
    pub rows: R,
    /// The implicit weight, in years, and one over it.
    pub a: V,
    pub inverse: V,
    /// 1 + a r.
    pub growth: V,
    /// q of the end rules `V_0` = (1 + q) `V_1` - q `V_2`.
    pub near_rule: V,
    pub far_rule: V,
    /// The last row, in which the far end is eliminated.
    pub last_lower: V,
    pub last_diagonal: V,
}

/// The cell next to a contact set, at its node: V, the distance of the set's end, and below 0 where the node is in it.
pub struct Cell<V> {
    pub value: V,
    pub distance: V,
    pub held: V,
}

/// What exercise brings at the nodes.
#[derive(Clone, Copy)]
pub struct Obstacle<V> {
    /// The signed strike.
    pub strike: V,
    pub rate_part: V,
    pub yield_part: V,
}

impl<V: Vector> Obstacle<V> {
    /// What exercise brings at a signed spot, and how far V rises above it in the first cell beyond the contact set, given
    /// 1/(2 D) there.
    ///
    /// The holder may not exercise, or would not, where one of them is below 0.
    #[inline(always)]
    pub fn at(&self, signed: V, half_inverse: V) -> (V, V) {
        let cost = self.rate_part - self.yield_part * signed;
        (self.strike - signed, cost * half_inverse)
    }
}

/// The weights of the compact scheme's mass matrix, at the node before, at the own one and behind it.
#[inline(always)]
pub fn mass_weights<V: Vector>(peclet: V) -> [V; 3] {
    [
        peclet.times(-1.0 / 24.0).plus(1.0 / 12.0),
        V::all(10.0 / 12.0),
        peclet.times(1.0 / 24.0).plus(1.0 / 12.0),
    ]
}

/// The sum of these weights with values at three nodes.
#[inline(always)]
pub fn mass_of<V: Vector>([lower, middle, upper]: [V; 3], [before, at, after]: [V; 3]) -> V {
    upper.times_plus(after, middle.times_plus(at, lower * before))
}

/// How often it is looked whether the pivots change any more, in rows.
const LOOKED_AT: usize = 8;

/// What the elimination from the far end leaves of a stage's matrix: how often a row takes in the one behind it, the
/// pivots, and one over these.
pub struct Elimination<V> {
    pub factor: Vec<V>,
    pub pivot: Vec<V>,
    pub inverse: Vec<V>,
}

impl<V: Vector> Elimination<V> {
    pub fn new(nodes: usize) -> Self {
        let array = || vec![V::zero(); nodes];
        Self {
            factor: array(),
            pivot: array(),
            inverse: array(),
        }
    }

    /// Whether a row has the pivot of the one behind it in all lanes.
    #[inline(always)]
    fn is_still(&self, row: usize) -> bool {
        let change = self.inverse[row] - self.inverse[row + 1];
        change.lanes().iter().all(|x| *x == 0.0)
    }

    /// Eliminate down to a row.
    #[inline(always)]
    pub fn of<R: Rows<V>>(&mut self, stage: &Stage<R, V>, first: usize) {
        let last = self.pivot.len() - 2;
        let one = V::all(1.0);
        self.factor[last] = V::zero();
        self.pivot[last] = stage.last_diagonal;
        self.inverse[last] = one / stage.last_diagonal;
        for i in (first..last).rev() {
            let factor = -(stage.rows.at(i).upper * self.inverse[i + 1]);
            let behind = stage.lower_of(i + 1, last);
            let pivot = factor.times_plus(behind, stage.rows.at(i).diagonal);
            self.factor[i] = factor;
            self.pivot[i] = pivot;
            self.inverse[i] = one / pivot;
            // With rows that are alike the pivots tend to a number, and stay at it to the last bit.
            if R::EVEN && i % LOOKED_AT == 0 && i + 1 < last && self.is_still(i) {
                let (factor, inverse) = (self.factor[i], self.inverse[i]);
                self.factor[first..i].fill(factor);
                self.pivot[first..i].fill(pivot);
                self.inverse[first..i].fill(inverse);
                break;
            }
        }
    }
}

impl<R: Rows<V>, V: Vector> Stage<R, V> {
    /// The stage of these rows, with the implicit weight and 1 + a r, and the rules of the two ends.
    #[inline(always)]
    pub fn new(rows: R, last: usize, a: V, growth: V, [near_rule, far_rule]: [V; 2]) -> Self {
        let row = *rows.at(last);
        Self {
            rows,
            a,
            inverse: V::all(1.0) / a,
            growth,
            near_rule,
            far_rule,
            last_lower: row.lower - row.upper * far_rule,
            last_diagonal: far_rule.plus(1.0).times_plus(row.upper, row.diagonal),
        }
    }

    /// What a row takes of the node before it; in the last one the far end is eliminated.
    #[inline(always)]
    pub fn lower_of(&self, row: usize, last: usize) -> V {
        if row == last {
            self.last_lower
        } else {
            self.rows.at(row).lower
        }
    }

    /// What the row before, the own and the row behind take of a node; `loose` is 1 where the near end is no obstacle, and
    /// eliminated, else 0.
    #[inline(always)]
    pub fn column(&self, node: usize, last: usize, loose: V) -> [V; 3] {
        let q = self.near_rule;
        let mut upper = self.rows.at(node - 1).upper;
        let mut diagonal = if node == last {
            self.last_diagonal
        } else {
            self.rows.at(node).diagonal
        };
        if node == 1 {
            diagonal = (loose * self.rows.at(1).lower).times_plus(q.plus(1.0), diagonal);
        }
        if node == 2 {
            upper = upper - loose * self.rows.at(1).lower * q;
        }
        let behind = if node < last {
            self.lower_of(node + 1, last)
        } else {
            V::zero()
        };
        [upper, diagonal, behind]
    }

    /// Settle the node of a cell where `near` is below 0, given its pivot and the rest of its row.
    #[inline(always)]
    pub fn cell(&self, node: usize, pivot: V, rest: V, (gain, rise): (V, V), near: V) -> Cell<V> {
        let (zero, one) = (V::zero(), V::all(1.0));
        let spread = self.rows.at(node).spread;
        let reach = spread * rise;
        let excess = rest - gain * pivot; // of what pushes V up over what holds it at the obstacle
        let held = (excess + reach).plus(-f64::MIN_POSITIVE);
        let mut found = Cell {
            value: gain,
            distance: zero,
            held,
        };
        let inside = near.negative(held, V::all(-1.0)).lanes();
        if inside.iter().any(|x| *x >= 0.0) {
            // (e - 1) s^2 + 2 s - 1 - excess/(a D rise) = 0 for the distance s, e the pivot over a D
            let bend = (pivot / spread).plus(-1.0);
            let slack = excess / near.negative(reach, one);
            let root = slack.plus(1.0).times_plus(bend, one).max(zero).sqrt();
            let distance = (root.plus(-1.0) / bend).max(zero).min(one);
            found.distance = held.negative(zero, distance);
            found.value = (found.distance * found.distance).times_plus(rise, gain);
        }
        found
    }
}
