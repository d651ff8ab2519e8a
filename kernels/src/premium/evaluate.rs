//! From the premium at the labels to the option at a spot.

use super::normal::{exp, expm1, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use super::obstacle::Contracts;
use super::vector::{Vector, LANES};

/// Labels in the interpolation.
pub const STENCIL: usize = 6;

/// v, `v_x`, `v_xx`, the European v, and `v_rate`, `v_dividend`, `v_spread`: V/K and its derivatives, x = ln(S/K).
pub const VALUES: usize = 7;

/// Where to read: the premiums and the spots.
pub struct Place<V> {
    /// ln(S/K).
    pub x: V,
    /// xi of label 0, and the distance of the labels.
    pub frame: V,
    pub dx: V,
    /// Labels that are free.
    pub nodes: [usize; LANES],
    /// ln(S*/K).
    pub boundary: V,
}

/// u and its derivatives by the parameters; `u_xi` and `u_xixi`.
struct Premium<V, const C: usize> {
    u: [V; C],
    slope: V,
    curvature: V,
}

/// Read, and add the European put; `label(lane, i)` is u and its derivatives at label i.
///
/// In the exercise region the payoff is the answer.
#[inline(always)]
pub fn evaluate<V: Vector, const C: usize>(
    contracts: &Contracts<V>,
    place: &Place<V>,
    label: impl Fn(usize, usize) -> [f64; C],
) -> [V; VALUES] {
    let Contracts {
        rate,
        dividend,
        spread,
    } = *contracts;
    let x = place.x;
    let inverse = V::all(1.0) / spread;
    let xi = (x + rate - dividend) * inverse - spread.times(0.5);
    let Premium {
        u,
        slope,
        curvature,
    } = interpolate(place, xi, label);
    let bond = exp(-rate);
    let stock = exp(x - dividend);
    let density = bond * exp((xi * xi).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI);
    let in_bond = weighted_normal(-xi, density, bond);
    let in_stock = weighted_normal(-(xi + spread), density, stock);
    let european = in_bond - in_stock;
    let moved = bond * slope * inverse;
    let moneyness = exp(x);
    let beyond = place.boundary - x;
    let held = |value: V, at_once: V| beyond.negative(value, at_once);
    let mut values = [V::zero(); VALUES];
    values[0] = held(european + bond * u[0], -expm1(x));
    values[1] = held(moved - in_stock, -moneyness);
    values[2] = held(
        (bond * curvature * inverse + density) * inverse - in_stock,
        -moneyness,
    );
    values[3] = european;
    if C > 1 {
        values[4] = held(moved + bond * (u[1] - u[0]) - in_bond, V::zero());
        values[5] = held(bond * u[2] - moved + in_stock, V::zero());
        values[6] = held(
            bond * (u[3] - slope * (xi * inverse).plus(1.0)) + density,
            V::zero(),
        );
    }
    values
}

/// Return the premium at xi; zero beyond the labels.
#[inline(always)]
#[allow(clippy::cast_precision_loss)]
fn interpolate<V: Vector, const C: usize>(
    place: &Place<V>,
    xi: V,
    label: impl Fn(usize, usize) -> [f64; C],
) -> Premium<V, C> {
    let y = ((xi - place.frame) / place.dx).lanes();
    let first: [usize; LANES] = std::array::from_fn(|l| first_label(y[l], place.nodes[l]));
    let z: [f64; LANES] = std::array::from_fn(|l| y[l] - first[l] as f64);
    let inside = V::from_lanes(z.map(|z| z - (STENCIL as f64 - 3.0)));
    let z = V::from_lanes(z).min(V::all(STENCIL as f64));
    let mut labels: [[V; C]; STENCIL] = std::array::from_fn(|k| {
        let read: [[f64; C]; LANES] = std::array::from_fn(|l| label(l, first[l] + k));
        std::array::from_fn(|c| V::from_lanes(std::array::from_fn(|l| read[l][c])))
    });
    // Newton's series of forward differences with the binomials of z.
    for order in 1..STENCIL {
        for k in (order..STENCIL).rev() {
            labels[k] = std::array::from_fn(|c| labels[k][c] - labels[k - 1][c]);
        }
    }
    let (mut binomial, mut once, mut twice) = (V::all(1.0), V::zero(), V::zero());
    let mut value = labels[0];
    let (mut slope, mut curvature) = (V::zero(), V::zero());
    for (k, difference) in labels.iter().enumerate().skip(1) {
        let (step, share) = (z.plus(1.0 - k as f64), 1.0 / k as f64);
        twice = (twice * step + once + once).times(share);
        once = (once * step + binomial).times(share);
        binomial = (binomial * step).times(share);
        value = std::array::from_fn(|c| value[c] + binomial * difference[c]);
        slope = slope + once * difference[0];
        curvature = curvature + twice * difference[0];
    }
    let kept = |v: V| inside.negative(v, V::zero());
    let cell = V::all(1.0) / place.dx;
    Premium {
        u: value.map(kept),
        slope: kept(slope * cell),
        curvature: kept(curvature * cell * cell),
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
