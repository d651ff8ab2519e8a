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

impl<V: Vector> Stage<V> {
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
        let sum = self.mass_middle.times_plus(at, self.mass_lower * before);
        self.mass_upper.times_plus(after, sum)
    }
}
