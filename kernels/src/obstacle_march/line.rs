//! The value at one time between the nodes: the obstacle in the contact set, polynomials beyond it.

use super::contract::Contract;
use super::mesh::Grid;
use crate::lanes::vector::{Vector, LANES};

/// The number of points of the polynomials.
const POINTS: usize = 6;
/// The fewest on one side of a contact set; where there are fewer it is disregarded.
const FEWEST_POINTS: usize = 3;

/// What exercise must bring more than waiting, as a share of the strike: more than rounding does.
const LEAST_GAIN: f64 = 1e-12;

/// The points next to the end of a contact set, that end among them.
const NEAR_POINTS: usize = 5;

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

impl<'a> Line<'a> {
    /// The value after what happens at the end of a segment that is not the last.
    pub fn after(
        contract: &Contract,
        number: usize,
        grid: &Grid,
        values: &'a [f64],
        contact: Contact,
    ) -> Self {
        Self {
            grid: *grid,
            values,
            contact,
            strike: contract.segments[number + 1].strike_at_beginning(),
        }
    }

    /// The value at a spot of 0 or more.
    pub fn at(&self, spot: f64) -> f64 {
        let index = self.grid.index(spot);
        if self.contact.holds(index) {
            return self.grid.sign * (self.strike - spot);
        }
        self.free_value(spot, index)
    }

