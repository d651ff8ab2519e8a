//! Contracts to their tolerances: one grid after another, each with half the cells' width of the one before.

use std::sync::Mutex;

use super::contract::Contract;
use super::march::{Group, Marched};
use super::mesh::{steps_on, Grid};
use super::settings::Settings;
use crate::interrupt::Interrupt;
use crate::lanes::dispatch::dispatch;
use crate::lanes::vector::LANES;

/// Places around the spot, in cells of the coarser grid, over which the difference of two grids is looked at: at one
/// place alone it may vanish by chance.
const AROUND: [f64; 7] = [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0];
/// What the error falls by from a grid to the next: the order is three.
const GAIN: f64 = 8.0;
/// The ratio of a difference to the one before it: up to the first an extrapolation counts, and the second at the most.
const STEEP: f64 = 0.25;
const SLOWEST: f64 = 0.9;
/// What is added to an extrapolated error where the differences fall less than the order says.
const MARGIN: f64 = 1.5;
/// What the difference before the last falls by at least on the way to the error; 56 at third order.
const PESSIMISM: f64 = 22.0;
/// The grids that are always marched, and the finest one's cells.
const FIRST_LEVELS: usize = 2;
const MOST_CELLS: usize = 4096;

/// What is found of a contract, money in strikes.
#[derive(Clone, Copy, Debug)]
pub struct Found {
    /// The value.
    pub value: f64,
    /// Its first derivative by x.
    pub slope: f64,
    /// Its second derivative by x.
    pub bend: f64,
    /// The estimate of the value's error.
    pub error: f64,
    /// The spot at which exercise begins, not a number where there is none.
    pub boundary: f64,
    /// Whether the spot is in contact with it.
    pub exercised: bool,
    /// Whether the error meets the tolerance.
    pub met: bool,
    /// Whether the finest march settled every stage.
    pub settled: bool,
    /// The cells of the finest grid.
    pub cells: usize,
    /// The steps of its march.
    pub steps: usize,
}

impl Found {
    const NOTHING: Self = Self {
        value: f64::NAN,
        slope: f64::NAN,
        bend: f64::NAN,
        error: f64::NAN,
        boundary: f64::NAN,
        exercised: false,
        met: false,
        settled: false,
        cells: 0,
        steps: 0,
    };
}

/// What a march says around the spot.
#[derive(Clone, Copy)]
struct Seen {
    /// The value and its derivatives by x at the spot.
    here: [f64; 3],
    /// The values at `AROUND` times its own cells, and times twice those.
    own: [f64; AROUND.len()],
    wide: [f64; AROUND.len()],
}

impl Seen {
    fn of(marched: &Marched, contract: &Contract) -> Self {
        let (line, h) = (marched.line(), marched.grid.h);
        let at = |cells: f64| line.at((contract.x + cells * h).exp());
        let spot = contract.x.exp();
        let index = marched.grid.index(spot);
        let here = if marched.contact.holds(index) {
            let by_x = -contract.sign * spot;
            [contract.obstacle(spot, marched.strike), by_x, by_x]
        } else {
            let [value, slope, bend] = line.free(spot, index);
            [value, slope * contract.sign / h, bend / (h * h)]
        };
        Self {
            here,
            own: AROUND.map(at),
            wide: AROUND.map(|cells| at(2.0 * cells)),
        }
    }
}

/// A contract on its way to its tolerance.
struct Work<'a> {
    place: usize,
    contract: Contract<'a>,
    tolerance: f64,
    cells: usize,
    last: Option<Seen>,
    /// The last two differences.
    differences: [f64; 2],
    levels: usize,
}

