//! The complementarity problem of one stage, solved to the place of the boundary inside its cell.
//!
//! On the free side w = u - G obeys `w_t = w_xixi/2 - h` with h = rate e^{rate t} - dividend e^{y + dividend t},
//! and w = w' = 0 at the boundary `xi_f` = `xi_0` + phi dx, which gives w's Taylor series there:
//! w'' = 2 h, w''' = 2 (h' - 2 h v), w'''' = 2 (h'' + 2 `h_t` + 4 h v^2) and, less a multiple of v's derivative,
//! w''''' = 2 (h''' + 2 `h_t`' - 8 `h_t` v - 4 h' v^2 - 8 h v^3), v the boundary's velocity.

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

/// What has been solved.
pub struct Solution<V> {
    /// The boundary is at `xi_0` + phi dx.
    pub phi: V,
    here: Obstacle<V>,
    there: Obstacle<V>,
    bond: V,
    stock: V,
    at: Residual<V>,
}

impl<V: Vector> Solution<V> {
    /// u at label 0.
    #[inline(always)]
    pub fn contact(&self) -> V {
        self.here.value + self.at.contact
    }
}

impl<V: Vector> Cell<'_, V> {
    /// Solve by Newton's method, from `y_1`; blind guesses take one step more.
    #[inline(always)]
    pub fn solve(&self, eliminated: V, guess: V, blind: bool) -> Solution<V> {
        let here = Obstacle::at(self.contracts, &self.moment, self.xi);
        let there = Obstacle::at(self.contracts, &self.moment, self.xi.plus(self.dx));
        let bond = self.moment.rate_growth.plus(1.0);
        let stock = here.growth * self.moment.dividend_growth.plus(1.0);
        let known = there.value - eliminated - self.pi * here.value;
        let most = V::all(LARGEST_MOVE * self.moment.root / self.dx);
        let mut phi = guess;
        if blind {
            phi = self.newton(phi, most, known, bond, stock);
        }
        phi = self.newton(phi, most, known, bond, stock);
        phi = self.newton(phi, most, known, bond, stock);
        let at = self.residual(phi, known, bond, stock);
        Solution {
            phi,
            here,
            there,
            bond,
            stock,
            at,
        }
    }

    /// The derivatives of u at label 0 and of phi by rate, dividend or spread (j = 0, 1, 2), from those of `y_1`, of
    /// `xi_0` and of the velocity at a fixed phi: the conditions differentiated, first at a fixed phi (the first three
    /// terms of w are enough: phi is small), then by phi.
    #[inline(always)]
    pub fn tangent(
        &self,
        j: usize,
        solution: &Solution<V>,
        eliminated: V,
        place_by: V,
        velocity_by: V,
    ) -> (V, V) {
        let Contracts {
            rate,
            dividend,
            spread,
        } = *self.contracts;
        let Solution {
            phi,
            here,
            there,
            bond,
            stock,
            at,
        } = solution;
        let (t, zero) = (self.moment.t, V::zero());
        let v = phi.times_plus(V::all(self.turn), self.velocity);
        let stock = self.stock_at(*phi, *stock);
        let (earned, paid) = (rate * *bond, dividend * stock);
        let h = earned - paid;
        let c = (spread * spread).times_plus(V::all(0.5), dividend);
        let held = rate.times(t).plus(1.0);
        let moving = spread * paid;
        let boundary = phi.times_plus(V::all(self.dx), self.xi);
        // At a fixed place.
        let paid_by = [
            zero,
            stock * dividend.times(t).plus(1.0),
            paid * spread.times_plus(V::all(t), boundary),
        ][j];
        let paid_by = moving.times_plus(place_by, paid_by);
        let earned_by = [*bond * held, zero, zero][j];
        // Of h_t, but for what comes with paid_by; and of spread.
        let grown_by = [earned * held.plus(1.0), -paid, -moving][j];
        let more = [zero, zero, paid][j];
        let z0 = phi.times(-self.dx);
        let z1 = z0.plus(self.dx);
        let h_by = earned_by - paid_by;
        let h_t_by = grown_by - c * paid_by;
        let h_xi_by = -spread.times_plus(paid_by, more);
        let swing = h * velocity_by;
        let third = (h_xi_by - h_by.times_plus(v, swing).times(2.0)).times(1.0 / 3.0);
        let bent = (v * h_by.times_plus(v, swing + swing)).times(4.0);
        let spread_out = spread * spread.times_plus(paid_by, more + more);
        let fourth = (bent + h_t_by.times(2.0) - spread_out).times(1.0 / 12.0);
        let u0 = z0.times_plus(z0.times_plus(fourth, third), h_by);
        let u1 = z1.times_plus(z1.times_plus(fourth, third), h_by);
        let g0 = here.slope.times_plus(place_by, here.tangents[j]);
        let g1 = there.slope.times_plus(place_by, there.tangents[j]);
        let u0 = (z0 * z0).times_plus(u0, g0);
        let u1 = (z1 * z1).times_plus(u1, g1);
        let moved = (eliminated + self.pi * u0 - u1) / at.derivative;
        (at.slope.times_plus(moved, u0), moved)
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
        let squared = spread * spread;
        let h_t = rate * earned - paid * squared.times_plus(V::all(0.5), dividend);
        let bent = h * (v * v);
        let third = (h_xi - (h * v).times(2.0)).times(1.0 / 3.0);
        let fourth = (bent.times(4.0) + h_t.times(2.0) + spread * h_xi).times(1.0 / 12.0);
        let curved = h_xi.times_plus(v, (h_t + bent).times(2.0));
        let fifth =
            (h_xi * (squared + dividend).times(2.0) - (v * curved).times(4.0)).times(1.0 / 60.0);
        let z0 = phi.times(-self.dx);
        let z1 = z0.plus(self.dx);
        // The velocity is in the coefficients of z^3, z^4 and z^5.
        let turned = h.times(self.turn * (2.0 / 3.0));
        let turned_fifth =
            (h_xi.times_plus(v, h_t) + bent.times(3.0)).times(self.turn * (-2.0 / 15.0));
        let series = [h + h, third.times(3.0), fourth.times(4.0), fifth.times(5.0)];
        let mut w = [z0, z1];
        let mut by = [z0, z1];
        for k in 0..2 {
            let z = w[k];
            let squared = z * z;
            w[k] = squared * z.times_plus(z.times_plus(z.times_plus(fifth, fourth), third), h);
            let slope = z.times_plus(series[3], series[2]);
            let slope = z * z.times_plus(z.times_plus(slope, series[1]), series[0]);
            let turning = turned.times_plus((z * v).plus(-1.0), turned_fifth * squared);
            by[k] = slope.times_plus(V::all(-self.dx), squared * z * turning);
        }
        let ([w0, w1], [by0, by1]) = (w, by);
        Residual {
            contact: w0,
            slope: by0,
            value: known + (w1 - self.pi * w0),
            derivative: by1 - self.pi * by0,
        }
    }
}
