//! The multiplier's contribution to the value: u = r - q e^x on the contact set (a put; its negative for a call).
//!
//! An integral over the ages of the contact sets, sixteen of its nodes side by side; where they are filled up, nodes have
//! no weight.

use super::profile::sum;
use super::stretch::Flow;
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::normal::{exp, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use crate::lanes::vector::{Vector, LANES};

/// What belongs to the ages alone.
#[derive(Clone, Copy)]
pub struct Ages {
    /// Of ln(spot) since.
    pub drift: [f64; LANES],
    pub spread: [f64; LANES],
    inverse: [f64; LANES],
    pub bond: [f64; LANES],
    pub discount: [f64; LANES],
    pub weight: [f64; LANES],
}

/// The blocks of the nodes (age, weight).
pub fn blocks(flow: &Flow, nodes: &[(f64, f64)]) -> Vec<Ages> {
    dispatch(Aging { flow, nodes })
}

struct Aging<'a> {
    flow: &'a Flow,
    nodes: &'a [(f64, f64)],
}

impl Work for Aging<'_> {
    type Result = Vec<Ages>;

    #[inline(always)]
    fn run<V: Vector>(self) -> Vec<Ages> {
        let flow = self.flow;
        let blocks = self.nodes.chunks(LANES).map(|nodes| {
            let (mut age, mut weight) = ([1.0; LANES], [0.0; LANES]);
            for (lane, node) in nodes.iter().enumerate() {
                (age[lane], weight[lane]) = *node;
            }
            let age = V::from_lanes(age);
            let spread = age.sqrt().times(flow.volatility);
            Ages {
                drift: age.times(flow.drift()).lanes(),
                spread: spread.lanes(),
                inverse: (V::all(1.0) / spread).lanes(),
                bond: exp(age.times(-flow.rate)).lanes(),
                discount: exp(age.times(-flow.dividend)).lanes(),
                weight,
            }
        });
        blocks.collect()
    }
}

/// From where contact sets are seen, and where they ended: x and e^x of both.
struct Sight<V> {
    x: V,
    spot: V,
    boundary: V,
    edge: V,
}

/// Weighted parts of the value, of its first and second derivative by x, and of the derivatives of value and slope by
/// the boundary.
struct Parts<V> {
    value: V,
    by_x: V,
    by_xx: V,
    value_by_boundary: V,
    slope_by_boundary: V,
}

/// The parts of one block; that of the value only where it is asked for.
#[inline(always)]
fn parts<V: Vector>(
    sign: f64,
    flow: &Flow,
    ages: &Ages,
    sight: &Sight<V>,
    with_value: bool,
) -> Parts<V> {
    let (inverse, bond) = (V::from_lanes(ages.inverse), V::from_lanes(ages.bond));
    let weight = V::from_lanes(ages.weight);
    let d2 = (sight.x + V::from_lanes(ages.drift) - sight.boundary) * inverse;
    let density = exp((d2 * d2).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI) * bond;
    let dividends = if flow.dividend == 0.0 {
        V::zero()
    } else {
        let d1 = d2 + V::from_lanes(ages.spread);
        let stock = sight.spot * V::from_lanes(ages.discount);
        // e^x n(d1) e^{-q age} = e^boundary n(d2) e^{-r age}
        let held = weighted_normal(d1.times(-sign), density * sight.edge, stock);
        held.times(flow.dividend * sign) * weight
    };
    let value = if with_value {
        let interest = weighted_normal(d2.times(-sign), density, bond).times(flow.rate * sign);
        interest.times_plus(weight, -dividends)
    } else {
        V::zero()
    };
    let at_boundary = sight.edge.times(flow.dividend);
    let density = density * inverse * weight;
    let flux = (V::all(flow.rate) - at_boundary) * density;
    let turn = flux * d2 * inverse;
    Parts {
        value,
        by_x: -(flux + dividends),
        by_xx: at_boundary.times_plus(density, turn - dividends),
        value_by_boundary: flux,
        slope_by_boundary: -turn,
    }
}

/// Where the contact sets of one block ended.
#[derive(Clone, Copy)]
pub struct Past {
    pub ages: Ages,
    pub boundary: [f64; LANES],
    /// e^boundary.
    pub edge: [f64; LANES],
}

