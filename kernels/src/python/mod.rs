//! The module `pricing_core._kernels`: arrays in, arrays out, without the interpreter lock.

mod arguments;
mod dense;
mod interrupt;
mod mode;
mod obstacle_march;
mod premium_march;
mod sparse;
mod strike_march;
mod tridiagonal;

use pyo3::prelude::*;

use crate::lanes::dispatch::InstructionSet;

/// Return the instruction set that the option engines use here: "avx512", "avx2" or "portable".
#[pyfunction]
fn instruction_set() -> &'static str {
    InstructionSet::best().name()
}

/// The inner loops of `pricing_core`, compiled.
#[pymodule]
mod _kernels {
    #[pymodule_export]
    use super::dense::{equilibrate, lemke};
    #[pymodule_export]
    use super::instruction_set;
    #[pymodule_export]
    use super::mode::{enter_mode, initial_signs, leading_signs, taylor_step};
    #[pymodule_export]
    use super::obstacle_march::{
        march_segments, MarchSettings, MarchedSegments, SegmentTable, VolatilitySurface,
    };
    #[pymodule_export]
    use super::premium_march::{march_boundaries, price_options, solve_puts};
    #[pymodule_export]
    use super::sparse::sparse_sweeps;
    #[pymodule_export]
    use super::strike_march::march_strikes;
    #[pymodule_export]
    use super::tridiagonal::{
        brennan_schwartz, growing_basic_set, policy_iteration, projected_sor,
    };

    /// The version of the crate.
    #[pymodule_export]
    #[allow(non_upper_case_globals)]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
