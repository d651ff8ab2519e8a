//! Options with events by collocation of their multiplier, one schedule after the other.
//!
//! # The problem
//!
//! A schedule is a row of segments of time, each with constant rate r, yield q and volatility sigma, and with an event at
//! its end: a dividend, a knot of a curve, a date of exercise, or expiry (`segment`). Everything is in units of the strike
//! and of years; x = ln(S/K), and s is the time to the end of the segment. Inside a segment the value V meets the
//! conditions (11.58), whose semidiscretisation is the complementarity system (11.63); with the multiplier u they read
//!
//! ```text
//! V_s = L V + u,     0 <= u,     0 <= V - g,     one of them zero,
//! L V = sigma^2/2 (V_xx - V_x) + (r - q) V_x - r V,
//! ```
//!
//! g being the payoff. By variation of constants
//!
//! ```text
//! V(s) = e^{sL} V(0) + int_0^s e^{(s - s')L} u(s') ds'.
//! ```
//!
//! On the contact set V = g, so that u = (d/ds - L) g there: r - q e^x for a put, its negative for a call (per unit of
//! the strike). The contact set ends at one place, the exercise boundary b(s). So the boundary is all that is unknown:
//! the first term is a Gaussian integral of the value at the segment's end (`propagation`), the second an integral over
//! s' of normal distribution functions (`multiplier`). This is the decomposition of Kim (1990), Jacka (1991) and Carr,
//! Jarrow and Myneni (1992), segment by segment.
//!
//! # Collocation
//!
//! With eta = sqrt(s/h), h the duration of the segment, b is a polynomial of degree m in eta, given by its values at the
//! Chebyshev points. At the m points behind the first, the stages, V - g has slope zero at the boundary, which is the
//! smooth pasting that goes with (11.56):
//!
//! ```text
//! d/dx [ e^{sL} V(0) + int_0^s e^{(s - s')L} u(s') ds' - g ](b(s)) = 0.
//! ```
//!
//! That is an implicit Runge-Kutta step of m stages over the whole segment with complementarity at every stage, and a
//! Volterra equation of the second kind for b. Newton's method solves it with an exact Jacobian (`collocation_system`,
//! `newton`). The substitution s' = s sin^2(angle) removes the root singularities at both ends of the integral, which
//! Gauss-Legendre quadrature then takes (`collocation_nodes`).
//!
//! A polynomial needs the right quantity (`contact_onset`): b itself, its squared distance from the onset, or its
//! distance from the place where the value without exercise is the payoff, in which case V - g = 0 itself is the equation. The onset, when and where the contact set begins, is found first (`onset_search`); a segment
//! is split where a contact set from far away has arrived, or next to its event where no degree is enough.
//!
//! # Events
//!
//! Just after an event V is known as a function of x: the payoff on the contact set, the integrals beside it
//! (`segment_value`, `continuation`). Before the event the spot is larger by the dividend, and the holder chooses between
//! that and the payoff (`event_transfer`, `exercise_choice`). The result is a profile (`profile`): lines in the spot where
//! it is known to be one, Gauss panels between them, which are fine next to kinks (`panels`). They reach as far as the spot
//! may come and still meet the strike later (`forecast`). So the recursion goes back to now (`backward_recursion`).
//!
//! # Error
//!
//! The degree is raised through 2, 3, 4, 6, 8, 12, 16. Each gains a factor of three to ten, so that 0.6 of the last change
//! of the value bounds what is left. The change is taken at the segment's beginning, cell by cell next to the boundary,
//! times the probability, as seen from now, of being in the cell (`boundary_solver`, `degree_control`). How finely the
//! value is held is a matter of the level (`fineness`). A contact set with two ends (q < r < 0 for a put) is not served,
//! and a schedule whose boundary is not found, or whose value falls below the payoff, is not settled.
//!
//! # Derivatives
//!
//! The adjoint of the recursion gives the derivatives of the value now, and of its slope, by the numbers of every segment
//! (`adjoint`, `boundary_adjoint`). The second derivative by the volatility is the second difference of values next to a
//! solution, with boundaries of the same degrees (`nearby_values`).
//!
//! The chapter `docs/multiplier_collocation.md` tells the same with the literature.

#![allow(clippy::inline_always)] // as in `lanes`
#![allow(clippy::similar_names, clippy::many_single_char_names)] // the formulas' names

mod adjoint;
mod backward_recursion;
mod boundary;
mod boundary_adjoint;
mod boundary_query;
mod boundary_solver;
mod chebyshev;
mod close_events;
mod collocation_nodes;
mod collocation_system;
mod contact_adjoint;
mod contact_onset;
mod continuation;
mod degree_control;
mod event_transfer;
mod exercise_choice;
mod fineness;
mod forecast;
mod gradient;
mod multiplier;
mod nearby_values;
mod newton;
mod onset_search;
mod panel_polynomials;
mod panels;
mod payoff_crossing;
mod points_seen;
mod profile;
mod propagation;
mod roots;
mod schedule;
mod schedules;
mod segment;
mod segment_value;
mod solution;
mod solved_part;
mod spot_drop;
mod stage_integrals;
mod unsettled;
mod viewpoint;

pub use fineness::LEVELS;
pub use gradient::{FUNCTIONALS, PARAMETERS};
pub(crate) use roots::find_root;
pub use schedules::{solve_schedules, Schedules, Solved, COLUMNS};
pub use solution::RESULTS;
