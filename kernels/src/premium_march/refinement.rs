//! The work of one thread: which puts are marched side by side, and how far each is refined.

use std::ops::Range;

use super::contracts::Contracts;
use super::grid_values::Workspace;
use super::group::{EarlierMarches, Group, Outcome, Refinement};
use super::mesh::STEPS;
use super::mesh_class::{classify, LOOSE_TOLERANCE_OF_PRICES};
use super::puts::{Puts, COLUMNS, DERIVATIVES, PLAIN, SECOND, VALUES};
use super::work_items::{by_class, groups, run_count, Item};
use crate::lanes::dispatch::Work;
use crate::lanes::vector::{Part, Vector, LANES};

/// The number of groups between two questions whether the work shall end; chosen: those that march too few steps to ask
/// take less than a millisecond together.
const GROUPS_BETWEEN_QUESTIONS: usize = 8;
/// The smallest level of a march whose derivatives are wanted.
const SMALLEST_WITH_DERIVATIVES: usize = 2;

/// A range of runs, and where the results of its spots go; see `Solved`.
pub struct Task<'a> {
    pub puts: Puts<'a>,
    pub runs: Range<usize>,
    /// The first spot.
    pub start: usize,
    /// As in `Solved`, of the spots of these runs.
    pub numbers: &'a mut [f64],
    pub per_spot: usize,
    pub exercised: &'a mut [bool],
    pub settled: &'a mut [bool],
    pub steps: &'a mut [i64],
}

/// A spot that needs no finer march: its premium over K, how far that is apart in the last two marches, and the number of
/// `Found`.
struct Finished {
    item: Item,
    premium: [f64; 2],
    european_by_spread_twice: f64,
}

/// What is still to be done after the marches so far.
#[derive(Default)]
struct Pending {
    /// By level: the spots that are to be marched there on from what earlier marches said.
    missed: [Vec<Item>; STEPS.len()],
    earlier: Vec<EarlierMarches>,
    /// The spots of this level whose second derivative by the spread is to be found.
    finished: Vec<Finished>,
}

/// The arrays of groups of many runs and of few.
struct Workspaces<V: Vector> {
    wide: Workspace<V>,
    narrow: Workspace<V::Narrow>,
    single: Workspace<V::Single>,
}

impl Work for Task<'_> {
    type Result = ();

    /// Go through the levels from the coarsest: at each first the puts that begin there, then those that missed their
    /// tolerance two levels below. What earlier marches said stays where an interrupt ends the work.
    ///
    /// Where derivatives are wanted too, the prices at a loose tolerance are found before, in the same way as without
    /// them.
    #[inline(always)]
    fn run<V: Vector>(mut self) {
        let whole = self.puts;
        let mut priced = Vec::new();
        for wanted in Wanted::of(&whole) {
            self.puts = wanted.of_puts(whole);
            let mut fresh: [Vec<Item>; STEPS.len()] = Default::default();
            V::call(Sorting {
                task: &self,
                fresh: &mut fresh,
            });
            wanted.choose(
                &mut fresh,
                &mut priced,
                self.start..self.start + self.settled.len(),
            );
            if self.refine::<V>(fresh).is_none() {
                return;
            }
        }
    }
}

/// What one passage through the levels is for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Wanted {
    /// All that was asked for.
    All,
    /// The prices of puts that are not marched in the same way where derivatives are wanted.
    LoosePrices,
    /// All, but for those prices.
    Rest,
}

impl Wanted {
    /// The passages for these puts.
    fn of(puts: &Puts) -> &'static [Self] {
        let may_be_loose = puts.levels.0 < SMALLEST_WITH_DERIVATIVES
            && puts
                .tolerance
                .iter()
                .any(|&t| t >= LOOSE_TOLERANCE_OF_PRICES);
        if puts.limits.is_some() && may_be_loose {
            &[Self::LoosePrices, Self::Rest]
        } else {
            &[Self::All]
        }
    }

    /// The puts as this passage takes them.
    fn of_puts(self, puts: Puts) -> Puts {
        let (smallest, largest) = puts.levels;
        match self {
            Self::LoosePrices => Puts {
                limits: None,
                spread_step: None,
                ..puts
            },
            Self::All | Self::Rest if puts.limits.is_some() => Puts {
                levels: (smallest.max(SMALLEST_WITH_DERIVATIVES), largest),
                ..puts
            },
            Self::All | Self::Rest => puts,
        }
    }

    /// Leave of the items those that this passage is for; `priced` says of each spot whether its price is found before.
    fn choose(
        self,
        fresh: &mut [Vec<Item>; STEPS.len()],
        priced: &mut Vec<bool>,
        spots: Range<usize>,
    ) {
        match self {
            Self::All => {}
            Self::LoosePrices => {
                priced.resize(spots.len(), false);
                for items in fresh {
                    items.retain(|item| item.class.is_single_at(0));
                    for item in items {
                        priced[item.spot - spots.start] = true;
                    }
                }
            }
            Self::Rest => {
                for item in fresh.iter_mut().flatten() {
                    item.valued = priced[item.spot - spots.start];
                }
            }
        }
    }
}

