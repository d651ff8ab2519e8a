//! Options with events by collocation of their multiplier; the mathematics is told in `collocation_twin`.

#![allow(clippy::inline_always)]
#![allow(clippy::similar_names, clippy::many_single_char_names)] // the formulas' names

mod boundary;
mod bumps;
mod held;
mod multiplier;
mod newton;
mod normal;
mod panels;
mod profile;
mod roots;
mod solve;
mod start;
mod stretch;
mod tables;
mod touching;
mod transfer;
mod values;

pub use solve::{solve_schedules, Schedules, Solved, COLUMNS, LEVELS, RESULTS};

/// The contact set is of a kind that is not followed, or its boundary was not found.
#[derive(Debug)]
pub struct Unsettled;
