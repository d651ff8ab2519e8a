//! Where the nodes are, and when the steps end.

use super::contract::Contract;
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
    /// The standard deviation of ln S at expiry.
    pub deviation: f64,
}

impl Grid {
    /// A grid of so many cells over what a contract reaches.
    #[allow(clippy::cast_precision_loss)]
    pub fn new(contract: &Contract, cells: usize, settings: &Settings) -> Self {
        let (left, right, deviation) = reach(contract, settings);
        Self {
            start: left,
            h: (right - left) / cells as f64,
            cells,
            sign: contract.sign,
            deviation,
        }
    }

    /// ln S at a node.
    #[allow(clippy::cast_precision_loss)]
    pub fn x(&self, node: usize) -> f64 {
        self.sign * self.h.mul_add(node as f64, self.start)
    }

    /// By how much ln S changes from a node to the next.
    pub fn step(&self) -> f64 {
        self.sign * self.h
    }

    /// The spot at a node.
    #[allow(clippy::cast_precision_loss)]
    pub fn spot(&self, node: usize) -> f64 {
        self.spot_at(node as f64)
    }

    /// The spot at a number of a node, which need not be whole; finite on the widest grids, too.
    pub fn spot_at(&self, index: f64) -> f64 {
        let x = self.sign * self.h.mul_add(index, self.start);
        x.min(LARGEST_LOG).exp()
    }

    /// Whether a place, in numbers of nodes, is so far from the ends that a contact set's end is seen there.
    #[allow(clippy::cast_precision_loss)]
    pub fn resolves(&self, index: f64) -> bool {
        index >= UNRESOLVED && index <= self.cells as f64 - UNRESOLVED
    }

    /// The number of the node at a spot, also between nodes and beyond the ends; infinite at a spot of 0.
    pub fn index(&self, spot: f64) -> f64 {
        (self.sign * spot.ln() - self.start) / self.h
    }
}

/// The logarithm of the largest spot of a grid: what is made of it stays finite.
const LARGEST_LOG: f64 = 690.0;
/// Cells next to an end of the grid in which no contact set is seen to end.
const UNRESOLVED: f64 = 2.0;
/// What a drop is of the largest one where it tells how far a grid reaches.
const LEAST_DROP: f64 = 0.01;
/// The same as a share of the strike or of the spot, whichever is less, where drops lead below the grid: there a put that
/// nobody pays for a drop any more is told from one with a drop to come.
const LEAST_WHERE_USED_UP: f64 = 1e-4;
/// How far the grid goes on below the least of them, in deviations and at most in ln S: there a put no longer depends on the
/// spot, which the line beyond the grid's end goes on with.
const BELOW_DROPS: f64 = 3.0;
const FURTHEST_BELOW: f64 = 1.0;
/// Where the strike is as many standard deviations away nothing depends on what happens there.
const FAR: f64 = 16.0;

/// How far x comes: the spots and the strike, with what drifts and drops add, and the width beyond; and the standard
/// deviation of ln S at expiry.
fn reach(contract: &Contract, settings: &Settings) -> (f64, f64, f64) {
    let (lowest, highest) = contract.span();
    let (mut low, mut high, mut variance) = (lowest, highest, 0.0);
    let mut deepest = lowest; // that drops lead to, however far
    for (number, segment) in contract.mesh.iter().enumerate() {
        let spread = 2.0 * f64::sqrt(variance);
        let square = mean_variance(contract, number, low - spread, high + spread);
        let drift = segment.rate - segment.dividend_yield - 0.5 * square;
        variance += square * segment.duration;
        low = (low + drift * segment.duration).min(lowest);
        high = (high + drift * segment.duration).max(highest);
        deepest = deepest.min(low);
        if segment.drops() {
            let dropped = |x: f64| x.min(segment.after_drop(x.exp()).max(1e-12).ln());
            deepest = dropped(deepest);
            low = dropped(low).max(lowest - 3.0 * variance.sqrt() - 1.0);
        }
    }
    let deviation = variance.sqrt();
    let far = FAR * deviation;
    if deepest < far && high > -far {
        (low, high) = (low.min(0.0), high.max(0.0));
    }
    let (mut left, right) = (
        low - settings.width * deviation,
        high + (settings.width + deviation) * deviation,
    );
    if contract.sign > 0.0 {
        // Where dividends may use up the spot a put is exercised at spots of the size of one of them.
        let drops = || contract.mesh.iter().map(|one| one.amount);
        let total: f64 = drops().sum();
        if total > 0.0 && (total.ln() > left || deepest < left) {
            let largest = drops().fold(0.0, f64::max);
            let least = if deepest < left {
                LEAST_WHERE_USED_UP * lowest.exp().min(1.0)
            } else {
                LEAST_DROP * largest
            };
            let felt = drops().filter(|one| *one > least);
            let below = (BELOW_DROPS * deviation).min(FURTHEST_BELOW);
            left = left.min(felt.fold(f64::INFINITY, f64::min).ln() - below);
        }
        (left, right, deviation)
    } else {
        (-right, -left, deviation)
    }
}

/// The mean of the volatility's square over a segment and between two places.
fn mean_variance(contract: &Contract, number: usize, low: f64, high: f64) -> f64 {
    const PLACES: u32 = 17;
    const TIMES: u32 = 4;
    let segment = &contract.mesh[number];
    if contract.local.is_none() {
        return segment.volatility * segment.volatility;
    }
    let end = contract.end_of(number);
    let mut sum = 0.0;
    for k in 0..TIMES {
        let time = end - segment.duration * (f64::from(k) + 0.5) / f64::from(TIMES);
        for place in 0..PLACES {
            let x = low + (high - low) * f64::from(place) / f64::from(PLACES - 1);
            sum += contract.variance(time, x, segment.volatility);
        }
    }
    sum / f64::from(PLACES * TIMES)
}

/// The volatility that tells the steps of a segment: the least at its end where exercise is near, within two standard
/// deviations of the strike.
fn slowest(contract: &Contract, number: usize, grid: &Grid) -> f64 {
    const PLACES: u32 = 8;
    let volatility = contract.mesh[number].volatility;
    if contract.local.is_none() {
        return volatility;
    }
    let end = contract.end_of(number);
    let least = (0..=PLACES)
        .map(|k| {
            let away = 2.0 * grid.deviation * f64::from(k) / f64::from(PLACES);
            contract.variance(end, -grid.sign * away, volatility)
        })
        .fold(f64::INFINITY, f64::min);
    least.sqrt()
}

/// The number of steps wanted of a segment on a grid.
#[allow(clippy::cast_precision_loss)]
pub fn steps_wanted(contract: &Contract, number: usize, grid: &Grid, settings: &Settings) -> f64 {
    let spread = slowest(contract, number, grid) * contract.mesh[number].duration.sqrt();
    let fewest = settings.fewest * grid.cells as f64;
    (settings.steps * spread / grid.h).max(fewest)
}
