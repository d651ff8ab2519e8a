//! Coefficients that depend on the place and the time: those of a local volatility.
//!
//! With F = (`V_tau` + r V - u)/D and p = m/D the equation is V'' + p V' = F, with the derivatives by the number of the
//! node. The compact scheme of fourth order for it takes F at three nodes with M's weights, and of V
//! (1 + (2 p' + p^2)/12) times the second difference and p + (p'' + p p')/12 times the first; each row here is D times
//! that. p' and p'' are differences of p.

use super::contract::Contract;
use super::mesh::Grid;
use super::stage::{mass_of, mass_weights, LocalRows, Row, Rows, Stage};
use super::steps::LaneSteps;
use super::surface::Moment;
use super::tableau::GAMMA;
use super::terms::{AtEnd, EndRules, Exercise, Terms};
use crate::lanes::vector::{Vector, LANES};

/// The least volatility, as a share of what stands for it in the segment: the equation divides by its square.
const LEAST: f64 = 1e-3;

/// What a lane's contract is at.
#[derive(Clone)]
struct Lane {
    /// The segment, and its end in years from now.
    number: usize,
    end: f64,
    /// The surface's times whose volatilities are in `before` and `behind`.
    known: Option<(usize, usize)>,
    share: f64,
    /// The cell Peclet number and D at the nodes at the segment's end, with the derivatives of the first.
    peclet: Vec<[f64; 3]>,
    diffusion: Vec<f64>,
}

/// The coefficients of up to a vector of contracts.
#[derive(Clone)]
pub struct LocalTerms<'a, V> {
    contracts: Vec<Contract<'a>>,
    grids: Vec<Grid>,
    exercise: Exercise,
    ends: EndRules,
    lanes: Vec<Lane>,
    rate: [f64; LANES],
    /// Rate less dividend yield.
    carry: [f64; LANES],
    /// The volatilities at the nodes at the surface's times before and behind the stage's.
    before: Vec<[f64; LANES]>,
    behind: Vec<[f64; LANES]>,
    /// By how much ln S changes from a node to the next, and one over the square of that.
    step: V,
    per_square: V,
    /// At the nodes at the stage: the derivatives of D by the volatility and by a shift of it in ln S, D, 1/D, and p with its
    /// differences.
    slope: Vec<V>,
    shift: Vec<V>,
    diffusion: Vec<V>,
    inverse: Vec<V>,
    peclet: Vec<V>,
    peclet_slope: Vec<V>,
    peclet_bend: Vec<V>,
    rows: Vec<Row<V>>,
}

