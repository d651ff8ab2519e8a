//! At most sixteen marches side by side, refined together, and what they say of their spots.

use super::labels::Workspace;
use super::march::{march, Marched};
use super::mesh::MeshClass;
use super::obstacle::Contracts;
use super::plan::{Plan, STEPS};
use super::reading::{Sight, Spots, VALUES};
use super::solve::{Item, Puts, COLUMNS};
use crate::lanes::vector::{Vector, LANES};

/// What the difference of two marches is to the finer one's error; without a third march half the steps are too few
/// for that law.
const GAIN: f64 = 5.5;
const LONE_GAIN: f64 = 12.0;
const BOUNDARY_GAIN: f64 = 4.0;
/// Of the differences M and M/2, M/2 and M/4, in the error; of the only one where there is no third march.
const NEAR_SHARE: f64 = 0.25;
const FAR_SHARE: f64 = 0.05;
const LONE_SHARE: f64 = 2.0;
/// The law of those differences does not hold yet with the fewest steps that allow three marches.
const COARSE_FACTOR: f64 = 2.0;
/// Of the difference of `u_xi`: values may agree by accident, but hardly the slopes, too.
const SLOPE_SHARE: f64 = 0.4;
/// Of the difference of two marches, for the derivatives' error after extrapolation.
const DERIVATIVE_SHARE: f64 = 0.17;
/// Derivatives ask for no more steps.
const MOST_STEPS_FOR_DERIVATIVES: usize = 96;
/// A march that loses the boundary with so many is not refined further.
const STEPS_TO_SETTLE: usize = 96;
/// The first level with three marches.
const COARSEST_CHECKED: usize = 4;

/// The numbers of each.
#[inline(always)]
fn lanes_of<V: Vector, const N: usize>(vectors: &[V; N]) -> [[f64; LANES]; N] {
    let mut numbers = [[0.0; LANES]; N];
    for (own, vector) in numbers.iter_mut().zip(vectors) {
        *own = vector.lanes();
    }
    numbers
}

/// Gain less error, from the newest and what it added.
#[inline(always)]
fn extrapolated<V: Vector>(newest: V, step: V, gain: f64) -> V {
    newest + step.times(1.0 / gain)
}

/// What to do with a group.
#[derive(Clone, Copy)]
pub struct Aim {
    /// Of the finest march.
    pub level: usize,
    /// Whether a finer one may follow.
    pub refines: bool,
}

/// What a spot's marches have said that the next level needs: the last sight, u and whether settled of that
/// before, and the last derivatives by the parameters.
pub type Past = [f64; 10];

/// What is found for one spot.
pub struct Outcome {
    /// The values, the error, the boundary.
    pub numbers: [f64; COLUMNS],
    pub exercised: bool,
    pub settled: bool,
    /// None where nothing finer is needed.
    pub past: Option<Past>,
}

/// Marches side by side.
pub struct Group<'a, 'w, V> {
    puts: Puts<'a>,
    contracts: Contracts<V>,
    chunks: Vec<Chunk<'a, V>>,
    work: &'w mut Workspace<V>,
}

/// At most sixteen of the spots.
struct Chunk<'a, V> {
    items: &'a [Item],
    spots: Spots<V>,
    /// By the last three marches, newest first.
    sights: [Sight<V>; 3],
}

impl<'a, 'w, V: Vector> Group<'a, 'w, V> {
    /// The items belong to at most sixteen runs, and those of one run follow each other.
    #[inline(always)]
    pub fn new(puts: Puts<'a>, items: &'a [Item], work: &'w mut Workspace<V>) -> Self {
        let mut runs = [items[0].run; LANES];
        let mut lane = 0;
        let mut chunks = Vec::with_capacity(items.len().div_ceil(LANES));
        for items in items.chunks(LANES) {
            let mut lanes = [0; LANES];
            for (place, item) in lanes.iter_mut().zip(items) {
                if item.run != runs[lane] {
                    lane += 1;
                    runs[lane..].fill(item.run);
                }
                *place = lane;
            }
            lanes[items.len()..].fill(lane);
            let (mut own, mut x) = ([0; LANES], [0.0; LANES]);
            for l in 0..LANES {
                let item = items[l.min(items.len() - 1)];
                (own[l], x[l]) = (item.run, puts.x[item.spot]);
            }
            let contracts = Contracts::gather(puts, &own);
            let x = V::from_lanes(x);
            chunks.push(Chunk {
                items,
                spots: Spots::new(contracts, x, lanes),
                sights: [Sight::nothing(); 3],
            });
        }
        Self {
            puts,
            contracts: Contracts::gather(puts, &runs),
            chunks,
            work,
        }
    }

