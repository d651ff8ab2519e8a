//! As many marches side by side as a vector holds, refined together, and what they say of their spots.

use super::contracts::Contracts;
use super::error_estimate::{
    derivatives_are_met, is_hopeless, Comparison, COARSEST_CHECKED, ONE_STEP_CHECKED,
    SINGLE_ROUNDING,
};
use super::first_step::OnlyStep;
use super::grid_values::Workspace;
use super::march::{march, Marched};
use super::mesh::Mesh;
use super::mesh_class::MeshClass;
use super::puts::{Puts, CROSS, VALUES};
use super::spot_evaluation::{SpotEvaluation, Spots};
use super::work_items::Item;
use crate::lanes::vector::{Vector, LANES};

/// The numbers of `EarlierMarches`.
const KEPT: usize = 14;

/// What the next level needs of the marches of a spot: the last evaluation without its tangents, u, `settled` and boundary
/// of the one before, and the last tangents.
pub type EarlierMarches = [f64; KEPT];

/// The lanes of each vector.
#[inline(always)]
fn lanes_of<V: Vector, const N: usize>(vectors: &[V; N]) -> [[f64; LANES]; N] {
    let mut numbers = [[0.0; LANES]; N];
    for (own, vector) in numbers.iter_mut().zip(vectors) {
        *own = vector.lanes();
    }
    numbers
}

/// Which marches a group takes.
#[derive(Clone, Copy)]
pub struct Refinement {
    /// The level of the finest march.
    pub level: usize,
    /// Whether a finer one may follow.
    pub may_continue: bool,
}

/// What the marches of a chunk say, number by number, of all its lanes.
pub struct Found {
    /// The `VALUES`.
    pub values: [[f64; LANES]; VALUES],
    /// How far they are apart in the last two marches.
    pub differences: [[f64; LANES]; VALUES],
    /// The error estimate of V/K.
    pub error: [f64; LANES],
    /// ln(S*/K), and the error estimate of that.
    pub boundary: [f64; LANES],
    pub boundary_error: [f64; LANES],
    /// The derivatives by x and each parameter, and how far they are apart in the last two marches.
    pub cross: [[[f64; LANES]; CROSS]; 2],
    /// The early exercise premium over K.
    pub premium: [f64; LANES],
    /// The second derivative by the spread of the European V/K.
    pub european_by_spread_twice: [f64; LANES],
}

/// What is found for one spot.
pub struct Outcome<'a> {
    pub found: &'a Found,
    pub lane: usize,
    /// Whether the spot lies in the exercise region.
    pub exercised: bool,
    /// Whether no march lost the boundary.
    pub settled: bool,
    /// Whether the value meets its tolerance.
    pub valued: bool,
    /// None where no finer march is needed.
    pub earlier: Option<EarlierMarches>,
}

/// Marches side by side: on vectors S, which may be of single precision, evaluated on vectors V.
pub struct Group<'a, 'w, V, S> {
    puts: Puts<'a>,
    contracts: Contracts<S>,
    chunks: Vec<Chunk<'a, V>>,
    /// Whether all lanes hold one run.
    is_one_run: bool,
    work: &'w mut Workspace<S>,
}

/// At most as many of the spots as a vector holds.
struct Chunk<'a, V> {
    items: &'a [Item],
    spots: Spots<V>,
    /// The evaluations of the last three marches, newest first.
    evaluations: [SpotEvaluation<V>; 3],
}

impl<'a, 'w, V: Vector, S: Vector> Group<'a, 'w, V, S> {
    /// The group of items of at most as many runs as the vectors hold, those of one run next to each other.
    ///
    /// With a factor on the spreads the evaluations continue u smoothly into the exercise region, for differences.
    #[inline(always)]
    pub fn new(
        puts: Puts<'a>,
        items: &'a [Item],
        factor: Option<f64>,
        work: &'w mut Workspace<S>,
    ) -> Self {
        let mut runs = [items[0].run; LANES];
        let mut lane = 0;
        let mut chunks = Vec::with_capacity(items.len().div_ceil(V::WIDTH));
        for items in items.chunks(V::WIDTH) {
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
            let contracts = Contracts::gather(puts, &own).with_spread_times(factor.unwrap_or(1.0));
            let x = V::from_lanes(x);
            chunks.push(Chunk {
                items,
                spots: Spots::new(contracts, x, lanes, factor.is_some()),
                evaluations: [SpotEvaluation::zero(); 3],
            });
        }
        Self {
            puts,
            contracts: Contracts::gather(puts, &runs).with_spread_times(factor.unwrap_or(1.0)),
            chunks,
            is_one_run: lane == 0,
            work,
        }
    }