impl<'a, V: Vector> LocalTerms<'a, V> {
    /// No coefficients yet, of these contracts on these grids.
    pub fn new(contracts: &[Contract<'a>], grids: &[Grid]) -> Self {
        let nodes = grids[0].cells + 1;
        let array = || vec![V::zero(); nodes];
        let of_grid = |of: fn(&Grid) -> f64| V::from_lanes(std::array::from_fn(|l| of(&grids[l])));
        let row = Row {
            lower: V::zero(),
            diagonal: V::zero(),
            upper: V::zero(),
            mass: [V::zero(); 3],
            spread: V::zero(),
            half_inverse: V::zero(),
        };
        let lane = Lane {
            number: usize::MAX,
            end: 0.0,
            known: None,
            share: 0.0,
            peclet: vec![[0.0; 3]; nodes],
            diffusion: vec![1.0; nodes],
        };
        Self {
            contracts: contracts.to_vec(),
            grids: grids.to_vec(),
            exercise: Exercise::NONE,
            ends: EndRules::new(grids),
            lanes: vec![lane; contracts.len()],
            rate: [0.0; LANES],
            carry: [0.0; LANES],
            before: vec![[1.0; LANES]; nodes],
            behind: vec![[1.0; LANES]; nodes],
            step: of_grid(Grid::step),
            per_square: of_grid(|grid| 1.0 / (grid.h * grid.h)),
            slope: array(),
            shift: array(),
            diffusion: array(),
            inverse: array(),
            peclet: array(),
            peclet_slope: array(),
            peclet_bend: array(),
            rows: vec![row; nodes],
        }
    }

    /// Take in the volatilities next to a time of a lane.
    fn look_up(&mut self, lane: usize, at: Moment) {
        let (contract, grid) = (&self.contracts[lane], &self.grids[lane]);
        let Some(local) = contract.local else { return };
        let own = &mut self.lanes[lane];
        let of_segment = contract.segments[own.number].volatility;
        let least = LEAST * of_segment;
        let at_time =
            |number: usize, node: usize| local.at_time(number, grid.x(node), of_segment).max(least);
        for (node, (before, behind)) in self.before.iter_mut().zip(&mut self.behind).enumerate() {
            behind[lane] = match own.known {
                Some((known, _)) if known == at.behind => before[lane],
                _ => at_time(at.behind, node),
            };
            before[lane] = if at.before == at.behind {
                behind[lane]
            } else {
                at_time(at.before, node)
            };
        }
        own.known = Some((at.before, at.behind));
    }

    /// Make the coefficients at the nodes from the volatilities next to the stage's time.
    #[inline(always)]
    fn set_coefficients(&mut self) {
        let last = self.lanes[0].diffusion.len() - 1;
        let mut share = [0.0; LANES];
        for (share, lane) in share.iter_mut().zip(&self.lanes) {
            *share = lane.share;
        }
        let (share, step, per_square) = (V::from_lanes(share), self.step, self.per_square);
        // m = step carry/h^2 - step D, with D in cells^2 a year
        let drift = step * V::from_lanes(self.carry) * per_square;
        let one = V::all(1.0);
        for node in 0..=last {
            let (before, behind) = (
                V::from_lanes(self.before[node]),
                V::from_lanes(self.behind[node]),
            );
            let square = share.times_plus(behind * behind - before * before, before * before);
            let diffusion = square * per_square.times(0.5);
            let inverse = one / diffusion;
            // of the mean of two squares, both volatilities changed by the same
            self.slope[node] = share.times_plus(behind - before, before) * per_square;
            (self.diffusion[node], self.inverse[node]) = (diffusion, inverse);
            self.peclet[node] = drift * inverse - step;
        }
        differences(&self.diffusion, &mut self.shift);
        let per_step = -one / step;
        for shift in &mut self.shift {
            *shift = *shift * per_step;
        }
        differences(&self.peclet, &mut self.peclet_slope);
        differences(&self.peclet_slope, &mut self.peclet_bend);
        for row in 1..last {
            let own = self.diffusion[row];
            let mut mass = mass_weights(self.peclet[row]);
            mass[0] = mass[0] * (own * self.inverse[row - 1]);
            mass[2] = mass[2] * (own * self.inverse[row + 1]);
            self.rows[row].mass = mass;
            self.rows[row].half_inverse = self.inverse[row].times(0.5);
        }
    }

    /// What multiplies the second and the first difference in a row, over D.
    #[inline(always)]
    fn operator(&self, row: usize) -> (V, V) {
        let (p, slope, bend) = (
            self.peclet[row],
            self.peclet_slope[row],
            self.peclet_bend[row],
        );
        let second = (slope.times(2.0) + p * p).times(1.0 / 12.0).plus(1.0);
        let first = (bend + p * slope).times(1.0 / 12.0) + p;
        (second, first)
    }

    /// Make the rows of the implicit weight.
    #[inline(always)]
    fn set_rows(&mut self, a: V) {
        let growth = V::from_lanes(self.rate).times_plus(a, V::all(1.0));
        for row in 1..self.diffusion.len() - 1 {
            let spread = a * self.diffusion[row];
            let (second, first) = self.operator(row);
            let (second, half) = (second * spread, first.times(0.5) * spread);
            let own = &mut self.rows[row];
            own.lower = growth * own.mass[0] - (second - half);
            own.diagonal = growth * own.mass[1] + second.times(2.0);
            own.upper = growth * own.mass[2] - (second + half);
            own.spread = spread;
        }
    }
}

impl<V: Vector> Terms<V> for LocalTerms<'_, V> {
    type Rows<'t>
        = LocalRows<'t, V>
    where
        Self: 't;

    fn enter(&mut self, lane: usize, _contract: &Contract, number: usize, _grid: &Grid) {
        if self.lanes[lane].number == number {
            return;
        }
        let (contract, grid) = (self.contracts[lane], self.grids[lane]);
        let segment = &contract.segments[number];
        let own = &mut self.lanes[lane];
        let end = contract.end_of(number);
        (own.number, own.end, own.known) = (number, end, None);
        self.rate[lane] = segment.rate;
        self.carry[lane] = segment.rate - segment.dividend_yield;
        self.exercise.enter(lane, segment, contract.sign);
        let (step, least) = (grid.step(), LEAST * segment.volatility);
        for (node, (peclet, diffusion)) in own.peclet.iter_mut().zip(&mut own.diffusion).enumerate()
        {
            let variance = contract.variance(end, grid.x(node), segment.volatility);
            let variance = variance.max(least * least);
            *diffusion = 0.5 * variance;
            let p = step * (self.carry[lane] / *diffusion - 1.0);
            let by_volatility = -(step + p) * variance.sqrt() / *diffusion;
            *peclet = [p, step / *diffusion, by_volatility];
        }
    }

    fn copy_lane(&mut self, from: usize, to: usize) {
        self.exercise.copy_lane(from, to);
        self.rate[to] = self.rate[from];
        self.carry[to] = self.carry[from];
    }

    #[inline(always)]
    #[allow(clippy::float_cmp)] // the same moment
    fn set(&mut self, stage: usize, steps: &LaneSteps<V>, is_first: bool) -> bool {
        let mut moved = false;
        for lane in 0..self.contracts.len() {
            let Some(local) = self.contracts[lane].local else {
                continue;
            };
            let own = &self.lanes[lane];
            let at = local.surface.moment(own.end - steps.years[stage][lane]);
            let is_other = own.known != Some((at.before, at.behind));
            moved |= is_other || (at.before != at.behind && own.share != at.share);
            if is_other {
                self.look_up(lane, at);
            }
            self.lanes[lane].share = at.share;
        }
        if moved {
            self.set_coefficients();
        }
        let is_other = moved || is_first;
        if is_other {
            self.set_rows(steps.dt.times(GAMMA));
        }
        is_other
    }