    /// March to the aim: from its quarter of steps, or on from what earlier marches said.
    #[inline(always)]
    pub fn march(&mut self, aim: Aim, class: MeshClass, known: Option<&[Past]>) {
        let level = aim.level;
        let mut coarsest = level;
        if let Some(pasts) = known {
            for chunk in &mut self.chunks {
                chunk.recall(pasts);
            }
        } else if level >= COARSEST_CHECKED {
            coarsest = level - 4;
        } else {
            coarsest = level - 2;
        }
        let mut half = None;
        for at in (coarsest..=level).step_by(2) {
            let plan = class.plan(at);
            if self.puts.limits.is_some() && at + 2 >= level {
                let marched = march::<V, true>(&plan, &self.contracts, half, self.work);
                for chunk in &mut self.chunks {
                    chunk.look::<true>(&plan, &marched, self.work);
                }
                half = Some(marched.first);
            } else {
                let marched = march::<V, false>(&plan, &self.contracts, half, self.work);
                for chunk in &mut self.chunks {
                    chunk.look::<false>(&plan, &marched, self.work);
                }
                half = Some(marched.first);
            }
        }
    }

    /// Extrapolate, state the error, and say of each spot what is found and whether it needs more.
    #[inline(always)]
    pub fn judge(&self, aim: Aim, mut store: impl FnMut(Item, Outcome)) {
        for chunk in &self.chunks {
            chunk.judge(self.puts, aim, &mut store);
        }
    }
}

