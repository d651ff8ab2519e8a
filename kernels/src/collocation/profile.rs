//! The value as a function of x = ln(S/K) at one instant, and what it is worth earlier if it is not exercised.

use super::panels::Panel;
use super::stretch::{Flow, Stretch};
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::normal::{exp, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use crate::lanes::vector::{Vector, LANES};

/// In standard deviations: what lies further away has no weight.
const FURTHEST: f64 = 7.5;

/// constant + slope e^x for lower < x < upper; the ends may be infinite.
#[derive(Clone, Copy, Debug)]
pub struct Piece {
    pub lower: f64,
    pub upper: f64,
    pub constant: f64,
    pub slope: f64,
}

/// Pieces that are linear in the spot, and Gauss nodes on the rest of the line, in increasing order.
#[derive(Clone, Debug, Default)]
pub struct Profile {
    /// Where the nodes lie, each with the same number of them.
    pub panels: Vec<Panel>,
    /// Filled up to whole vectors with copies of the last node.
    nodes: Vec<f64>,
    /// The value at the nodes times their weights; 0 where they are filled up.
    weighted: Vec<f64>,
    /// The finite ends of the pieces, filled up likewise, and what ends there less what begins.
    ends: Vec<f64>,
    constants: Vec<f64>,
    slopes: Vec<f64>,
    /// e^x at the ends.
    spots: Vec<f64>,
    /// What holds far to the right.
    constant: f64,
    slope: f64,
}

impl Profile {
    pub fn new(
        pieces: &[Piece],
        panels: Vec<Panel>,
        mut nodes: Vec<f64>,
        mut weighted: Vec<f64>,
    ) -> Self {
        let last = nodes.last().copied().unwrap_or(0.0);
        pad(&mut nodes, last);
        pad(&mut weighted, 0.0);
        let mut profile = Profile {
            panels,
            nodes,
            weighted,
            ..Profile::default()
        };
        for piece in pieces {
            for (end, sign) in [(piece.upper, 1.0), (piece.lower, -1.0)] {
                let (constant, slope) = (sign * piece.constant, sign * piece.slope);
                if end == f64::INFINITY {
                    profile.constant += constant;
                    profile.slope += slope;
                } else if end > f64::NEG_INFINITY {
                    profile.ends.push(end);
                    profile.constants.push(constant);
                    profile.slopes.push(slope);
                }
            }
        }
        let last = profile.ends.last().copied().unwrap_or(0.0);
        pad(&mut profile.ends, last);
        pad(&mut profile.constants, 0.0);
        pad(&mut profile.slopes, 0.0);
        profile.spots = profile.ends.iter().map(|end| end.exp()).collect();
        profile
    }

    /// Whether the value is known at nodes anywhere.
    pub fn has_nodes(&self) -> bool {
        !self.nodes.is_empty()
    }

    /// Whether this end of the stretch is but a place in a contact set's history, at which nothing happens.
    pub fn continues(&self, stretch: &Stretch) -> bool {
        stretch.is_continuous() && stretch.exercise_at_end && self.has_nodes()
    }

    /// The nodes of one panel and the values there times their weights.
    pub fn panel(&self, index: usize, points: usize) -> (&[f64], &[f64]) {
        let range = index * points..(index + 1) * points;
        (&self.nodes[range.clone()], &self.weighted[range])
    }

    /// The finite ends of the pieces: place, and constant and slope of what ends there less those of what begins.
    pub fn ends(&self) -> impl Iterator<Item = (f64, f64, f64)> + '_ {
        let jumps = self.constants.iter().zip(&self.slopes);
        self.ends
            .iter()
            .zip(jumps)
            .map(|(end, (constant, slope))| (*end, *constant, *slope))
            .filter(|(_, constant, slope)| *constant != 0.0 || *slope != 0.0)
    }

    /// Constant and slope of what holds far to the right.
    pub fn far_right(&self) -> (f64, f64) {
        (self.constant, self.slope)
    }

    /// Value, slope and second derivative by x of e^{sL} profile at x, for s > 0.
    pub fn propagate(&self, flow: &Flow, x: f64, s: f64) -> [f64; 3] {
        dispatch(Propagation {
            profile: self,
            flow,
            x,
            s,
        })
    }
}

fn pad(values: &mut Vec<f64>, filling: f64) {
    values.resize(values.len().next_multiple_of(LANES), filling);
}

/// Sixteen numbers from a slice.
#[inline(always)]
pub fn load<V: Vector>(values: &[f64]) -> V {
    let mut lanes = [0.0; LANES];
    lanes.copy_from_slice(&values[..LANES]);
    V::from_lanes(lanes)
}

/// The sum of all lanes.
#[inline(always)]
pub fn sum<V: Vector>(values: V) -> f64 {
    let mut lanes = values.lanes();
    let mut width = LANES / 2;
    while width > 0 {
        for k in 0..width {
            lanes[k] += lanes[k + width];
        }
        width /= 2;
    }
    lanes[0]
}

struct Propagation<'a> {
    profile: &'a Profile,
    flow: &'a Flow,
    x: f64,
    s: f64,
}

impl Work for Propagation<'_> {
    type Result = [f64; 3];

    #[inline(always)]
    fn run<V: Vector>(self) -> [f64; 3] {
        let Propagation {
            profile,
            flow,
            x,
            s,
        } = self;
        let spread = flow.volatility * s.sqrt();
        let inverse = 1.0 / spread;
        let centre = x + flow.drift() * s;
        let (bond, stock) = ((-flow.rate * s).exp(), (x - flow.dividend * s).exp());
        let mut zeroth = V::zero();
        let mut first = V::zero();
        let mut second = V::zero();
        for start in (0..profile.nodes.len()).step_by(LANES) {
            let near = (profile.nodes[start + LANES - 1] - centre) * inverse;
            let far = (profile.nodes[start] - centre) * inverse;
            if near < -FURTHEST || far > FURTHEST {
                continue;
            }
            let z = load::<V>(&profile.nodes[start..])
                .plus(-centre)
                .times(inverse);
            let weight = exp((z * z).times(-0.5)) * load::<V>(&profile.weighted[start..]);
            let turned = weight * z;
            zeroth = zeroth + weight;
            first = first + turned;
            second = turned.times_plus(z, second - weight);
        }
        let scale = ONE_OVER_SQRT_TWO_PI * bond * inverse;
        zeroth = zeroth.times(scale);
        first = first.times(scale * inverse);
        second = second.times(scale * inverse * inverse);
        let (in_bonds, in_stocks) = (V::all(bond), V::all(stock));
        for start in (0..profile.ends.len()).step_by(LANES) {
            let z = load::<V>(&profile.ends[start..])
                .plus(-centre)
                .times(inverse);
            let constant = load::<V>(&profile.constants[start..]);
            let slope = load::<V>(&profile.slopes[start..]);
            let spot = load::<V>(&profile.spots[start..]);
            let density = exp((z * z).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI * bond);
            let in_bond = constant * weighted_normal(z, density, in_bonds);
            // e^x n(z - spread) e^{-q s} = e^end n(z) e^{-r s}
            let in_stock = slope * weighted_normal(z.plus(-spread), density * spot, in_stocks);
            let there = slope * spot;
            let whole = constant + there;
            let density = density.times(inverse);
            zeroth = zeroth + in_bond + in_stock;
            first = first + in_stock - whole * density;
            second = second + in_stock - (whole * z.times(inverse) + there) * density;
        }
        let far = profile.slope * stock;
        [
            sum(zeroth) + profile.constant * bond + far,
            sum(first) + far,
            sum(second) + far,
        ]
    }
}