impl Task<'_> {
    /// March the items from their levels on. None where the work is told to end.
    #[inline(always)]
    fn refine<V: Vector>(&mut self, mut fresh: [Vec<Item>; STEPS.len()]) -> Option<()> {
        let puts = self.puts;
        let mut pending = Pending::default();
        let mut work = Workspaces::<V> {
            wide: Workspace::new(),
            narrow: Workspace::new(),
            single: Workspace::new(),
        };
        let mut marched = 0_usize;
        for (level, fresh) in fresh.iter_mut().enumerate() {
            for continues in [false, true] {
                let items = if continues {
                    std::mem::take(&mut pending.missed[level])
                } else {
                    std::mem::take(fresh)
                };
                for items in by_class(items).chunk_by(|a, b| a.class == b.class) {
                    for items in groups(items) {
                        if marched.is_multiple_of(GROUPS_BETWEEN_QUESTIONS) && (puts.interrupt)() {
                            return None;
                        }
                        marched += 1;
                        let (pending, narrow) = (&mut pending, &mut work.narrow);
                        if items[0].class.is_single_at(level) {
                            let work = &mut work.single;
                            V::call(Marching(self, items, level, continues, pending, work))?;
                        } else if run_count(items) <= V::Narrow::WIDTH {
                            V::Narrow::call(Marching(
                                self, items, level, continues, pending, narrow,
                            ))?;
                        } else {
                            let work = &mut work.wide;
                            V::call(Marching(self, items, level, continues, pending, work))?;
                        }
                    }
                }
            }
            let finished = std::mem::take(&mut pending.finished);
            if let Some(step) = puts.spread_step {
                self.second_by_spread(level, &finished, step, &mut work)?;
            }
        }
        Some(())
    }

    /// Find the mesh and the first level of each run.
    #[inline(always)]
    fn sort_into_levels<V: Vector>(&self, fresh: &mut [Vec<Item>; STEPS.len()]) {
        let puts = self.puts;
        let mut start = self.runs.start;
        while start < self.runs.end {
            let end = self.runs.end.min(start + LANES);
            let (mut runs, mut tolerance) = ([0; LANES], [f64::MAX; LANES]);
            for l in 0..LANES {
                runs[l] = (start + l).min(end - 1);
                for spot in puts.first[runs[l]]..puts.first[runs[l] + 1] {
                    tolerance[l] = tolerance[l].min(puts.tolerance[spot]);
                }
            }
            let classes = classify(
                &Contracts::<V>::gather(puts, &runs),
                V::from_lanes(tolerance),
                puts.levels,
            );
            for (run, class) in (start..end).zip(classes) {
                if let Some((class, level)) = class {
                    let items = &mut fresh[level];
                    let spots = puts.first[run]..puts.first[run + 1];
                    let known = spots.filter(|&spot| puts.x[spot].is_finite());
                    items.extend(known.map(|spot| Item {
                        run,
                        spot,
                        class,
                        earlier: 0,
                        valued: false,
                    }));
                }
            }
            start = end;
        }
    }

    /// March a group to this level, keep what is found, and note what is still to be done. None where the work is told to
    /// end.
    #[inline(always)]
    fn march<W: Vector, S: Vector>(
        &mut self,
        items: &[Item],
        level: usize,
        continues: bool,
        pending: &mut Pending,
        work: &mut Workspace<S>,
    ) -> Option<()> {
        let Pending {
            missed,
            earlier,
            finished,
        } = pending;
        let mut group = Group::<W, S>::new(self.puts, items, None, work);
        let known = continues.then_some(&earlier[..]);
        group.march(level, items[0].class, known)?;
        let refinement = Refinement {
            level,
            may_continue: level + 2 <= self.puts.levels.1,
        };
        group.report(refinement, |item, outcome| {
            self.store(item, level, &outcome);
            let is_held = !self.exercised[item.spot - self.start];
            if outcome.earlier.is_none() && outcome.settled && is_held {
                let Outcome { found, lane, .. } = outcome;
                finished.push(Finished {
                    item,
                    premium: [found.premium[lane], found.differences[0][lane]],
                    european_by_spread_twice: found.european_by_spread_twice[lane],
                });
            }
            if let Some(kept) = outcome.earlier {
                let place = if continues {
                    earlier[item.earlier] = kept;
                    item.earlier
                } else {
                    earlier.push(kept);
                    earlier.len() - 1
                };
                missed[level + 2].push(Item {
                    earlier: place,
                    valued: item.valued || outcome.valued,
                    ..item
                });
            }
        });
        Some(())
    }

    /// Find the second derivative by the spread of spots whose last march was at this level: that of the European value,
    /// and the premium's difference of second order, from two more marches of each on the same mesh. None where the work
    /// is told to end.
    #[inline(always)]
    fn second_by_spread<V: Vector>(
        &mut self,
        level: usize,
        finished: &[Finished],
        step: f64,
        work: &mut Workspaces<V>,
    ) -> Option<()> {
        let puts = Puts {
            limits: None,
            ..self.puts
        };
        let items = finished.iter().enumerate().map(|(place, of)| Item {
            earlier: place,
            ..of.item
        });
        for items in by_class(items.collect()).chunk_by(|a, b| a.class == b.class) {
            for items in groups(items) {
                let mut sides = [const { Vec::new() }; 2];
                for (side, factor) in sides.iter_mut().zip([1.0 + step, 1.0 - step]) {
                    if (puts.interrupt)() {
                        return None;
                    }
                    *side = if run_count(items) <= V::Narrow::WIDTH {
                        V::Narrow::call(Premiums(puts, items, factor, level, &mut work.narrow))?
                    } else {
                        V::call(Premiums(puts, items, factor, level, &mut work.wide))?
                    };
                }
                for (item, (up, down)) in items.iter().zip(sides[0].iter().zip(&sides[1])) {
                    let here = &finished[item.earlier];
                    let apart = step * puts.spread[item.run];
                    let known = [here.european_by_spread_twice, 0.0];
                    for k in 0..2 {
                        let column = COLUMNS + SECOND - 1 + k * SECOND;
                        let premium = (up[k] - here.premium[k]) + (down[k] - here.premium[k]);
                        let number = known[k] + premium / (apart * apart);
                        self.numbers_of(item.spot)[column] = number;
                    }
                }
            }
        }
        Some(())
    }

    /// What is kept of a spot.
    fn numbers_of(&mut self, spot: usize) -> &mut [f64] {
        let start = (spot - self.start) * self.per_spot;
        &mut self.numbers[start..start + self.per_spot]
    }

    /// Keep what was found; the value that met its tolerance stays, whatever derivatives are asked for.
    #[inline(always)]
    fn store(&mut self, item: Item, level: usize, outcome: &Outcome<'_>) {
        let Outcome { found, lane, .. } = *outcome;
        let numbers = self.numbers_of(item.spot);
        if !item.valued || outcome.settled {
            for (k, derivative) in DERIVATIVES.into_iter().enumerate() {
                if let Some(apart) = numbers.get_mut(PLAIN + k) {
                    *apart = found.differences[derivative][lane];
                    numbers[derivative] = found.values[derivative][lane];
                }
            }
            store_cross(numbers, outcome);
        }
        if item.valued {
            return;
        }
        for (kept, value) in numbers.iter_mut().zip(&found.values) {
            *kept = value[lane];
        }
        let others = [&found.error, &found.boundary, &found.boundary_error];
        for (kept, other) in numbers[VALUES..PLAIN].iter_mut().zip(others) {
            *kept = other[lane];
        }
        let at = item.spot - self.start;
        self.exercised[at] = outcome.exercised;
        self.settled[at] = outcome.settled;
        self.steps[at] = i64::try_from(STEPS[level]).unwrap_or(i64::MAX);
    }
}