impl<V: Vector> Chunk<'_, V> {
    /// Take in what a march says.
    #[inline(always)]
    fn look<const D: bool>(&mut self, plan: &Plan, marched: &Marched<V>, work: &Workspace<V>) {
        let newest = self.spots.sight::<D>(plan, marched, work);
        self.sights = [newest, self.sights[0], self.sights[1]];
    }

    #[inline(always)]
    fn recall(&mut self, pasts: &[Past]) {
        let mut columns = [[0.0; LANES]; 10];
        for l in 0..LANES {
            let past = &pasts[self.items[l.min(self.items.len() - 1)].past];
            for (column, number) in columns.iter_mut().zip(past) {
                column[l] = *number;
            }
        }
        self.sights[0] = Sight {
            u: V::from_lanes(columns[0]),
            slope: V::from_lanes(columns[1]),
            curvature: V::from_lanes(columns[2]),
            boundary: V::from_lanes(columns[3]),
            settled: V::from_lanes(columns[4]),
            tangents: [
                V::from_lanes(columns[7]),
                V::from_lanes(columns[8]),
                V::from_lanes(columns[9]),
            ],
        };
        self.sights[1] = Sight {
            u: V::from_lanes(columns[5]),
            settled: V::from_lanes(columns[6]),
            ..Sight::nothing()
        };
    }

    /// The numbers of each lane, in the order of `recall`.
    #[inline(always)]
    fn past(&self) -> [[f64; LANES]; 10] {
        let [whole, half, _] = &self.sights;
        let [rate, dividend, spread] = whole.tangents;
        lanes_of(&[
            whole.u,
            whole.slope,
            whole.curvature,
            whole.boundary,
            whole.settled,
            half.u,
            half.settled,
            rate,
            dividend,
            spread,
        ])
    }

    #[inline(always)]
    fn judge(&self, puts: Puts, aim: Aim, store: &mut impl FnMut(Item, Outcome)) {
        let [whole, half, quarter] = &self.sights;
        let mut by = whole.tangents;
        for (tangent, before) in by.iter_mut().zip(half.tangents) {
            *tangent = *tangent - before;
        }
        let near = Sight {
            tangents: by,
            u: whole.u - half.u,
            slope: whole.slope - half.slope,
            curvature: whole.curvature - half.curvature,
            boundary: whole.boundary - half.boundary,
            settled: whole.settled.min(half.settled).min(quarter.settled),
        };
        let differences = self.spots.differences(&near);
        let error = self.stated_error(aim, &near, differences[0]);
        let gain = if aim.level < COARSEST_CHECKED {
            LONE_GAIN
        } else {
            GAIN
        };
        for (tangent, newest) in by.iter_mut().zip(whole.tangents) {
            *tangent = extrapolated(newest, *tangent, gain);
        }
        let extrapolant = Sight {
            tangents: by,
            u: extrapolated(whole.u, near.u, gain),
            slope: extrapolated(whole.slope, near.slope, gain),
            curvature: extrapolated(whole.curvature, near.curvature, gain),
            boundary: extrapolated(whole.boundary, near.boundary, BOUNDARY_GAIN),
            settled: near.settled,
        };
        let held = extrapolant.boundary - self.spots.x;
        let values = self.spots.values(&extrapolant, held);

        let values = lanes_of(&values);
        let (error, boundary) = (error.lanes(), extrapolant.boundary.lanes());
        let (held, settled) = (held.lanes(), near.settled.lanes());
        let lost = whole.settled.lanes();
        let differences = lanes_of(&differences);
        let steps = STEPS[aim.level];
        let mut past = None;
        for (l, &item) in self.items.iter().enumerate() {
            let mut numbers = [0.0; COLUMNS];
            for (number, value) in numbers.iter_mut().zip(&values) {
                *number = value[l];
            }
            (numbers[VALUES], numbers[VALUES + 1]) = (error[l], boundary[l]);
            let close = |limits: &[f64]| {
                let mut limits = limits[item.spot * VALUES..].iter().zip(&differences);
                limits.all(|(limit, d)| DERIVATIVE_SHARE * d[l].abs() <= *limit)
            };
            let met = settled[l] > 0.0
                && error[l] <= puts.tolerance[item.spot]
                && (steps >= MOST_STEPS_FOR_DERIVATIVES || puts.limits.is_none_or(close));
            let hopeless = lost[l] < 0.0 && steps >= STEPS_TO_SETTLE;
            let goes_on = aim.refines && !met && !hopeless;
            let past = goes_on.then(|| {
                let columns = past.get_or_insert_with(|| self.past());
                columns.each_ref().map(|column| column[l])
            });
            let outcome = Outcome {
                numbers,
                exercised: held[l] >= 0.0,
                settled: settled[l] > 0.0,
                past,
            };
            store(item, outcome);
        }
    }

    /// The error of the extrapolant; `difference` is that of v by the last two marches.
    #[inline(always)]
    fn stated_error(&self, aim: Aim, near: &Sight<V>, difference: V) -> V {
        let [whole, half, quarter] = &self.sights;
        let error = if aim.level < COARSEST_CHECKED {
            difference.abs().times(LONE_SHARE)
        } else {
            let before = self.spots.discounted(half.u - quarter.u).abs();
            let factor = if aim.level == COARSEST_CHECKED {
                COARSE_FACTOR
            } else {
                1.0
            };
            let near = difference.abs().times(factor * NEAR_SHARE);
            before.times_plus(V::all(factor * FAR_SHARE), near)
        };
        let slopes = self.spots.discounted(near.slope).abs();
        let error = error.max(slopes.times(SLOPE_SHARE));
        // Just inside the exercise region: what the value exceeds the payoff by if the boundary is that far off.
        let inside = whole.boundary - self.spots.x;
        let shortfall = (near.boundary.abs() - inside).max(V::zero());
        let excess = shortfall * shortfall * self.spots.early_interest();
        let error = inside.negative(error, error.max(excess));
        // Beyond the grid u is taken for zero.
        let lost = self.spots.premium_bound(whole.boundary);
        (-whole.u.abs()).negative(error, error.max(lost))
    }
}
