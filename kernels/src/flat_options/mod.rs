//! American puts and calls in a flat market, without events: what they are to the solvers of puts, and their prices and
//! Greeks in money.
//!
//! Three numbers are left of a put: r T, q T and sigma sqrt(T). A call is the put with spot and strike, and rate and yield,
//! exchanged. `premium_march` solves puts.

mod options;
mod puts;

pub use options::{price_options, ErrorShares, Greeks, Options, Priced, Solver};
pub use puts::{
    Puts, Solved, COLUMNS, CROSS, DERIVATIVES, PLAIN, SECOND, SECOND_COLUMNS, SPOTS_AT_ONCE, VALUES,
};
