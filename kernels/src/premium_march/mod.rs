//! The early exercise premium of flat puts by a march from expiry to now, sixteen options side by side.
//!
//! # The problem
//!
//! S is the spot, K the strike, T the time to expiry, r the rate, q the yield (both continuously compounded, per year),
//! sigma the volatility (per square root of a year) and tau the time to expiry of the state that is marched. With
//! t = tau/T, from 0 (expiry) to 1 (now), and
//!
//! ```text
//! xi = (ln(S/K) + (r - q - sigma^2/2) tau) / (sigma sqrt(T)),     u(xi, t) = e^{r tau} (V - V_European)/K,
//! ```
//!
//! the conditions (11.58) of the American put, whose semidiscretisation is the complementarity system (11.63), read
//!
//! ```text
//! 0 <= u - G,     0 <= u_t - u_xixi/2,     one of them zero,     u(., 0) = 0,
//! ```
//!
//! G = e^{r tau} (payoff - European put)/K being a closed formula (`obstacle`). Three numbers are left of a contract:
//! rate = r T, dividend = q T and spread = sigma sqrt(T). A call is the put with spot and strike, and rate and yield,
//! exchanged. There is no kink at the strike any more, and u is narrow: it decays within a few units of xi.
//!
//! # Space
//!
//! The nodes travel with the exercise boundary: node i is at xi = X(t) + i dx, and the boundary at X + phi dx. So the
//! contact set of the complementarity problem of every stage is known but for phi. Second derivatives are compact, of
//! fourth order, and the matrix of a stage has constant coefficients and factors in closed form (`wiener_hopf`): one
//! elimination from the far end (`stage_equations`) leaves `u_1 = y_1 + pi u_0`. At the boundary w = u - G and its slope
//! vanish, and w'' = 2 H > 0 with H the cost of waiting; the Taylor series of w there, of fifth order, gives `u_0` and `u_1`
//! as functions of phi. Newton's method solves the one equation that is left (`boundary_cell`), and one substitution
//! gives u at the other nodes. Far from expiry dx is constant; it is halved each time sqrt(t) is (`mesh`). Where the premium
//! decays faster than these nodes resolve, dx is halved equally often in all marches of a put (`mesh_class`).
//!
//! # Time
//!
//! sqrt(t) = n/M, n = 1, ..., M. Each step is a third-order, L-stable, diagonally implicit Runge-Kutta method with an
//! explicit first stage (`tableau`; Kennedy and Carpenter 2016). That stage is du/dt as the last step left it, corrected
//! for the new speed of the nodes; it makes all stages accurate to second order, without which the motion of the
//! boundary lowers the order. The nodes move at a constant speed through a step, so that one matrix serves its three
//! implicit stages (`stages`, `runge_kutta_step`). The first step is implicit Euler's in closed form (`first_step`), the
//! second has no du/dt to start from and takes the method of Alexander (1977). Where the nodes go is predicted: in the
//! first steps from implicit Euler's boundary (`runge_kutta_step`), then by extrapolation of the last three places of the
//! boundary (`boundary_history`). What the boundary does beyond it, its velocity included, is part of every stage's
//! problem, and a step is taken again where the boundary ends too far from node 0.
//!
//! # Derivatives
//!
//! The derivatives by rate, dividend and spread are marched beside u with the same factors: the equations of the solved
//! stages are differentiated (`cell_tangents`, `stages`), the motion of the nodes with the parameters included. Their slopes
//! at the spot are the derivatives by x and a parameter. The second derivative by spread is a difference of second order of
//! the premium, from two more marches on the same mesh (`refinement`): there the discrete premium is smooth in spread.
//!
//! # Error
//!
//! A put is marched with M, M/2 and M/4 steps, v being V/K. The answer is `v + (v - v_half)/5.5` and its error estimate
//! `0.25 |v - v_half| + 0.05 |v_half - v_quarter|`, with lower bounds from the slopes, the curvatures, the boundary and
//! what the premium can be at most beyond the nodes (`error_estimate`). Where that misses the tolerance the put is marched with 2 M steps as well, and so on (`group`,
//! `refinement`). Puts of one class of meshes (`mesh_class`) are marched side by side, one in each lane.
//!
//! Where prices alone are asked for to a tolerance of at least 5e-5 in V/K, ordinary puts (`mesh_class`) are first marched with
//! two steps: the march of one step, which is in closed form (`first_step`), stands for that of M/2. Their marches are in
//! single precision up to eight steps; the error estimate counts what that changes.
//!
//! At most four puts of one class are marched in a vector of four lanes, which takes less than half the time.
//!
//! The rows of `solve_puts` are independent, and its cost is about proportional to M^{3/2}. The arrays of a thread take at
//! most 5 MiB, whatever it solves, those of its results about 300 bytes for each spot. Every march asks whether the work
//! shall end. The chapter `docs/premium_march.md` tells the same with the literature.

// Every operation must be compiled into the one function that has the instruction set.
#![allow(clippy::inline_always)]
#![allow(clippy::similar_names, clippy::many_single_char_names)] // the formulas' names

mod boundaries;
mod boundary_cell;
mod boundary_history;
mod cell_tangents;
mod contracts;
mod error_estimate;
mod first_step;
mod grid_values;
mod group;
mod interpolation;
mod march;
mod mesh;
mod mesh_class;
mod obstacle;
mod options;
mod puts;
mod refinement;
mod runge_kutta_step;
mod solve;
mod spot_evaluation;
mod stage_equations;
mod stages;
mod tableau;
mod wiener_hopf;
mod work_items;

pub use boundaries::march_boundaries;
pub use mesh::STEPS;
pub use options::{price_options, Greeks, Options};
pub use puts::{Puts, Solved, COLUMNS, VALUES};
pub use solve::solve_puts;
