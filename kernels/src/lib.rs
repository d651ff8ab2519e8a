//! What must be fast in `pricing_core`, over plain slices: complementarity solvers, and
//! two option engines.
//!
//! - Solvers of 0 <= z, 0 <= w = M z + q, z w = 0 with a tridiagonal M: `brennan_schwartz`, `growing_basic_set`,
//!   `policy_iteration`, `projected_sor`; with a dense one: `equilibrate`, `lemke`; with a sparse one,
//!   between bounds: `sparse_sweeps`.
//! - The flow of a mode of a linear complementarity system up to its first event, and the signs that select the next:
//!   `taylor_step`, `enter`, `initial_signs`, `leading_signs`.
//! - `march_strikes`: options of all strikes of an expiry under one local volatility, on one grid.
//! - `premium_march`: American options in a flat market, by a march of the early exercise premium of puts.
//! - `obstacle_march`: options with whatever happens to them, by one march with averaged complementarity.
//!
//! The engines run sixteen numbers side by side (`lanes`), with the instruction set that the processor has. Nothing here
//! knows of calendars, currencies or files; the module `python` (feature "python") is the only bridge to Python.

mod brennan_schwartz;
mod equilibration;
mod error;
mod first_crossing;
mod growing_basic_set;
#[cfg(test)]
mod instruction_set_tests;
pub mod interrupt;
mod lanes;
mod lemke;
mod mode_flow;
mod mode_signs;
pub mod obstacle_march;
mod policy_iteration;
pub mod premium_march;
mod psor;
#[cfg(feature = "python")]
mod python;
mod sparse_sweeps;
mod strike_march;
mod tridiagonal;

pub use brennan_schwartz::brennan_schwartz;
pub use equilibration::equilibrate;
pub use error::KernelError;
pub use growing_basic_set::growing_basic_set;
pub use lemke::{lemke, Path, PathEnd};
pub use mode_flow::{taylor_step, StepEnd};
pub use mode_signs::{enter, initial_signs, leading_signs, SignShares};
pub use policy_iteration::{policy_iteration, Settling};
pub use psor::{projected_sor, Sweeping};
pub use sparse_sweeps::{sparse_sweeps, Bounds, SparseRows, SparseSweeping};
pub use strike_march::{march_strikes, StrikeSteps};
pub use tridiagonal::Tridiagonal;

/// max(0, x), except that NaN stays NaN: a breakdown must reach the caller.
#[inline]
fn positive_part(x: f64) -> f64 {
    if x < 0.0 {
        0.0
    } else {
        x
    }
}

#[cfg(test)]
mod tests {
    use super::positive_part;

    #[test]
    fn the_positive_part_keeps_nan() {
        assert_eq!(positive_part(-1.0).to_bits(), 0.0_f64.to_bits());
        assert_eq!(positive_part(2.0).to_bits(), 2.0_f64.to_bits());
        assert!(positive_part(f64::NAN).is_nan());
    }
}
