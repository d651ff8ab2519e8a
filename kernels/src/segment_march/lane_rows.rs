//! The arithmetic of one stage for sixteen marches side by side, each with its own grid, operator and step.
//!
//! Every lane does what `stage` does where the exercise region is one run of rows at an end of the grid, operation by
//! operation, without fused products: a march has the same bits here and there. Row 0 is the end of the grid where the
//! region is expected; for a call the rows are reversed.

#![allow(clippy::inline_always)] // as in `lanes`

use super::elimination::SMALLEST_RESPONSE;
use super::SDIRK2_THETA;
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::vector::{Vector, LANES};

pub(super) type Column = [f64; LANES];
const ZERO: Column = [0.0; LANES];

/// The numbers of one interior node, one march per lane.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Row {
    pub s: Column,
    /// 1/max(1, s).
    pub weight: Column,
    /// L's entry towards row 0; nothing in row 0 itself.
    pub lower: Column,
    pub diagonal: Column,
    /// L's entry away from row 0; nothing in the last row.
    pub upper: Column,
    /// v after the last stage.
    pub value: Column,
    /// v at the start of the step.
    pub start: Column,
    /// v - g after the last stage.
    pub slack: Column,
    /// The right-hand side: M g - base - h e.
    pub q: Column,
    /// One over the pivot of the elimination towards row 0.
    pub pivot: Column,
    /// What the elimination leaves: z = intercept + slope times the z of the row before.
    pub intercept: Column,
    /// One over M's diagonal.
    reciprocal: Column,
    slope: Column,
    carry: Column,
}

impl Row {
    /// What makes no trouble where no march is.
    pub const IDLE: Self = Self {
        s: ZERO,
        weight: ZERO,
        lower: ZERO,
        diagonal: ZERO,
        upper: ZERO,
        value: ZERO,
        start: ZERO,
        slack: ZERO,
        q: ZERO,
        pivot: ZERO,
        intercept: ZERO,
        reciprocal: ZERO,
        slope: ZERO,
        carry: ZERO,
    };
}

/// What the lanes of a stage know.
#[derive(Clone, Copy)]
pub(super) struct Terms {
    /// The stage's step.
    pub h: Column,
    /// 1 for a put, -1 for a call, 0 where nothing can be exercised and v itself is solved for.
    pub sign: Column,
    /// The smallest slack: 0, or minus infinity where nothing can be exercised.
    pub floor: Column,
    /// 1 - A e^{-rt}.
    pub strike_left: Column,
    /// h times L's entry times v at the end node next to row 0, and next to the last row.
    pub ends: [Column; 2],
}

/// What the direct solution looks like.
pub(super) struct Found {
    pub residual: Column,
    pub largest: Column,
    /// The number of rows without slack, and of rows up to the last of them.
    pub contact: Column,
    pub up_to: Column,
}

/// A boundary placed inside its cell: the number of rows in contact, and what the row next to them lacks.
pub(super) struct Placed {
    /// Negative where there is none.
    pub contact: Column,
    pub missing: Column,
}

/// Begin a step: keep v, and compute pivots; return the smallest one.
pub(super) struct Factor<'a>(pub &'a mut [Row], pub &'a Column);

/// Form q for a stage, the second one of a step or the first; solve the complementarity problem, and write v.
pub(super) struct Solve<'a>(pub &'a mut [Row], pub &'a Terms, pub bool);

/// Solve once more with the boundaries placed inside their cells; return residual and largest slack of these lanes.
pub(super) struct Correct<'a>(pub &'a mut [Row], pub &'a Terms, pub &'a Placed);

impl Factor<'_> {
    pub fn done(self) -> Column {
        dispatch(self)
    }
}

impl Solve<'_> {
    pub fn done(self) -> Found {
        dispatch(self)
    }
}

impl Correct<'_> {
    pub fn done(self) -> [Column; 2] {
        dispatch(self)
    }
}

#[inline(always)]
fn of<V: Vector>(column: &Column) -> V {
    V::from_lanes(*column)
}

/// The rows of M = 1 - h L.
#[derive(Clone, Copy)]
struct Matrix<V> {
    h: V,
}

impl<V: Vector> Matrix<V> {
    #[inline(always)]
    fn diagonal(self, row: &Row) -> V {
        V::all(1.0) - self.h * of::<V>(&row.diagonal)
    }

    #[inline(always)]
    fn lower(self, row: &Row) -> V {
        -self.h * of::<V>(&row.lower)
    }

    #[inline(always)]
    fn upper(self, row: &Row) -> V {
        -self.h * of::<V>(&row.upper)
    }

    #[inline(always)]
    fn times(self, row: &Row, below: V, own: V, above: V) -> V {
        self.diagonal(row) * own + (self.lower(row) * below + self.upper(row) * above)
    }
}

/// The largest natural residual and the largest slack, seen row by row.
struct Measure<V> {
    matrix: Matrix<V>,
    residual: V,
    largest: V,
}

impl<V: Vector> Measure<V> {
    #[inline(always)]
    fn new(h: V) -> Self {
        Self {
            matrix: Matrix { h },
            residual: V::zero(),
            largest: V::zero(),
        }
    }

    #[inline(always)]
    fn see(&mut self, row: &Row, below: V, own: V, above: V) {
        let w = self.matrix.times(row, below, own, above) + of::<V>(&row.q);
        let natural = own.min(w * of::<V>(&row.reciprocal)).abs();
        let weight = of::<V>(&row.weight);
        self.residual = self.residual.max(natural * weight);
        self.largest = self.largest.max(own * weight);
    }
}