    #[inline(always)]
    fn stage(&self, a: V) -> Stage<LocalRows<'_, V>, V> {
        let growth = V::from_lanes(self.rate).times_plus(a, V::all(1.0));
        self.ends.stage(LocalRows(&self.rows), a, growth)
    }

    fn exercise(&self) -> &Exercise {
        &self.exercise
    }

    fn at_end(&self, lane: usize) -> AtEnd<'_> {
        AtEnd::Local(&self.lanes[lane].peclet, &self.lanes[lane].diffusion)
    }

    #[inline(always)]
    fn log_diffusion_slopes(&self, node: usize) -> [V; 2] {
        let inverse = self.inverse[node];
        [self.slope[node] * inverse, self.shift[node] * inverse]
    }

    /// By the chain rule: the rows by D, p and p's differences at every node, these by p, and D and p by the numbers.
    #[inline(always)]
    fn by_coefficients(
        &self,
        stage: &Stage<LocalRows<'_, V>, V>,
        first_row: usize,
        weights: &[V],
        values: &[V],
        forces: &[V],
    ) -> [V; 4] {
        let last = values.len() - 1;
        let (zero, a) = (V::zero(), stage.a);
        let array = || vec![zero; last + 1];
        let (mut by_diffusion, mut by_peclet) = (array(), array());
        let (mut by_slope, mut by_bend) = (array(), array());
        let mut mass = zero;
        for row in first_row..last {
            let own = self.diffusion[row];
            let weight = weights[row] * own;
            let f = [
                forces[row - 1] * self.inverse[row - 1],
                forces[row] * self.inverse[row],
                forces[row + 1] * self.inverse[row + 1],
            ];
            let v = [values[row - 1], values[row], values[row + 1]];
            let second = v[0] + v[2] - v[1].times(2.0);
            let first = (v[2] - v[0]).times(0.5);
            let p = self.peclet[row];
            let parts = mass_weights(p);
            let (of_second, of_first) = self.operator(row);
            // What the row leaves to the obstacle, over D: 0 outside its cells.
            let rest = mass_of(parts, f) - a * (of_second * second + of_first * first);
            by_diffusion[row] = by_diffusion[row] - weights[row] * rest;
            for (k, part) in parts.into_iter().enumerate() {
                let node = row + k - 1;
                by_diffusion[node] =
                    (weight * part * f[k]).times_plus(self.inverse[node], by_diffusion[node]);
            }
            let by_p = a
                * (p.times(1.0 / 6.0) * second
                    + self.peclet_slope[row].times(1.0 / 12.0).plus(1.0) * first);
            by_peclet[row] = weight * (by_p - (f[2] - f[0]).times(1.0 / 24.0));
            by_slope[row] = weight * a * (second.times(1.0 / 6.0) + p.times(1.0 / 12.0) * first);
            by_bend[row] = weight * a * first.times(1.0 / 12.0);
            mass = weights[row].times_plus(mass_of(stage.rows.at(row).mass, v), mass);
        }
        add_transposed_differences(&by_bend, &mut by_slope);
        add_transposed_differences(&by_slope, &mut by_peclet);
        let (mut by_carry, mut by_volatility, mut by_shift) = (zero, zero, zero);
        for node in 0..=last {
            let own = by_peclet[node] * self.inverse[node];
            by_carry = by_carry + own;
            let by_own = by_diffusion[node] - own * (self.peclet[node] + self.step);
            by_volatility = by_own.times_plus(self.slope[node], by_volatility);
            by_shift = by_own.times_plus(self.shift[node], by_shift);
        }
        let by_carry = by_carry * self.step * self.per_square;
        [by_carry - a * mass, -by_carry, by_volatility, by_shift]
    }
}

/// The differences of numbers at nodes: central ones, one-sided at the ends.
#[inline(always)]
fn differences<V: Vector>(of: &[V], into: &mut [V]) {
    let last = of.len() - 1;
    for node in 1..last {
        into[node] = (of[node + 1] - of[node - 1]).times(0.5);
    }
    into[0] = of[1] - of[0];
    into[last] = of[last] - of[last - 1];
}

/// Add the transposed of `differences`.
#[inline(always)]
fn add_transposed_differences<V: Vector>(of: &[V], into: &mut [V]) {
    let last = of.len() - 1;
    for node in 1..last {
        let half = of[node].times(0.5);
        into[node + 1] = into[node + 1] + half;
        into[node - 1] = into[node - 1] - half;
    }
    into[1] = into[1] + of[0];
    into[0] = into[0] - of[0];
    into[last] = into[last] + of[last];
    into[last - 1] = into[last - 1] - of[last];
}
