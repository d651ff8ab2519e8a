//! American puts in a flat market whose exercise region lies between two boundaries, by collocation of both.
//!
//! # The problem
//!
//! Where dividend < rate < 0, rate being r T, dividend q T and spread sigma sqrt(T), a put is exercised between two spots:
//! at a lower one it is better to wait, since the strike loses less by waiting than the stock. Just before expiry they are
//! K r/q and K; later the upper falls and the lower rises, until they may meet, and no earlier time has an exercise
//! region. A call is the put with spot and strike, and rate and yield, exchanged. The value is the European one and what
//! exercise earns inside the region,
//!
//! ```text
//! V = V_European + int_0^t (r K e^{-r (t-s)} P(s) - q S e^{-q (t-s)} Q(s)) ds,
//! ```
//!
//! P and Q being the probabilities, under either measure, that the spot is between the boundaries at the time s before
//! expiry (Carr, Jarrow and Myneni 1992; for two boundaries Battauz, De Donno and Sbuelz 2015, Healy 2021). This is the
//! complementarity system (11.59)-(11.60) with its multiplier integrated: u = r K - q S, positive in the region, zero outside.
//!
//! # The equations
//!
//! At both boundaries V is the payoff. The unknowns are polynomials of z, the square root of the time to expiry: (ln(S*/K))^2
//! of the upper boundary, ln(S*/K) of the lower one, at Chebyshev's nodes (`nodes`, `system`). At each node the second
//! equation is the divided difference of both, see `Equations` in `newton`: without it boundaries that fall together would
//! solve everything. Newton's method with the whole Jacobian settles in about six steps from expansions at expiry.
//!
//! Where the boundaries meet before now, the time at which they do is one more unknown. They cross there at an angle, and
//! each is smooth up to it: the polynomials reach to where they are a ten thousandth of their first distance apart, which
//! leaves out 1e-8 of the premium.
//!
//! # Derivatives
//!
//! Those by rate, dividend and spread are those of the equations (`Put::tangents`), and the value's at fixed boundaries, in closed form
//! (`integrand`). The mixed ones by x are differences of these, that by spread twice is a difference of solutions.
//!
//! # Error
//!
//! The degree grows by half until the error estimate meets the tolerance: half of the last change of the value, and a fifth
//! of that of its slope. Where no boundaries are found and the premium is negligible by a bound, the European value is the
//! answer (`LatestExercise`). The cost of a put is below a millisecond.

#![allow(clippy::inline_always)]

mod integrand;
mod newton;
mod nodes;
mod over_time;
mod put;
mod solve;
mod spot_value;
mod start;
mod system;

pub use integrand::Parameters;
pub use over_time::{boundaries_over_time, BoundaryPair};
pub use put::Put;
pub use solve::solve_puts;

use nodes::DEGREES;

use crate::flat_options::{ErrorShares, Solver};

/// The collocation of two boundaries.
pub const BOUNDARY_COLLOCATION: Solver = Solver {
    solve_puts,
    levels: (1, DEGREES.len() - 1),
    shares: &ErrorShares {
        changes: [0.5, 0.5, 0.7, 0.5, 0.5],
        values: [0.3, 0.6, 1.0, 1.0, 0.5],
        cross_changes: 0.35,
        cross_values: [1.0, 1.0, 0.05],
        theta: [1.0, 0.2],
    },
};
