//! The cell of the boundary: the complementarity problem of one stage, solved to the place of the boundary inside it.
//!
//! The boundary is at `xi_f` = `xi_0` + phi dx, `xi_0` being the place of node 0. Beyond it w = u - G > 0 obeys
//! `w_t` = w''/2 - H, with H = rate e^{rate t} - dividend e^{y + dividend t} what waiting costs, and w = w' = 0 at
//! `xi_f`. Differentiated along the boundary, which moves at the velocity v, that gives the Taylor series of w there:
//!
//! - w'' = 2 H, w''' = 2 (H' - 2 H v), w'''' = 2 (H'' + 2 `H_t` + 4 H v^2),
//! - w''''' = 2 (H''' + 2 `H_t`' - 8 `H_t` v - 4 H' v^2 - 8 H v^3), less a multiple of dv/dt that is left out.
//!
//! `u_0` and `u_1` = G + w at the nodes 0 and 1, and the elimination's `u_1` = `y_1` + pi `u_0`, are one equation for phi.

use super::contracts::Contracts;
use super::obstacle::{Obstacle, TimeFactors};
use crate::lanes::vector::Vector;

/// The largest move of the boundary in one of Newton's steps, in sqrt(t), and half the largest distance from node 0;
/// chosen.
const LARGEST_MOVE: f64 = 0.6;

/// The cell between the nodes 0 and 1.
pub struct BoundaryCell<'a, V> {
    pub contracts: &'a Contracts<V>,
    pub time: TimeFactors<V>,
    /// xi of node 0.
    pub xi: V,
    /// The distance of the nodes, in xi.
    pub dx: f64,
    /// d `xi_f`/dt for a boundary at node 0.
    pub velocity: V,
    /// The derivative of d `xi_f`/dt by phi.
    pub velocity_by_phi: f64,
    /// The factor in `u_1` = `y_1` + pi `u_0`.
    pub pi: V,
}

/// The equation of the cell at some phi.
pub(super) struct Residual<V> {
    /// w at node 0.
    contact: V,
    /// Its derivative by phi.
    pub(super) contact_by_phi: V,
    /// What is left of `u_1` - `y_1` - pi `u_0`.
    value: V,
    /// Its derivative by phi.
    pub(super) by_phi: V,
}

/// A solved cell.
pub struct CellSolution<V> {
    /// The boundary is at `xi_0` + phi dx.
    pub phi: V,
    /// The obstacle at node 0 and at node 1.
    pub(super) here: Obstacle<V>,
    pub(super) there: Obstacle<V>,
    /// e^{rate t}.
    pub(super) bond: V,
    /// e^{y + dividend t} at node 0.
    pub(super) stock: V,
    pub(super) at: Residual<V>,
}

impl<V: Vector> CellSolution<V> {
    /// u at node 0.
    #[inline(always)]
    pub fn contact(&self) -> V {
        self.here.value + self.at.contact
    }
}

impl<V: Vector> BoundaryCell<'_, V> {
    /// Solve by Newton's method from `eliminated` = `y_1`: two steps from a good guess of phi, three from a blind one.
    #[inline(always)]
    pub fn solve(&self, eliminated: V, guess: V, blind: bool) -> CellSolution<V> {
        let here = Obstacle::at(self.contracts, &self.time, self.xi);
        let there = Obstacle::at(self.contracts, &self.time, self.xi.plus(self.dx));
        let bond = self.time.rate_growth.plus(1.0);
        let stock = here.growth * self.time.dividend_growth.plus(1.0);
        let known = there.value - eliminated - self.pi * here.value;
        let most = V::all(LARGEST_MOVE * self.time.root / self.dx);
        let mut phi = guess;
        if blind {
            phi = self.newton_step(phi, most, known, bond, stock);
        }
        phi = self.newton_step(phi, most, known, bond, stock);
        phi = self.newton_step(phi, most, known, bond, stock);
        let at = self.residual(phi, known, bond, stock);
        CellSolution {
            phi,
            here,
            there,
            bond,
            stock,
            at,
        }
    }

    /// One step of Newton's method, of at most `most`.
    #[inline(always)]
    fn newton_step(&self, phi: V, most: V, known: V, bond: V, stock: V) -> V {
        let at = self.residual(phi, known, bond, stock);
        let step = (at.value / at.by_phi).min(most).max(-most);
        (phi - step).min(most + most).max(-(most + most))
    }

    /// e^{y + dividend t} at the boundary, from that at node 0: e^{spread phi dx} by its series.
    #[inline(always)]
    pub(super) fn stock_at(&self, phi: V, stock: V) -> V {
        let d = (self.contracts.spread * phi).times(self.dx);
        let series = d.times_plus(V::all(1.0 / 24.0), V::all(1.0 / 6.0));
        let series = d.times_plus(d.times_plus(series, V::all(0.5)), V::all(1.0));
        stock * d.times_plus(series, V::all(1.0))
    }

    /// The equation at phi; `known` is its part that phi does not change.
    #[inline(always)]
    fn residual(&self, phi: V, known: V, bond: V, stock: V) -> Residual<V> {
        let Contracts {
            rate,
            dividend,
            spread,
        } = *self.contracts;
        let v = phi.times_plus(V::all(self.velocity_by_phi), self.velocity);
        let interest = rate * bond;
        let dividends = dividend * self.stock_at(phi, stock);
        let h = interest - dividends;
        let h_xi = -(spread * dividends);
        let spread_squared = spread * spread;
        let h_t = rate * interest - dividends * spread_squared.times_plus(V::all(0.5), dividend);
        let h_v2 = h * (v * v);
        // The coefficients of z^3, z^4 and z^5 in w, z the distance from the boundary; that of z^2 is h.
        let third = (h_xi - (h * v).times(2.0)).times(1.0 / 3.0);
        let fourth = (h_v2.times(4.0) + h_t.times(2.0) + spread * h_xi).times(1.0 / 12.0);
        let with_v = h_xi.times_plus(v, (h_t + h_v2).times(2.0));
        let fifth = (h_xi * (spread_squared + dividend).times(2.0) - (v * with_v).times(4.0))
            .times(1.0 / 60.0);
        let z0 = phi.times(-self.dx);
        let z1 = z0.plus(self.dx);
        // phi moves the velocity too, which is in these three coefficients.
        let third_by_phi = h.times(self.velocity_by_phi * (2.0 / 3.0));
        let fifth_by_phi =
            (h_xi.times_plus(v, h_t) + h_v2.times(3.0)).times(self.velocity_by_phi * (-2.0 / 15.0));
        let slopes = [h + h, third.times(3.0), fourth.times(4.0), fifth.times(5.0)];
        let mut w = [z0, z1];
        let mut by = [z0, z1];
        for k in 0..2 {
            let z = w[k];
            let squared = z * z;
            w[k] = squared * z.times_plus(z.times_plus(z.times_plus(fifth, fourth), third), h);
            let slope = z.times_plus(slopes[3], slopes[2]);
            let slope = z * z.times_plus(z.times_plus(slope, slopes[1]), slopes[0]);
            let by_velocity = third_by_phi.times_plus((z * v).plus(-1.0), fifth_by_phi * squared);
            by[k] = slope.times_plus(V::all(-self.dx), squared * z * by_velocity);
        }
        let ([w0, w1], [by0, by1]) = (w, by);
        Residual {
            contact: w0,
            contact_by_phi: by0,
            value: known + (w1 - self.pi * w0),
            by_phi: by1 - self.pi * by0,
        }
    }
}
