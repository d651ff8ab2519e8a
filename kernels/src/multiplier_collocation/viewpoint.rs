//! Places that a profile is seen from, with the adjoint weights of value and slope there, from which those of the profile follow.
//!
//! The propagated value V = e^{sL} profile depends on the parameters as its equation says. L has constant coefficients, so
//! that its derivatives commute with e^{sL}: by the volatility sigma, the rate and the yield V changes by
//! `s sigma (V_xx - V_x)`, `s (V_x - V)` and `-s V_x`.

use super::gradient::{add, SegmentGradient, Weights, FUNCTIONALS};
use super::profile::{EndBlock, Piece, Profile};
use super::propagation::{load, Transition};
use super::segment::Dynamics;
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::normal::{exp, weighted_normal, ONE_OVER_SQRT_TWO_PI};
use crate::lanes::vector::{sum_of_lanes, Vector, LANES};

/// The largest |z| at which a normal distribution function is evaluated; chosen: it is 0 or 1 beyond.
const FAR: f64 = 37.0;
/// The smallest weight of a viewpoint that counts; chosen: the sum of all is about one.
const NEGLIGIBLE: f64 = 1e-16;

/// A place x, a time s before the profile's.
#[derive(Clone, Copy, Debug)]
pub struct Viewpoint {
    pub x: f64,
    pub s: f64,
    /// The adjoint weights of the value there.
    pub value: Weights,
    /// The adjoint weights of the slope there.
    pub slope: Weights,
}

impl Viewpoint {
    /// A place where the value alone counts.
    pub fn of_value(x: f64, s: f64, value: Weights) -> Viewpoint {
        Viewpoint {
            x,
            s,
            value,
            slope: [0.0; FUNCTIONALS],
        }
    }

    /// Whether neither the value nor the slope counts for more than rounding.
    pub fn is_negligible(&self) -> bool {
        let mut weights = self.value.iter().chain(&self.slope);
        weights.all(|weight| weight.abs() < NEGLIGIBLE)
    }

    /// Whether the slope counts.
    pub fn has_slope(&self) -> bool {
        self.slope.iter().any(|weight| *weight != 0.0)
    }

    /// Add what the functionals change by the parameters, given the propagated value and its derivatives by x.
    fn add_to(&self, gradient: &mut SegmentGradient, dynamics: &Dynamics, seen: &[f64; 4]) {
        let (s, by_volatility) = (self.s, self.s * dynamics.volatility);
        for (k, weights) in [(0, &self.value), (1, &self.slope)] {
            add(
                &mut gradient.volatility,
                by_volatility * (seen[k + 2] - seen[k + 1]),
                weights,
            );
            add(&mut gradient.rate, s * (seen[k + 1] - seen[k]), weights);
            add(&mut gradient.dividend, -s * seen[k + 1], weights);
        }
    }
}

/// The derivative of each functional by a profile's value at its nodes, per unit of x; filled up as the nodes are.
pub type Densities = [Vec<f64>; FUNCTIONALS];

/// See a profile from the viewpoints; what the functionals change by the parameters is added to `gradient`.
pub fn see_profile(
    profile: &Profile,
    dynamics: &Dynamics,
    views: &[Viewpoint],
    gradient: &mut SegmentGradient,
) -> Densities {
    let mut densities = std::array::from_fn(|_| vec![0.0; profile.nodes.len()]);
    dispatch(Seeing {
        profile,
        dynamics,
        views,
        densities: &mut densities,
        gradient,
    });
    densities
}

struct Seeing<'a> {
    profile: &'a Profile,
    dynamics: &'a Dynamics,
    views: &'a [Viewpoint],
    densities: &'a mut Densities,
    gradient: &'a mut SegmentGradient,
}

impl Work for Seeing<'_> {
    type Result = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let profile = self.profile;
        let mut transition = Transition::new(self.dynamics, self.views[0].s);
        let mut s = self.views[0].s;
        for view in self.views {
            if view.is_negligible() {
                continue;
            }
            if view.s.to_bits() != s.to_bits() {
                s = view.s;
                transition = Transition::new(self.dynamics, s);
            }
            let Transition {
                inverse,
                shift,
                bond,
                ..
            } = transition;
            let centre = view.x + shift;
            let scale = ONE_OVER_SQRT_TWO_PI * bond * inverse;
            let mut moments = [V::zero(); 4];
            for start in (0..profile.nodes.len()).step_by(LANES) {
                let Some(z) = profile.distances::<V>(start, centre, inverse) else {
                    continue;
                };
                let density = exp((z * z).times(-0.5)).times(scale);
                let mut mass = density * load::<V>(&profile.weighted[start..]);
                for moment in &mut moments {
                    *moment = *moment + mass;
                    mass = mass * z;
                }
                for k in 0..FUNCTIONALS {
                    let there = &mut self.densities[k][start..start + LANES];
                    let weight = z.times(view.slope[k] * inverse).plus(view.value[k]);
                    let total = weight.times_plus(density, load::<V>(there));
                    there.copy_from_slice(&total.lanes());
                }
            }
            let [zeroth, first, second, third] = moments.map(sum_of_lanes);
            let panels = [
                zeroth,
                first * inverse,
                (second - zeroth) * inverse * inverse,
                (third - 3.0 * first) * inverse * inverse * inverse,
            ];
            let pieces = see_pieces::<V>(profile, &transition, view.x);
            let seen = std::array::from_fn(|order| panels[order] + pieces[order]);
            view.add_to(self.gradient, self.dynamics, &seen);
        }
    }
}

