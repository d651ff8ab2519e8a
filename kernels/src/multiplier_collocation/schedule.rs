//! What one schedule asks for.

use super::segment::Segment;
use crate::interrupt::Interrupt;

/// What is asked of one schedule.
#[derive(Clone, Copy)]
pub struct Schedule<'a> {
    /// The segments from now on, at least one.
    pub segments: &'a [Segment],
    /// ln(S/K) now.
    pub x: f64,
    /// The place in `FINENESS`, and in `DEGREES` where `tolerance` is 0.
    pub level: usize,
    /// The largest error estimate of the boundaries, in strikes; 0 for one degree without an estimate.
    pub tolerance: f64,
    /// The step of all volatilities for which values nearby are wanted; 0 for none.
    pub volatility_step: f64,
    pub interrupt: Interrupt<'a>,
}
