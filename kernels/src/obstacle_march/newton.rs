//! Newton's method for a stage whose contact set need not begin at the near end: two boundaries, or parts that meet.
//!
//! As in `pricing_core/obstacle/averaged.py` the value and the mass of the multiplier are functions of one number s for
//! each node, the distance of the contact set's end in cells: V - g = rise s^2 and mass = c (1 - s)^2 / 2 in between,
//! the node in contact below 0, on the tangent of V - g above 1.

use super::line::Contact;
use super::stage::{mass_of, Obstacle, Rows, Stage};
use crate::lanes::vector::{Vector, LANES};

const MOST_ITERATIONS: usize = 60;
/// The iterations after which half a step is made: where the matrix is not an M-matrix whole ones may go round in circles.
const PATIENCE: usize = 20;
/// What a last iteration may still change in the distances, in cells: it leaves an error of its square.
const SETTLED: f64 = 1e-4;

/// What a distance may still change a value by, as a share of the strike and of what exercise brings, however far it moves: next
/// to nothing is earned or lost by exercise there, and rounding alone may move it for ever.
const UNFELT: f64 = 1e-14;

/// The arrays of the method.
pub struct Newton<V> {
    /// The values that were found.
    pub values: Vec<V>,
    s: Vec<V>,
    slope: Vec<V>,
    /// How far each node is from a contact set: 0 in it, 1 where none is near.
    inside: Vec<V>,
    /// Whether `s` of a lane is that of the stage before.
    fresh: [bool; LANES],
    /// What each row is left with by the elimination from the far end: right-hand side, pivot, lower neighbour.
    right: Vec<V>,
    pivot: Vec<V>,
}

/// The equations of the rows, and what the elimination from the far end has left of them.
pub struct System<'a, V> {
    /// The last row that may touch, in each lane and the largest of them.
    pub tops: V,
    pub top: usize,
    /// The signed spots at the nodes.
    pub signed: &'a [V],
    /// What the stage starts from, the right-hand sides with the elimination, its pivots, and one over these.
    pub base: &'a [V],
    pub left: &'a [V],
    pub pivot: &'a [V],
    pub inverse: &'a [V],
}

/// V and the mass times the implicit weight at some s, and their derivatives.
struct Point<V> {
    value: V,
    mass: V,
    slope: V,
    change: V,
    inside: V,
}

impl<V: Vector> Newton<V> {
    #[inline(always)]
    pub fn new(nodes: usize) -> Self {
        let array = vec![V::zero(); nodes];
        Self {
            values: array.clone(),
            s: array.clone(),
            slope: array.clone(),
            inside: array.clone(),
            fresh: [false; LANES],
            right: array.clone(),
            pivot: array,
        }
    }

    /// Solve the stage from values near by; return which lanes have settled.
    #[inline(always)]
    pub fn solve<R: Rows<V>>(
        &mut self,
        stage: &Stage<R, V>,
        obstacle: &Obstacle<V>,
        rows: &System<V>,
        near: &[V],
        wanted: [bool; LANES],
    ) -> [bool; LANES] {
        let (top, signed) = (rows.top, rows.signed);
        let last = self.s.len() - 2;
        let one = V::all(1.0);
        let mut kept = [1.0; LANES]; // below 0 where the method goes on from where it was
        for l in 0..LANES {
            if self.fresh[l] && wanted[l] {
                kept[l] = -1.0;
            }
        }
        self.fresh = wanted;
        let kept = V::from_lanes(kept);
        for i in 1..=top {
            let (gain, rise) = obstacle.at(signed[i], stage.rows.at(i).half_inverse);
            let may = gain.min(rise);
            let value = near[i];
            let height = (value - gain) / may.negative(one, rise);
            let inside = height.max(V::zero()).min(one).sqrt();
            let s = height
                .plus(-1.0)
                .negative(inside, height.plus(1.0).times(0.5));
            self.s[i] = kept.negative(self.s[i], may.negative(value, s));
        }
        // A lane that has settled, or is not wanted, stays as it is, so that it does not depend on the others.
        let mut moving = wanted.map(|wanted| if wanted { -1.0 } else { 1.0 });
        for iteration in 0..MOST_ITERATIONS {
            let length = if iteration < PATIENCE { 1.0 } else { 0.5 };
            let moved = self
                .iterate(stage, obstacle, rows, V::from_lanes(moving), length)
                .lanes();
            for (moving, moved) in moving.iter_mut().zip(moved) {
                if moved <= SETTLED {
                    *moving = 1.0;
                }
            }
            if moving.iter().all(|moving| *moving > 0.0) {
                break;
            }
        }
        let settled = moving.map(|moving| moving > 0.0);
        for i in 1..=last {
            let lower = stage.lower_of(i, last);
            let free = (rows.left[i] - lower * self.values[i - 1]) * rows.inverse[i];
            self.values[i] = free;
            if i <= top {
                let own = Self::point(stage, obstacle, signed, i, self.s[i]).value;
                self.values[i] = Self::behind(rows, i).negative(free, own);
            }
        }
        let touching = self.touching(stage, obstacle, signed);
        let (q, p) = (stage.near_rule, stage.far_rule);
        let free = self.values[1] * q.plus(1.0) - q * self.values[2];
        self.values[0] = touching.negative(obstacle.strike - signed[0], free);
        self.values[last + 1] = self.values[last] * p.plus(1.0) - p * self.values[last - 1];
        self.mark(stage, obstacle, rows);
        settled
    }

