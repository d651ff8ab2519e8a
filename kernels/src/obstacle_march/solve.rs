//! Contracts to their tolerances: one grid after another, each with half the cells' width of the one before.

use std::sync::Mutex;

use super::contract::{Contract, Segment};
use super::march::{End, Group, Marched};
use super::mesh::Grid;
use super::record::record_size;
use super::settings::Settings;
use super::steps::steps_of;
use super::walk_back::BySegment;
use crate::interrupt::Interrupt;
use crate::lanes::dispatch::dispatch;
use crate::lanes::vector::LANES;

/// Places around the spot, in cells of the coarser grid, over which the difference of two grids is looked at: at one
/// place alone it may vanish by chance.
const AROUND: [f64; 7] = [-3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 3.0];
/// The same for the derivatives at the spot.
const BESIDE: [f64; 2] = [-1.5, 1.5];
/// What the error falls by from a grid to the next: the order is three.
const GAIN: f64 = 8.0;
/// The ratio of a difference to the one before it: up to the first an extrapolation counts, and the second at the most.
const STEEP: f64 = 0.25;
const SLOWEST: f64 = 0.9;
/// What is added to an extrapolated error where the differences fall less than the order says.
const MARGIN: f64 = 3.0;
/// What the difference before the last falls by at least on the way to the error; 56 at third order.
const PESSIMISM: f64 = 22.0;
/// What of the difference's slope, times the deviation of ln S, may be left at a place where it vanishes by chance.
const TILT_SHARE: f64 = 0.15;
/// The caution with constant coefficients, and with a local volatility, which is not smooth everywhere; where it depends on
/// the time not all steps double from grid to grid. Calibrated.
const EVEN: Caution = Caution {
    first_levels: 2,
    of_value: 1.0,
    of_derivatives: 1.0,
};
const STEADY: Caution = Caution {
    first_levels: 3,
    of_value: 2.0,
    of_derivatives: 2.0,
};
const MOVING: Caution = Caution {
    first_levels: 3,
    of_value: 4.0,
    of_derivatives: 2.0,
};
/// Cells from the exercise boundary within which all errors are multiplied once more, and by what. Calibrated.
const NEAR: f64 = 6.0;
const NEAR_FACTOR: f64 = 4.0;
/// By what the error of a call's and of a put's value is multiplied whose spot drops: the first steps after each drop leave
/// an error of either sign, by where in its cell the boundary lies, and a put's boundary comes back from a spot of 0 after
/// each time. Calibrated.
const RETURNING: [f64; 2] = [1.5, 3.0];
/// What of the boundary's last difference and of that before counts as its error, and of the only one; and what of a cell
/// does where there is only one, and where it may move unseen. Calibrated.
const OF_BOUNDARY: [f64; 2] = [1.5, 0.75];
const OF_FIRST_BOUNDARY: f64 = 3.0;
const OF_FIRST_CELL: f64 = 0.03;
const OF_UNSEEN: f64 = 0.25;
/// The share of the boundary's error within which the spot may as well lie on its other side; calibrated.
const OTHER_SIDE: f64 = 0.5;
/// What of a kink's error in a cell is left where a polynomial goes over it; calibrated.
const OF_KINKS: f64 = 0.2;
/// The cells of the finest grid.
const MOST_CELLS: usize = 4096;

/// The step of the volatilities for second derivatives, a share of the smallest one: their error falls with its square,
/// and rounding is divided by it.
const VOLATILITY_STEP: f64 = 5e-3;
/// What the step costs of a second derivative, which no grid shows; calibrated next to exercise boundaries.
const OF_STEP: f64 = 1e-4;
/// How far from the boundary, over how far this moves with the step, the places move along with it; chosen.
const CROSSED: f64 = 3.0;
/// So many marches are side by side at the price of one.
const FEW: usize = 4;
/// The largest record of a march, bytes; on finer grids the derivatives stay those of the grids before.
const LARGEST_RECORD: usize = 3 << 24;

