//! From the premium at the labels to options at sixteen spots.

use super::labels::Workspace;
use super::march::Marched;
use super::obstacle::Contracts;
use super::plan::Plan;
use crate::lanes::normal::{exp, expm1, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use crate::lanes::vector::{Vector, LANES};

/// Labels in the interpolation.
const STENCIL: usize = 6;

/// v, `v_x`, `v_xx`, the European v, and `v_rate`, `v_dividend`, `v_spread`: V/K and its derivatives, x = ln(S/K).
pub const VALUES: usize = 7;

/// What one march says at the spots.
#[derive(Clone, Copy)]
pub struct Sight<V> {
    /// u, `u_xi` and `u_xixi`; those of the obstacle where the option is exercised.
    pub u: V,
    pub slope: V,
    pub curvature: V,
    /// Derivatives of u by rate, dividend and spread at fixed xi.
    pub tangents: [V; 3],
    /// ln(S*/K).
    pub boundary: V,
    /// 1, or -1 where the march lost the boundary.
    pub settled: V,
}

impl<V: Vector> Sight<V> {
    #[inline(always)]
    pub fn nothing() -> Self {
        let zero = V::zero();
        Self {
            u: zero,
            slope: zero,
            curvature: zero,
            tangents: [zero; 3],
            boundary: zero,
            settled: V::all(1.0),
        }
    }
}

/// Sixteen spots, and what of their options no march changes.
pub struct Spots<V> {
    /// The marched lane that each belongs to.
    lanes: [usize; LANES],
    contracts: Contracts<V>,
    /// ln(S/K).
    pub x: V,
    xi: V,
    /// e^{-r T}, e^x and N'(xi).
    bond: V,
    moneyness: V,
    density: V,
    /// The parts of the European put, e^{-r T} N(-d2) and e^{x - q T} N(-d1).
    in_bond: V,
    in_stock: V,
    /// The obstacle and its derivatives.
    at_once: Sight<V>,
}

impl<V: Vector> Spots<V> {
    #[inline(always)]
    pub fn new(contracts: Contracts<V>, x: V, lanes: [usize; LANES]) -> Self {
        let Contracts {
            rate,
            dividend,
            spread,
        } = contracts;
        let xi = (x + rate - dividend) / spread - spread.times(0.5);
        let (bond, stock, moneyness) = (exp(-rate), exp(x - dividend), exp(x));
        let density = exp((xi * xi).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI);
        let in_bond = weighted_normal(-xi, bond * density, bond);
        let in_stock = weighted_normal(-(xi + spread), bond * density, stock);
        let growth = V::all(1.0) / bond;
        let held = growth * (moneyness - in_stock);
        let slope = -(spread * held);
        Self {
            lanes,
            contracts,
            x,
            xi,
            bond,
            moneyness,
            density,
            in_bond,
            in_stock,
            at_once: Sight {
                u: growth * (in_stock - in_bond - expm1(x)),
                slope,
                curvature: spread * (slope - density),
                tangents: [
                    growth,
                    -(growth * moneyness),
                    -((xi + spread) * held) - density,
                ],
                ..Sight::nothing()
            },
        }
    }

    /// What a march says: the obstacle in its exercise region.
    #[inline(always)]
    pub fn sight<const D: bool>(
        &self,
        plan: &Plan,
        marched: &Marched<V>,
        work: &Workspace<V>,
    ) -> Sight<V> {
        let read = self.read::<D>(plan, marched, work);
        let boundary = self.of_lanes(marched.boundary);
        let held = boundary - self.x;
        let mut settled = [1.0; LANES];
        for (own, &lane) in settled.iter_mut().zip(&self.lanes) {
            *own = if marched.settled[lane] { 1.0 } else { -1.0 };
        }
        let mut tangents = read.tangents;
        for (tangent, at_once) in tangents.iter_mut().zip(self.at_once.tangents) {
            *tangent = held.negative(*tangent, at_once);
        }
        Sight {
            u: held.negative(read.u, self.at_once.u),
            slope: held.negative(read.slope, self.at_once.slope),
            curvature: held.negative(read.curvature, self.at_once.curvature),
            tangents,
            boundary,
            settled: V::from_lanes(settled),
        }
    }

    /// From u to v.
    #[inline(always)]
    pub fn discounted(&self, u: V) -> V {
        self.bond * u
    }

    /// Half the second derivative of V/K less the payoff by x, at the boundary, where the dividend is small.
    #[inline(always)]
    pub fn early_interest(&self) -> V {
        self.contracts.rate / (self.contracts.spread * self.contracts.spread)
    }

    /// What the premium in v is at most, about, that far from the boundary: now, and without expiry.
    #[inline(always)]
    pub fn premium_bound(&self, boundary: V) -> V {
        let Contracts {
            rate,
            dividend,
            spread,
        } = self.contracts;
        let drift = (rate - dividend) / spread - spread.times(0.5);
        let decay = drift + (drift * drift + rate + rate).sqrt();
        let deviations = (self.x - boundary) / spread;
        let now = rate * exp((deviations * deviations).times(-0.5));
        now.min(exp(-(decay * deviations)))
    }

    /// The differences of v and its derivatives from those of u and its own.
    #[inline(always)]
    pub fn differences(&self, near: &Sight<V>) -> [V; VALUES] {
        let scale = self.bond / self.contracts.spread;
        [
            self.bond * near.u,
            scale * near.slope,
            scale * near.curvature / self.contracts.spread,
            V::zero(),
            self.bond * near.tangents[0],
            self.bond * near.tangents[1],
            self.bond * near.tangents[2],
        ]
    }

    /// V/K and its derivatives from u and its own; those of the payoff where `held` is not negative.
    #[inline(always)]
    pub fn values(&self, premium: &Sight<V>, held: V) -> [V; VALUES] {
        let inverse = V::all(1.0) / self.contracts.spread;
        let density = self.bond * self.density;
        let moved = self.bond * premium.slope * inverse;
        let european = self.in_bond - self.in_stock;
        let carried = premium.slope * (self.xi * inverse).plus(1.0);
        let (zero, by) = (V::zero(), premium.tangents);
        [
            held.negative(european + self.bond * premium.u, -expm1(self.x)),
            held.negative(moved - self.in_stock, -self.moneyness),
            held.negative(
                (self.bond * premium.curvature * inverse + density) * inverse - self.in_stock,
                -self.moneyness,
            ),
            european,
            held.negative(moved + self.bond * (by[0] - premium.u) - self.in_bond, zero),
            held.negative(self.bond * by[1] - moved + self.in_stock, zero),
            held.negative(self.bond * (by[2] - carried) + density, zero),
        ]
    }

    /// From the marched lanes to the spots.
    #[inline(always)]
    fn of_lanes(&self, v: V) -> V {
        let (numbers, mut own) = (v.lanes(), [0.0; LANES]);
        for (number, &lane) in own.iter_mut().zip(&self.lanes) {
            *number = numbers[lane];
        }
        V::from_lanes(own)
    }

    /// u, `u_xi` and `u_xixi` at xi; zero beyond the labels.
    #[inline(always)]
    #[allow(clippy::cast_precision_loss)]
    fn read<const D: bool>(
        &self,
        plan: &Plan,
        marched: &Marched<V>,
        work: &Workspace<V>,
    ) -> Sight<V> {
        let cell = 1.0 / plan.last_spacing();
        let y = (self.xi - self.of_lanes(marched.frame)).times(cell).lanes();
        let (mut first, mut z) = ([0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            first[l] = first_label(y[l], plan.nodes);
            z[l] = y[l] - first[l] as f64;
        }
        let z = V::from_lanes(z);
        let inside = z.plus(3.0 - STENCIL as f64);
        let z = z.min(V::all(STENCIL as f64));
        let labels = self.differences_of(&work.base.state, &first);
        // Newton's series of forward differences with the binomials of z.
        let (mut binomial, mut once, mut twice) = (V::all(1.0), V::zero(), V::zero());
        let mut value = labels[0];
        let (mut slope, mut curvature) = (V::zero(), V::zero());
        let mut binomials = [binomial; STENCIL];
        for (k, &difference) in labels.iter().enumerate().skip(1) {
            let (step, share) = (z.plus(1.0 - k as f64), 1.0 / k as f64);
            twice = (twice * step + once + once).times(share);
            once = (once * step + binomial).times(share);
            binomial = (binomial * step).times(share);
            binomials[k] = binomial;
            value = binomial.times_plus(difference, value);
            slope = slope + once * difference;
            curvature = curvature + twice * difference;
        }
        let zero = V::zero();
        slope = slope.times(cell);
        let mut tangents = [zero; 3];
        if D {
            for (j, tangent) in tangents.iter_mut().enumerate() {
                let labels = self.differences_of(&work.tangents[j].state, &first);
                let mut along = labels[0];
                for (difference, binomial) in labels[1..].iter().zip(&binomials[1..]) {
                    along = binomial.times_plus(*difference, along);
                }
                let at_fixed_xi = along - slope * self.of_lanes(marched.frame_by[j]);
                *tangent = inside.negative(at_fixed_xi, zero);
            }
        }
        Sight {
            u: inside.negative(value, zero),
            slope: inside.negative(slope, zero),
            curvature: inside.negative(curvature.times(cell * cell), zero),
            tangents,
            ..Sight::nothing()
        }
    }
}

impl<V: Vector> Spots<V> {
    /// The forward differences, by order, of labels from the first ones on.
    #[inline(always)]
    fn differences_of(&self, state: &[V], first: &[usize; LANES]) -> [V; STENCIL] {
        let mut labels = [V::zero(); STENCIL];
        for (k, label) in labels.iter_mut().enumerate() {
            let mut numbers = [0.0; LANES];
            for l in 0..LANES {
                numbers[l] = state[first[l] + k].lane(self.lanes[l]);
            }
            *label = V::from_lanes(numbers);
        }
        for order in 1..STENCIL {
            for k in (order..STENCIL).rev() {
                labels[k] = labels[k] - labels[k - 1];
            }
        }
        labels
    }
}

/// The first of the labels around y, at least 0, with the stencil inside.
#[inline(always)]
fn first_label(y: f64, nodes: usize) -> usize {
    let last = nodes + 1 - STENCIL;
    if y >= 2.0 {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let wanted = y.min(1e9) as usize - 2;
        wanted.min(last)
    } else {
        0
    }
}
