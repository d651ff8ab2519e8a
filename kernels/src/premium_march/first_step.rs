//! The first step of a march: implicit Euler's from u = 0, in closed form.
//!
//! With lam = sqrt(2/t) the step's equation u - t `u_xixi`/2 = 0 beyond the boundary X has the solution
//! u = G(X) e^{-lam (xi - X)}, and smooth pasting puts the boundary where G' + lam G = 0.

use super::boundary_history::BoundaryHistory;
use super::contracts::Contracts;
use super::grid_values::{array_of, Workspace};
use super::mesh::Mesh;
use super::obstacle::{Obstacle, TimeFactors};
use crate::lanes::normal::ln;
use crate::lanes::vector::{Part, Vector};

/// The largest number of Halley's steps; chosen.
const ITERATIONS: usize = 16;
/// The largest move in the last of Halley's steps, in sqrt(t); chosen: the error left is about its cube.
const TOLERANCE: f64 = 0.03;
/// The distance added to the guess of the boundary, in sqrt(t); calibrated on random puts.
const SHIFT: f64 = 0.45;
/// The distance below the upper end of the bracket at which its lower end lies, in sqrt(t); chosen beyond any boundary.
const BRACKET: f64 = 9.0;

/// Node 0 after a step.
#[derive(Clone, Copy)]
pub struct FirstNode<V> {
    /// sqrt(t).
    pub root: f64,
    /// xi of node 0.
    pub xi: V,
    /// The derivatives of `xi` by rate, dividend and spread.
    pub xi_by: [V; 3],
}

/// A march of one step alone, which leaves u = `contact` e^{-`lam` (xi' - `xi`)} at xi' beyond the boundary.
pub struct OnlyStep<V> {
    /// xi of the boundary.
    pub xi: V,
    /// u there.
    pub contact: V,
    /// sqrt(2/t) at t = 1.
    pub lam: f64,
}

impl<V: Vector> OnlyStep<V> {
    /// March from expiry to now.
    #[inline(always)]
    pub fn take(contracts: &Contracts<V>) -> Self {
        V::call(TakeOnlyStep(contracts))
    }
}

struct TakeOnlyStep<'a, V>(&'a Contracts<V>);

impl<V: Vector> Part<V> for TakeOnlyStep<'_, V> {
    type Result = OnlyStep<V>;

    #[inline(always)]
    fn run(self) -> OnlyStep<V> {
        let (time, lam) = (TimeFactors::new(self.0, 1.0, 1.0), std::f64::consts::SQRT_2);
        let xi = first_boundary(self.0, &time, lam);
        OnlyStep {
            xi,
            contact: Obstacle::at(self.0, &time, xi).value,
            lam,
        }
    }
}

/// Take the step; with derivatives by the parameters in D arrays, see `array_of`.
#[inline(always)]
pub fn first_step<V: Vector, const D: usize>(
    mesh: &Mesh,
    contracts: &Contracts<V>,
    history: &mut BoundaryHistory<V>,
    work: &mut Workspace<V>,
) -> FirstNode<V> {
    let step = mesh.step(1);
    let (root, t) = (step.root, step.root * step.root);
    let lam = std::f64::consts::SQRT_2 / root;
    let time = TimeFactors::new(contracts, t, root);
    let xi = first_boundary(contracts, &time, lam);
    let obstacle = Obstacle::at(contracts, &time, xi);
    let decay = (-lam * step.dx).exp();
    work.premium
        .start(mesh.nodes, step.active, obstacle.value, decay);

    // G' + lam G = 0 differentiated by the parameters.
    let [by_rate, by_dividend, by_spread] = obstacle.tangents;
    let spread = contracts.spread;
    let inverse = V::all(-1.0) / obstacle.slope.times_plus(V::all(lam), obstacle.curvature);
    let slope_by_spread = spread.times_plus(by_spread, obstacle.slope / spread);
    let xi_by = [
        by_rate.times(lam) * inverse,
        by_dividend * spread.plus(lam) * inverse,
        by_spread.times_plus(V::all(lam), slope_by_spread) * inverse,
    ];
    if D > 0 {
        let mut along = xi_by;
        for (along, tangent) in along.iter_mut().zip(obstacle.tangents) {
            *along = obstacle.slope.times_plus(*along, tangent);
        }
        for (j, tangent) in work.tangents[..D].iter_mut().enumerate() {
            let value = array_of::<V, D>(j, along);
            tangent.start(mesh.nodes, step.active, value, decay);
        }
        for array in &mut work.speed_sources {
            array.resize(mesh.nodes + 3, V::zero());
        }
    }
    work.differences.resize(mesh.nodes + 3, V::zero());
    history.euler = xi - history.drift.times(t);
    history.record(history.euler, xi_by, root);
    FirstNode { root, xi, xi_by }
}

/// The boundary after one step from expiry, in xi: G' + lam G = 0, which falls with xi, by Halley's method inside a
/// bracket.
#[inline(always)]
pub fn first_boundary<V: Vector>(contracts: &Contracts<V>, time: &TimeFactors<V>, lam: f64) -> V {
    let Contracts {
        rate,
        dividend,
        spread,
    } = *contracts;
    let (t, root) = (time.t, time.root);
    // The boundary without chance: e^y (lam + spread) expm1(dividend t) = lam expm1(rate t).
    let ratio = time.rate_growth.times(lam) / (spread.plus(lam) * time.dividend_growth);
    let logarithm = ln((-dividend).negative(ratio, V::all(f64::MAX)));
    let certain = (logarithm - (spread * spread).times(0.5 * t)) / spread;
    let mut high = certain.min(V::all(0.5 * root));
    let mut low = high.plus(-BRACKET * root);
    // At d = xi/sqrt(t) the right to wait is worth about N(d), which falls to the cost of waiting at the boundary.
    let cost =
        (rate - dividend).max(V::zero()).times(root) / spread + dividend.times(t).max(V::zero());
    let odds = V::all(0.5) / cost.max(V::all(1e-300));
    let guess = (V::all(SHIFT) - (ln(odds.plus(1.0)).times(2.0)).sqrt()).times(root);
    let mut xi = guess.min(high).max(low);
    let mut open = V::all(1.0); // -1 in a lane that is done
    for _ in 0..ITERATIONS {
        let obstacle = Obstacle::at(contracts, time, xi);
        let residual = obstacle.value.times_plus(V::all(lam), obstacle.slope);
        let derivative = obstacle.slope.times_plus(V::all(lam), obstacle.curvature);
        low = (-residual).negative(xi.max(low), low);
        high = (-residual).negative(high, xi.min(high));
        let second = obstacle.curvature.times_plus(V::all(lam), obstacle.third);
        let denominator = derivative * derivative - (residual * second).times(0.5);
        let halley = xi - residual * derivative / denominator;
        let middle = (low + high).times(0.5);
        let inside = (halley - low).negative(middle, (high - halley).negative(middle, halley));
        let inside = derivative.negative((-denominator).negative(inside, middle), middle);
        let following = open.negative(xi, inside);
        open = ((following - xi).abs().plus(-TOLERANCE * root)).negative(V::all(-1.0), open);
        xi = following;
        if open.lanes().iter().all(|&o| o < 0.0) {
            break;
        }
    }
    xi
}