/// Which derivatives are wanted.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd)]
pub enum Greeks {
    /// None.
    None,
    /// By the spot and the time, and the first ones by what each segment states.
    Standard,
    /// Those by the volatility and the spot, and the second one by the volatility, as well.
    Extended,
}

/// What is found of a contract, money in strikes.
#[derive(Clone, Debug, Default)]
pub struct Found {
    /// The value.
    pub value: f64,
    /// The estimate of the value's error.
    pub error: f64,
    /// The value without early exercise, not a number where it is not wanted.
    pub european: f64,
    /// The spot at which exercise begins, not a number where there is none.
    pub boundary: f64,
    /// The estimate of its error.
    pub boundary_error: f64,
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
    /// How many grids the contract was marched on to the end.
    pub levels: usize,
    /// The derivatives at the spot.
    pub local: [Changing; LOCAL],
    /// Those by the numbers of each segment, where they are wanted.
    pub by_segment: Vec<[Changing; BySegment::COUNT]>,
    /// Where exercise begins over time, from expiry to now, on the last grid but one and on the finest.
    pub ends: [Vec<End>; 2],
}

/// The derivatives at the spot: the first two by x, the rate `V_tau` and its derivative by x, that of the first by a parallel
/// change of the volatilities, and the second and the first one by that; and by how much the second one by x jumps where the
/// spot may as well lie on the boundary's other side, 0 elsewhere.
pub const LOCAL: usize = 8;

/// The place of the mixed one, of the first one by the volatility, and of the jump.
const VOLATILITY_AND_X: usize = 4;
const BY_VOLATILITY: usize = 6;
const JUMP: usize = 7;
/// The place of the volatility among the numbers of a segment.
const VOLATILITY: usize = 2;

/// A number of the finest grid, extrapolated where the differences let it be, and its last difference.
#[derive(Clone, Copy, Debug, Default)]
pub struct Changing {
    /// The number.
    pub value: f64,
    /// The difference, not below 0.
    pub change: f64,
}

impl Changing {
    const NOTHING: Self = Self {
        value: f64::NAN,
        change: f64::NAN,
    };
}

impl Found {
    fn nothing(segments: usize) -> Self {
        Self {
            value: f64::NAN,
            error: f64::NAN,
            european: f64::NAN,
            boundary: f64::NAN,
            boundary_error: f64::NAN,
            local: [Changing::NOTHING; LOCAL],
            by_segment: vec![[Changing::NOTHING; BySegment::COUNT]; segments],
            ..Self::default()
        }
    }
}

/// What a march says around the spot.
#[derive(Clone)]
struct Seen {
    /// The cells' width.
    h: f64,
    /// Where it was looked at, and the end of the contact set nearest to there, not a number where there is none; in x.
    x: f64,
    end: f64,
    /// By how much the second derivative by x jumps there.
    jump: f64,
    value: f64,
    /// The values at `AROUND` times its own cells, and times twice those.
    own: [f64; AROUND.len()],
    wide: [f64; AROUND.len()],
    /// The first two derivatives by x, the rate and its derivative: at the spot, and at `BESIDE` times the cells.
    local: [f64; 4],
    own_local: [[f64; 4]; BESIDE.len()],
    wide_local: [[f64; 4]; BESIDE.len()],
    boundary: f64,
    /// How far the boundary may move unseen, as in `End`.
    unseen: f64,
    exercised: bool,
    settled: bool,
    steps: usize,
    ends: Vec<End>,
    by_segment: Vec<[f64; BySegment::COUNT]>,
}

