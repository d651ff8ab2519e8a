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

/// A finite end of a piece.
#[derive(Clone, Copy, Debug)]
pub struct End {
    pub place: f64,
    /// Constant and slope of what ends there less those of what begins.
    pub constant: f64,
    pub slope: f64,
    /// e^place.
    pub spot: f64,
}

const HALF: usize = LANES / 2;
/// 1 in the lanes of the slopes.
const SLOPES: [f64; LANES] = {
    let mut lanes = [0.0; LANES];
    let mut k = HALF;
    while k < LANES {
        lanes[k] = 1.0;
        k += 1;
    }
    lanes
};

/// Up to eight ends in one vector: lane k weighs the constant at end k, lane k + 8 the slope there.
#[derive(Clone, Debug)]
struct Jumps {
    places: [f64; LANES],
    amounts: [f64; LANES],
    /// 1, and e^place for the slopes.
    spots: [f64; LANES],
    /// By how much the value jumps: amounts times spots.
    heights: [f64; LANES],
}

impl Jumps {
    fn new(ends: &[End]) -> Jumps {
        let mut jumps = Jumps {
            places: [ends[0].place; LANES],
            amounts: [0.0; LANES],
            spots: [1.0; LANES],
            heights: [0.0; LANES],
        };
        for (k, end) in ends.iter().enumerate() {
            for (lane, amount, spot) in [(k, end.constant, 1.0), (k + HALF, end.slope, end.spot)] {
                jumps.places[lane] = end.place;
                jumps.amounts[lane] = amount;
                jumps.spots[lane] = spot;
                jumps.heights[lane] = amount * spot;
            }
        }
        jumps
    }
}

/// What e^{sL} needs to know of s.
#[derive(Clone, Copy, Debug)]
pub struct Passage {
    spread: f64,
    inverse: f64,
    shift: f64,
    bond: f64,
    discount: f64,
}

impl Passage {
    /// Through a time s > 0.
    pub fn new(flow: &Flow, s: f64) -> Passage {
        let spread = flow.volatility * s.sqrt();
        Passage {
            spread,
            inverse: 1.0 / spread,
            shift: flow.drift() * s,
            bond: (-flow.rate * s).exp(),
            discount: (-flow.dividend * s).exp(),
        }
    }
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
    /// The finite ends of the pieces.
    ends: Vec<End>,
    jumps: Vec<Jumps>,
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
                } else if end > f64::NEG_INFINITY && (constant != 0.0 || slope != 0.0) {
                    profile.ends.push(End {
                        place: end,
                        constant,
                        slope,
                        spot: end.exp(),
                    });
                }
            }
        }
        profile.jumps = profile.ends.chunks(HALF).map(Jumps::new).collect();
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

    /// The finite ends of the pieces.
    pub fn ends(&self) -> &[End] {
        &self.ends
    }

    /// Constant and slope of what holds far to the right.
    pub fn far_right(&self) -> (f64, f64) {
        (self.constant, self.slope)
    }

    /// Value, slope and second derivative by x of e^{sL} profile at x, for s > 0.
    pub fn propagate(&self, flow: &Flow, x: f64, s: f64) -> [f64; 3] {
        self.passed(&Passage::new(flow, s), x, x.exp())
    }

    /// The same for a known passage, at x = ln(spot).
    pub fn passed(&self, passage: &Passage, x: f64, spot: f64) -> [f64; 3] {
        dispatch(Propagation {
            profile: self,
            passage,
            x,
            spot,
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
    passage: &'a Passage,
    x: f64,
    spot: f64,
}

impl Work for Propagation<'_> {
    type Result = [f64; 3];

    #[inline(always)]
    fn run<V: Vector>(self) -> [f64; 3] {
        let (profile, stock) = (self.profile, self.spot * self.passage.discount);
        let &Passage {
            spread,
            inverse,
            shift,
            bond,
            ..
        } = self.passage;
        let centre = self.x + shift;
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
        if !profile.jumps.is_empty() {
            let in_stocks = V::from_lanes(SLOPES);
            let wholes = in_stocks.times_plus(V::all(stock - bond), V::all(bond));
            let apart = in_stocks.times(-spread);
            for jumps in &profile.jumps {
                let z = V::from_lanes(jumps.places).plus(-centre).times(inverse);
                let density = exp((z * z).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI * bond);
                // e^x n(z - spread) e^{-q s} = e^end n(z) e^{-r s}
                let there = density * V::from_lanes(jumps.spots);
                let part = V::from_lanes(jumps.amounts) * weighted_normal(z + apart, there, wholes);
                let in_stock = part * in_stocks;
                let height = V::from_lanes(jumps.heights);
                let bend = height * (z.times(inverse) + in_stocks);
                let density = density.times(inverse);
                zeroth = zeroth + part;
                first = first + in_stock - height * density;
                second = second + in_stock - bend * density;
            }
        }
        let far = profile.slope * stock;
        [
            sum(zeroth) + profile.constant * bond + far,
            sum(first) + far,
            sum(second) + far,
        ]
    }
}
