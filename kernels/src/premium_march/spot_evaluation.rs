//! From the premium at the nodes to the options at sixteen spots.

use super::contracts::Contracts;
use super::first_step::OnlyStep;
use super::grid_values::Workspace;
use super::interpolation::Interpolation;
use super::march::Marched;
use super::mesh::Mesh;
use super::puts::{CROSS, VALUES};
use crate::lanes::normal::{exp, expm1, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use crate::lanes::vector::{Vector, LANES};

/// What one march says at sixteen spots; in the exercise region u is the obstacle G, unless it is continued.
#[derive(Clone, Copy)]
pub struct SpotEvaluation<V> {
    /// u, `u_xi` and `u_xixi`.
    pub u: V,
    pub slope: V,
    pub curvature: V,
    /// The derivatives of u by rate, dividend and spread at fixed xi.
    pub tangents: [V; 3],
    /// The derivatives of these by xi.
    pub tangent_slopes: [V; 3],
    /// ln(S*/K).
    pub boundary: V,
    /// 1, or -1 where the march lost the boundary.
    pub settled: V,
}

impl<V: Vector> SpotEvaluation<V> {
    /// The evaluation of a march with the premium zero.
    #[inline(always)]
    pub fn zero() -> Self {
        let zero = V::zero();
        Self {
            u: zero,
            slope: zero,
            curvature: zero,
            tangents: [zero; 3],
            tangent_slopes: [zero; 3],
            boundary: zero,
            settled: V::all(1.0),
        }
    }
}

/// Sixteen spots, and the parts of their options that no march changes.
pub struct Spots<V> {
    /// The lane of the march that each spot belongs to.
    lanes: [usize; LANES],
    contracts: Contracts<V>,
    /// Whether evaluations continue u from the free nodes into the exercise region.
    is_continued: bool,
    /// ln(S/K).
    pub x: V,
    xi: V,
    /// e^{-r T}, e^x and n(xi).
    bond: V,
    moneyness: V,
    density: V,
    /// The parts of the European put, e^{-r T} N(-d2) and e^{x - q T} N(-d1).
    in_bond: V,
    in_stock: V,
    /// The evaluation in the exercise region: the obstacle and its derivatives.
    exercised: SpotEvaluation<V>,
}

impl<V: Vector> Spots<V> {
    /// The spots x = ln(S/K) of these contracts; `lanes` says which lane of the march each belongs to.
    #[inline(always)]
    pub fn new(contracts: Contracts<V>, x: V, lanes: [usize; LANES], is_continued: bool) -> Self {
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
        let shares = growth * (moneyness - in_stock);
        let slope = -(spread * shares);
        Self {
            lanes,
            contracts,
            is_continued,
            x,
            xi,
            bond,
            moneyness,
            density,
            in_bond,
            in_stock,
            exercised: SpotEvaluation {
                u: growth * (in_stock - in_bond - expm1(x)),
                slope,
                curvature: spread * (slope - density),
                tangents: [
                    growth,
                    -(growth * moneyness),
                    -((xi + spread) * shares) - density,
                ],
                ..SpotEvaluation::zero()
            },
        }
    }

    /// Evaluate a march at the spots, with the derivatives by the parameters from D arrays, see `array_of`.
    #[inline(always)]
    pub fn evaluate<S: Vector, const D: usize>(
        &self,
        mesh: &Mesh,
        marched: &Marched<S>,
        work: &Workspace<S>,
    ) -> SpotEvaluation<V> {
        let waiting = self.interpolate::<S, D>(mesh, marched, work);
        let boundary = self.of_lanes(marched.boundary);
        let depth = if self.is_continued {
            V::all(-1.0)
        } else {
            boundary - self.x // negative where the option is not exercised
        };
        let mut settled = [1.0; LANES];
        for (own, &lane) in settled.iter_mut().zip(&self.lanes) {
            *own = if marched.settled[lane] { 1.0 } else { -1.0 };
        }
        let mut tangents = waiting.tangents;
        for (tangent, exercised) in tangents.iter_mut().zip(self.exercised.tangents) {
            *tangent = depth.negative(*tangent, exercised);
        }
        SpotEvaluation {
            u: depth.negative(waiting.u, self.exercised.u),
            slope: depth.negative(waiting.slope, self.exercised.slope),
            curvature: depth.negative(waiting.curvature, self.exercised.curvature),
            tangents,
            tangent_slopes: waiting.tangent_slopes,
            boundary,
            settled: V::from_lanes(settled),
        }
    }

    /// Evaluate a march of one step at the spots, without derivatives by the parameters.
    #[inline(always)]
    pub fn evaluate_only_step<S: Vector>(&self, step: &OnlyStep<S>) -> SpotEvaluation<V> {
        let Contracts {
            rate,
            dividend,
            spread,
        } = self.contracts;
        let (from, lam) = (self.of_lanes(step.xi), step.lam);
        let boundary = from * spread - (rate - dividend) + (spread * spread).times(0.5);
        let u = self.of_lanes(step.contact) * exp((from - self.xi).times(lam));
        let depth = boundary - self.x; // negative where the option is not exercised
        SpotEvaluation {
            u: depth.negative(u, self.exercised.u),
            slope: depth.negative(u.times(-lam), self.exercised.slope),
            curvature: depth.negative(u.times(lam * lam), self.exercised.curvature),
            boundary,
            ..SpotEvaluation::zero()
        }
    }

    /// The premium at the spots: zero beyond the nodes.
    #[inline(always)]
    fn interpolate<S: Vector, const D: usize>(
        &self,
        mesh: &Mesh,
        marched: &Marched<S>,
        work: &Workspace<S>,
    ) -> SpotEvaluation<V> {
        let per_cell = 1.0 / mesh.last_spacing();
        let cells = (self.xi - self.of_lanes(marched.node)).times(per_cell);
        let at = Interpolation::new(cells, mesh.nodes);
        let inside = at.inside();
        let (value, slope, curvature) = at.with_derivatives(&work.premium.state, &self.lanes);
        let zero = V::zero();
        let (slope, curvature) = (slope.times(per_cell), curvature.times(per_cell * per_cell));
        let (mut tangents, mut tangent_slopes) = ([zero; 3], [zero; 3]);
        if D > 0 {
            for j in 0..3 {
                let (array, lanes) = if D == 1 {
                    (0, [j; LANES])
                } else {
                    (j, self.lanes)
                };
                let state = &work.tangents[array].state;
                let (along, along_slope, _) = at.with_derivatives(state, &lanes);
                let node_by = self.of_lanes(marched.node_by[j]);
                tangents[j] = inside.negative(along - slope * node_by, zero);
                let slope_by = along_slope.times(per_cell) - curvature * node_by;
                tangent_slopes[j] = inside.negative(slope_by, zero);
            }
        }
        SpotEvaluation {
            u: inside.negative(value, zero),
            slope: inside.negative(slope, zero),
            curvature: inside.negative(curvature, zero),
            tangents,
            tangent_slopes,
            ..SpotEvaluation::zero()
        }
    }

    /// Take numbers from the lanes of the march to the spots.
    #[inline(always)]
    fn of_lanes<S: Vector>(&self, v: S) -> V {
        let (numbers, mut own) = (v.lanes(), [0.0; LANES]);
        for (number, &lane) in own.iter_mut().zip(&self.lanes) {
            *number = numbers[lane];
        }
        V::from_lanes(own)
    }

    /// Turn u into V/K less the European V/K.
    #[inline(always)]
    pub fn discounted(&self, u: V) -> V {
        self.bond * u
    }

    /// The most that exercise may earn until expiry, over K.
    #[inline(always)]
    pub fn earned(&self) -> V {
        self.contracts.earned()
    }

    /// The standard deviation of ln S at expiry.
    #[inline(always)]
    pub fn spread(&self) -> V {
        self.contracts.spread
    }

    /// What exercise costs when the boundary leaves its limit at expiry, but for a factor: the less, the more sharply the
    /// boundary turns there; infinite where it begins at the strike.
    #[inline(always)]
    pub fn cost_at_turn(&self) -> V {
        let limit = self.contracts.boundary_at_expiry() / self.contracts.spread;
        limit.negative(self.contracts.dividend * limit * limit, V::all(f64::MAX))
    }

    /// Half the second derivative by x of V/K less the payoff, at the boundary; at least, where the yield is positive.
    #[inline(always)]
    pub fn half_curvature_at_boundary(&self) -> V {
        self.contracts.earned() / (self.contracts.spread * self.contracts.spread)
    }

    /// An upper bound of the premium over K, for a spot above the boundary's limit at expiry.
    ///
    /// Exercise earns at most `earned`, and only where the spot lies below that limit, which no boundary exceeds. With D the
    /// distance of ln(S/K) from it, that is so with probability N(-(D + drift u)/sqrt(u)) at u; and what is earned when
    /// the spot first comes there is worth at most e^{-decay D} times itself, as in the option without expiry. All of it
    /// in units of spread.
    #[inline(always)]
    pub fn premium_bound(&self) -> V {
        let Contracts {
            rate,
            dividend,
            spread,
        } = self.contracts;
        let away = ((self.x - self.contracts.boundary_at_expiry()) / spread).max(V::zero());
        let drift = (rate - dividend) / spread - spread.times(0.5);
        let decay = drift + (drift * drift + rate + rate).sqrt();
        // The probability is largest now, or, where drift > D, less than at u = 1 with the drift D.
        let deviations = (away + drift.min(away)).max(V::zero());
        let exponent = (deviations * deviations).times(0.5).max(decay * away);
        self.contracts.earned() * exp(-exponent)
    }

    /// The differences of the `VALUES` numbers from those of u and its derivatives.
    #[inline(always)]
    pub fn value_differences(&self, difference: &SpotEvaluation<V>) -> [V; VALUES] {
        let scale = self.bond / self.contracts.spread;
        [
            self.bond * difference.u,
            scale * difference.slope,
            scale * difference.curvature / self.contracts.spread,
            V::zero(),
            self.bond * difference.tangents[0],
            self.bond * difference.tangents[1],
            self.bond * difference.tangents[2],
        ]
    }

    /// The `VALUES` numbers from u and its derivatives; those of the payoff where `depth`, ln(S*/S), is not negative.
    #[inline(always)]
    pub fn values(&self, premium: &SpotEvaluation<V>, depth: V) -> [V; VALUES] {
        let inverse = V::all(1.0) / self.contracts.spread;
        let density = self.bond * self.density;
        let by_x = self.bond * premium.slope * inverse;
        let european = self.in_bond - self.in_stock;
        let slope_by_spread = premium.slope * (self.xi * inverse).plus(1.0);
        let (zero, by) = (V::zero(), premium.tangents);
        [
            depth.negative(european + self.bond * premium.u, -expm1(self.x)),
            depth.negative(by_x - self.in_stock, -self.moneyness),
            depth.negative(
                (self.bond * premium.curvature * inverse + density) * inverse - self.in_stock,
                -self.moneyness,
            ),
            european,
            depth.negative(by_x + self.bond * (by[0] - premium.u) - self.in_bond, zero),
            depth.negative(self.bond * by[1] - by_x + self.in_stock, zero),
            depth.negative(self.bond * (by[2] - slope_by_spread) + density, zero),
        ]
    }

    /// The `CROSS` second derivatives from u and its derivatives; zero where `depth`, ln(S*/S), is not negative.
    #[inline(always)]
    pub fn cross_derivatives(&self, premium: &SpotEvaluation<V>, depth: V) -> [V; CROSS] {
        let inverse = V::all(1.0) / self.contracts.spread;
        let premium_scale = self.bond * inverse;
        let density = self.bond * self.density;
        let along = (self.xi * inverse).plus(1.0);
        let [by_rate, by_dividend, by_spread] = premium.tangent_slopes;
        let curvature = premium.curvature * inverse;
        let by_spread = by_spread - premium.curvature * along - premium.slope * inverse;
        let zero = V::zero();
        [
            depth.negative(
                premium_scale * (by_rate + curvature - premium.slope) + density * inverse,
                zero,
            ),
            depth.negative(
                premium_scale * (by_dividend - curvature) + self.in_stock - density * inverse,
                zero,
            ),
            depth.negative(
                premium_scale * by_spread - density * self.xi * inverse,
                zero,
            ),
        ]
    }

    /// The second derivative by the spread of the European V/K.
    #[inline(always)]
    pub fn european_by_spread_twice(&self) -> V {
        self.bond * self.density * self.xi * (self.xi / self.contracts.spread).plus(1.0)
    }

    /// The differences of the `CROSS` second derivatives from those of u and its derivatives.
    #[inline(always)]
    pub fn cross_differences(&self, difference: &SpotEvaluation<V>) -> [V; CROSS] {
        let scale = self.bond / self.contracts.spread;
        difference.tangent_slopes.map(|by| scale * by)
    }
}