impl Seen {
    /// What a march says around one of the contract's places; of the boundaries over time to the first that asks.
    fn of(marched: &mut Marched, contract: &Contract, x: f64) -> Self {
        let ends = std::mem::take(&mut marched.ends);
        let (line, h) = (marched.line(), marched.grid.h);
        let at = |cells: f64| line.at((x + cells * h).exp());
        let local = |cells: f64| local(marched, contract, x + cells * h);
        let index = marched.grid.index(x.exp());
        let now = End::of(&marched.grid, 0, 0.0, marched.contact);
        let end = now.nearest(x);
        Self {
            h,
            x,
            end,
            jump: if end.is_nan() {
                0.0
            } else {
                jump(contract, end).abs()
            },
            value: at(0.0),
            own: AROUND.map(at),
            wide: AROUND.map(|cells| at(2.0 * cells)),
            local: local(0.0),
            own_local: BESIDE.map(local),
            wide_local: BESIDE.map(|cells| local(2.0 * cells)),
            boundary: now.near.exp(),
            unseen: now.unseen,
            exercised: marched.contact.holds(index),
            settled: marched.settled,
            steps: marched.steps,
            ends,
            by_segment: marched.by_segment.iter().map(BySegment::numbers).collect(),
        }
    }

    /// The same next to that place where it is in contact: at the end of the contact set.
    fn beside_contact(marched: &mut Marched, contract: &Contract, x: f64) -> Self {
        let now = End::of(&marched.grid, 0, 0.0, marched.contact);
        let end = now.nearest(x);
        let in_contact = marched.contact.holds(marched.grid.index(x.exp()));
        let free = if in_contact && !end.is_nan() { end } else { x };
        Self::of(marched, contract, free)
    }

    /// Whether the spot is so near to where exercise begins that a few cells lie between.
    fn is_near_boundary(&self) -> bool {
        (self.boundary.ln() - self.x).abs() < NEAR * self.h
    }

    /// By what the errors are multiplied.
    fn near_factor(&self) -> f64 {
        if self.is_near_boundary() {
            NEAR_FACTOR
        } else {
            1.0
        }
    }

    /// How far the values lie apart from those on the grid before, at places around the spot, and the largest of that.
    fn apart(&self, before: &Self) -> ([f64; AROUND.len()], f64) {
        let apart = std::array::from_fn(|k| self.wide[k] - before.own[k]);
        let largest = apart.iter().fold(0.0, |most: f64, one| most.max(one.abs()));
        (apart, largest)
    }
}

/// The first two derivatives by x, the rate `V_tau` and its derivative by x, at a place now.
fn local(marched: &Marched, contract: &Contract, x: f64) -> [f64; 4] {
    let (line, now) = (marched.line(), &contract.segments[0]);
    let (spot, sign, h) = (x.exp(), contract.sign, marched.grid.h);
    let obstacle_rate = sign * now.rate * (1.0 - marched.strike);
    let index = marched.grid.index(spot);
    if marched.contact.holds(index) {
        return [-sign * spot, -sign * spot, obstacle_rate, 0.0];
    }
    let rise = |end: f64| 0.5 * h * h * jump(contract, marched.grid.spot_at(end).ln());
    let [value, slope, rate, rate_slope] =
        line.local(spot, index, &marched.rates, rise, obstacle_rate);
    let slope = slope * sign / h;
    let here = diffusion(contract, x);
    let drift = now.rate - now.dividend_yield - here;
    let bend = (rate - drift * slope + now.rate * value) / here;
    [slope, bend, rate, rate_slope * sign / h]
}

/// Half the variance per year at a place now.
fn diffusion(contract: &Contract, x: f64) -> f64 {
    0.5 * contract.variance(0.0, x, contract.segments[0].volatility)
}

/// By how much the second derivative by x jumps where the contact set ends now: what contact costs over the diffusion.
fn jump(contract: &Contract, end: f64) -> f64 {
    let now = &contract.segments[0];
    let cost = contract.sign * (now.rate - now.dividend_yield * end.exp());
    cost / diffusion(contract, end)
}