    /// March up to the level: from a quarter of its steps, or on from what earlier marches said. None where the work is
    /// told to end.
    #[inline(always)]
    pub fn march(
        &mut self,
        level: usize,
        class: MeshClass,
        earlier: Option<&[EarlierMarches]>,
    ) -> Option<()> {
        let mut coarsest = level;
        let mut coarser_first = None;
        if let Some(earlier) = earlier {
            for chunk in &mut self.chunks {
                chunk.restore(earlier);
            }
        } else if level >= COARSEST_CHECKED {
            coarsest = level - 4;
        } else if level > ONE_STEP_CHECKED {
            coarsest = level - 2;
        } else {
            let alone = OnlyStep::take(&self.contracts);
            for chunk in &mut self.chunks {
                chunk.keep_newest(chunk.spots.evaluate_only_step(&alone));
            }
            coarser_first = Some(alone.xi);
        }
        for at in (coarsest..=level).step_by(2) {
            let mesh = class.mesh(at);
            let with_derivatives = self.puts.limits.is_some() && at + 2 >= level;
            coarser_first = Some(if S::IS_SINGLE || !with_derivatives {
                self.march_once::<0>(&mesh, coarser_first)?
            } else if V::WIDTH < LANES && self.is_one_run {
                self.march_once::<1>(&mesh, coarser_first)?
            } else {
                self.march_once::<3>(&mesh, coarser_first)?
            });
        }
        Some(())
    }

    /// March on one mesh and evaluate the march at the spots; return the boundary after its first step.
    #[inline(always)]
    fn march_once<const D: usize>(&mut self, mesh: &Mesh, coarser_first: Option<S>) -> Option<S> {
        let (contracts, interrupt) = (&self.contracts, self.puts.interrupt);
        let marched = march::<S, D>(mesh, contracts, coarser_first, self.work, interrupt)?;
        for chunk in &mut self.chunks {
            chunk.evaluate::<S, D>(mesh, &marched, self.work);
        }
        Some(marched.first_boundary)
    }

    /// The early exercise premium over K of each of the items, and how far it is apart in the last two marches.
    #[inline(always)]
    pub fn premiums(&self, level: usize) -> Vec<[f64; 2]> {
        let mut found = Vec::new();
        for chunk in &self.chunks {
            let comparison = chunk.comparison(level);
            let difference = comparison.difference();
            let premium = comparison.extrapolant(&difference).u;
            let premium = chunk.spots.discounted(premium).lanes();
            let apart = chunk.spots.discounted(difference.u).lanes();
            found.extend((0..chunk.items.len()).map(|l| [premium[l], apart[l]]));
        }
        found
    }

    /// Extrapolate, estimate the error, and say of each spot what is found and whether it needs a finer march.
    #[inline(always)]
    pub fn report(&self, refinement: Refinement, mut store: impl FnMut(Item, Outcome<'_>)) {
        for chunk in &self.chunks {
            let rounding = if S::IS_SINGLE { SINGLE_ROUNDING } else { 0.0 };
            chunk.report(self.puts, refinement, rounding, &mut store);
        }
    }
}

impl<V: Vector> Chunk<'_, V> {
    /// Take in what a march says.
    #[inline(always)]
    fn evaluate<S: Vector, const D: usize>(
        &mut self,
        mesh: &Mesh,
        marched: &Marched<S>,
        work: &Workspace<S>,
    ) {
        self.keep_newest(self.spots.evaluate::<S, D>(mesh, marched, work));
    }

    #[inline(always)]
    fn keep_newest(&mut self, newest: SpotEvaluation<V>) {
        self.evaluations = [newest, self.evaluations[0], self.evaluations[1]];
    }

