//! The mesh that a put is marched on: few classes of meshes, so that puts of one class can march side by side.

use super::contracts::Contracts;
use super::error_estimate::COARSEST_CHECKED;
use super::mesh::{Mesh, STEPS};
use crate::lanes::normal::{exp, ln};
use crate::lanes::vector::{Vector, LANES};

/// The product dx sqrt(M) in the last steps, in xi; derived: where it is larger, the matrix of the compact scheme loses
/// the signs of an M-matrix.
const WIDTH: f64 = 0.75;
/// The largest dx, as a share of the length over which the premium decays; chosen.
const LAYER: f64 = 0.7;
/// The length of the grid where that decay decides dx, in lengths over which the premium decays; chosen.
const LAYERS: f64 = 20.0;
/// The error of V/K of the march with 16 steps at r T = 1; calibrated on random puts, of which four in five have less.
const TYPICAL_ERROR: f64 = 7e-6;
/// The power of r T with which that error grows; calibrated on the same puts.
const TYPICAL_POWER: f64 = 0.7;
/// The smallest tolerance of V/K for which two marches are enough to state the error; chosen.
const LOOSE_TOLERANCE: f64 = 1e-4;
/// The smallest tolerance of V/K for which an ordinary put starts with two steps where prices alone are asked for; chosen:
/// a tolerance of 1e-4 strikes of a call is less in strikes of its put, which are spots of the call.
pub const LOOSE_TOLERANCE_OF_PRICES: f64 = 5e-5;
/// The power of the error with which the number of steps falls, 1/log2(6); calibrated: twice the steps have a sixth of the
/// error.
const STEPS_POWER: f64 = 0.386_852_807_234_541_6;
/// The smallest earnings of exercise that are served, see `Contracts::earned`; chosen.
const SMALLEST_EARNED: f64 = 1e-9;
/// The largest r T and |q T| that are served; chosen.
const LARGEST_GROWTH: f64 = 8.0;
/// The smallest sigma sqrt(T) that is served; chosen.
const SMALLEST_SPREAD: f64 = 1e-7;
/// The largest sigma sqrt(T) that is served; chosen.
const LARGEST_SPREAD: f64 = 16.0;
/// The largest distance from the boundary to the end of the grid that is served, in xi; chosen.
const LARGEST_DISTANCE: f64 = 40.0;
/// The fastest decay that is served, in quarters of an octave; chosen.
const LARGEST_DECAY_CLASS: u32 = 18;
/// The limits of ordinary puts, whose marches to prices at a loose tolerance start with two steps, and are in single
/// precision: dx is not halved, and these are the largest r T and |q T|, the smallest and the largest sigma sqrt(T), the
/// least that exercise earns, the largest drift |r - q| T/(sigma sqrt(T)), and the largest distance of the boundary at
/// expiry from the strike, in xi. Calibrated on random puts: some beyond twice the growth and the drift have one step and
/// two agree on a wrong boundary.
const ORDINARY_GROWTH: f64 = 0.5;
const ORDINARY_SPREADS: [f64; 2] = [0.01, 1.5];
const ORDINARY_EARNED: f64 = 1e-5;
const ORDINARY_DRIFT: f64 = 1.5;
const ORDINARY_DISTANCE: f64 = 60.0;
/// What the widths of their grids are multiples of, in units of `WIDTH`; chosen: fuller groups are worth more nodes.
const SINGLE_DISTANCES: u32 = 4;
/// The last level at which they may be: 8 steps.
const MOST_SINGLE: usize = 4;
/// The number of widths of the grid, in units of `WIDTH`: above `LARGEST_DISTANCE`/`WIDTH`
/// rounded up to `SINGLE_DISTANCES`.
const DISTANCES: usize = 57;

/// The largest number of halvings of dx because of that decay; derived: 2^((`LARGEST_DECAY_CLASS` + 2)/4)/sqrt(4) is 2^4.
const LARGEST_HALVINGS: u32 = 4;

/// The width of the grid in units of `WIDTH`, how fast the premium decays, in quarters of an octave, and how often dx is
/// halved because of that: equally often at all levels, so that all errors fall from one to the next.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct MeshClass {
    distance: u32,
    decay: u32,
    halvings: u32,
    /// Whether the first marches are in single precision.
    single: bool,
}