    /// The values at so many places, in numbers of nodes, and at the spots there.
    #[inline(always)]
    #[allow(clippy::cast_precision_loss)]
    pub fn at_many<V: Vector>(
        &self,
        count: usize,
        indices: &[f64; LANES],
        spot: impl Fn(usize) -> f64,
        values: &mut [f64],
    ) {
        let mut nodes = [[0.0; LANES]; POINTS];
        let mut within = [0.0; LANES];
        let mut apart = [true; LANES]; // where there are fewer points, or none
        for (k, index) in indices.iter().enumerate().take(count) {
            if self.contact.holds(*index) {
                continue;
            }
            if let Some((start, POINTS, u)) = self.stencil(*index) {
                (within[k], apart[k]) = (u, false);
                for (point, value) in nodes.iter_mut().zip(&self.values[start..start + POINTS]) {
                    point[k] = *value;
                }
            }
        }
        let [a, b, c, d, e, f] = nodes; // a closure over vectors would be a call for each
        let nodes = [
            V::from_lanes(a),
            V::from_lanes(b),
            V::from_lanes(c),
            V::from_lanes(d),
            V::from_lanes(e),
            V::from_lanes(f),
        ];
        let found = polynomial_values(nodes, V::from_lanes(within)).lanes();
        for (k, value) in values.iter_mut().enumerate() {
            *value = if apart[k] { self.at(spot(k)) } else { found[k] };
        }
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

    /// The value and its first two derivatives by the number of a node, outside the contact set.
    pub fn free(&self, spot: f64, index: f64) -> [f64; 3] {
        match self.stencil(index) {
            None => self.beyond(spot, index < 0.0),
            Some((start, points, u)) => polynomial(&self.values[start..start + points], u),
        }
    }

    /// The value and its slope, and the rate of change and its slope, by the number of a node, outside the contact set.
    ///
    /// The second derivative jumps where the contact set ends, and the rate at the node of that cell is wrong. Near
    /// there the value is told by (V - g)/y^2, with y the distance, which `rise` continues to the end, and the rate by
    /// the further nodes and what it is at the end, that of the obstacle.
    pub fn local(
        &self,
        spot: f64,
        index: f64,
        rates: &[f64],
        rise: impl Fn(f64) -> f64,
        obstacle_rate: f64,
    ) -> [f64; 4] {
        let stencil = self.stencil(index);
        let Some((end, nodes)) =
            self.near_end(index, stencil.map(|(start, points, _)| (start, points)))
        else {
            let [value, slope, _] = self.free(spot, index);
            let [rate, rate_slope, _] = if let Some((start, points, u)) = stencil {
                polynomial(&rates[start..start + points], u)
            } else {
                let own = Line {
                    values: rates,
                    ..*self
                };
                own.beyond(spot, index < 0.0)
            };
            return [value, slope, rate, rate_slope];
        };
        let mut places = [end; NEAR_POINTS];
        let mut heights = [rise(end); NEAR_POINTS];
        let mut near_rates = [obstacle_rate; NEAR_POINTS];
        for (k, node) in nodes.into_iter().enumerate() {
            #[allow(clippy::cast_precision_loss)]
            let place = node as f64;
            let gain = self.grid.sign * (self.strike - self.grid.spot(node));
            places[k + 1] = place;
            heights[k + 1] = (self.values[node] - gain) / (place - end).powi(2);
            near_rates[k + 1] = rates[node];
        }
        let [height, bend] = through(&places, &heights, index);
        let [rate, rate_slope] = through(&places, &near_rates, index);
        let away = index - end;
        let value = self.grid.sign * (self.strike - spot) + away * away * height;
        let slope = -spot * self.grid.h + away * (2.0 * height + away * bend);
        [value, slope, rate, rate_slope]
    }

    /// The end of the contact set next to a place outside it, and the nodes beyond it without the nearest one; None where
    /// the polynomial of the place does not use that, or there are too few.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    fn near_end(
        &self,
        index: f64,
        stencil: Option<(usize, usize)>,
    ) -> Option<(f64, [usize; NEAR_POINTS - 1])> {
        let (start, points) = stencil?;
        let Contact { begin, end } = self.contact;
        if index > end && end >= 0.0 {
            let nearest = end.floor() as usize + 1;
            let is_used = start <= nearest && nearest + NEAR_POINTS <= self.grid.cells;
            return is_used.then(|| (end, std::array::from_fn(|k| nearest + 1 + k)));
        }
        if index < begin && begin.is_finite() {
            let nearest = (begin.ceil() as usize).saturating_sub(1);
            let is_used = start + points > nearest && nearest >= NEAR_POINTS;
            return is_used.then(|| (begin, std::array::from_fn(|k| nearest - 1 - k)));
        }
        None
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

    /// What the value at a spot outside the contact set is made of.
    pub fn reading(&self, spot: f64, index: f64) -> Reading {
        if let Some((start, points, u)) = self.stencil(index) {
            return Reading {
                start,
                points,
                weights: lagrange(points, u),
            };
        }
        let last = self.grid.cells;
        let (start, end, next) = if index < 0.0 {
            (0, 0, 1)
        } else {
            (last - 1, last, last - 1)
        };
        let (at, inside) = (self.grid.spot(end), self.grid.spot(next));
        let share = (spot - at) / (inside - at);
        let mut weights = [0.0; POINTS];
        (weights[end - start], weights[next - start]) = (1.0 - share, share);
        Reading {
            start,
            points: 2,
            weights,
        }
    }

    /// The contact set; where the grid has none that below it, at spots at which exercising a put brings more than the line
    /// that the value goes on with. The holder of a spot that a dividend has used up exercises at once.
    pub fn contact_below(&self, exercisable: bool) -> Contact {
        let is_free = self.contact.end == f64::NEG_INFINITY;
        let gain = self.strike - self.beyond(0.0, true)[0]; // at a spot of 0
        if !(is_free && exercisable && self.grid.sign > 0.0 && gain > LEAST_GAIN * self.strike) {
            return self.contact;
        }
        let lost = (self.values[0] - (self.strike - self.grid.spot(0))).max(0.0);
        let spot = self.grid.spot(0) * gain / (gain + lost);
        Contact::from_near_end(self.grid.index(spot).min(-f64::EPSILON))
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

/// A value as a sum over values at nodes.
pub struct Reading {
    pub start: usize,
    pub points: usize,
    pub weights: [f64; POINTS],
}

/// The weights of values at 0, 1, ... in the polynomial through them, at u.
#[allow(clippy::cast_precision_loss)]
fn lagrange(points: usize, u: f64) -> [f64; POINTS] {
    // (u - 0) ... (u - (k - 1)) before each node k, then the same from the other end, each over the factorial.
    let mut weights = [0.0; POINTS];
    let mut product = 1.0;
    for (k, weight) in weights.iter_mut().enumerate().take(points) {
        *weight = product;
        product *= (u - k as f64) * INVERSES[k + 1];
    }
    product = 1.0;
    for k in (0..points).rev() {
        weights[k] *= product;
        product *= (k as f64 - u) * INVERSES[points - k];
    }
    weights
}

/// One over 1, 2, ...; the first is not used.
const INVERSES: [f64; POINTS + 1] = [
    0.0,
    1.0,
    1.0 / 2.0,
    1.0 / 3.0,
    1.0 / 4.0,
    1.0 / 5.0,
    1.0 / 6.0,
];

/// The polynomials through values at 0, ..., 5, at u.
#[inline(always)]
fn polynomial_values<V: Vector>(values: [V; POINTS], u: V) -> V {
    let mut d = values;
    for order in 1..POINTS {
        for k in (order..POINTS).rev() {
            d[k] = d[k] - d[k - 1];
        }
    }
    let mut value = d[5];
    value = value.times_plus(u.plus(-4.0).times(1.0 / 5.0), d[4]);
    value = value.times_plus(u.plus(-3.0).times(1.0 / 4.0), d[3]);
    value = value.times_plus(u.plus(-2.0).times(1.0 / 3.0), d[2]);
    value = value.times_plus(u.plus(-1.0).times(1.0 / 2.0), d[1]);
    value.times_plus(u, d[0])
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

/// The polynomial through values at places, and its slope, at another place.
fn through(places: &[f64; NEAR_POINTS], values: &[f64; NEAR_POINTS], at: f64) -> [f64; 2] {
    let mut d = *values;
    for order in 1..NEAR_POINTS {
        for k in (order..NEAR_POINTS).rev() {
            d[k] = (d[k] - d[k - 1]) / (places[k] - places[k - order]);
        }
    }
    let (mut value, mut slope) = (d[NEAR_POINTS - 1], 0.0);
    for k in (0..NEAR_POINTS - 1).rev() {
        slope = slope * (at - places[k]) + value;
        value = value * (at - places[k]) + d[k];
    }
    [value, slope]
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
