//! Many puts to their tolerances, on several threads.

use std::sync::Mutex;

use super::puts::{Puts, Solved, SPOTS_AT_ONCE};
use super::refinement::Task;
use crate::lanes::dispatch::dispatch;

/// The smallest number of spots that is worth a thread of its own; chosen.
const SMALLEST_SHARE: usize = 256;

/// Refine every put until its error estimate meets its tolerance, or to the finest mesh, or until an interrupt ends it all:
/// what has not been marched then is not settled.
#[must_use]
pub fn solve_puts(puts: Puts, threads: usize) -> Solved {
    let count = puts.x.len();
    let mut solved = Solved::new(&puts);
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

/// Split the runs into tasks of about `SPOTS_AT_ONCE` spots, equally many for each thread.
fn tasks<'a>(puts: Puts<'a>, threads: usize, solved: &'a mut Solved) -> Vec<Task<'a>> {
    let count = puts.x.len();
    let wanted = count
        .div_ceil(SPOTS_AT_ONCE)
        .next_multiple_of(threads)
        .max(1);
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