impl MeshClass {
    /// The class with the fewest halvings that resolve the decay with `steps` time steps.
    fn new(distance: u32, decay: u32, steps: usize) -> Self {
        let mut halvings = 0;
        // The smallest h with dx = WIDTH/(2^h sqrt(M)) <= LAYER/decay.
        while (1 << (decay + 2)) > (steps * steps) << (4 * halvings) {
            halvings += 1;
        }
        Self {
            distance,
            // Without halvings the mesh does not depend on it.
            decay: if halvings > 0 { decay } else { 0 },
            halvings,
            single: false,
        }
    }

    /// Whether the march to this level is in single precision.
    pub fn is_single_at(self, level: usize) -> bool {
        self.single && level <= MOST_SINGLE
    }

    /// The number of this class; those of one book lie close together.
    pub fn index(self) -> usize {
        let slope = self.decay * (LARGEST_HALVINGS + 1) + self.halvings;
        let precision = 2 * slope + u32::from(self.single);
        precision as usize * DISTANCES + self.distance as usize
    }

    /// The mesh of this class at a level.
    #[allow(
        clippy::cast_precision_loss,
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss
    )]
    pub fn mesh(self, level: usize) -> Mesh {
        let root = (STEPS[level] as f64).sqrt();
        let finer = f64::from(1_u32 << self.halvings);
        let mut cells = f64::from(self.distance) * root * finer;
        if self.halvings > 0 {
            let slowest = LAYER / WIDTH * 2.0_f64.powf(0.25 * f64::from(self.decay + 1));
            cells = cells.min((LAYERS / slowest + 1.0) / WIDTH * root * finer);
        }
        Mesh::new(level, WIDTH / root, cells.ceil() as usize, self.halvings)
    }
}

/// The class of each lane and the level of its first march; None where the march does not serve.
///
/// `tolerance` is the largest error allowed in V/K; `levels` has the smallest and the largest level.
#[inline(always)]
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss
)]
pub fn classify<V: Vector>(
    contracts: &Contracts<V>,
    tolerance: V,
    levels: (usize, usize),
) -> [Option<(MeshClass, usize)>; LANES] {
    let Contracts {
        rate,
        dividend,
        spread,
    } = *contracts;
    let drift = (rate - dividend) / spread - spread.times(0.5);
    let decay = drift + (drift * drift + rate + rate).sqrt();
    let decay_class = ln(decay.times(WIDTH / LAYER))
        .times(4.0 * std::f64::consts::LOG2_E)
        .plus(-2.0);
    let distance = distance(contracts, tolerance, drift, decay).times(1.0 / WIDTH);
    let small = contracts.earned().min(V::all(1.0));
    let typical = ln(small).times(TYPICAL_POWER).plus(TYPICAL_ERROR.ln());
    let steps = exp((typical - ln(tolerance)).times(STEPS_POWER)).times(16.0);
    // Written so that what is not a number is not inside.
    let mut served = V::all(1.0);
    for margin in [
        rate.plus(f64::MIN_POSITIVE),
        contracts.earned().plus(-SMALLEST_EARNED * (1.0 - 1e-12)),
        V::all(LARGEST_GROWTH * (1.0 + 1e-12)) - rate,
        V::all(LARGEST_GROWTH * (1.0 + 1e-12)) - dividend.abs(),
        spread.plus(-SMALLEST_SPREAD * (1.0 - 1e-12)),
        V::all(LARGEST_SPREAD * (1.0 + 1e-12)) - spread,
        V::all(LARGEST_DISTANCE / WIDTH) - distance,
        V::all(f64::from(LARGEST_DECAY_CLASS)) - decay_class,
    ] {
        served = (-margin).negative(served, V::zero());
    }
    let ordinary = ordinary(contracts);
    let (served, decay_class, distance) = (served.lanes(), decay_class.lanes(), distance.lanes());
    let (steps, tolerance) = (steps.lanes(), tolerance.lanes());
    let mut classes = [None; LANES];
    for (l, found) in classes.iter_mut().enumerate() {
        if served[l] <= 0.0 {
            continue;
        }
        let decay = decay_class[l].max(0.0).ceil() as u32;
        let level = STEPS.iter().filter(|&&s| (s as f64) < steps[l]).count();
        let is_loose = levels.0 == 0 && tolerance[l] >= LOOSE_TOLERANCE_OF_PRICES;
        let mut class = MeshClass::new(distance[l].ceil() as u32, decay, STEPS[2]);
        if is_loose && ordinary[l] > 0.0 && level < COARSEST_CHECKED && class.halvings == 0 {
            class.single = true;
            class.distance = class.distance.next_multiple_of(SINGLE_DISTANCES);
            *found = Some((class, 0));
            continue;
        }
        let fewest = if tolerance[l] >= LOOSE_TOLERANCE {
            2
        } else {
            4
        };
        let level = level
            .clamp(fewest, STEPS.len() - 1)
            .clamp(levels.0, levels.1);
        let class = MeshClass::new(distance[l].ceil() as u32, decay, STEPS[level]);
        *found = Some((class, level));
    }
    classes
}

