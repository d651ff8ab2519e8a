//! Early exercise premiums, sixteen at a time; the mathematics is told in `premium_twin/march.py`.

// Every operation must be compiled into the one function that has the instruction set.
#![allow(clippy::inline_always)]
#![allow(clippy::similar_names, clippy::many_single_char_names)] // the formulas' names

mod cell;
mod dispatch;
mod evaluate;
mod first_step;
mod groups;
mod march;
mod normal;
mod obstacle;
mod plan;
mod vector;

pub use evaluate::{STENCIL, VALUES};
pub use groups::{
    premium_march, premium_values, profile_values, Library, Mesh, Profiles, Rows, Values,
};
