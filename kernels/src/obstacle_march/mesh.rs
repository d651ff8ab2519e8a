//! Where the nodes are, and when the steps end.

use super::contract::{Contract, Segment};
use super::settings::Settings;

/// Nodes i = 0, ..., cells at x = `start` + i h, where x is ln S for a put and -ln S for a call: exercise lies at their
/// beginning.
#[derive(Clone, Copy, Debug)]
pub struct Grid {
    pub start: f64,
    pub h: f64,
    pub cells: usize,
    /// 1 for a put, -1 for a call.
    pub sign: f64,
}

impl Grid {
    /// A grid of so many cells over what a contract reaches.
    #[allow(clippy::cast_precision_loss)]
    pub fn new(contract: &Contract, cells: usize, settings: &Settings) -> Self {
        let (left, right) = reach(contract, settings);
        Self {
            start: left,
            h: (right - left) / cells as f64,
            cells,
            sign: contract.sign,
        }
    }

    /// The spot at a node.
    #[allow(clippy::cast_precision_loss)]
    pub fn spot(&self, node: usize) -> f64 {
        self.spot_at(node as f64)
    }

    /// The spot at a number of a node, which need not be whole.
    pub fn spot_at(&self, index: f64) -> f64 {
        (self.sign * self.h.mul_add(index, self.start)).exp()
    }

    /// The number of the node at a spot, also between nodes and beyond the ends; infinite at a spot of 0.
    pub fn index(&self, spot: f64) -> f64 {
        (self.sign * spot.ln() - self.start) / self.h
    }
}

/// How far x comes: the spot and the strike, with what drifts and drops add, and the width beyond.
fn reach(contract: &Contract, settings: &Settings) -> (f64, f64) {
    let (mut low, mut high, mut variance) = (contract.x, contract.x, 0.0);
    for segment in contract.mesh {
        variance += segment.volatility * segment.volatility * segment.duration;
        low = (low + segment.drift() * segment.duration).min(contract.x);
        high = (high + segment.drift() * segment.duration).max(contract.x);
        if segment.drops() {
            let after = segment.after_drop(low.exp());
            low = low
                .min(after.max(1e-12).ln())
                .max(contract.x - 3.0 * variance.sqrt() - 1.0);
        }
    }
    let deviation = variance.sqrt();
    let (left, right) = (
        low.min(0.0) - settings.width * deviation,
        high.max(0.0) + (settings.width + deviation) * deviation,
    );
    if contract.sign > 0.0 {
        (left, right)
    } else {
        (-right, -left)
    }
}

/// The number of steps of a segment on a grid, at least 2: from 4 on, 4 to 7 times a power of two, so that it doubles
/// exactly where the cells are halved.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
pub fn step_count(segment: &Segment, h: f64, settings: &Settings) -> usize {
    let wanted = settings.steps * segment.volatility * segment.duration.sqrt() / h;
    let power = (wanted.max(4.0) / 4.0).log2().floor().exp2();
    ((settings.rounded * wanted / power).floor() * power).max(2.0) as usize
}

/// The number of steps of a contract on a grid of so many cells.
pub fn steps_on(contract: &Contract, cells: usize, settings: &Settings) -> usize {
    let h = Grid::new(contract, cells, settings).h;
    let of = |segment| step_count(segment, h, settings);
    contract.mesh.iter().map(of).sum()
}