/// Positive for ordinary puts, see `ORDINARY_GROWTH`.
#[inline(always)]
fn ordinary<V: Vector>(contracts: &Contracts<V>) -> [f64; LANES] {
    let Contracts {
        rate,
        dividend,
        spread,
    } = *contracts;
    let at_expiry = contracts.boundary_at_expiry() / spread;
    let drift = (rate - dividend) / spread;
    let mut least = V::all(1.0);
    for margin in [
        contracts.earned().plus(-ORDINARY_EARNED),
        V::all(ORDINARY_GROWTH) - rate,
        V::all(ORDINARY_GROWTH) - dividend.abs(),
        spread.plus(-ORDINARY_SPREADS[0]),
        V::all(ORDINARY_SPREADS[1]) - spread,
        at_expiry.plus(ORDINARY_DISTANCE),
        V::all(ORDINARY_DRIFT) - drift.abs(),
    ] {
        least = least.min(margin);
    }
    least.lanes()
}

/// The distance in xi from the boundary to where the premium is negligible, which the free nodes cover.
///
/// The premium at xi is at most about what is earned times N(-xi); it is cut off where that is a tenth of the tolerance.
/// The boundary is guessed, rather too low, from its expansion at expiry and that of the option without expiry.
#[inline(always)]
fn distance<V: Vector>(contracts: &Contracts<V>, tolerance: V, drift: V, decay: V) -> V {
    let Contracts {
        rate,
        dividend,
        spread,
    } = *contracts;
    let one = V::all(1.0);
    let cut = (contracts.earned().times(10.0) / tolerance).max(V::all(100.0));
    let reach = ln(cut).times(2.0).sqrt();
    let logarithm = ln((-dividend).negative(rate / dividend, one)).min(V::zero());
    let at_expiry = logarithm / spread;
    let cost = (rate - dividend).max(V::zero()) / spread + dividend.max(V::zero());
    let odds = V::all(0.5) / cost.max(V::all(1e-300));
    let falling = -(ln(odds.plus(1.0)).times(2.0).sqrt());
    let perpetual = -(ln((spread / decay).plus(1.0)) / spread);
    let lowest = falling.min(at_expiry.plus(-1.0)).max(perpetual);
    reach + (at_expiry - lowest - drift).max(V::zero())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With the 24 arrays of `Workspace` these are at most 4 MiB of a thread, and 1 MiB those of narrow vectors.
    #[test]
    #[allow(clippy::cast_possible_truncation)]
    fn no_mesh_has_more_than_a_thousand_nodes_or_so() {
        let mut most = 0;
        for decay in 0..=LARGEST_DECAY_CLASS {
            for (level, &first) in STEPS.iter().enumerate().skip(2) {
                let class = MeshClass::new(DISTANCES as u32 - 1, decay, first);
                assert!(class.halvings <= LARGEST_HALVINGS);
                let finest = (level..STEPS.len()).map(|level| class.mesh(level).nodes);
                most = most.max(finest.max().unwrap_or(0));
            }
        }
        assert!(most > 500 && most <= 1300, "{most}");
    }
}