    /// Put back what `keep` has kept.
    #[inline(always)]
    fn restore(&mut self, earlier: &[EarlierMarches]) {
        let mut columns = [[0.0; LANES]; KEPT];
        for l in 0..LANES {
            let numbers = &earlier[self.items[l.min(self.items.len() - 1)].earlier];
            for (column, number) in columns.iter_mut().zip(numbers) {
                column[l] = *number;
            }
        }
        self.evaluations[0] = SpotEvaluation {
            u: V::from_lanes(columns[0]),
            slope: V::from_lanes(columns[1]),
            curvature: V::from_lanes(columns[2]),
            boundary: V::from_lanes(columns[3]),
            settled: V::from_lanes(columns[4]),
            tangents: [
                V::from_lanes(columns[8]),
                V::from_lanes(columns[9]),
                V::from_lanes(columns[10]),
            ],
            tangent_slopes: [
                V::from_lanes(columns[11]),
                V::from_lanes(columns[12]),
                V::from_lanes(columns[13]),
            ],
        };
        self.evaluations[1] = SpotEvaluation {
            u: V::from_lanes(columns[5]),
            settled: V::from_lanes(columns[6]),
            boundary: V::from_lanes(columns[7]),
            ..SpotEvaluation::zero()
        };
    }

    /// `EarlierMarches` of each lane.
    #[inline(always)]
    fn keep(&self) -> [[f64; LANES]; KEPT] {
        let [whole, half, _] = &self.evaluations;
        let [rate, dividend, spread] = whole.tangents;
        let [slope_by_rate, slope_by_dividend, slope_by_spread] = whole.tangent_slopes;
        lanes_of(&[
            whole.u,
            whole.slope,
            whole.curvature,
            whole.boundary,
            whole.settled,
            half.u,
            half.settled,
            half.boundary,
            rate,
            dividend,
            spread,
            slope_by_rate,
            slope_by_dividend,
            slope_by_spread,
        ])
    }

    /// The last three marches, the newest at this level.
    #[inline(always)]
    fn comparison(&self, level: usize) -> Comparison<'_, V> {
        let [whole, half, quarter] = &self.evaluations;
        Comparison {
            spots: &self.spots,
            level,
            whole,
            half,
            quarter,
        }
    }

    #[inline(always)]
    fn report(
        &self,
        puts: Puts,
        refinement: Refinement,
        rounding: f64,
        store: &mut impl FnMut(Item, Outcome<'_>),
    ) {
        let comparison = self.comparison(refinement.level);
        let difference = comparison.difference();
        let differences = self.spots.value_differences(&difference);
        let error = comparison.error(&difference, differences[0]);
        let extrapolant = comparison.extrapolant(&difference);
        let depth = extrapolant.boundary - self.spots.x;
        let nothing = [[0.0; LANES]; CROSS];
        let mut found = Found {
            values: lanes_of(&self.spots.values(&extrapolant, depth)),
            differences: lanes_of(&differences),
            error: error.plus(rounding).lanes(),
            boundary: extrapolant.boundary.lanes(),
            boundary_error: comparison.boundary_error(&difference).lanes(),
            cross: [nothing; 2],
            premium: self.spots.discounted(extrapolant.u).lanes(),
            european_by_spread_twice: [0.0; LANES],
        };
        if puts.spread_step.is_some() {
            found.cross = [
                lanes_of(&self.spots.cross_derivatives(&extrapolant, depth)),
                lanes_of(&self.spots.cross_differences(&difference)),
            ];
            found.european_by_spread_twice = self.spots.european_by_spread_twice().lanes();
        }
        let (depth, settled) = (depth.lanes(), difference.settled.lanes());
        let newest_settled = self.evaluations[0].settled.lanes();
        let cost_at_turn = puts.limits.map(|_| self.spots.cost_at_turn().lanes());
        let mut kept = None;
        for (l, &item) in self.items.iter().enumerate() {
            let limits = puts.limits.map(|limits| &limits[item.spot * VALUES..]);
            let valued = settled[l] > 0.0 && found.error[l] <= puts.tolerance[item.spot];
            let cost_at_turn = cost_at_turn.map_or(f64::MAX, |cost| cost[l]);
            let met = valued
                && derivatives_are_met(
                    refinement.level,
                    limits,
                    &found.differences,
                    cost_at_turn,
                    l,
                );
            let hopeless = newest_settled[l] < 0.0 && is_hopeless(refinement.level);
            let goes_on = refinement.may_continue && !met && !hopeless;
            let earlier = goes_on.then(|| {
                let columns = kept.get_or_insert_with(|| self.keep());
                columns.each_ref().map(|column| column[l])
            });
            let outcome = Outcome {
                found: &found,
                lane: l,
                exercised: depth[l] >= 0.0,
                settled: settled[l] > 0.0,
                valued,
                earlier,
            };
            store(item, outcome);
        }
    }
}