/// What kinks cost now that a segment behind a drop does not smooth over a cell, as within a day of expiry: the polynomials
/// that carry them to the spots before the drop do not see them.
fn unresolved(contract: &Contract, seen: &Seen) -> f64 {
    let (mut variance, mut cost) = (0.0, 0.0);
    let last = contract.segments.len() - 1;
    for (number, pair) in contract.segments.windows(2).enumerate() {
        let [before, behind] = [pair[0], pair[1]];
        variance += before.duration * contract.variance(0.0, seen.x, before.volatility);
        let has_kink = number + 1 == last || (behind.exercise_at_end && !behind.exercisable);
        if before.drops() && has_kink {
            let own = behind.duration * contract.variance(0.0, seen.x, behind.volatility);
            let smoothed = f64::exp(-0.5 * (std::f64::consts::PI / seen.h).powi(2) * own);
            let away = (seen.x.abs() / variance.sqrt() - 1.0).max(0.0);
            cost += smoothed * f64::exp(-0.5 * away * away) * seen.h * seen.h / variance.sqrt();
        }
    }
    OF_KINKS * cost
}

/// How many grids are always marched, and by what the error estimates of the value and of the derivatives are multiplied.
#[derive(Clone, Copy)]
struct Caution {
    first_levels: usize,
    of_value: f64,
    of_derivatives: f64,
}

/// A contract on its way to its tolerances.
struct Work<'a> {
    contract: Contract<'a>,
    /// With higher and with lower volatilities, and by how much, where that is wanted.
    sides: Option<([Vec<Segment>; 2], f64)>,
    /// Without early exercise, where that is wanted.
    held: Vec<Segment>,
    /// The standard deviation of ln S at expiry.
    deviation: f64,
    caution: Caution,
    cells: usize,
    levels: usize,
    places: Vec<Place>,
}

/// A place of a contract on its way to its tolerance.
struct Place {
    x: f64,
    tolerance: f64,
    last: Option<Seen>,
    /// Whether the value without early exercise is still wanted, and what the last march without said.
    is_held: bool,
    held: Option<Seen>,
    /// The last two differences of the value, and the last one of the boundary, not a number before there is one.
    differences: [f64; 2],
    boundary_difference: f64,
    /// How far the place moves with the volatility's step where the boundary next to it does, in x.
    along: f64,
    found: Found,
    done: bool,
}

impl<'a> Work<'a> {
    fn new(contract: Contract<'a>, tolerance: &[f64], settings: &Settings, greeks: Greeks) -> Self {
        let is_walked = greeks != Greeks::None && contract.places.len() == 1;
        let is_moved = greeks == Greeks::Extended || (greeks != Greeks::None && !is_walked);
        let sides = is_moved.then(|| {
            let volatilities = contract.segments.iter().map(|one| one.volatility);
            let step = VOLATILITY_STEP * volatilities.fold(f64::INFINITY, f64::min);
            let moved = |by: f64| {
                let mut segments = contract.segments.to_vec();
                for segment in &mut segments {
                    segment.volatility += by;
                }
                segments
            };
            ([moved(step), moved(-step)], step)
        });
        let whole = Grid::new(&contract, 1, settings);
        let times = contract.local.map(|local| local.surface.times.len());
        let caution = match times {
            None => EVEN,
            Some(1) => STEADY,
            Some(_) => MOVING,
        };
        let segments = if is_walked {
            contract.segments.len()
        } else {
            0
        };
        let places = contract.places.iter().zip(tolerance);
        Self {
            contract,
            sides,
            held: if contract.european {
                contract.segments.iter().map(|one| one.held()).collect()
            } else {
                Vec::new()
            },
            deviation: whole.deviation,
            caution,
            cells: first_cells(&whole, settings),
            levels: 0,
            places: places
                .map(|(x, tolerance)| Place {
                    x: *x,
                    tolerance: *tolerance,
                    last: None,
                    is_held: contract.european,
                    held: None,
                    differences: [0.0; 2],
                    boundary_difference: f64::NAN,
                    along: 0.0,
                    found: Found::nothing(segments),
                    done: false,
                })
                .collect(),
        }
    }

