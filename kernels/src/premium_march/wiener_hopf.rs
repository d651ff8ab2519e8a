//! The matrix of a stage on nodes that move at one speed, factored in closed form.
//!
//! On moving nodes u obeys `u_t` = `u_xixi`/2 + c `u_xi`, c the speed. The compact scheme takes the mean m of `u_t` over
//! three nodes, with weights (1/12 - c dx/12, 10/12, 1/12 + c dx/12), and the difference quotients with the diffusion
//! 1/2 + c^2 dx^2/6, which makes it of fourth order. A stage with the implicit weight h solves
//! m u - h (`u_xixi`/2 + c `u_xi`) = m rhs, tridiagonal with constant coefficients: diagonal d, and -l and -r beside it.
//! On the half line that is kappa (1 - rho E)(1 - pi E^-1) u with kappa = (d + sqrt(d^2 - 4 l r))/2, pi = l/kappa,
//! rho = r/kappa and E the shift by one node to the right.

use crate::lanes::vector::Vector;

/// The factors of the matrix.
pub struct WienerHopf<V> {
    /// The weights of m, divided by kappa.
    pub lower: V,
    pub middle: V,
    pub upper: V,
    pub pi: V,
    pub rho: V,
    /// Minus the derivative of the matrix by the speed, divided by kappa: the factors of the central differences of u - rhs
    /// and of u, and of the second difference of u.
    pub mean_by_speed: V,
    pub advection_by_speed: V,
    pub diffusion_by_speed: V,
}

impl<V: Vector> WienerHopf<V> {
    /// The factors at the speed d xi/dt of the nodes, for the implicit weight h (a time) and the distance dx of the nodes.
    #[inline(always)]
    pub fn new(speed: V, h: f64, dx: f64) -> Self {
        let diffusion = (speed * speed)
            .times_plus(V::all(dx * dx / 6.0), V::all(0.5))
            .times(h / (dx * dx));
        let shift = speed.times(dx / 12.0);
        let (mean_lower, mean_upper) = (-shift.plus(-1.0 / 12.0), shift.plus(1.0 / 12.0));
        let advection = speed.times(h / (2.0 * dx));
        let lower = diffusion - advection - mean_lower;
        let upper = diffusion + advection - mean_upper;
        let diagonal = (diffusion + diffusion).plus(10.0 / 12.0);
        let kappa =
            (diagonal + (diagonal * diagonal - (lower * upper).times(4.0)).sqrt()).times(0.5);
        let inverse = V::all(1.0) / kappa;
        Self {
            lower: mean_lower * inverse,
            middle: inverse.times(10.0 / 12.0),
            upper: mean_upper * inverse,
            pi: lower * inverse,
            rho: upper * inverse,
            mean_by_speed: inverse.times(-dx / 12.0),
            advection_by_speed: inverse.times(0.5 * h / dx),
            diffusion_by_speed: (speed * inverse).times(h / 3.0),
        }
    }
}
