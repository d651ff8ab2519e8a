//! Why a schedule has no answer from this engine.

/// The contact set is of a kind that is not followed, or its boundary was not found.
#[derive(Debug)]
pub struct Unsettled;
