//! The value as a function of x = ln(S/K) at one instant: lines in the spot, and Gauss nodes between them.

use super::panels::Panel;
use super::segment::Segment;
use crate::lanes::vector::LANES;

/// What a piece is, which settles what its line depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PieceKind {
    /// The payoff at this instant: the option is exercised.
    Payoff,
    /// The payoff just after the event: the option is held through it and exercised then, or expires.
    LaterPayoff,
    /// The value of waiting, which is a line where the option is all but sure to be exercised, or never to be.
    Waiting,
    /// The value at a spot of zero, which the event leaves, or of a put next to that.
    AtZero,
    /// Any other line: its dependence on the parameters does not matter, for the spot hardly gets there.
    Other,
}

/// The line constant + slope e^x for lower < x < upper; the ends may be infinite.
#[derive(Clone, Copy, Debug)]
pub struct Piece {
    pub kind: PieceKind,
    pub lower: f64,
    pub upper: f64,
    pub constant: f64,
    pub slope: f64,
}

/// A finite end of a piece.
#[derive(Clone, Copy, Debug)]
pub struct PieceEnd {
    pub place: f64,
    /// The constant and the slope of the piece that ends there less those of the piece that begins.
    pub constant: f64,
    pub slope: f64,
    /// e^place.
    pub spot: f64,
}

/// The number of piece ends in one vector.
const ENDS: usize = LANES / 2;

/// Up to eight piece ends in one vector: lane k has the constant at end k, lane k + 8 the slope there.
#[derive(Clone, Debug)]
pub struct EndBlock {
    pub places: [f64; LANES],
    pub amounts: [f64; LANES],
    /// 1, and e^place for the slopes.
    pub spots: [f64; LANES],
    /// The jumps of the value: amounts times spots.
    pub heights: [f64; LANES],
}

impl EndBlock {
    /// 1 in the lanes of the slopes, 0 in those of the constants.
    pub const SLOPES: [f64; LANES] = {
        let mut lanes = [0.0; LANES];
        let mut k = ENDS;
        while k < LANES {
            lanes[k] = 1.0;
            k += 1;
        }
        lanes
    };

    fn new(ends: &[PieceEnd]) -> EndBlock {
        let mut block = EndBlock {
            places: [ends[0].place; LANES],
            amounts: [0.0; LANES],
            spots: [1.0; LANES],
            heights: [0.0; LANES],
        };
        for (k, end) in ends.iter().enumerate() {
            for (lane, amount, spot) in [(k, end.constant, 1.0), (k + ENDS, end.slope, end.spot)] {
                block.places[lane] = end.place;
                block.amounts[lane] = amount;
                block.spots[lane] = spot;
                block.heights[lane] = amount * spot;
            }
        }
        block
    }
}

/// Pieces that are linear in the spot, and Gauss nodes on the rest of the line, in increasing order.
#[derive(Clone, Debug, Default)]
pub struct Profile {
    /// The panels of the nodes, each with the same number of them.
    pub panels: Vec<Panel>,
    /// Filled up to whole vectors with copies of the last node.
    pub nodes: Vec<f64>,
    /// The value at the nodes times their quadrature weights; 0 where they are filled up.
    pub weighted: Vec<f64>,
    pub pieces: Vec<Piece>,
    /// The finite ends of the pieces.
    pub ends: Vec<PieceEnd>,
    /// The same, eight side by side.
    pub end_blocks: Vec<EndBlock>,
    /// The constant and the slope of the piece that reaches to x = infinity.
    pub constant: f64,
    pub slope: f64,
}

impl Profile {
    /// The profile made of pieces, panels, their nodes, and the values there times their quadrature weights.
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
            pieces: pieces.to_vec(),
            ..Profile::default()
        };
        for piece in pieces {
            for (end, sign) in [(piece.upper, 1.0), (piece.lower, -1.0)] {
                let (constant, slope) = (sign * piece.constant, sign * piece.slope);
                if end == f64::INFINITY {
                    profile.constant += constant;
                    profile.slope += slope;
                } else if end > f64::NEG_INFINITY && (constant != 0.0 || slope != 0.0) {
                    profile.ends.push(PieceEnd {
                        place: end,
                        constant,
                        slope,
                        spot: end.exp(),
                    });
                }
            }
        }
        profile.end_blocks = profile.ends.chunks(ENDS).map(EndBlock::new).collect();
        profile
    }

    /// Whether the value is known at nodes anywhere.
    pub fn has_nodes(&self) -> bool {
        !self.nodes.is_empty()
    }

    /// Whether nothing happens at this end of the segment, so that the contact set goes on through it.
    pub fn continues(&self, segment: &Segment) -> bool {
        segment.is_continuous() && segment.exercise_at_end && self.has_nodes()
    }

    /// The values at the `points` nodes of one panel times their quadrature weights.
    pub fn weighted_panel(&self, index: usize, points: usize) -> &[f64] {
        &self.weighted[index * points..(index + 1) * points]
    }
}

fn pad(values: &mut Vec<f64>, filling: f64) {
    values.resize(values.len().next_multiple_of(LANES), filling);
}