/// The propagated value of the pieces at x and its first three derivatives.
#[inline(always)]
fn see_pieces<V: Vector>(profile: &Profile, transition: &Transition, x: f64) -> [f64; 4] {
    let &Transition {
        spread,
        inverse,
        shift,
        bond,
        discount,
    } = transition;
    let (centre, stock) = (x + shift, x.exp() * discount);
    let mut sums = [V::zero(); 4];
    let in_stocks = V::from_lanes(EndBlock::SLOPES);
    let wholes = in_stocks.times_plus(V::all(stock - bond), V::all(bond));
    for block in &profile.end_blocks {
        let z = V::from_lanes(block.places).plus(-centre).times(inverse);
        let density = exp((z * z).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI * bond);
        let there = density * V::from_lanes(block.spots);
        let d = z + in_stocks.times(-spread);
        let part = V::from_lanes(block.amounts) * weighted_normal(d, there, wholes);
        let in_stock = part * in_stocks;
        let height = V::from_lanes(block.heights) * density.times(inverse);
        let slope = z.times(inverse);
        let bend = height * slope;
        // The height is a normal density of x: its derivatives are Hermite polynomials in z.
        let first = in_stock - height;
        let second = in_stock - height * in_stocks - bend;
        let bent = (bend * slope) - height.times(inverse * inverse);
        let third = in_stock - (height + bend) * in_stocks - bent;
        for (sum, part) in sums.iter_mut().zip([part, first, second, third]) {
            *sum = *sum + part;
        }
    }
    let far_right = profile.slope * stock;
    let mut found = sums.map(|sum| sum_of_lanes(sum) + far_right);
    found[0] += profile.constant * bond;
    found
}

/// The derivative of each functional by the constant of a piece, or by its slope.
pub fn weight_of_piece(
    piece: &Piece,
    dynamics: &Dynamics,
    views: &[Viewpoint],
    of: Coefficient,
) -> Weights {
    let mut total = [0.0; FUNCTIONALS];
    for (place, sign) in [(piece.upper, 1.0), (piece.lower, -1.0)] {
        if place == f64::NEG_INFINITY {
            continue;
        }
        let below = dispatch(Below {
            place,
            dynamics,
            views,
            of,
        });
        add(&mut total, sign, &below);
    }
    total
}

/// One of the two numbers of a piece.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Coefficient {
    Constant,
    Slope,
}

/// The derivative of each functional by a constant below a place, which may be infinity, or by a slope.
struct Below<'a> {
    place: f64,
    dynamics: &'a Dynamics,
    views: &'a [Viewpoint],
    of: Coefficient,
}

impl Work for Below<'_> {
    type Result = Weights;

    #[inline(always)]
    fn run<V: Vector>(self) -> Weights {
        let dynamics = self.dynamics;
        let is_slope = self.of == Coefficient::Slope;
        let mut totals = [V::zero(); FUNCTIONALS];
        for views in self.views.chunks(LANES) {
            let lanes = |of: &dyn Fn(&Viewpoint) -> f64, rest: f64| {
                let mut lanes = [rest; LANES];
                for (lane, view) in lanes.iter_mut().zip(views) {
                    *lane = of(view);
                }
                V::from_lanes(lanes)
            };
            let (x, s) = (lanes(&|view| view.x, 0.0), lanes(&|view| view.s, 1.0));
            let spread = s.sqrt().times(dynamics.volatility);
            let inverse = V::all(1.0) / spread;
            let bond = exp(s.times(-dynamics.rate));
            let z = (V::all(self.place.min(f64::MAX)) - x - s.times(dynamics.drift())) * inverse;
            let z = z.max(V::all(-FAR)).min(V::all(FAR));
            let density = exp((z * z).times(-0.5)).times(ONE_OVER_SQRT_TWO_PI) * bond;
            // For a slope, e^x n(z - spread) e^{-q s} = e^place n(z) e^{-r s}.
            let (mass, density) = if is_slope {
                let stock = exp(x - s.times(dynamics.dividend));
                let density = if self.place < f64::INFINITY {
                    density.times(self.place.exp())
                } else {
                    V::zero()
                };
                (weighted_normal(z - spread, density, stock), density)
            } else {
                (weighted_normal(z, density, bond), density)
            };
            let mut by_x = V::zero() - density * inverse;
            if is_slope {
                by_x = by_x + mass;
            }
            for (k, total) in totals.iter_mut().enumerate() {
                let value = lanes(&|view| view.value[k], 0.0);
                let slope = lanes(&|view| view.slope[k], 0.0);
                *total = *total + value * mass + slope * by_x;
            }
        }
        totals.map(sum_of_lanes)
    }
}