/// `Task::sort_into_levels`. This and the parts below are functions of their own: all in one takes a minute to compile.
struct Sorting<'s, 'a> {
    task: &'s Task<'a>,
    fresh: &'s mut [Vec<Item>; STEPS.len()],
}

impl<V: Vector> Part<V> for Sorting<'_, '_> {
    type Result = ();

    #[inline(always)]
    fn run(self) {
        self.task.sort_into_levels::<V>(self.fresh);
    }
}

/// `Task::march`, in the order of its arguments.
struct Marching<'m, 'a, S: Vector>(
    &'m mut Task<'a>,
    &'m [Item],
    usize,
    bool,
    &'m mut Pending,
    &'m mut Workspace<S>,
);

impl<W: Vector, S: Vector> Part<W> for Marching<'_, '_, S> {
    type Result = Option<()>;

    #[inline(always)]
    fn run(self) -> Self::Result {
        let Self(task, items, level, continues, pending, work) = self;
        task.march::<W, S>(items, level, continues, pending, work)
    }
}

/// The premiums of a group of these puts with the spread times a factor on a level, as `Group::premiums`. None where the
/// work is told to end.
struct Premiums<'m, 'a, W: Vector>(Puts<'a>, &'m [Item], f64, usize, &'m mut Workspace<W>);

impl<W: Vector> Part<W> for Premiums<'_, '_, W> {
    type Result = Option<Vec<[f64; 2]>>;

    #[inline(always)]
    fn run(self) -> Self::Result {
        let Self(puts, items, factor, level, work) = self;
        let mut group = Group::<W, W>::new(puts, items, Some(factor), work);
        group.march(level, items[0].class, None)?;
        Some(group.premiums(level))
    }
}

/// Keep the derivatives by x and each parameter, where there is room for them.
#[inline(always)]
fn store_cross(numbers: &mut [f64], outcome: &Outcome<'_>) {
    let start = numbers.len().min(COLUMNS);
    for (kept, cross) in numbers[start..]
        .chunks_exact_mut(SECOND)
        .zip(&outcome.found.cross)
    {
        for (kept, number) in kept.iter_mut().zip(cross) {
            *kept = number[outcome.lane];
        }
    }
}
