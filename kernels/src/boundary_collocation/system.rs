//! The equations of the two boundaries at the nodes: value matching, with their derivatives.

use super::integrand::{European, Parameters, Passed};
use super::nodes::Nodes;
use crate::lanes::normal::exp;
use crate::lanes::vector::{sum_of_lanes, Part, Vector, LANES};

/// The smallest distance of the upper boundary from the strike, in standard deviations; chosen: its square may be negative
/// between the nodes.
const SMALLEST_DISTANCE: f64 = 1e-4;

/// The two boundaries at the nodes, up to a share of the time to expiry.
///
/// The upper one is kept as (ln(S*/K))^2, 0 at expiry, the lower one as ln(S*/K).
#[derive(Clone)]
pub struct Curves {
    pub upper_squared: Vec<f64>,
    pub lower: Vec<f64>,
    /// The time up to which the boundaries are sought, as a share of the time to expiry.
    pub share: f64,
}

impl Curves {
    /// ln(S*/K) of the upper boundary at a node.
    pub fn upper(&self, node: usize) -> f64 {
        -self.upper_squared[node].sqrt()
    }

    /// How far the boundaries are apart at a node.
    pub fn width(&self, node: usize) -> f64 {
        self.upper(node) - self.lower[node]
    }
}

/// The derivatives of the put less the payoff, over K, at the boundaries of the nodes. All by the parameters of the share
/// of the time that the boundaries reach to.
pub struct Matching {
    /// The put less the payoff, first at the upper boundaries, then at the lower ones, (2 m,).
    pub residual: Vec<f64>,
    /// Its derivatives by the unknowns of the curves at the nodes 0 to m, first the upper curve's, (2 m x 2 (m + 1),).
    pub by_curves: Vec<f64>,
    /// Its derivatives by rate, dividend and spread, (2 m,) each.
    pub by_parameters: [Vec<f64>; 3],
}

/// The work of finding these.
pub struct MatchingWork<'a> {
    pub parameters: Parameters,
    pub nodes: &'a Nodes,
    pub curves: &'a Curves,
}

/// The sums over the quadrature for one target: value, derivative by x, and by the parameters.
type Sums<V> = [V; 5];

impl<V: Vector> Part<V> for MatchingWork<'_> {
    type Result = Matching;

    #[inline(always)]
    fn run(self) -> Matching {
        let m = self.nodes.degree;
        let mut found = Matching {
            residual: vec![0.0; 2 * m],
            by_curves: vec![0.0; 4 * m * (m + 1)],
            by_parameters: [const { Vec::new() }; 3],
        };
        for by in &mut found.by_parameters {
            by.resize(2 * m, 0.0);
        }
        let mut by_curves = vec![V::zero(); 4 * (m + 1)];
        for node in 1..=m {
            self.match_node(node, &mut by_curves, &mut found);
        }
        found
    }
}

impl MatchingWork<'_> {
    /// Add what one node says; `by_curves` is memory.
    #[inline(always)]
    fn match_node<V: Vector>(&self, node: usize, by_curves: &mut [V], found: &mut Matching) {
        let (nodes, curves, m) = (self.nodes, self.curves, self.nodes.degree);
        let z = nodes.z[node];
        let targets = [curves.upper(node), curves.lower[node]];
        let mut first_lanes = [targets[0]; LANES];
        first_lanes[1] = targets[1];
        let both = V::from_lanes(first_lanes);
        let european = European::at(self.parameters, V::all(z), both);
        let moneyness = exp(both);
        let (mut sums, zero) = ([[V::zero(); 5]; 2], V::zero());
        by_curves.fill(zero);
        let stride = (m + 1) * nodes.points;
        let basis = &nodes.basis[(node - 1) * stride..node * stride];
        for start in (0..nodes.points).step_by(LANES) {
            let (cosine, sine) = (
                chunk::<V>(&nodes.cosines, start),
                chunk::<V>(&nodes.sines, start),
            );
            let passed = Passed::new(self.parameters, cosine.times(z));
            let weight = chunk::<V>(&nodes.quadrature, start).times(z * z);
            let mut kept = [zero; 4];
            for (c, values) in [&curves.upper_squared, &curves.lower]
                .into_iter()
                .enumerate()
            {
                let mut kept_value = zero;
                for (k, value) in values.iter().enumerate() {
                    let of_node = chunk::<V>(basis, k * nodes.points + start);
                    kept_value = of_node.times_plus(V::all(*value), kept_value);
                }
                let root = sine.times(z);
                let (y, by_unknown, sign) = boundary(c == 0, kept_value, root, self.parameters);
                for (a, sums) in sums.iter_mut().enumerate() {
                    let x = V::all(targets[a]);
                    let at = passed.integrand(x, V::all(moneyness.lane(a)), y);
                    let weight = weight.times(sign);
                    let [by_rate, by_dividend, by_spread] = at.by_parameters;
                    let terms = [at.value, at.by_x, by_rate, by_dividend, by_spread];
                    for (sum, term) in sums.iter_mut().zip(terms) {
                        *sum = weight.times_plus(term, *sum);
                    }
                    kept[2 * a + c] = weight * at.by_y * by_unknown;
                }
            }
            for k in 0..=m {
                let of_node = chunk::<V>(basis, k * nodes.points + start);
                for (at, kept) in kept.iter().enumerate() {
                    let sum = &mut by_curves[at * (m + 1) + k];
                    *sum = kept.times_plus(of_node, *sum);
                }
            }
        }
        for (a, sums) in sums.iter().enumerate() {
            let row = a * m + node - 1;
            let [value, by_x, by_parameters @ ..]: Sums<f64> = sums.map(sum_of_lanes);
            found.residual[row] = european.above_payoff.lane(a) + value;
            for (j, by) in by_parameters.into_iter().enumerate() {
                found.by_parameters[j][row] = european.by_parameters[j].lane(a) + by;
            }
            let by_target = european.above_payoff_by_x.lane(a) + by_x;
            let unknowns = &mut found.by_curves[row * 2 * (m + 1)..(row + 1) * 2 * (m + 1)];
            let own = &by_curves[2 * a * (m + 1)..2 * (a + 1) * (m + 1)];
            for (unknown, sum) in unknowns.iter_mut().zip(own) {
                *unknown = sum_of_lanes(*sum);
            }
            if a == 0 {
                unknowns[node] += by_target * 0.5 / targets[0];
            } else {
                unknowns[m + 1 + node] += by_target;
            }
        }
    }
}

/// ln(S*/K) of a boundary from what `Curves` keeps of it, its derivative by that, and the sign with which the integral up to
/// it counts; `root` is the square root of the time to expiry, in that of `parameters`.
#[inline(always)]
pub fn boundary<V: Vector>(
    is_upper: bool,
    kept: V,
    root: V,
    parameters: Parameters,
) -> (V, V, f64) {
    if !is_upper {
        return (kept, V::all(1.0), -1.0);
    }
    let least = root.times(SMALLEST_DISTANCE * parameters.spread);
    let least = least * least;
    let y = -(kept.max(least).sqrt());
    let is_held = kept - least; // negative where the square is held
    (y, is_held.negative(V::zero(), V::all(0.5) / y), 1.0)
}

/// As many numbers as there are lanes, from `start`.
#[inline(always)]
pub fn chunk<V: Vector>(numbers: &[f64], start: usize) -> V {
    let mut lanes = [0.0; LANES];
    lanes.copy_from_slice(&numbers[start..start + LANES]);
    V::from_lanes(lanes)
}
