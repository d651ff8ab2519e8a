//! The coefficients of the segment that each lane is in, and the rows that they make.

use super::contract::{Contract, Segment};
use super::event::hat_weights;
use super::mesh::Grid;
use super::stage::{mass_of, mass_weights, EvenRows, Obstacle, Row, Rows, Stage};
use super::steps::LaneSteps;
use crate::lanes::vector::{Vector, LANES};

/// What the march and its walk back ask of coefficients.
pub trait Terms<V: Vector>: Clone {
    /// The rows that they make.
    type Rows<'t>: Rows<V>
    where
        Self: 't;

    /// Take over the coefficients of a segment.
    fn enter(&mut self, lane: usize, contract: &Contract, number: usize, grid: &Grid);

    /// Give a lane that holds no contract the coefficients of another.
    fn copy_lane(&mut self, from: usize, to: usize);

    /// Make the rows those of a stage of a step; return whether they are others than before. `is_first` says that no other
    /// stage of the step has been asked for yet.
    fn set(&mut self, stage: usize, steps: &LaneSteps<V>, is_first: bool) -> bool;

    /// The rows with an implicit weight in years.
    fn stage(&self, a: V) -> Stage<Self::Rows<'_>, V>;

    /// What exercise brings.
    fn exercise(&self) -> &Exercise;

    /// The coefficients of a lane at the end of its segment.
    fn at_end(&self, lane: usize) -> AtEnd<'_>;

    /// The derivatives of ln D by the volatility, and by a shift of it in ln S, at a node at the stage.
    fn log_diffusion_slopes(&self, node: usize) -> [V; 2];

    /// The derivatives, by the rate, the dividend yield, the volatility and a shift of it, of the sums of the rows from
    /// `first_row` on, given their weights, the values and (1 + a r) V less the base at the nodes.
    fn by_coefficients(
        &self,
        stage: &Stage<Self::Rows<'_>, V>,
        first_row: usize,
        weights: &[V],
        values: &[V],
        forces: &[V],
    ) -> [V; 4];
}

/// The cell Peclet number with its derivatives by the rate and the volatility, where a segment ends.
pub enum AtEnd<'t> {
    /// Everywhere the same, and D as well.
    Even([f64; 3]),
    /// At every node, and D.
    Local(&'t [[f64; 3]], &'t [f64]),
}

impl AtEnd<'_> {
    /// The number and its derivatives at a node.
    pub fn peclet(&self, node: usize) -> [f64; 3] {
        match self {
            Self::Even(numbers) => *numbers,
            Self::Local(numbers, _) => numbers[node],
        }
    }

    /// The weights of M in a row.
    pub fn mass(&self, row: usize) -> [f64; 3] {
        let own = hat_weights(self.peclet(row)[0]);
        match self {
            Self::Even(_) => own,
            Self::Local(_, d) => [
                own[0] * d[row] / d[row - 1],
                own[1],
                own[2] * d[row] / d[row + 1],
            ],
        }
    }

    /// D at a node over D at the nearest of some places, in numbers of nodes.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss
    )]
    pub fn share(&self, node: usize, places: &[f64]) -> f64 {
        let Self::Local(_, d) = self else { return 1.0 };
        let away = |place: f64| (place - node as f64).abs();
        let nearest = places
            .iter()
            .copied()
            .min_by(|a, b| away(*a).total_cmp(&away(*b)));
        nearest.map_or(1.0, |place| {
            let before = (place.max(0.0) as usize).min(d.len() - 2);
            let share = (place - before as f64).clamp(0.0, 1.0);
            d[node] / share.mul_add(d[before + 1] - d[before], d[before])
        })
    }
}

/// What exercise brings in each lane: c = `rate_part` - `yield_part` T, T the signed spot; below 0 where the holder may not.
#[derive(Clone, Copy)]
pub struct Exercise {
    rate_part: [f64; LANES],
    yield_part: [f64; LANES],
}

impl Exercise {
    /// Nobody may exercise.
    pub const NONE: Self = Self {
        rate_part: [-1.0; LANES],
        yield_part: [0.0; LANES],
    };

    /// Take over what a segment allows.
    ///
    /// Where exercise earns nothing at any spot the value never comes down to what it brings: as if the holder might not.
    pub fn enter(&mut self, lane: usize, segment: &Segment, sign: f64) {
        let earns = sign * segment.rate > 0.0 || sign * segment.dividend_yield < 0.0;
        let may = segment.exercisable && earns;
        self.rate_part[lane] = if may { sign * segment.rate } else { -1.0 };
        self.yield_part[lane] = if may { segment.dividend_yield } else { 0.0 };
    }

    /// Give a lane what another has.
    pub fn copy_lane(&mut self, from: usize, to: usize) {
        self.rate_part[to] = self.rate_part[from];
        self.yield_part[to] = self.yield_part[from];
    }

    /// What exercise brings at the nodes at a stage, given the signed strike.
    #[inline(always)]
    pub fn obstacle<V: Vector>(&self, strike: V) -> Obstacle<V> {
        Obstacle {
            strike,
            rate_part: V::from_lanes(self.rate_part),
            yield_part: V::from_lanes(self.yield_part),
        }
    }
}

/// The rules at the ends, the same at all times: the spot's ratio from a node to the one before and to the next.
#[derive(Clone, Copy)]
pub struct EndRules {
    near: [f64; LANES],
    far: [f64; LANES],
    last: usize,
}

impl EndRules {
    pub fn new(grids: &[Grid]) -> Self {
        let step = |l: usize| grids[l].step();
        Self {
            near: std::array::from_fn(|l| (-step(l)).exp()),
            far: std::array::from_fn(|l| step(l).exp()),
            last: grids[0].cells - 1,
        }
    }

