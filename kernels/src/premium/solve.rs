//! Many puts to their tolerances: which are marched together, how far each is refined, and by which thread.
//!
//! A put is marched with M, M/2 and M/4 time steps. What that says is the extrapolant and two differences; where
//! the error they leave is too large, it is marched with 2 M steps as well, and so on.

use std::ops::Range;
use std::sync::Mutex;

use super::group::{Aim, Group, Outcome, Past};
use super::labels::Workspace;
use super::mesh::{classify, MeshClass};
use super::obstacle::Contracts;
use super::plan::STEPS;
use super::reading::VALUES;
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::vector::{Vector, LANES};

/// Spots that one thread takes at a time: enough to fill the lanes, few enough for the cache.
const TASK: usize = 16_384;
/// Fewer are not worth a second thread.
const SMALLEST_SHARE: usize = 256;

/// Puts in their dimensionless parameters: runs of spots that share a march.
#[derive(Clone, Copy)]
pub struct Puts<'a> {
    /// r T, by run.
    pub rate: &'a [f64],
    /// q T, by run.
    pub dividend: &'a [f64],
    /// sigma sqrt(T), by run.
    pub spread: &'a [f64],
    /// The first spot of each run, and their number; increasing, one longer than the runs.
    pub first: &'a [usize],
    /// ln(S/K), by spot.
    pub x: &'a [f64],
    /// Of V/K, by spot.
    pub tolerance: &'a [f64],
    /// What each of the values may be off by, seven by spot; None leaves out the derivatives by the parameters.
    pub limits: Option<&'a [f64]>,
    /// Bounds of the level of the first march with M steps and of the last.
    pub levels: (usize, usize),
}

/// By spot; nothing of a spot that is not settled may be used.
pub struct Solved {
    /// Columns: the values, the error of V/K, ln(S*/K).
    pub numbers: Vec<f64>,
    /// Whether the spot is in the exercise region.
    pub exercised: Vec<bool>,
    /// False where x is not finite, the march does not serve, or a march lost the boundary.
    pub settled: Vec<bool>,
    /// Of the finest march; 0 where the march does not serve.
    pub steps: Vec<i64>,
}

/// How many columns `Solved::numbers` has.
pub const COLUMNS: usize = VALUES + 2;

/// Refine every put until its stated error meets its tolerance, or to the finest mesh.
#[must_use]
pub fn solve_puts(puts: Puts, threads: usize) -> Solved {
    let count = puts.x.len();
    let mut solved = Solved {
        numbers: vec![f64::NAN; COLUMNS * count],
        exercised: vec![false; count],
        settled: vec![false; count],
        steps: vec![0; count],
    };
    let threads = threads.min(count / SMALLEST_SHARE).max(1);
    let tasks = Mutex::new(tasks(puts, threads, &mut solved));
    let working = || {
        while let Some(task) = take(&tasks) {
            dispatch(task);
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..threads {
            scope.spawn(working);
        }
        working();
    });
    solved
}

fn take<'a>(tasks: &Mutex<Vec<Task<'a>>>) -> Option<Task<'a>> {
    tasks.lock().ok()?.pop()
}

/// A range of runs and the places of what is found.
struct Task<'a> {
    puts: Puts<'a>,
    runs: Range<usize>,
    /// The first spot.
    start: usize,
    numbers: Vec<&'a mut [f64]>,
    exercised: &'a mut [bool],
    settled: &'a mut [bool],
    steps: &'a mut [i64],
}

/// Split the runs into tasks of about `TASK` spots, equally many for each thread.
fn tasks<'a>(puts: Puts<'a>, threads: usize, solved: &'a mut Solved) -> Vec<Task<'a>> {
    let count = puts.x.len();
    let wanted = count.div_ceil(TASK).next_multiple_of(threads).max(1);
    let size = count.div_ceil(wanted).max(1);
    let mut columns: Vec<&mut [f64]> = solved.numbers.chunks_mut(count.max(1)).collect();
    let (mut exercised, mut settled, mut steps) = (
        &mut solved.exercised[..],
        &mut solved.settled[..],
        &mut solved.steps[..],
    );
    let runs = puts.rate.len();
    let mut tasks = Vec::new();
    let mut run = 0;
    while run < runs {
        let start = puts.first[run];
        let end = (run + 1..runs)
            .find(|&r| puts.first[r] - start >= size)
            .unwrap_or(runs);
        let spots = puts.first[end] - start;
        let mut numbers = Vec::with_capacity(COLUMNS);
        for column in &mut columns {
            let (mine, rest) = std::mem::take(column).split_at_mut(spots);
            numbers.push(mine);
            *column = rest;
        }
        tasks.push(Task {
            puts,
            runs: run..end,
            start,
            numbers,
            exercised: split_off(&mut exercised, spots),
            settled: split_off(&mut settled, spots),
            steps: split_off(&mut steps, spots),
        });
        run = end;
    }
    tasks
}

