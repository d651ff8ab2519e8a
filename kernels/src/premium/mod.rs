//! Early exercise premiums, sixteen at a time; the mathematics is told in `premium_twin/march.py`.

// Every operation must be compiled into the one function that has the instruction set.
#![allow(clippy::inline_always)]
#![allow(clippy::similar_names, clippy::many_single_char_names)] // the formulas' names

mod boundaries;
mod cell;
mod first_step;
mod group;
mod labels;
mod march;
mod mesh;
mod obstacle;
mod plan;
mod reading;
mod solve;
mod tableau;
mod track;

pub use boundaries::march_boundaries;
pub use plan::STEPS;
pub use reading::VALUES;
pub use solve::{solve_puts, Puts, Solved, COLUMNS};
