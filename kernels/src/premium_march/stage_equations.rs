//! The equations of one stage at the nodes: right-hand side, elimination from the far end, substitution from the
//! boundary.

use super::grid_values::GridValues;
use super::mesh::TimeStep;
use super::wiener_hopf::WienerHopf;
use crate::lanes::vector::Vector;

impl<V: Vector> GridValues<V> {
    /// Eliminate from the far end: y with kappa (1 - rho E) y = m rhs at the nodes 1 to `active`, zero beyond, left in
    /// the stage. `source` times `multiple` is added to m rhs/kappa where S.
    #[inline(always)]
    pub fn eliminate<const S: bool>(
        &mut self,
        stage: usize,
        weights: &[f64; 4],
        matrix: &WienerHopf<V>,
        active: usize,
        (source, multiple): (&[V], V),
    ) {
        let (known, found) = self.stages.split_at_mut(stage);
        let rhs = RightHandSide::new(weights, active, &self.state, &self.increment, known);
        let eliminated = &mut found[0][..=active];
        let (mut above, mut here) = (rhs.at(active + 1), rhs.at(active));
        let mut y = V::zero();
        for i in (1..=active).rev() {
            let below = rhs.at(i - 1);
            let mut mean = matrix.middle.times_plus(here, matrix.upper * above);
            if S {
                mean = multiple.times_plus(source[i], mean);
            }
            y = matrix
                .rho
                .times_plus(y, matrix.lower.times_plus(below, mean));
            eliminated[i] = y;
            (above, here) = (here, below);
        }
    }

    /// Substitute from the boundary: `u_0` = `contact`, `u_i` = `y_i` + pi `u_{i-1}`; beyond `active` u stays as it was,
    /// and is zero after the last stage.
    #[inline(always)]
    pub fn substitute(&mut self, stage: usize, matrix: &WienerHopf<V>, active: usize, contact: V) {
        if stage < 2 {
            self.stages[stage][active + 1] = self.state[active + 1];
        } else {
            self.stages[stage][active + 1..].fill(V::zero());
        }
        let found = &mut self.stages[stage][..=active];
        let mut u = contact;
        found[0] = u;
        for node in &mut found[1..] {
            u = matrix.pi.times_plus(u, *node);
            *node = u;
        }
    }

    /// Make the last stage, with these weights, the state, and keep what it added to its right-hand side as the
    /// increment, for the next step.
    #[inline(always)]
    pub fn finish(&mut self, step: &TimeStep, weights: &[f64; 4]) {
        if !step.last {
            let [first, second, last] = &self.stages;
            for i in 0..=step.active {
                let increment = self.increment[i];
                let sum = weighted(2, weights, [self.state[i], increment, first[i], second[i]]);
                self.increment[i] = last[i] - sum;
            }
        }
        std::mem::swap(&mut self.state, &mut self.stages[2]);
    }
}

/// The right-hand side of a stage at one node, from the state, the increment and the stages before.
#[inline(always)]
fn weighted<V: Vector>(stage: usize, weights: &[f64; 4], known: [V; 4]) -> V {
    let [state, increment, first, second] = known;
    let mut sum = state.times_plus(V::all(weights[0]), increment.times(weights[1]));
    if stage > 0 {
        sum = first.times_plus(V::all(weights[2]), sum);
    }
    if stage > 1 {
        sum = second.times_plus(V::all(weights[3]), sum);
    }
    sum
}

/// The right-hand side of a stage.
pub struct RightHandSide<'a, V> {
    /// The number of the stage, from 0.
    stage: usize,
    weights: &'a [f64; 4],
    /// The state, the increment and the first two stages; those not known yet are not read.
    arrays: [&'a [V]; 4],
}

impl<'a, V: Vector> RightHandSide<'a, V> {
    /// The right-hand side of the stage behind `stages`.
    #[inline(always)]
    pub fn new(
        weights: &'a [f64; 4],
        active: usize,
        state: &'a [V],
        increment: &'a [V],
        stages: &'a [Vec<V>],
    ) -> Self {
        let nodes = active + 2;
        let state = &state[..nodes];
        let first = stages.first().map_or(state, |v| &v[..nodes]);
        let second = stages.get(1).map_or(state, |v| &v[..nodes]);
        Self {
            stage: stages.len(),
            weights,
            arrays: [state, &increment[..nodes], first, second],
        }
    }

    #[inline(always)]
    fn at(&self, i: usize) -> V {
        let [state, increment, first, second] = self.arrays;
        weighted(
            self.stage,
            self.weights,
            [state[i], increment[i], first[i], second[i]],
        )
    }
}

/// Fill in minus the derivative of a stage's equations, divided by kappa, by the speed of the nodes, at the solved u.
#[inline(always)]
pub fn speed_source<V: Vector>(
    rhs: &RightHandSide<V>,
    u: &[V],
    matrix: &WienerHopf<V>,
    found: &mut [V],
) {
    let active = u.len() - 2;
    let mut above = u[active + 1] - rhs.at(active + 1);
    let mut here = u[active] - rhs.at(active);
    for i in (1..=active).rev() {
        let below = u[i - 1] - rhs.at(i - 1);
        let second = (u[i + 1] - u[i]) - (u[i] - u[i - 1]);
        let advection = (u[i + 1] - u[i - 1]) * matrix.advection_by_speed;
        let mean = (above - below).times_plus(matrix.mean_by_speed, advection);
        found[i] = second.times_plus(matrix.diffusion_by_speed, mean);
        (above, here) = (here, below);
    }
}