    /// Whether derivatives by the numbers of the segments are wanted: of one place alone.
    fn is_walked(&self) -> bool {
        self.places
            .iter()
            .any(|place| !place.found.by_segment.is_empty())
    }

    /// Whether the value without early exercise is still wanted.
    fn is_held(&self) -> bool {
        self.places.iter().any(|place| place.is_held)
    }

    /// The contracts to be marched: itself, that without early exercise, and those with other volatilities on its grid.
    fn contracts(&self) -> Vec<Contract<'_>> {
        let mut contracts = vec![self.contract];
        if self.is_held() {
            contracts.push(Contract {
                segments: &self.held,
                ..self.contract
            });
        }
        if let Some((sides, _)) = &self.sides {
            contracts.extend(sides.iter().map(|segments| Contract {
                segments,
                ..self.contract
            }));
        }
        contracts
    }

    /// 1 and -1 of the last two contracts, which have higher and lower volatilities; None of the others.
    fn side(&self, contract: usize) -> Option<f64> {
        let others = 1 + usize::from(self.is_held());
        self.sides.as_ref()?;
        match contract.checked_sub(others)? {
            0 => Some(1.0),
            _ => Some(-1.0),
        }
    }

    /// Take in what the marches on the next grid say at each place; return whether they were the last.
    fn take(&mut self, seen: Vec<Vec<Seen>>) -> bool {
        let cells = self.cells;
        self.cells *= 2;
        let is_held = self.is_held();
        let mut seen = seen.into_iter();
        let own = seen.next().filter(|own| own.iter().all(|own| own.settled));
        let Some(own) = own else {
            // The grid does not resolve the problem: nothing is taken from it, and those before it have no neighbour.
            self.levels = 0;
            for place in self.places.iter_mut().filter(|place| !place.done) {
                place.forget();
            }
            return self.cells > MOST_CELLS;
        };
        self.levels += 1;
        let held = if is_held { seen.next() } else { None };
        let mut held = held.into_iter().flatten();
        let sides: Vec<Vec<Seen>> = seen.collect();
        let (levels, caution) = (self.levels, self.caution);
        for (k, (place, mut own)) in self.places.iter_mut().zip(own).enumerate() {
            let held = held.next();
            if place.done {
                continue;
            }
            if let Some(held) = held {
                place.take_held(held, caution, levels);
            }
            if let Some(last) = place.last.take() {
                let (apart, largest) = own.apart(&last);
                let tilts = apart.windows(3).map(|three| (three[2] - three[0]).abs());
                place.differences = [largest, place.differences[0]];
                // The difference's slope by x, times the deviation of ln S at expiry.
                // In contact there is no difference: next to it the slope is that of a corner, whatever is left.
                let tilt = if own.is_near_boundary() {
                    0.0
                } else {
                    tilts.fold(0.0, f64::max) / (2.0 * 2.0 * own.h) * self.deviation
                };
                let share = place.estimate(&own, &last, tilt, &self.contract, caution, levels);
                place.derive(&own, &last, share, caution);
            }
            if let (Some((_, step)), [up, down]) = (&self.sides, &sides[..]) {
                place.take_sides(&own, [&up[k], &down[k]], *step);
            }
            let found = &mut place.found;
            (found.cells, found.steps, found.levels) = (cells, own.steps, levels);
            found.settled = own.settled;
            found.exercised = own.exercised;
            let [_, before] = std::mem::take(&mut found.ends);
            found.ends = [before, std::mem::take(&mut own.ends)];
            found.met = levels >= caution.first_levels && found.error <= place.tolerance;
            place.done = found.met;
            place.last = Some(own);
        }
        self.places.iter().all(|place| place.done) || self.cells > MOST_CELLS
    }
}

