//! The question that long work asks now and then: whether it shall end.

/// Tells whether the work shall end; asked often, from any thread, and cheap.
pub type Interrupt<'a> = &'a (dyn Fn() -> bool + Sync);

/// The answer of work that nothing ends.
#[must_use]
pub fn never() -> bool {
    false
}