    /// The stage before was not solved by this method, but in these lanes.
    pub fn forget(&mut self, wanted: [bool; LANES]) {
        for (fresh, wanted) in self.fresh.iter_mut().zip(wanted) {
            *fresh &= wanted;
        }
    }

    /// Below 0 in the lanes whose rows that may touch end before a row.
    #[inline(always)]
    #[allow(clippy::cast_precision_loss)]
    fn behind(rows: &System<V>, row: usize) -> V {
        rows.tops.plus(-(row as f64))
    }

    /// Below 0 where the first inner node is in contact, and with it the near end.
    #[inline(always)]
    fn touching<R: Rows<V>>(&self, stage: &Stage<R, V>, obstacle: &Obstacle<V>, signed: &[V]) -> V {
        let (gain, rise) = obstacle.at(signed[1], stage.rows.at(1).half_inverse);
        let one = V::all(1.0);
        gain.min(rise)
            .negative(one, self.s[1].plus(-f64::MIN_POSITIVE))
    }

    #[inline(always)]
    fn point<R: Rows<V>>(
        stage: &Stage<R, V>,
        obstacle: &Obstacle<V>,
        signed: &[V],
        i: usize,
        s: V,
    ) -> Point<V> {
        let (zero, one) = (V::zero(), V::all(1.0));
        let (gain, rise) = obstacle.at(signed[i], stage.rows.at(i).half_inverse);
        let may = gain.min(rise);
        let inside = s.max(zero).min(one);
        let (beyond, short) = (s - inside, one - inside);
        let value = (inside * inside + beyond.max(zero).times(2.0)).times_plus(rise, gain);
        let cost = rise * stage.rows.at(i).spread.times(2.0); // a c
        let mass = cost * ((short * short).times(0.5) - beyond.min(zero));
        Point {
            value: may.negative(s, value),
            mass: may.negative(zero, mass),
            slope: may.negative(one, rise.times(2.0) * inside),
            change: may.negative(zero, -(cost * short)),
            inside: may.negative(one, inside),
        }
    }

