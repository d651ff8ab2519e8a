//! The spots that are still to be marched, and how they are put into groups.

use super::mesh_class::MeshClass;
use crate::lanes::vector::LANES;

/// A spot to be marched.
#[derive(Clone, Copy)]
pub struct Item {
    pub run: usize,
    pub spot: usize,
    pub class: MeshClass,
    /// Where the task keeps what earlier marches said of the spot.
    pub earlier: usize,
    /// Whether the value met its tolerance at an earlier level, so that only derivatives are still refined.
    pub valued: bool,
}

/// Sort by class, in order otherwise.
pub fn by_class(items: Vec<Item>) -> Vec<Item> {
    if items.len() < 2 {
        return items;
    }
    let indices = items.iter().map(|item| item.class.index());
    let least = indices.clone().min().unwrap_or(0);
    let most = indices.clone().max().unwrap_or(0);
    let mut places = vec![0_usize; most - least + 1];
    for index in indices {
        places[index - least] += 1;
    }
    let mut next = 0;
    for place in &mut places {
        next += std::mem::replace(place, next);
    }
    let mut sorted = items.clone();
    for item in items {
        let place = &mut places[item.class.index() - least];
        sorted[*place] = item;
        *place += 1;
    }
    sorted
}

/// Split into the items of at most sixteen runs.
pub fn groups(items: &[Item]) -> impl Iterator<Item = &[Item]> {
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

/// The number of runs of a group.
pub fn run_count(items: &[Item]) -> usize {
    items.chunk_by(|a, b| a.run == b.run).count()
}
