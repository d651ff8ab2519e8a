//! Sixteen numbers at once, for three instruction sets.

// Every operation must be compiled into the one function that has the instruction set.
#![allow(clippy::inline_always, clippy::many_single_char_names)]

pub mod dispatch;
pub mod normal;
pub mod vector;