    /// One step of Newton's method, or a part of it, in the lanes where `moving` is below 0; return by how much a distance
    /// changes at most.
    #[inline(always)]
    fn iterate<R: Rows<V>>(
        &mut self,
        stage: &Stage<R, V>,
        obstacle: &Obstacle<V>,
        rows: &System<V>,
        moving: V,
        length: f64,
    ) -> V {
        let (top, signed) = (rows.top, rows.signed);
        let (zero, one) = (V::zero(), V::all(1.0));
        let q = stage.near_rule;
        let touching = self.touching(stage, obstacle, signed);
        let last = self.s.len() - 2;
        // Elimination from the far end, which the rows behind the top have gone through already:
        // pivot_i d_i + lower_i slope_{i-1} d_{i-1} = right_i.
        let mut here = Self::point(stage, obstacle, signed, top, self.s[top]);
        let mut below = Self::point(stage, obstacle, signed, top - 1, self.s[top - 1]);
        let (mut above_value, mut above_slope) = (zero, zero);
        let (mut above_right, mut above_pivot, mut lower) = (zero, one, stage.lower_of(top, last));
        for i in (1..=top).rev() {
            let (mut before, mut diagonal, mut upper) = (
                below.value,
                stage.rows.at(i).diagonal,
                stage.rows.at(i).upper,
            );
            let own_lower = stage.lower_of(i, last);
            // From the last row on that may touch, the far rows are eliminated already.
            let coupled = -Self::behind(rows, i); // below 0 in the rows before that
            diagonal = coupled.negative(diagonal, rows.pivot[i]);
            upper = coupled.negative(upper, zero);
            let base = [rows.base[i - 1], rows.base[i], rows.base[i + 1]];
            let right = coupled.negative(mass_of(stage.rows.at(i).mass, base), rows.left[i]);
            if i == 1 {
                let free = here.value * q.plus(1.0) - q * above_value;
                before = touching.negative(obstacle.strike - signed[0], free);
            }
            let row = own_lower * before + diagonal * here.value + upper * above_value;
            let mut rest = right + here.mass - row;
            if i == 1 {
                let first = touching.negative(zero, q.plus(1.0));
                diagonal = own_lower.times_plus(first, diagonal);
                upper = upper - own_lower * touching.negative(zero, q);
            }
            let factor = upper * above_slope / above_pivot;
            let pivot = (diagonal - factor * lower) * here.slope - here.change;
            rest = rest - factor * above_right;
            lower = own_lower;
            (self.right[i], self.pivot[i], self.slope[i]) = (rest, pivot, here.slope);
            self.inside[i] = here.inside;
            (above_right, above_pivot, above_slope) = (rest, pivot, here.slope);
            above_value = here.value;
            if i > 1 {
                here = below;
                let next = i.saturating_sub(2).max(1);
                below = Self::point(stage, obstacle, signed, next, self.s[next]);
            }
        }
        let mut moved = zero;
        let mut change = self.right[1] / self.pivot[1];
        for (i, signed) in signed.iter().enumerate().take(top + 1).skip(1) {
            if i > 1 {
                let lower = stage.lower_of(i, last);
                change = (self.right[i] - lower * self.slope[i - 1] * change) / self.pivot[i];
            }
            let s = moving.negative(change.times(length) + self.s[i], self.s[i]);
            self.s[i] = s;
            let inside = self.inside[i];
            let (gain, rise) = obstacle.at(*signed, stage.rows.at(i).half_inverse);
            let now = gain.min(rise).negative(inside, s.max(zero).min(one));
            let drift = (now - inside).abs();
            let unfelt = gain.abs().plus(1.0).times(UNFELT);
            let felt = drift * rise - unfelt;
            moved = moved.max(felt.negative(zero, drift));
        }
        moved
    }

    /// Leave in `slope` how far each node is from a contact set: below 0 in it, 1 where none is near.
    #[inline(always)]
    fn mark<R: Rows<V>>(&mut self, stage: &Stage<R, V>, obstacle: &Obstacle<V>, rows: &System<V>) {
        let one = V::all(1.0);
        self.slope.fill(one);
        for i in 1..=rows.top {
            let (gain, rise) = obstacle.at(rows.signed[i], stage.rows.at(i).half_inverse);
            self.slope[i] = gain.min(rise).negative(one, self.s[i].min(one));
        }
    }

    /// The contact set of a lane: of several intervals the one that is furthest from the near end.
    #[allow(clippy::cast_precision_loss)]
    pub fn contact(&self, lane: usize) -> Contact {
        let last = self.s.len() - 2;
        let distance = |i: usize| self.slope[i].lane(lane);
        let Some(final_node) = (1..=last).rev().find(|&i| distance(i) <= 0.0) else {
            return Contact::NONE;
        };
        let first = (1..final_node).rev().find(|&i| distance(i) > 0.0);
        let end = if final_node < last {
            final_node as f64 + 1.0 - distance(final_node + 1)
        } else {
            final_node as f64
        };
        let begin = first.map_or(f64::NEG_INFINITY, |i| i as f64 + distance(i));
        Contact { begin, end }
    }
}
