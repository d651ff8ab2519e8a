//! The complementarity problem of one stage, solved to the place of the boundary inside its cell.
//!
//! On the free side w = u - G obeys `w_t = w_xixi/2 - h` with h = rate e^{rate t} - dividend e^{y + dividend t},
//! and w = w' = 0 at the boundary `xi_f` = `xi_0` + phi dx, which gives w's Taylor series there:
//! w'' = 2 h, w''' = 2 (h' - 2 h velocity), w'''' = 2 (4 h velocity^2 + 2 `h_t` + h'').

use super::obstacle::{Contracts, Moment, Obstacle};
use super::vector::Vector;

const ITERATIONS: usize = 3;
/// Of sqrt(t), per iteration, for the boundary.
const LARGEST_MOVE: f64 = 0.6;

/// The cell between the labels 0 and 1.
pub struct Cell<'a, V> {
    pub contracts: &'a Contracts<V>,
    pub moment: Moment<V>,
    /// xi of label 0.
    pub xi: V,
    pub dx: f64,
    /// d `xi_f`/dt.
    pub velocity: V,
    /// The elimination says `u_1` = `y_1` + pi `u_0`.
    pub pi: V,
}

/// w at label 0; the residual of label 1's equation and its derivative by phi.
struct Residual<V> {
    contact: V,
    value: V,
    derivative: V,
}

impl<V: Vector> Cell<'_, V> {
    /// Return u (and its derivatives) at label 0, and phi, by Newton's method from `y_1`.
    #[inline(always)]
    pub fn solve<const C: usize>(&self, eliminated: [V; C]) -> ([V; C], V) {
        let here = Obstacle::at(self.contracts, &self.moment, self.xi);
        let there = Obstacle::at(self.contracts, &self.moment, self.xi.plus(self.dx));
        let bond = self.moment.rate_growth.plus(1.0);
        let stock = here.growth * self.moment.dividend_growth.plus(1.0);
        let known = there.value - eliminated[0] - self.pi * here.value;
        let most = LARGEST_MOVE * self.moment.root / self.dx;
        let mut phi = V::zero();
        for _ in 0..ITERATIONS {
            let at = self.residual(phi, known, bond, stock);
            let newton = (at.value / at.derivative)
                .min(V::all(most))
                .max(V::all(-most));
            phi = (phi - newton)
                .min(V::all(2.0 * most))
                .max(V::all(-2.0 * most));
        }
        let mut contact = [here.value + self.residual(phi, known, bond, stock).contact; C];
        if C > 1 {
            let derivatives = self.tangents(eliminated, phi, &here, &there, bond, stock);
            contact[1..].copy_from_slice(&derivatives[..C - 1]);
        }
        (contact, phi)
    }

    /// e^{y + dividend t} at the boundary, e^{spread phi dx} by its series.
    #[inline(always)]
    fn stock_at(&self, phi: V, stock: V) -> V {
        let d = (self.contracts.spread * phi).times(self.dx);
        let series = d.times_plus(V::all(1.0 / 24.0), V::all(1.0 / 6.0));
        let series = d.times_plus(d.times_plus(series, V::all(0.5)), V::all(1.0));
        stock * d.times_plus(series, V::all(1.0))
    }

    #[inline(always)]
    fn residual(&self, phi: V, known: V, bond: V, stock: V) -> Residual<V> {
        let Contracts {
            rate,
            dividend,
            spread,
        } = *self.contracts;
        let v = self.velocity;
        let earned = rate * bond;
        let paid = dividend * self.stock_at(phi, stock);
        let h = earned - paid;
        let h_xi = -(spread * paid);
        let h_t = rate * earned - paid * (spread * spread).times_plus(V::all(0.5), dividend);
        let third = (h_xi - (h * v).times(2.0)).times(1.0 / 3.0);
        let fourth = ((h * (v * v)).times(4.0) + h_t.times(2.0) + spread * h_xi).times(1.0 / 12.0);
        let z0 = phi.times(-self.dx);
        let z1 = z0.plus(self.dx);
        let w0 = z0 * z0 * z0.times_plus(z0.times_plus(fourth, third), h);
        let w1 = z1 * z1 * z1.times_plus(z1.times_plus(fourth, third), h);
        let (twice, thrice, fourfold) = (h + h, third.times(3.0), fourth.times(4.0));
        let slope0 = z0 * z0.times_plus(z0.times_plus(fourfold, thrice), twice);
        let slope1 = z1 * z1.times_plus(z1.times_plus(fourfold, thrice), twice);
        Residual {
            contact: w0,
            value: known + (w1 - self.pi * w0),
            derivative: (slope1 - self.pi * slope0).times(-self.dx),
        }
    }

    /// Derivatives of u at label 0 by rate, dividend and spread.
    ///
    /// That of w vanishes at the boundary; beyond it is c (z - velocity `z^2`) + h' `z^2`, h' the derivative of h.
    #[inline(always)]
    fn tangents<const C: usize>(
        &self,
        eliminated: [V; C],
        phi: V,
        here: &Obstacle<V>,
        there: &Obstacle<V>,
        bond: V,
        stock: V,
    ) -> [V; 3] {
        let Contracts {
            rate,
            dividend,
            spread,
        } = *self.contracts;
        let t = self.moment.t;
        let stock = self.stock_at(phi, stock);
        let boundary = phi.times_plus(V::all(self.dx), self.xi);
        let sources = [
            bond * rate.times(t).plus(1.0),
            -(stock * dividend.times(t).plus(1.0)),
            -(dividend * stock * (boundary + spread.times(t))),
        ];
        let z0 = phi.times(-self.dx);
        let z1 = z0.plus(self.dx);
        let line0 = z0 - self.velocity * (z0 * z0);
        let line1 = z1 - self.velocity * (z1 * z1);
        let lever = V::all(1.0) / (line1 - self.pi * line0);
        let bend = z1 * z1 - self.pi * (z0 * z0);
        let mut derivatives = here.tangents;
        for (j, g0) in derivatives.iter_mut().enumerate() {
            let c = ((eliminated[j + 1] + self.pi * *g0 - there.tangents[j]) - sources[j] * bend)
                * lever;
            *g0 = *g0 + c * line0 + sources[j] * (z0 * z0);
        }
        derivatives
    }
}