impl Work<'_> {
    /// Take in a march on the next grid; return whether it was the last.
    fn take(&mut self, marched: &Marched, found: &mut Found) -> bool {
        self.cells *= 2;
        if !marched.settled {
            // The grid does not resolve the problem: nothing is taken from it.
            return self.cells > MOST_CELLS;
        }
        let seen = Seen::of(marched, &self.contract);
        self.levels += 1;
        if let Some(last) = self.last {
            let apart = seen.wide.iter().zip(&last.own).map(|(a, b)| (a - b).abs());
            self.differences = [apart.fold(0.0, f64::max), self.differences[0]];
            self.estimate(&seen, &last, found);
        }
        self.last = Some(seen);
        (found.cells, found.steps) = (marched.grid.cells, marched.steps);
        found.settled = marched.settled;
        let (grid, end) = (&marched.grid, marched.contact.end);
        found.boundary = f64::NAN;
        if end.is_finite() {
            found.boundary = grid.spot_at(end);
        }
        found.exercised = marched.contact.holds(grid.index(self.contract.x.exp()));
        found.met = self.levels >= FIRST_LEVELS && found.error <= self.tolerance;
        found.met || self.cells > MOST_CELLS
    }

    fn estimate(&self, seen: &Seen, last: &Seen, found: &mut Found) {
        let [last_difference, before] = self.differences;
        let mut ratio = 0.5;
        if self.levels > 2 {
            let of = if before > 0.0 { before } else { 1.0 };
            ratio = (last_difference / of).clamp(0.0, SLOWEST);
        }
        let third = 1.0 / (GAIN - 1.0);
        let falls = ratio <= STEEP;
        let share = if falls { third } else { 0.0 };
        let best = |k: usize| seen.here[k] + share * (seen.here[k] - last.here[k]);
        (found.value, found.slope, found.bend) = (best(0), best(1), best(2));
        let geometric = ratio / (1.0 - ratio);
        let rest = if falls {
            third.max(MARGIN * (geometric - third))
        } else {
            geometric
        };
        let rounding = 1e-13 * found.value.abs().max(1.0);
        found.error = (last_difference * rest).max(before / PESSIMISM) + rounding;
    }
}

/// Solve every contract until its error estimate meets its tolerance, or to the finest grid, or until an interrupt ends
/// it all: what has not been solved then is not settled.
#[must_use]
pub fn solve(
    contracts: &[Contract],
    tolerance: &[f64],
    settings: Settings,
    threads: usize,
    interrupt: Interrupt,
) -> Vec<Found> {
    let mut found = vec![Found::NOTHING; contracts.len()];
    let mut work: Vec<Work> = contracts
        .iter()
        .zip(tolerance)
        .enumerate()
        .map(|(place, (contract, tolerance))| Work {
            place,
            contract: *contract,
            tolerance: *tolerance,
            cells: first_cells(contract, &settings),
            last: None,
            differences: [0.0; 2],
            levels: 0,
        })
        .collect();
    while !work.is_empty() {
        work.sort_by_cached_key(|one| (one.cells, steps_on(&one.contract, one.cells, &settings)));
        let mut groups: Vec<&mut [Work]> = work
            .chunk_by_mut(|a, b| a.cells == b.cells)
            .flat_map(|same| same.chunks_mut(LANES))
            .collect();
        groups.reverse();
        let queue = Mutex::new(groups);
        let results = Mutex::new(&mut found);
        let working = || {
            while let Some(group) = queue.lock().ok().and_then(|mut queue| queue.pop()) {
                let marched = dispatch(Group {
                    contracts: group.iter().map(|one| one.contract).collect(),
                    cells: group[0].cells,
                    settings,
                    interrupt,
                });
                let Some(marched) = marched else {
                    return;
                };
                for (one, marched) in group.iter_mut().zip(&marched) {
                    let place = one.place;
                    let mut own = results.lock().map_or(Found::NOTHING, |found| found[place]);
                    if one.take(marched, &mut own) {
                        one.cells = 0;
                    }
                    if let Ok(mut found) = results.lock() {
                        found[place] = own;
                    }
                }
            }
        };
        std::thread::scope(|scope| {
            for _ in 1..threads {
                scope.spawn(working);
            }
            working();
        });
        if interrupt() {
            break;
        }
        work.retain(|one| one.cells > 0);
    }
    found
}

/// The cells of the coarsest grid: so many over the width of the contract's own deviation, a multiple of 8.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss
)]
fn first_cells(contract: &Contract, settings: &Settings) -> usize {
    let grid = Grid::new(contract, 1, settings);
    let variance: f64 = contract
        .segments
        .iter()
        .map(|one| one.volatility * one.volatility * one.duration)
        .sum();
    let share = grid.h / (2.0 * settings.width * variance.sqrt());
    let cells = (share * settings.cells as f64).ceil().clamp(16.0, 1024.0) as usize;
    cells.next_multiple_of(8)
}