impl Place {
    /// Forget what the marches so far said, but for what was found.
    fn forget(&mut self) {
        (self.last, self.differences, self.boundary_difference) = (None, [0.0; 2], f64::NAN);
        self.found.ends = [Vec::new(), Vec::new()];
        self.held = None;
    }

    /// Tell the value and its error; return the share of the last difference that extrapolates.
    fn estimate(
        &mut self,
        seen: &Seen,
        last: &Seen,
        tilt: f64,
        contract: &Contract,
        caution: Caution,
        levels: usize,
    ) -> f64 {
        let [last_difference, before] = self.differences;
        let mut ratio = 0.5;
        if levels > 2 {
            let of = if before > 0.0 { before } else { 1.0 };
            ratio = (last_difference / of).clamp(0.0, SLOWEST);
        }
        let third = 1.0 / (GAIN - 1.0);
        let falls = ratio <= STEEP;
        let share = if falls { third } else { 0.0 };
        let geometric = ratio / (1.0 - ratio);
        let rest = if falls {
            third.max(MARGIN * (geometric - third))
        } else {
            geometric
        };
        let mut caution = caution.of_value;
        let drops = contract.segments.iter().any(Segment::drops);
        if drops {
            caution *= RETURNING[usize::from(contract.sign > 0.0)];
        }
        caution *= seen.near_factor();
        let found = &mut self.found;
        found.value = seen.value + share * (seen.value - last.value);
        let rounding = 1e-13 * found.value.abs().max(1.0);
        let by_tilt = TILT_SHARE * tilt;
        found.error = caution
            * (last_difference * rest)
                .max(before / PESSIMISM)
                .max(by_tilt)
            + rounding
            + unresolved(contract, seen);
        share
    }

    /// Tell the derivatives and by how much they change from the last grid to this one.
    fn derive(&mut self, seen: &Seen, last: &Seen, share: f64, caution: Caution) {
        let factor = caution.of_derivatives * seen.near_factor();
        let best = |now: f64, before: f64, change: f64| Changing {
            value: now + share * (now - before),
            change: factor * change.max((now - before).abs()),
        };
        let found = &mut self.found;
        found.boundary = best(seen.boundary, last.boundary, 0.0).value;
        let difference = (seen.boundary - last.boundary).abs();
        let before = std::mem::replace(&mut self.boundary_difference, difference);
        found.boundary_error = OF_UNSEEN * seen.unseen * seen.boundary
            + if before.is_nan() {
                OF_FIRST_BOUNDARY * difference + OF_FIRST_CELL * seen.h * seen.boundary
            } else {
                (OF_BOUNDARY[0] * difference).max(OF_BOUNDARY[1] * before)
            };
        for k in 0..4 {
            let beside = seen.wide_local.iter().zip(&last.own_local);
            let change = beside.map(|(a, b)| (a[k] - b[k]).abs()).fold(0.0, f64::max);
            if !seen.local[k].is_nan() {
                found.local[k] = best(seen.local[k], last.local[k], change);
            }
        }
        let away = (seen.x - seen.end).abs() * seen.end.exp();
        let is_unsure = away < OTHER_SIDE * found.boundary_error;
        found.local[JUMP] = Changing {
            value: if is_unsure { seen.jump } else { 0.0 },
            change: 0.0,
        };
        let walked = !seen.by_segment.is_empty();
        if walked && seen.by_segment.len() == last.by_segment.len() {
            let pairs = seen.by_segment.iter().zip(&last.by_segment);
            found.by_segment = pairs
                .map(|(now, before)| std::array::from_fn(|k| best(now[k], before[k], 0.0)))
                .collect();
        } else if !walked && !last.by_segment.is_empty() && found.by_segment[0][0].value.is_nan() {
            // One grid alone was walked back, the others were too large: nothing tells the errors.
            let change = f64::NAN;
            let only = last.by_segment.iter();
            found.by_segment = only
                .map(|one| one.map(|value| Changing { value, change }))
                .collect();
        } else {
            return;
        }
        let by_volatility = || found.by_segment.iter().map(|one| one[VOLATILITY]);
        found.local[BY_VOLATILITY] = Changing {
            value: by_volatility().map(|one| one.value).sum(),
            change: by_volatility().map(|one| one.change).sum(),
        };
    }

