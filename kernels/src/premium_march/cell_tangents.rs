//! A solved cell of the boundary differentiated by rate, dividend and spread: first at a fixed phi, then by phi.

use super::boundary_cell::{BoundaryCell, CellSolution};
use super::contracts::Contracts;
use super::grid_values::array_of;
use crate::lanes::vector::Vector;

/// What the derivatives of one cell share; the notation is that of `boundary_cell`. What ends in `_by` has the
/// derivatives by rate, dividend and spread at fixed places.
pub struct CellTangents<V> {
    /// tau/T.
    pub t: f64,
    /// sqrt(t).
    pub root: f64,
    spread: V,
    pi: V,
    h: V,
    /// The velocity of the boundary, d `xi_f`/dt.
    v: V,
    /// spread^2/2 + dividend: `H_t` of the dividends, over the dividends.
    dividend_growth: V,
    /// The derivative of the dividends by the place of node 0.
    dividends_by_place: V,
    interest_by: [V; 3],
    dividends_by: [V; 3],
    /// The derivatives of `H_t`, but for its part in proportion to those of the dividends.
    h_t_by: [V; 3],
    /// The derivatives of spread, times the dividends.
    spread_by: [V; 3],
    /// The distances from the boundary to the nodes 0 and 1.
    z: [V; 2],
    /// The slopes of G at the nodes 0 and 1.
    obstacle_slopes: [V; 2],
    /// The derivatives of G at the nodes 0 and 1 by the parameters.
    obstacle_by: [[V; 3]; 2],
    /// The derivative of w at node 0 by phi.
    contact_by_phi: V,
    /// 1 over the derivative of the cell's equation by phi.
    inverse: V,
}

impl<V: Vector> CellTangents<V> {
    /// The tangents of a solved cell.
    #[inline(always)]
    pub fn new(cell: &BoundaryCell<V>, solution: &CellSolution<V>) -> Self {
        let Contracts {
            rate,
            dividend,
            spread,
        } = *cell.contracts;
        let CellSolution {
            phi,
            here,
            there,
            bond,
            stock,
            at,
        } = solution;
        let (t, zero) = (cell.time.t, V::zero());
        let stock = cell.stock_at(*phi, *stock);
        let (interest, dividends) = (rate * *bond, dividend * stock);
        let one_plus_rate_t = rate.times(t).plus(1.0);
        let dividends_by_place = spread * dividends;
        let boundary = phi.times_plus(V::all(cell.dx), cell.xi);
        let z0 = phi.times(-cell.dx);
        Self {
            t,
            root: cell.time.root,
            spread,
            pi: cell.pi,
            h: interest - dividends,
            v: phi.times_plus(V::all(cell.velocity_by_phi), cell.velocity),
            dividend_growth: (spread * spread).times_plus(V::all(0.5), dividend),
            dividends_by_place,
            interest_by: [*bond * one_plus_rate_t, zero, zero],
            dividends_by: [
                zero,
                stock * dividend.times(t).plus(1.0),
                dividends * spread.times_plus(V::all(t), boundary),
            ],
            h_t_by: [
                interest * one_plus_rate_t.plus(1.0),
                -dividends,
                -dividends_by_place,
            ],
            spread_by: [zero, zero, dividends],
            z: [z0, z0.plus(cell.dx)],
            obstacle_slopes: [here.slope, there.slope],
            obstacle_by: [here.tangents, there.tangents],
            contact_by_phi: at.contact_by_phi,
            inverse: V::all(1.0) / at.by_phi,
        }
    }

    /// The derivatives of u at node 0 and of phi in array j of D, from those of `y_1`, of `xi_0` and of the velocity at a
    /// fixed phi. The first three terms of w are enough here, because phi is small.
    #[inline(always)]
    pub fn tangent<const D: usize>(
        &self,
        j: usize,
        eliminated: V,
        place_by: V,
        velocity_by: V,
    ) -> (V, V) {
        let of = |by| array_of::<V, D>(j, by);
        let spread_by = of(self.spread_by);
        let dividends_by = self
            .dividends_by_place
            .times_plus(place_by, of(self.dividends_by));
        let h_by = of(self.interest_by) - dividends_by;
        let h_t_by = of(self.h_t_by) - self.dividend_growth * dividends_by;
        let h_xi_by = -self.spread.times_plus(dividends_by, spread_by);
        let h_v_by = self.h * velocity_by;
        let third = (h_xi_by - h_by.times_plus(self.v, h_v_by).times(2.0)).times(1.0 / 3.0);
        let h_v2_by = (self.v * h_by.times_plus(self.v, h_v_by + h_v_by)).times(4.0);
        let twice = spread_by + spread_by;
        let h_xixi_by = self.spread * self.spread.times_plus(dividends_by, twice);
        let fourth = (h_v2_by + h_t_by.times(2.0) - h_xixi_by).times(1.0 / 12.0);
        let mut u = self.z;
        for (k, u) in u.iter_mut().enumerate() {
            let z = self.z[k];
            let series = z.times_plus(z.times_plus(fourth, third), h_by);
            let obstacle = self.obstacle_slopes[k].times_plus(place_by, of(self.obstacle_by[k]));
            *u = (z * z).times_plus(series, obstacle);
        }
        let phi_by = (eliminated + self.pi * u[0] - u[1]) * self.inverse;
        (self.contact_by_phi.times_plus(phi_by, u[0]), phi_by)
    }
}