    /// A stage of these rows.
    #[inline(always)]
    pub fn stage<R: Rows<V>, V: Vector>(&self, rows: R, a: V, growth: V) -> Stage<R, V> {
        let rules = [V::from_lanes(self.near), V::from_lanes(self.far)];
        Stage::new(rows, self.last, a, growth, rules)
    }
}

/// Coefficients that depend neither on the place nor, within a segment, on the time.
#[derive(Clone, Copy)]
pub struct EvenTerms {
    exercise: Exercise,
    ends: EndRules,
    /// D in cells^2 a year.
    diffusion: [f64; LANES],
    peclet: [f64; LANES],
    rate: [f64; LANES],
    /// The derivatives of the cell Peclet number by the rate and the volatility, and of ln D by the volatility.
    by_rate: [f64; LANES],
    by_volatility: [f64; LANES],
    log_slope: [f64; LANES],
}

impl EvenTerms {
    /// No coefficients yet, on these grids.
    pub fn new(grids: &[Grid]) -> Self {
        Self {
            exercise: Exercise::NONE,
            ends: EndRules::new(grids),
            diffusion: [1.0; LANES],
            peclet: [0.0; LANES],
            rate: [0.0; LANES],
            by_rate: [0.0; LANES],
            by_volatility: [0.0; LANES],
            log_slope: [0.0; LANES],
        }
    }
}

impl<V: Vector> Terms<V> for EvenTerms {
    type Rows<'t> = EvenRows<V>;

    fn enter(&mut self, lane: usize, contract: &Contract, number: usize, grid: &Grid) {
        let segment = &contract.segments[number];
        let (step, volatility) = (grid.step(), segment.volatility);
        let diffusion = 0.5 * volatility * volatility;
        let peclet = segment.drift() * step / diffusion;
        self.diffusion[lane] = diffusion / (grid.h * grid.h);
        self.peclet[lane] = peclet;
        self.rate[lane] = segment.rate;
        self.by_rate[lane] = step / diffusion;
        self.by_volatility[lane] = -(step + peclet) * volatility / diffusion;
        self.log_slope[lane] = 2.0 / volatility;
        self.exercise.enter(lane, segment, contract.sign);
    }

    fn copy_lane(&mut self, from: usize, to: usize) {
        self.exercise.copy_lane(from, to);
        for column in [&mut self.diffusion, &mut self.peclet, &mut self.rate] {
            column[to] = column[from];
        }
    }

    #[inline(always)]
    fn set(&mut self, _stage: usize, _steps: &LaneSteps<V>, is_first: bool) -> bool {
        is_first
    }

    #[inline(always)]
    fn stage(&self, a: V) -> Stage<EvenRows<V>, V> {
        let diffusion = V::from_lanes(self.diffusion);
        let peclet = V::from_lanes(self.peclet);
        let one = V::all(1.0);
        let spread = a * diffusion;
        let second = (peclet * peclet).times(1.0 / 12.0).plus(1.0) * spread;
        let half = peclet.times(0.5) * spread;
        let growth = V::from_lanes(self.rate).times_plus(a, one);
        let mass = mass_weights(peclet);
        let row = Row {
            lower: growth * mass[0] - (second - half),
            diagonal: growth * mass[1] + second.times(2.0),
            upper: growth * mass[2] - (second + half),
            mass,
            spread,
            half_inverse: V::all(0.5) / diffusion,
        };
        self.ends.stage(EvenRows(row), a, growth)
    }

    fn exercise(&self) -> &Exercise {
        &self.exercise
    }

    fn at_end(&self, lane: usize) -> AtEnd<'_> {
        AtEnd::Even([
            self.peclet[lane],
            self.by_rate[lane],
            self.by_volatility[lane],
        ])
    }

    #[inline(always)]
    fn log_diffusion_slopes(&self, _node: usize) -> [V; 2] {
        [V::from_lanes(self.log_slope), V::zero()]
    }

    #[inline(always)]
    fn by_coefficients(
        &self,
        stage: &Stage<EvenRows<V>, V>,
        first_row: usize,
        weights: &[V],
        values: &[V],
        forces: &[V],
    ) -> [V; 4] {
        let zero = V::zero();
        let row = stage.rows.0;
        let (mut mass, mut second, mut first, mut tilt) = (zero, zero, zero, zero);
        let (values, forces) = (&values[first_row - 1..], &forces[first_row - 1..]);
        let triples = values.windows(3).zip(forces.windows(3));
        for (weight, (v, f)) in weights[first_row..].iter().zip(triples) {
            mass = weight.times_plus(mass_of(row.mass, [v[0], v[1], v[2]]), mass);
            second = weight.times_plus(v[0] + v[2] - v[1].times(2.0), second);
            first = weight.times_plus(v[2] - v[0], first);
            tilt = weight.times_plus(f[2] - f[0], tilt);
        }
        let (peclet, spread) = (V::from_lanes(self.peclet), row.spread);
        first = first.times(0.5);
        let by_peclet =
            spread * (peclet.times(1.0 / 6.0) * second + first) - tilt.times(1.0 / 24.0);
        let by_log_diffusion =
            spread * ((peclet * peclet).times(1.0 / 12.0).plus(1.0) * second + peclet * first);
        let by_drift = by_peclet * V::from_lanes(self.by_rate);
        let by_volatility = by_peclet * V::from_lanes(self.by_volatility)
            + by_log_diffusion * V::from_lanes(self.log_slope);
        [by_drift - stage.a * mass, -by_drift, by_volatility, zero]
    }
}
