//! The complementarity problem of one stage, solved to the place of the boundary inside its cell.
//!
//! On the free side w = u - G obeys `w_t = w_xixi/2 - h` with h = rate e^{rate t} - dividend e^{y + dividend t},
//! and w = w' = 0 at the boundary `xi_f` = `xi_0` + phi dx, which gives w's Taylor series there:
//! w'' = 2 h, w''' = 2 (h' - 2 h velocity), w'''' = 2 (4 h velocity^2 + 2 `h_t` + h'').

use super::obstacle::{Contracts, Moment, Obstacle};
use super::vector::Vector;

/// Of sqrt(t), per iteration, for the boundary.
const LARGEST_MOVE: f64 = 0.6;

/// The cell between the labels 0 and 1.
pub struct Cell<'a, V> {
    pub contracts: &'a Contracts<V>,
    pub moment: Moment<V>,
    /// xi of label 0.
    pub xi: V,
    pub dx: f64,
    /// d `xi_f`/dt for a boundary at label 0, and its derivative by phi.
    pub velocity: V,
    pub turn: f64,
    /// The elimination says `u_1` = `y_1` + pi `u_0`.
    pub pi: V,
}

/// w at label 0 and its derivative by phi; the residual of label 1's equation and its derivative by phi.
struct Residual<V> {
    contact: V,
    slope: V,
    value: V,
    derivative: V,
}

impl<V: Vector> Cell<'_, V> {
    /// Return u (and its derivatives) at label 0, and phi, by Newton's method from `y_1`.
    #[inline(always)]
    pub fn solve<const C: usize>(&self, eliminated: [V; C], guess: V, blind: bool) -> ([V; C], V) {
        let here = Obstacle::at(self.contracts, &self.moment, self.xi);
        let there = Obstacle::at(self.contracts, &self.moment, self.xi.plus(self.dx));
        let bond = self.moment.rate_growth.plus(1.0);
        let stock = here.growth * self.moment.dividend_growth.plus(1.0);
        let known = there.value - eliminated[0] - self.pi * here.value;
        let most = V::all(LARGEST_MOVE * self.moment.root / self.dx);
        let mut phi = guess;
        if blind {
            phi = self.newton(phi, most, known, bond, stock);
        }
        phi = self.newton(phi, most, known, bond, stock);
        phi = self.newton(phi, most, known, bond, stock);
        let at = self.residual(phi, known, bond, stock);
        let mut contact = [here.value + at.contact; C];
        if C > 1 {
            let sources = self.sources(phi, bond, stock);
            let z0 = phi.times(-self.dx);
            let z1 = z0.plus(self.dx);
            let inverse = V::all(1.0) / at.derivative;
            for j in 0..3 {
                // The conditions differentiated: what moves u_0 and u_1 at a fixed boundary, then the boundary.
                let (bend, third) = sources[j];
                let u0 = here.tangents[j] + z0 * z0 * z0.times_plus(third, bend);
                let u1 = there.tangents[j] + z1 * z1 * z1.times_plus(third, bend);
                let moved = (eliminated[j + 1] + self.pi * u0 - u1) * inverse;
                contact[j + 1] = at.slope.times_plus(moved, u0);
            }
        }
        (contact, phi)
    }

    /// One step of Newton's method, held to `most`.
    #[inline(always)]
    fn newton(&self, phi: V, most: V, known: V, bond: V, stock: V) -> V {
        let at = self.residual(phi, known, bond, stock);
        let step = (at.value / at.derivative).min(most).max(-most);
        (phi - step).min(most + most).max(-(most + most))
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
        let v = phi.times_plus(V::all(self.turn), self.velocity);
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
        // The velocity is in the coefficients of z^3 and z^4.
        let turned = h.times(self.turn * (2.0 / 3.0));
        let by0 = slope0.times(-self.dx) + turned * (z0 * z0 * z0) * (z0 * v).plus(-1.0);
        let by1 = slope1.times(-self.dx) + turned * (z1 * z1 * z1) * (z1 * v).plus(-1.0);
        Residual {
            contact: w0,
            slope: by0,
            value: known + (w1 - self.pi * w0),
            derivative: by1 - self.pi * by0,
        }
    }

    /// The coefficients of z^2 and z^3 in the derivatives of w by rate, dividend and spread at a fixed boundary.
    #[inline(always)]
    fn sources(&self, phi: V, bond: V, stock: V) -> [(V, V); 3] {
        let Contracts {
            rate,
            dividend,
            spread,
        } = *self.contracts;
        let t = self.moment.t;
        let stock = self.stock_at(phi, stock);
        let boundary = phi.times_plus(V::all(self.dx), self.xi);
        let v = phi.times_plus(V::all(self.turn), self.velocity);
        let paid = dividend * stock;
        let by_rate = bond * rate.times(t).plus(1.0);
        let by_dividend = -(stock * dividend.times(t).plus(1.0));
        let by_spread = -(paid * (boundary + spread.times(t)));
        let twice = v + v;
        [
            (by_rate, -(by_rate * twice).times(1.0 / 3.0)),
            (
                by_dividend,
                (by_dividend * (spread - twice)).times(1.0 / 3.0),
            ),
            (
                by_spread,
                (by_spread * (spread - twice) - paid).times(1.0 / 3.0),
            ),
        ]
    }
}
