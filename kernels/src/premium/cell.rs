//! The complementarity problem of one stage, solved to the place of the boundary inside its cell.
//!
//! On the free side w = u - G obeys `w_t = w_xixi/2 - h` with h = rate e^{rate t} - dividend e^{y + dividend t},
//! and w = w' = 0 at the boundary `xi_f` = `xi_0` + phi dx, which gives w's Taylor series there:
//! w'' = 2 h, w''' = 2 (h' - 2 h v), w'''' = 2 (h'' + 2 `h_t` + 4 h v^2) and, less a multiple of v's derivative,
//! w''''' = 2 (h''' + 2 `h_t`' - 8 `h_t` v - 4 h' v^2 - 8 h v^3), v the boundary's velocity.

use super::obstacle::{Contracts, Moment, Obstacle};
use crate::lanes::vector::Vector;

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

    /// What the derivatives by all parameters share: the conditions differentiated at a fixed phi (the first three
    /// terms of w are enough: phi is small), and by phi.
    #[inline(always)]
    pub fn differentiated(&self, solution: &Solution<V>) -> Differentiated<V> {
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
        let stock = self.stock_at(*phi, *stock);
        let (earned, paid) = (rate * *bond, dividend * stock);
        let held = rate.times(t).plus(1.0);
        let moving = spread * paid;
        let boundary = phi.times_plus(V::all(self.dx), self.xi);
        let z0 = phi.times(-self.dx);
        Differentiated {
            t,
            root: self.moment.root,
            spread,
            pi: self.pi,
            h: earned - paid,
            v: phi.times_plus(V::all(self.turn), self.velocity),
            c: (spread * spread).times_plus(V::all(0.5), dividend),
            moving,
            earned_by: [*bond * held, zero, zero],
            paid_by: [
                zero,
                stock * dividend.times(t).plus(1.0),
                paid * spread.times_plus(V::all(t), boundary),
            ],
            grown_by: [earned * held.plus(1.0), -paid, -moving],
            spread_by: [zero, zero, paid],
            z: [z0, z0.plus(self.dx)],
            obstacle_slopes: [here.slope, there.slope],
            obstacle_by: [here.tangents, there.tangents],
            contact_slope: at.slope,
            inverse: V::all(1.0) / at.derivative,
        }
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

/// The conditions of a solved cell, ready to be differentiated by rate, dividend and spread: what ends in `_by` has
/// one part for each, at fixed places.
pub struct Differentiated<V> {
    pub t: f64,
    pub root: f64,
    spread: V,
    pi: V,
    h: V,
    /// The boundary's velocity.
    v: V,
    c: V,
    /// The derivative of paid by the place.
    moving: V,
    earned_by: [V; 3],
    paid_by: [V; 3],
    /// Of `h_t`, but for what comes with paid.
    grown_by: [V; 3],
    /// Of spread, times paid.
    spread_by: [V; 3],
    /// From the boundary to the labels 0 and 1.
    z: [V; 2],
    obstacle_slopes: [V; 2],
    obstacle_by: [[V; 3]; 2],
    contact_slope: V,
    /// Of the residual's derivative by phi.
    inverse: V,
}

impl<V: Vector> Differentiated<V> {
    /// The derivatives of u at label 0 and of phi by one parameter (j = 0, 1, 2), from those of `y_1`, of `xi_0` and
    /// of the velocity at a fixed phi.
    #[inline(always)]
    pub fn tangent(&self, j: usize, eliminated: V, place_by: V, velocity_by: V) -> (V, V) {
        let paid_by = self.moving.times_plus(place_by, self.paid_by[j]);
        let h_by = self.earned_by[j] - paid_by;
        let h_t_by = self.grown_by[j] - self.c * paid_by;
        let h_xi_by = -self.spread.times_plus(paid_by, self.spread_by[j]);
        let swing = self.h * velocity_by;
        let third = (h_xi_by - h_by.times_plus(self.v, swing).times(2.0)).times(1.0 / 3.0);
        let bent = (self.v * h_by.times_plus(self.v, swing + swing)).times(4.0);
        let twice = self.spread_by[j] + self.spread_by[j];
        let spread_out = self.spread * self.spread.times_plus(paid_by, twice);
        let fourth = (bent + h_t_by.times(2.0) - spread_out).times(1.0 / 12.0);
        let mut u = self.z;
        for (k, u) in u.iter_mut().enumerate() {
            let z = self.z[k];
            let series = z.times_plus(z.times_plus(fourth, third), h_by);
            let obstacle = self.obstacle_slopes[k].times_plus(place_by, self.obstacle_by[k][j]);
            *u = (z * z).times_plus(series, obstacle);
        }
        let moved = (eliminated + self.pi * u[0] - u[1]) * self.inverse;
        (self.contact_slope.times_plus(moved, u[0]), moved)
    }
}
