//! The value of the put at one spot, from its boundaries, with its derivatives.

use std::f64::consts::FRAC_PI_2;

use super::integrand::{European, Passed};
use super::newton::{Boundaries, BoundaryTangents};
use super::nodes::Nodes;
use super::put::Put;
use super::system::{boundary, chunk};
use crate::flat_options::VALUES;
use crate::gauss_legendre::legendre;
use crate::lanes::normal::exp;
use crate::lanes::vector::{sum_of_lanes, Part, Vector, LANES};

/// The width of the first panel of the integral, in distances of the spot from the boundary, and the factor from panel to
/// panel; chosen.
const FIRST_PANEL: f64 = 2.0;
const GROWTH: f64 = 6.0;
/// The smallest such distance; chosen.
const SMALLEST_DISTANCE: f64 = 1e-6;
/// The smallest distance of a point of the quadrature from a node.
const NODE_ROUNDING: f64 = 1e-15;

/// The work of finding the `VALUES` of a spot.
pub struct SpotValue<'a> {
    pub put: &'a Put,
    pub boundaries: &'a Boundaries,
    /// Without these the derivatives by the parameters are not numbers.
    pub tangents: Option<&'a BoundaryTangents>,
    /// ln(S/K).
    pub x: f64,
}

impl Boundaries {
    /// The boundaries now, ln(S*/K), upper and lower; None where they have met before.
    pub fn now(&self) -> Option<(f64, f64)> {
        let last = Nodes::of_level(self.level).degree;
        (!self.meet).then(|| (self.curves.upper(last), self.curves.lower[last]))
    }

    /// Whether the put is exercised at x = ln(S/K).
    pub fn exercised(&self, x: f64) -> bool {
        self.now()
            .is_some_and(|(upper, lower)| lower <= x && x <= upper)
    }

    /// The distance of x from the nearer boundary as they are last.
    pub fn distance(&self, x: f64) -> f64 {
        let last = Nodes::of_level(self.level).degree;
        let (upper, lower) = (self.curves.upper(last), self.curves.lower[last]);
        (x - upper).max(lower - x).max(0.0)
    }
}

impl<V: Vector> Part<V> for SpotValue<'_> {
    type Result = [f64; VALUES];

    #[inline(always)]
    fn run(self) -> [f64; VALUES] {
        let parameters = self.put.parameters;
        let european = European::<V>::at(parameters, V::all(1.0), V::all(self.x));
        let mut sums = [V::zero(); VALUES];
        let angle = self.boundaries.curves.share.sqrt().min(1.0).acos();
        let distance = self.boundaries.distance(self.x) / parameters.spread;
        let scale = FIRST_PANEL * distance.max(angle).max(SMALLEST_DISTANCE);
        let (mut start, mut width) = (angle, scale);
        while start < FRAC_PI_2 {
            // A rest that is narrower than the panel belongs to it.
            let end = if start + 2.0 * width >= FRAC_PI_2 {
                FRAC_PI_2
            } else {
                start + width
            };
            self.add_panel(start, end, &mut sums);
            (start, width) = (end, width * GROWTH);
        }
        let mut values = sums.map(sum_of_lanes);
        values[0] += european.value.lane(0);
        values[1] += european.by_x.lane(0);
        values[2] += european.by_x_twice.lane(0);
        values[3] = european.value.lane(0);
        values[4..].fill(f64::NAN);
        if let Some(tangents) = self.tangents {
            let at_meeting = self.at_meeting::<V>();
            for j in 0..3 {
                values[4 + j] = sum_of_lanes(sums[4 + j])
                    + european.by_parameters[j].lane(0)
                    + at_meeting * tangents.share[j];
            }
        }
        values
    }
}