impl Work for Factor<'_> {
    type Result = Column;
    #[inline(always)]
    fn run<V: Vector>(self) -> Column {
        let Self(rows, h) = self;
        let (matrix, one) = (Matrix::<V> { h: of(h) }, V::all(1.0));
        let (mut smallest, mut less) = (V::all(f64::INFINITY), V::zero());
        for index in (0..rows.len()).rev() {
            let outward = if index > 0 {
                matrix.upper(&rows[index - 1])
            } else {
                V::zero()
            };
            let row = &mut rows[index];
            let diagonal = matrix.diagonal(row);
            let pivot = diagonal - less;
            smallest = smallest.min(pivot);
            let (reciprocal, inward) = (one / pivot, matrix.lower(row));
            let carry = outward * reciprocal;
            less = carry * inward;
            row.reciprocal = (one / diagonal).lanes();
            row.pivot = reciprocal.lanes();
            row.slope = (-inward * reciprocal).lanes();
            row.carry = carry.lanes();
            row.start = row.value;
        }
        smallest.lanes()
    }
}

impl Solve<'_> {
    /// From the last row to row 0: q and the intercepts.
    #[inline(always)]
    fn eliminate<V: Vector>(&mut self) {
        let Self(rows, terms, second) = self;
        let matrix = Matrix::<V> { h: of(&terms.h) };
        let (sign, left) = (of::<V>(&terms.sign), of::<V>(&terms.strike_left));
        let obstacle = |row: &Row| sign * (left - of::<V>(&row.s));
        let ahead = V::all((1.0 - SDIRK2_THETA) / SDIRK2_THETA);
        let last = rows.len() - 1;
        let (mut above, mut own) = (V::zero(), obstacle(&rows[last]));
        let mut carried = V::zero();
        for index in (0..=last).rev() {
            let below = if index > 0 {
                obstacle(&rows[index - 1])
            } else {
                V::zero()
            };
            let row = &mut rows[index];
            let start = of::<V>(&row.start);
            let base = if *second {
                start + ahead * (of::<V>(&row.value) - start)
            } else {
                start
            };
            let mut q = matrix.times(row, below, own, above) - base;
            if index == 0 {
                q = q - of(&terms.ends[0]);
            }
            if index == last {
                q = q - of(&terms.ends[1]);
            }
            let rest = q - carried;
            row.q = q.lanes();
            row.intercept = (-rest * of::<V>(&row.pivot)).lanes();
            carried = of::<V>(&row.carry) * rest;
            (above, own) = (own, below);
        }
    }

    /// From row 0 to the last row: the slack.
    #[inline(always)]
    fn substitute<V: Vector>(&mut self) -> Found {
        let Self(rows, terms, _) = self;
        let (floor, zero, one) = (of::<V>(&terms.floor), V::zero(), V::all(1.0));
        let (sign, left) = (of::<V>(&terms.sign), of::<V>(&terms.strike_left));
        let mut measure = Measure::<V>::new(of(&terms.h));
        let (mut before, mut own) = (zero, zero);
        let (mut contact, mut up_to, mut count) = (zero, zero, zero);
        for index in 0..rows.len() {
            let row = &mut rows[index];
            let z = (of::<V>(&row.intercept) + of::<V>(&row.slope) * own).max(floor);
            row.slack = z.lanes();
            row.value = (sign * (left - of::<V>(&row.s)) + z).lanes();
            count = count + one;
            contact = (-z).negative(contact, contact + one);
            up_to = (-z).negative(up_to, count);
            if index > 0 {
                measure.see(&rows[index - 1], before, own, z);
            }
            (before, own) = (own, z);
        }
        measure.see(&rows[rows.len() - 1], before, own, zero);
        Found {
            residual: measure.residual.lanes(),
            largest: measure.largest.lanes(),
            contact: contact.lanes(),
            up_to: up_to.lanes(),
        }
    }
}

impl Work for Solve<'_> {
    type Result = Found;
    #[inline(always)]
    fn run<V: Vector>(mut self) -> Found {
        self.eliminate::<V>();
        self.substitute::<V>()
    }
}

impl Work for Correct<'_> {
    type Result = [Column; 2];
    #[inline(always)]
    fn run<V: Vector>(self) -> [Column; 2] {
        let Self(rows, terms, placed) = self;
        let (contact, missing) = (of::<V>(&placed.contact), of::<V>(&placed.missing));
        let (sign, left) = (of::<V>(&terms.sign), of::<V>(&terms.strike_left));
        let (zero, one, tiny) = (V::zero(), V::all(1.0), V::all(SMALLEST_RESPONSE));
        let mut measure = Measure::<V>::new(of(&terms.h));
        let (mut uncorrected, mut response, mut place) = (zero, zero, zero);
        let (mut before, mut own) = (zero, zero);
        for index in 0..rows.len() {
            let row = &mut rows[index];
            let slope = of::<V>(&row.slope);
            let inside = place - contact; // negative in contact, 0 in the row next to it
            uncorrected = inside.negative(zero, of::<V>(&row.intercept) + slope * uncorrected);
            response = (-inside).negative(response * slope, inside.negative(zero, of(&row.pivot)));
            response = (response.abs() - tiny).negative(zero, response);
            let z = (uncorrected + missing * response).max(zero);
            let z = contact.negative(of(&row.slack), z);
            row.slack = z.lanes();
            row.value = (sign * (left - of::<V>(&row.s)) + z).lanes();
            place = place + one;
            if index > 0 {
                measure.see(&rows[index - 1], before, own, z);
            }
            (before, own) = (own, z);
        }
        measure.see(&rows[rows.len() - 1], before, own, zero);
        [measure.residual.lanes(), measure.largest.lanes()]
    }
}
