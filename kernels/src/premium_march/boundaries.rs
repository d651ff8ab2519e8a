//! The exercise boundary of many puts, from one march each.

use super::contracts::Contracts;
use super::grid_values::Workspace;
use super::march::march;
use super::mesh_class::classify;
use super::puts::Puts;
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::vector::{Vector, LANES};

/// The tolerance of V/K that decides the width of the grid; chosen.
const TOLERANCE: f64 = 1e-8;
/// The level that resolves the decay of the premium: the others have their dx in proportion; chosen.
const RESOLVING: usize = 6;

/// Return ln(S*/K) now and whether it was found, of each run, from the march with `STEPS[level]` time steps.
///
/// The spots of `puts`, their tolerances and its levels play no part.
#[must_use]
pub fn march_boundaries(puts: Puts, level: usize) -> (Vec<f64>, Vec<bool>) {
    dispatch(Marching { puts, level })
}

struct Marching<'a> {
    puts: Puts<'a>,
    level: usize,
}

impl Work for Marching<'_> {
    type Result = (Vec<f64>, Vec<bool>);

    #[inline(always)]
    fn run<V: Vector>(self) -> Self::Result {
        let count = self.puts.rate.len();
        let (mut boundary, mut settled) = (vec![f64::NAN; count], vec![false; count]);
        let mut work = Workspace::<V>::new();
        let mut sorted = Vec::with_capacity(count);
        for start in (0..count).step_by(LANES) {
            let runs = std::array::from_fn(|l| (start + l).min(count - 1));
            let classes = classify(
                &Contracts::<V>::gather(self.puts, &runs),
                V::all(TOLERANCE),
                (RESOLVING, RESOLVING),
            );
            let mine = (start..count).zip(classes);
            sorted.extend(mine.filter_map(|(run, class)| class.map(|(class, _)| (class, run))));
        }
        sorted.sort_unstable();
        for rows in sorted.chunk_by(|a, b| a.0 == b.0) {
            let mesh = rows[0].0.mesh(self.level);
            for rows in rows.chunks(LANES) {
                let runs = std::array::from_fn(|l| rows[l.min(rows.len() - 1)].1);
                let contracts = Contracts::<V>::gather(self.puts, &runs);
                let interrupt = self.puts.interrupt;
                let marched = march::<V, 0>(&mesh, &contracts, None, &mut work, interrupt);
                let Some(marched) = marched else {
                    return (boundary, settled);
                };
                let found = marched.boundary.lanes();
                for (l, &(_, run)) in rows.iter().enumerate() {
                    (boundary[run], settled[run]) = (found[l], marched.settled[l]);
                }
            }
        }
        (boundary, settled)
    }
}
