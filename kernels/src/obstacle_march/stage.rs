//! One implicit stage: the rows of its matrix, what exercise brings, and the cell next to a contact set.

use crate::lanes::vector::Vector;

/// The rows of a stage's matrix, A = (1 + a r) M - a L, and what else a stage needs.
#[derive(Clone, Copy)]
pub struct Stage<V> {
    pub lower: V,
    pub diagonal: V,
    pub upper: V,
    pub mass_lower: V,
    pub mass_middle: V,
    pub mass_upper: V,
    /// One over the implicit weight.
    pub inverse: V,
    /// D in cells^2 a year, and a D.
    pub diffusion: V,
    pub spread: V,
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
    /// 1/(2 D).
    pub half_inverse: V,
}

impl<V: Vector> Obstacle<V> {
    /// What exercise brings at a signed spot, and how far V rises above it in the first cell beyond the contact set.
    ///
    /// The holder may not exercise, or would not, where one of them is below 0.
    #[inline(always)]
    pub fn at(&self, signed: V) -> (V, V) {
        let cost = self.rate_part - self.yield_part * signed;
        (self.strike - signed, cost * self.half_inverse)
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

/// What the elimination from the far end leaves of a stage's matrix: what the row above is multiplied by, the pivots, and
/// one over these.
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

    /// Eliminate down to a row.
    #[inline(always)]
    pub fn of(&mut self, stage: &Stage<V>, first: usize) {
        let last = self.pivot.len() - 2;
        let one = V::all(1.0);
        self.factor[last] = V::zero();
        self.pivot[last] = stage.last_diagonal;
        self.inverse[last] = one / stage.last_diagonal;
        for i in (first..last).rev() {
            let factor = stage.upper * self.inverse[i + 1];
            let pivot = stage.diagonal - factor * stage.lower_of(i + 1, last);
            self.factor[i] = factor;
            self.pivot[i] = pivot;
            self.inverse[i] = one / pivot;
        }
    }
}

impl<V: Vector> Stage<V> {
    /// What a row takes of the node before it; in the last one the far end is eliminated.
    #[inline(always)]
    pub fn lower_of(&self, row: usize, last: usize) -> V {
        if row == last {
            self.last_lower
        } else {
            self.lower
        }
    }

    /// What the row before, the own and the row behind take of a node; `loose` is 1 where the near end is no obstacle, and
    /// eliminated, else 0.
    #[inline(always)]
    pub fn column(&self, node: usize, last: usize, loose: V) -> [V; 3] {
        let q = self.near_rule;
        let (mut upper, mut diagonal) = (self.upper, self.diagonal);
        if node == last {
            diagonal = self.last_diagonal;
        }
        if node == 1 {
            diagonal = (loose * self.lower).times_plus(q.plus(1.0), diagonal);
        }
        if node == 2 {
            upper = upper - loose * self.lower * q;
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
    pub fn cell(&self, pivot: V, rest: V, gain: V, rise: V, near: V) -> Cell<V> {
        let (zero, one) = (V::zero(), V::all(1.0));
        let reach = self.spread * rise;
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
            let bend = (pivot / self.spread).plus(-1.0);
            let slack = excess / near.negative(reach, one);
            let root = slack.plus(1.0).times_plus(bend, one).max(zero).sqrt();
            found.distance = (root.plus(-1.0) / bend).max(zero).min(one);
            found.value = (found.distance * found.distance).times_plus(rise, gain);
        }
        found
    }

    /// M V at a node, from the values at the one before, at it and behind it.
    #[inline(always)]
    pub fn mass(&self, before: V, at: V, after: V) -> V {
        let weights = [self.mass_lower, self.mass_middle, self.mass_upper];
        mass_of(weights, [before, at, after])
    }
}