#[allow(clippy::mut_mut)]
fn split_off<'a, T>(slice: &mut &'a mut [T], count: usize) -> &'a mut [T] {
    let (mine, rest) = std::mem::take(slice).split_at_mut(count);
    *slice = rest;
    mine
}

/// A spot to be marched.
#[derive(Clone, Copy)]
pub struct Item {
    pub run: usize,
    pub spot: usize,
    class: MeshClass,
    /// Where to find what earlier marches said.
    pub past: usize,
}

impl Work for Task<'_> {
    type Result = ();

    #[inline(always)]
    fn run<V: Vector>(mut self) {
        let puts = self.puts;
        let mut fresh: [Vec<Item>; STEPS.len()] = Default::default();
        self.sort_into_levels::<V>(&mut fresh);
        let mut missed: [Vec<Item>; STEPS.len()] = Default::default();
        let mut pasts = Vec::<Past>::new();
        let mut work = Workspace::<V>::new();
        for level in 0..STEPS.len() {
            let aim = Aim {
                level,
                refines: level + 2 <= puts.levels.1,
            };
            for refining in [false, true] {
                let items = if refining {
                    std::mem::take(&mut missed[level])
                } else {
                    std::mem::take(&mut fresh[level])
                };
                for items in by_class(items).chunk_by(|a, b| a.class == b.class) {
                    for items in groups(items) {
                        let mut group = Group::new(puts, items, &mut work);
                        let known = refining.then_some(&pasts[..]);
                        group.march(aim, items[0].class, known);
                        group.judge(aim, |item, outcome| {
                            self.store(item.spot, level, &outcome);
                            if let Some(past) = outcome.past {
                                let past = if refining {
                                    pasts[item.past] = past;
                                    item.past
                                } else {
                                    pasts.push(past);
                                    pasts.len() - 1
                                };
                                missed[level + 2].push(Item { past, ..item });
                            }
                        });
                    }
                }
            }
        }
    }
}

impl Task<'_> {
    /// Find each run's meshes and first level.
    #[inline(always)]
    fn sort_into_levels<V: Vector>(&self, fresh: &mut [Vec<Item>; STEPS.len()]) {
        let puts = self.puts;
        let (fewest, most) = puts.levels;
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
            );
            for (run, class) in (start..end).zip(classes) {
                if let Some((class, level)) = class {
                    let items = &mut fresh[level.clamp(fewest, most)];
                    let spots = puts.first[run]..puts.first[run + 1];
                    let known = spots.filter(|&spot| puts.x[spot].is_finite());
                    items.extend(known.map(|spot| Item {
                        run,
                        spot,
                        class,
                        past: 0,
                    }));
                }
            }
            start = end;
        }
    }

    #[inline(always)]
    fn store(&mut self, spot: usize, level: usize, found: &Outcome) {
        let at = spot - self.start;
        for (column, number) in self.numbers.iter_mut().zip(found.numbers) {
            column[at] = number;
        }
        self.exercised[at] = found.exercised;
        self.settled[at] = found.settled;
        self.steps[at] = i64::try_from(STEPS[level]).unwrap_or(i64::MAX);
    }
}

/// Sort by class, in order otherwise.
fn by_class(items: Vec<Item>) -> Vec<Item> {
    if items.len() < 2 {
        return items;
    }
    let mut places = vec![0_usize; MeshClass::COUNT];
    for item in &items {
        places[item.class.index()] += 1;
    }
    let mut next = 0;
    for place in &mut places {
        next += std::mem::replace(place, next);
    }
    let mut sorted = items.clone();
    for item in items {
        let place = &mut places[item.class.index()];
        sorted[*place] = item;
        *place += 1;
    }
    sorted
}

/// Split into the items of at most sixteen runs.
fn groups(items: &[Item]) -> impl Iterator<Item = &[Item]> {
    let mut rest = items;
    std::iter::from_fn(move || {
        let mut runs = 0;
        let mut last = usize::MAX;
        let full = rest.iter().position(|item| {
            runs += usize::from(item.run != last);
            last = item.run;
            runs > LANES
        });
        let (group, others) = rest.split_at(full.unwrap_or(rest.len()));
        rest = others;
        (!group.is_empty()).then_some(group)
    })
}

impl<V: Vector> Contracts<V> {
    #[inline(always)]
    pub fn gather(puts: Puts, runs: &[usize; LANES]) -> Self {
        Self {
            rate: gather(puts.rate, runs),
            dividend: gather(puts.dividend, runs),
            spread: gather(puts.spread, runs),
        }
    }
}

#[inline(always)]
fn gather<V: Vector>(column: &[f64], rows: &[usize; LANES]) -> V {
    let mut numbers = [0.0; LANES];
    for (number, &row) in numbers.iter_mut().zip(rows) {
        *number = column[row];
    }
    V::from_lanes(numbers)
}
