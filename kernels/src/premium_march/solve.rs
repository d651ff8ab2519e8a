//! Many puts to their tolerances, on several threads.

use std::sync::Mutex;

use super::contracts::Puts;
use super::group::{COLUMNS, SECOND_COLUMNS};
use super::refinement::Task;
use super::spot_evaluation::VALUES;
use crate::lanes::dispatch::dispatch;

/// The number of spots that one thread takes at a time; chosen: enough to fill the lanes, few enough for the cache.
const TASK: usize = 16_384;
/// The smallest number of spots that is worth a thread of its own; chosen.
const SMALLEST_SHARE: usize = 256;

/// The results, by spot; nothing of a spot that is not settled may be used.
pub struct Solved {
    /// For each spot `per_spot` numbers side by side: the `VALUES`, the error estimate of V/K, ln(S*/K), and where there are
    /// limits, `COLUMNS` in all, the differences of the derivatives. Where there is a step of the spread `SECOND_COLUMNS` follow, not a number in the
    /// exercise region: the derivatives by x and each of rate, dividend and spread, and by spread twice, and how far each
    /// is apart in the last two marches.
    pub numbers: Vec<f64>,
    /// How many numbers there are for each spot.
    pub per_spot: usize,
    /// Whether the spot is in the exercise region.
    pub exercised: Vec<bool>,
    /// False where x is not finite, the march does not serve, a march lost the boundary, or an interrupt came before.
    pub settled: Vec<bool>,
    /// The number of time steps of the finest march; 0 where the march does not serve.
    pub steps: Vec<i64>,
}

/// Refine every put until its error estimate meets its tolerance, or to the finest mesh, or until an interrupt ends it all:
/// what has not been marched then is not settled.
#[must_use]
pub fn solve_puts(puts: Puts, threads: usize) -> Solved {
    let count = puts.x.len();
    let per_spot = match (puts.limits, puts.spread_step) {
        (_, Some(_)) => COLUMNS + SECOND_COLUMNS,
        (Some(_), None) => COLUMNS,
        (None, None) => VALUES + 2,
    };
    let mut solved = Solved {
        numbers: vec![f64::NAN; per_spot * count],
        per_spot,
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

/// Split the runs into tasks of about `TASK` spots, equally many for each thread.
fn tasks<'a>(puts: Puts<'a>, threads: usize, solved: &'a mut Solved) -> Vec<Task<'a>> {
    let count = puts.x.len();
    let wanted = count.div_ceil(TASK).next_multiple_of(threads).max(1);
    let size = count.div_ceil(wanted).max(1);
    let (per_spot, mut numbers) = (solved.per_spot, &mut solved.numbers[..]);
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
        tasks.push(Task {
            puts,
            runs: run..end,
            start,
            numbers: split_off(&mut numbers, per_spot * spots),
            per_spot,
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