    /// Tell the value without early exercise, which is looked at no further where that is accurate enough.
    fn take_held(&mut self, seen: Seen, caution: Caution, levels: usize) {
        if !self.is_held {
            return;
        }
        self.found.european = seen.value;
        if let Some(last) = &self.held {
            let (_, largest) = seen.apart(last);
            let third = 1.0 / (GAIN - 1.0);
            self.found.european += third * (seen.value - last.value);
            let error = caution.of_value * MARGIN * third * largest;
            if levels >= caution.first_levels && error <= self.tolerance {
                self.is_held = false;
                return;
            }
        }
        self.held = Some(seen);
    }

    /// Tell the derivatives in which the volatility takes part, of one that changes everywhere alike.
    ///
    /// V is smooth in the volatility along a way x(sigma) that stays outside the contact set: what changes along it less
    /// what the way itself adds is the derivative at one place.
    fn take_sides(&mut self, own: &Seen, [up, down]: [&Seen; 2], step: f64) {
        let (higher, lower) = (up.x - own.x, down.x - own.x);
        let (speed, bend) = (
            (higher - lower) / (2.0 * step),
            (higher + lower) / (step * step),
        );
        let [by_x, by_x_twice, ..] = own.local;
        let along = (up.value - down.value) / (2.0 * step);
        let slope_along = (up.local[0] - down.local[0]) / (2.0 * step);
        let twice_along = (up.value + down.value - 2.0 * own.value) / (step * step);
        let first = along - by_x * speed;
        let mixed = slope_along - by_x_twice * speed;
        let second = twice_along - (mixed + slope_along) * speed - by_x * bend;
        let factor = own.near_factor();
        let shares = [OF_STEP, OF_STEP, 0.0];
        let found = self.found.local[VOLATILITY_AND_X..].iter_mut();
        for ((found, now), share) in found.zip([mixed, second, first]).zip(shares) {
            *found = Changing {
                value: now,
                change: factor * (now - found.value).abs() + share * now.abs(),
            };
        }
        let moves = 0.5 * (up.end - down.end);
        let is_near = (own.x - own.end).abs() < CROSSED * moves.abs();
        self.along = if is_near { moves } else { 0.0 };
    }
}

/// A march of a level: of whose work, and which of its contracts.
#[derive(Clone, Copy)]
struct Job {
    work: usize,
    contract: usize,
    is_local: bool,
    cells: usize,
    /// Whether it is walked back.
    walked: bool,
}

/// Solve every contract until the error estimate at each of its places meets its tolerance, or to the finest grid, or until an
/// interrupt ends it all: what has not been solved then is not settled.
///
/// `tolerance` has a number for each place of the contracts, in their order, and so has what is found. Of a contract with
/// more than one place there are no derivatives by the numbers of its segments.
#[must_use]
pub fn solve(
    contracts: &[Contract],
    tolerance: &[f64],
    settings: Settings,
    greeks: Greeks,
    threads: usize,
    interrupt: Interrupt,
) -> Vec<Found> {
    let mut works: Vec<Work> = contracts
        .iter()
        .scan(tolerance, |left, contract| {
            let (own, rest) = left.split_at(contract.places.len());
            *left = rest;
            Some(Work::new(*contract, own, &settings, greeks))
        })
        .collect();
    let mut open: Vec<usize> = (0..works.len()).collect();
    while !open.is_empty() && !interrupt() {
        let seen = march_level(&works, &open, settings, threads, interrupt);
        let Some(seen) = seen else { break };
        let mut still = Vec::new();
        for (place, seen) in open.into_iter().zip(seen) {
            if !works[place].take(seen) {
                still.push(place);
            }
        }
        open = still;
    }
    let places = works.into_iter().flat_map(|work| work.places);
    places.map(|place| place.found).collect()
}