impl SpotValue<'_> {
    /// Add the integral over the exercise between two angles; cos of the angle is the square root of the time to expiry
    /// of the exercise, sin that of the time from now on.
    #[inline(always)]
    fn add_panel<V: Vector>(&self, start: f64, end: f64, sums: &mut [V; VALUES]) {
        let curves = &self.boundaries.curves;
        let nodes = Nodes::of_level(self.boundaries.level);
        let (x, moneyness) = (V::all(self.x), exp(V::all(self.x)));
        let rule = legendre(nodes.points);
        let per_root = 1.0 / curves.share.sqrt();
        let within = self.put.parameters.within(curves.share);
        for points in rule.chunks_exact(LANES) {
            let (mut z, mut root, mut weight) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
            for (l, (place, share)) in points.iter().enumerate() {
                let half = 0.5 * (end - start);
                let (sine, cosine) = (start + half * (1.0 + place)).sin_cos();
                (z[l], root[l]) = (cosine * per_root, sine);
                weight[l] = 2.0 * half * share * sine * cosine;
            }
            let polynomials = Polynomials::<V>::new(nodes, chunk(&z, 0));
            let passed = Passed::new(self.put.parameters, chunk(&root, 0));
            for is_upper in [true, false] {
                let values = if is_upper {
                    &curves.upper_squared
                } else {
                    &curves.lower
                };
                let own: V = polynomials.of(values);
                let (y, by_unknown, sign) = boundary(is_upper, own, chunk(&z, 0), within);
                let at = passed.integrand(x, moneyness, y);
                let weight = chunk::<V>(&weight, 0).times(sign);
                for (k, term) in [at.value, at.by_x, at.by_x_twice].into_iter().enumerate() {
                    sums[k] = weight.times_plus(term, sums[k]);
                }
                if let Some(tangents) = self.tangents {
                    let by = if is_upper {
                        &tangents.upper_squared
                    } else {
                        &tangents.lower
                    };
                    let by_unknown = at.by_y * by_unknown;
                    for j in 0..3 {
                        let moved = by_unknown * polynomials.of(&by[j]) + at.by_parameters[j];
                        sums[4 + j] = weight.times_plus(moved, sums[4 + j]);
                    }
                }
            }
        }
    }

    /// What exercise earns where the boundaries meet: they are not quite together there.
    #[inline(always)]
    fn at_meeting<V: Vector>(&self) -> f64 {
        if !self.boundaries.meet {
            return 0.0;
        }
        let curves = &self.boundaries.curves;
        let last = Nodes::of_level(self.boundaries.level).degree;
        let passed = Passed::<V>::new(
            self.put.parameters,
            V::all((1.0 - curves.share).max(0.0).sqrt().max(SMALLEST_DISTANCE)),
        );
        let x = V::all(self.x);
        let at = |y: f64| passed.integrand(x, exp(x), V::all(y)).value.lane(0);
        at(curves.upper(last)) - at(curves.lower[last])
    }
}

/// Interpolation at as many places z as lanes.
struct Polynomials<'a, V> {
    nodes: &'a Nodes,
    z: V,
    /// One over the sum of the barycentric terms.
    inverse: V,
}

impl<'a, V: Vector> Polynomials<'a, V> {
    #[inline(always)]
    fn new(nodes: &'a Nodes, z: V) -> Self {
        let mut found = Self {
            nodes,
            z,
            inverse: V::all(1.0),
        };
        let mut sum = V::zero();
        for k in 0..=nodes.degree {
            sum = sum + found.term(k);
        }
        found.inverse = V::all(1.0) / sum;
        found
    }

    /// The barycentric term of one node.
    #[inline(always)]
    fn term(&self, node: usize) -> V {
        let away = self.z.plus(-self.nodes.z[node]);
        let rounding = V::all(NODE_ROUNDING);
        let away = (away.abs() - rounding).negative(rounding, away);
        V::all(self.nodes.weight(node)) / away
    }

    /// The polynomial with these values at the nodes.
    #[inline(always)]
    fn of(&self, values: &[f64]) -> V {
        let mut sum = V::zero();
        for (k, value) in values.iter().enumerate() {
            sum = self.term(k).times_plus(V::all(*value), sum);
        }
        sum * self.inverse
    }
}