/// Value, slope and second derivative at x of what the contact sets contribute.
pub fn contribution(sign: f64, flow: &Flow, past: &[Past], x: f64) -> [f64; 3] {
    dispatch(Contribution {
        sign,
        flow,
        past,
        x,
    })
}

struct Contribution<'a> {
    sign: f64,
    flow: &'a Flow,
    past: &'a [Past],
    x: f64,
}

impl Work for Contribution<'_> {
    type Result = [f64; 3];

    #[inline(always)]
    fn run<V: Vector>(self) -> [f64; 3] {
        let (x, spot) = (V::all(self.x), V::all(self.x.exp()));
        let mut sums = [V::zero(); 3];
        for past in self.past {
            let sight = Sight {
                x,
                spot,
                boundary: V::from_lanes(past.boundary),
                edge: V::from_lanes(past.edge),
            };
            let parts = parts(self.sign, self.flow, &past.ages, &sight, true);
            for (sum, part) in sums.iter_mut().zip([parts.value, parts.by_x, parts.by_xx]) {
                *sum = *sum + part;
            }
        }
        sums.map(sum)
    }
}

/// Contact sets as seen from many places, one of them for each node.
pub struct Views {
    blocks: Vec<View>,
}

#[derive(Clone, Copy)]
struct View {
    ages: Ages,
    x: [f64; LANES],
    /// e^x.
    spot: [f64; LANES],
    boundary: [f64; LANES],
    seen: [[f64; LANES]; 5],
}

/// What is seen, weighted: value, slope and second derivative, and the derivatives of value and slope by the boundary.
#[derive(Clone, Copy)]
pub struct Seen {
    pub value: f64,
    pub by_x: f64,
    pub by_xx: f64,
    pub value_by_boundary: f64,
    pub slope_by_boundary: f64,
}

impl Views {
    /// Of the nodes (age, weight).
    pub fn new(flow: &Flow, nodes: &[(f64, f64)]) -> Self {
        let blocks = blocks(flow, nodes).into_iter().map(|ages| View {
            ages,
            x: [0.0; LANES],
            spot: [1.0; LANES],
            boundary: [0.0; LANES],
            seen: [[0.0; LANES]; 5],
        });
        Views {
            blocks: blocks.collect(),
        }
    }

    /// Look at the contact set of node `index`, which ended at `boundary`, from x = ln(spot).
    pub fn place(&mut self, index: usize, x: f64, spot: f64, boundary: f64) {
        let (view, lane) = (&mut self.blocks[index / LANES], index % LANES);
        (view.x[lane], view.spot[lane]) = (x, spot);
        view.boundary[lane] = boundary;
    }

    /// Fill in what they contribute; to the value only if that is asked for.
    pub fn integrate(&mut self, sign: f64, flow: &Flow, with_value: bool) {
        dispatch(Integration {
            sign,
            flow,
            with_value,
            views: self,
        });
    }

    /// What node `index` contributes.
    pub fn seen(&self, index: usize) -> Seen {
        let seen = &self.blocks[index / LANES].seen;
        let [value, by_x, by_xx, value_by_boundary, slope_by_boundary] =
            std::array::from_fn(|column| seen[column][index % LANES]);
        Seen {
            value,
            by_x,
            by_xx,
            value_by_boundary,
            slope_by_boundary,
        }
    }
}

struct Integration<'a> {
    sign: f64,
    flow: &'a Flow,
    with_value: bool,
    views: &'a mut Views,
}

impl Work for Integration<'_> {
    type Result = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        for view in &mut self.views.blocks {
            let boundary = V::from_lanes(view.boundary);
            let sight = Sight {
                x: V::from_lanes(view.x),
                spot: V::from_lanes(view.spot),
                boundary,
                edge: exp(boundary),
            };
            let parts = parts(self.sign, self.flow, &view.ages, &sight, self.with_value);
            view.seen = [
                parts.value.lanes(),
                parts.by_x.lanes(),
                parts.by_xx.lanes(),
                parts.value_by_boundary.lanes(),
                parts.slope_by_boundary.lanes(),
            ];
        }
    }
}