/// March every open work on its next grid; return what its contracts' marches say at each place, None where an interrupt
/// came.
fn march_level(
    works: &[Work],
    open: &[usize],
    settings: Settings,
    threads: usize,
    interrupt: Interrupt,
) -> Option<Vec<Vec<Vec<Seen>>>> {
    let contracts: Vec<Vec<Contract>> = open.iter().map(|at| works[*at].contracts()).collect();
    let mut jobs: Vec<(Job, usize)> = Vec::new();
    for (work, own) in contracts.iter().enumerate() {
        let cells = works[open[work]].cells;
        let steps = steps_of(&own[0], &Grid::new(&own[0], cells, &settings), &settings).len();
        let fits = record_size(cells, steps) <= LARGEST_RECORD;
        for contract in 0..own.len() {
            let walked = contract == 0 && works[open[work]].is_walked() && fits;
            let job = Job {
                work,
                contract,
                is_local: own[0].local.is_some(),
                cells,
                walked,
            };
            jobs.push((job, steps));
        }
    }
    // What the jobs of a group have in common; few are one group, whether they are walked back or not.
    let few = jobs.len() <= FEW;
    let kind = |job: &Job| (job.is_local, job.cells, job.walked || few);
    jobs.sort_by_key(|(job, steps)| (kind(job), !job.walked, *steps));
    let groups: Vec<Vec<Job>> = jobs
        .chunk_by(|(a, _), (b, _)| kind(a) == kind(b))
        .flat_map(|same| same.chunks(LANES))
        .map(|group| group.iter().map(|(job, _)| *job).collect())
        .collect();
    let mut found: Vec<Vec<Option<Vec<Seen>>>> =
        contracts.iter().map(|own| vec![None; own.len()]).collect();
    let (queue, results) = (Mutex::new(groups), Mutex::new(&mut found));
    let working = || {
        while let Some(group) = queue.lock().ok().and_then(|mut queue| queue.pop()) {
            let chosen = |job: &Job| contracts[job.work][job.contract];
            let marched = dispatch(Group {
                contracts: group.iter().map(chosen).collect(),
                cells: group[0].cells,
                settings,
                walked: group.iter().filter(|job| job.walked).count(),
                interrupt,
            });
            let Some(mut marched) = marched else { return };
            let seen: Vec<Vec<Seen>> = group
                .iter()
                .zip(&mut marched)
                .map(|(job, marched)| {
                    let (contract, work) = (chosen(job), &works[open[job.work]]);
                    let side = work.side(job.contract);
                    let looked = work.places.iter().map(|place| match side {
                        None => Seen::of(marched, &contract, place.x),
                        Some(up) => {
                            Seen::beside_contact(marched, &contract, place.x + up * place.along)
                        }
                    });
                    looked.collect()
                })
                .collect();
            if let Ok(mut results) = results.lock() {
                for (job, seen) in group.iter().zip(seen) {
                    results[job.work][job.contract] = Some(seen);
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
    found
        .into_iter()
        .map(|own| own.into_iter().collect())
        .collect()
}

/// The cells of the coarsest grid: so many over the width of the contract's own deviation, a multiple of 8.
#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    clippy::cast_precision_loss
)]
fn first_cells(whole: &Grid, settings: &Settings) -> usize {
    let share = whole.h / (2.0 * settings.width * whole.deviation);
    let cells = (share * settings.cells as f64).ceil().clamp(16.0, 1024.0) as usize;
    cells.next_multiple_of(8)
}
