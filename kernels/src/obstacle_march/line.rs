//! The value at one time between the nodes: the obstacle in the contact set, polynomials beyond it.

use super::mesh::Grid;

/// The number of points of the polynomials.
const POINTS: usize = 6;
/// The fewest on one side of a contact set; where there are fewer it is disregarded.
const FEWEST_POINTS: usize = 3;

/// Where the value is what exercise brings, in numbers of nodes: from `begin` to `end`, both minus infinity where nowhere.
#[derive(Clone, Copy, Debug)]
pub struct Contact {
    /// Minus infinity where it reaches beyond the near end.
    pub begin: f64,
    pub end: f64,
}

impl Contact {
    pub const NONE: Self = Self::from_near_end(f64::NEG_INFINITY);

    /// All up to a place.
    pub const fn from_near_end(end: f64) -> Self {
        Self {
            begin: f64::NEG_INFINITY,
            end,
        }
    }

    /// Whether a place is in contact.
    pub fn holds(&self, index: f64) -> bool {
        index >= self.begin && index <= self.end && self.end > f64::NEG_INFINITY
    }
}

/// The value of one contract at one time as a function of the spot.
pub struct Line<'a> {
    pub grid: Grid,
    /// At the nodes.
    pub values: &'a [f64],
    pub contact: Contact,
    /// The strike less what is escrowed.
    pub strike: f64,
}

impl Line<'_> {
    /// The value at a spot of 0 or more.
    pub fn at(&self, spot: f64) -> f64 {
        let index = self.grid.index(spot);
        if self.contact.holds(index) {
            return self.grid.sign * (self.strike - spot);
        }
        self.free_value(spot, index)
    }

    /// The value outside the contact set.
    fn free_value(&self, spot: f64, index: f64) -> f64 {
        match self.stencil(index) {
            None => self.beyond(spot, index < 0.0)[0],
            Some((start, points, u)) => {
                match <&[f64; POINTS]>::try_from(&self.values[start..start + points]) {
                    Ok(values) => polynomial_value(values, u),
                    Err(_) => polynomial(&self.values[start..start + points], u)[0],
                }
            }
        }
    }

    /// The value and its first two derivatives by x, outside the contact set.
    pub fn free(&self, spot: f64, index: f64) -> [f64; 3] {
        match self.stencil(index) {
            None => self.beyond(spot, index < 0.0),
            Some((start, points, u)) => polynomial(&self.values[start..start + points], u),
        }
    }

    /// The first node of the polynomial at a place, the number of its nodes, and the place from there; None beyond the
    /// ends.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss
    )]
    fn stencil(&self, index: f64) -> Option<(usize, usize, f64)> {
        if !(index >= 0.0 && index <= self.grid.cells as f64) {
            return None;
        }
        let (first, last) = self.free_nodes(index);
        let points = POINTS.min(last + 1 - first);
        let start = (index as usize + 1)
            .saturating_sub(points / 2)
            .clamp(first, last + 1 - points);
        Some((start, points, index - start as f64))
    }

    /// The first and the last node on the same side of the contact set as a place outside it.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss
    )]
    fn free_nodes(&self, index: f64) -> (usize, usize) {
        let last = self.grid.cells;
        let Contact { begin, end } = self.contact;
        let free = if index < begin {
            (0, (begin.ceil() as usize).saturating_sub(1))
        } else if end >= 0.0 {
            ((end.floor() as usize + 1).min(last), last)
        } else {
            (0, last)
        };
        if free.1 + 1 < free.0 + FEWEST_POINTS {
            (0, last)
        } else {
            free
        }
    }

    /// Beyond an end the value is linear in the spot.
    fn beyond(&self, spot: f64, left: bool) -> [f64; 3] {
        let last = self.grid.cells;
        let (end, next) = if left { (0, 1) } else { (last, last - 1) };
        let (at, inside) = (self.grid.spot(end), self.grid.spot(next));
        let slope = (self.values[next] - self.values[end]) / (inside - at);
        let value = slope.mul_add(spot - at, self.values[end]);
        let by_x = self.grid.sign * slope * spot * self.grid.h;
        [value, by_x, self.grid.sign * by_x * self.grid.h]
    }
}

/// The polynomial through values at 0, ..., 5, at u.
fn polynomial_value(values: &[f64; POINTS], u: f64) -> f64 {
    let mut d = *values;
    for order in 1..POINTS {
        for k in (order..POINTS).rev() {
            d[k] -= d[k - 1];
        }
    }
    let mut value = d[5];
    value = value.mul_add((u - 4.0) * (1.0 / 5.0), d[4]);
    value = value.mul_add((u - 3.0) * (1.0 / 4.0), d[3]);
    value = value.mul_add((u - 2.0) * (1.0 / 3.0), d[2]);
    value = value.mul_add((u - 1.0) * (1.0 / 2.0), d[1]);
    value.mul_add(u, d[0])
}

/// The polynomial through values at 0, 1, ..., and its first two derivatives, at u.
fn polynomial(values: &[f64], u: f64) -> [f64; 3] {
    let mut differences = [0.0; POINTS];
    differences[..values.len()].copy_from_slice(values);
    for order in 1..values.len() {
        for k in (order..values.len()).rev() {
            differences[k] -= differences[k - 1];
        }
    }
    let (mut value, mut slope, mut bend) = (0.0, 0.0, 0.0);
    for k in (0..values.len()).rev() {
        #[allow(clippy::cast_precision_loss)]
        let (factor, share) = if k + 1 < values.len() {
            ((u - k as f64) / (k as f64 + 1.0), 1.0 / (k as f64 + 1.0))
        } else {
            (0.0, 0.0)
        };
        bend = bend * factor + 2.0 * slope * share;
        slope = slope * factor + value * share;
        value = value * factor + differences[k];
    }
    [value, slope, bend]
}
