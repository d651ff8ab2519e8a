//! The inner loops of `pricing_core`, over plain slices.
//!
//! Problem: 0 <= z, 0 <= w = M z + q, z w = 0 with a tridiagonal M. Nothing here knows of options,
//! dates or Python; the module `python` (feature "python") is the only bridge.

mod brennan_schwartz;
pub mod collocation;
mod error;
mod lanes;
mod policy_iteration;
pub mod premium;
mod psor;
#[cfg(feature = "python")]
mod python;
#[cfg(feature = "python")]
mod python_collocation;
#[cfg(feature = "python")]
mod python_premium;
mod tridiagonal;

pub use brennan_schwartz::brennan_schwartz;
pub use error::KernelError;
pub use policy_iteration::{policy_iteration, Settling};
pub use psor::{projected_sor, Sweeping};
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
