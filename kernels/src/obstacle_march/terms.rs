//! The coefficients of the segment that each lane is in, and the rows that they make.

use super::contract::Segment;
use super::mesh::Grid;
use super::stage::{mass_weights, Obstacle, Stage};
use crate::lanes::vector::{Vector, LANES};

/// The coefficients in each lane.
#[derive(Clone, Copy)]
pub struct Terms {
    /// D in cells^2 a year.
    pub diffusion: [f64; LANES],
    pub peclet: [f64; LANES],
    pub rate: [f64; LANES],
    /// c = `rate_part` - `yield_part` T, T the signed spot; below 0 where the holder may not exercise.
    rate_part: [f64; LANES],
    yield_part: [f64; LANES],
    /// The spot's ratio from a node to the next one, which the rules at the ends need, and one over it.
    ratio: [f64; LANES],
    inverse_ratio: [f64; LANES],
}

impl Terms {
    /// No coefficients yet, on these grids.
    pub fn new(grids: &[Grid]) -> Self {
        let step = |l: usize| grids[l].sign * grids[l].h;
        Self {
            diffusion: [1.0; LANES],
            peclet: [0.0; LANES],
            rate: [0.0; LANES],
            rate_part: [-1.0; LANES],
            yield_part: [0.0; LANES],
            ratio: std::array::from_fn(|l| step(l).exp()),
            inverse_ratio: std::array::from_fn(|l| (-step(l)).exp()),
        }
    }

    /// Take over the coefficients of a segment; return the cell Peclet number.
    pub fn enter(&mut self, lane: usize, segment: &Segment, grid: &Grid) -> f64 {
        let sign = grid.sign;
        let diffusion = 0.5 * segment.volatility * segment.volatility;
        let peclet = sign * segment.drift() * grid.h / diffusion;
        self.diffusion[lane] = diffusion / (grid.h * grid.h);
        self.peclet[lane] = peclet;
        self.rate[lane] = segment.rate;
        let may = segment.exercisable;
        self.rate_part[lane] = if may { sign * segment.rate } else { -1.0 };
        self.yield_part[lane] = if may { segment.dividend_yield } else { 0.0 };
        peclet
    }

    /// Give a lane that holds no contract the coefficients of another.
    pub fn copy_lane(&mut self, from: usize, to: usize) {
        for column in [
            &mut self.diffusion,
            &mut self.peclet,
            &mut self.rate,
            &mut self.rate_part,
            &mut self.yield_part,
        ] {
            column[to] = column[from];
        }
    }

    /// The rows of a stage with this implicit weight in years.
    #[inline(always)]
    pub fn stage<V: Vector>(&self, a: V) -> Stage<V> {
        let diffusion = V::from_lanes(self.diffusion);
        let peclet = V::from_lanes(self.peclet);
        let one = V::all(1.0);
        let spread = a * diffusion;
        let second = (peclet * peclet).times(1.0 / 12.0).plus(1.0) * spread;
        let half = peclet.times(0.5) * spread;
        let growth = V::from_lanes(self.rate).times_plus(a, one);
        let [mass_lower, mass_middle, mass_upper] = mass_weights(peclet);
        let lower = growth * mass_lower - (second - half);
        let diagonal = growth * mass_middle + second.times(2.0);
        let upper = growth * mass_upper - (second + half);
        let near_rule = V::from_lanes(self.inverse_ratio);
        let far_rule = V::from_lanes(self.ratio);
        Stage {
            lower,
            diagonal,
            upper,
            mass_lower,
            mass_middle,
            mass_upper,
            inverse: one / a,
            diffusion,
            spread,
            near_rule,
            far_rule,
            last_lower: lower - upper * far_rule,
            last_diagonal: far_rule.plus(1.0).times_plus(upper, diagonal),
        }
    }

    /// What exercise brings at the nodes at a stage.
    #[inline(always)]
    pub fn obstacle<V: Vector>(&self, stage: &Stage<V>, strike: V) -> Obstacle<V> {
        Obstacle {
            strike,
            rate_part: V::from_lanes(self.rate_part),
            yield_part: V::from_lanes(self.yield_part),
            half_inverse: V::all(0.5) / stage.diffusion,
        }
    }
}
