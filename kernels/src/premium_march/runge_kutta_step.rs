//! One Runge-Kutta step: where the nodes go, the stages, and what they say of the boundary.

use super::boundary_history::BoundaryHistory;
use super::contracts::Contracts;
use super::first_step::{first_boundary, FirstNode};
use super::grid_values::Workspace;
use super::mesh::TimeStep;
use super::obstacle::TimeFactors;
use super::stages::{Differentiation, SolvedCells, Stages};
use super::tableau::STAGE;
use crate::lanes::vector::{Part, Vector, LANES};

/// The largest distance between boundary and node 0 of an accepted step, in sqrt(t); chosen: beyond it the Taylor series
/// of the cell is too short.
const ACCEPTED_OFFSET: f64 = 0.5;
/// The largest number of times that a step is taken with corrected places of the nodes; chosen.
const TRIES: usize = 8;

/// Take the step, again with a corrected place of node 0 where the boundary turned out too far from it; return which
/// lanes were accepted.
pub struct RungeKuttaStep<'a, V, const D: usize> {
    pub step: &'a TimeStep<'a>,
    pub contracts: &'a Contracts<V>,
    pub history: &'a mut BoundaryHistory<V>,
    /// Node 0 before the step, and after it.
    pub node: &'a mut FirstNode<V>,
    /// xi of the boundary after the first step of the march with half as many steps, which ends where the second step
    /// of this one does; None without such a march.
    pub coarser_first: Option<V>,
    pub work: &'a mut Workspace<V>,
}

impl<V: Vector, const D: usize> Part<V> for RungeKuttaStep<'_, V, D> {
    type Result = [bool; LANES];

    #[inline(always)]
    fn run(self) -> [bool; LANES] {
        let Self {
            step,
            contracts,
            history,
            node,
            coarser_first,
            work,
        } = self;
        let t = step.root * step.root;
        let h = t - node.root * node.root;
        let moved = history.drift.times(t);
        let mut x = predicted_place(step, contracts, history, coarser_first);
        let mut to = FirstNode {
            root: step.root,
            xi: x + moved,
            xi_by: history.node_motion(t),
        };
        let mut open = V::all(1.0); // -1 where the step is accepted
        let mut tries = 0;
        let (scale, last_speed) = (h / history.increment_time, history.speed);
        let (stages, solved) = loop {
            let speed = (to.xi - node.xi).times(1.0 / h);
            let faster = (speed - history.speed).times(h / step.dx);
            let scale = if tries == 0 { scale } else { 1.0 };
            if step.number > 2 {
                let terms = (scale, faster, faster);
                work.premium
                    .update_increment::<false>(terms, step.active, &mut work.differences);
            }
            history.speed = speed;
            let stages = Stages::new(step, contracts, history, *node, to);
            let mut solved: SolvedCells<V> = [const { None }; 3];
            let phi = stages.solve::<D>(&mut solved, work);
            x = open.negative(x, phi.times_plus(V::all(step.dx), to.xi) - moved);
            let excess = phi.abs().times(step.dx).plus(-ACCEPTED_OFFSET * step.root);
            open = excess.negative(V::all(-1.0), open);
            tries += 1;
            if tries == TRIES || open.lanes().iter().all(|&o| o < 0.0) {
                break (stages, solved);
            }
            x = open.negative(x, history.bounded(x));
            to.xi = open.negative(to.xi, x + moved);
        };
        let mut boundary_by = to.xi_by;
        if D > 0 {
            let faster = (history.speed - last_speed).times(h / step.dx);
            let phi_by = V::apart(Differentiation::<V, D> {
                stages: &stages,
                solved: &solved,
                scale,
                faster,
                work,
            });
            for (found, phi) in boundary_by.iter_mut().zip(phi_by) {
                *found = phi.times_plus(V::all(step.dx), *found);
            }
            history.speed_by = stages.speed_by;
        }
        work.premium.finish(step, &stages.tableau.rhs_weights[2]);
        history.increment_time = STAGE * h;
        history.record(x, boundary_by, step.root);
        *node = to;
        let mut accepted = [false; LANES];
        for (own, open) in accepted.iter_mut().zip(open.lanes()) {
            *own = open < 0.0;
        }
        accepted
    }
}

/// The place x of node 0 at the end of the step, in units of spread.
#[inline(always)]
fn predicted_place<V: Vector>(
    step: &TimeStep,
    contracts: &Contracts<V>,
    history: &mut BoundaryHistory<V>,
    coarser_first: Option<V>,
) -> V {
    if step.number > step.euler_steps {
        let reduced = history.predicted(step);
        return history.bounded(reduced.times_plus(V::all(step.root), history.at_expiry));
    }
    // The first steps do not show where the boundary goes: where rate < dividend it turns, and may turn sharply, from
    // its limit at expiry to the course that it has without that limit. Implicit Euler's boundary does the same.
    let t = step.root * step.root;
    let xi = match coarser_first {
        Some(found) if step.number == 2 => found,
        _ => {
            let time = TimeFactors::new(contracts, t, step.root);
            first_boundary(contracts, &time, std::f64::consts::SQRT_2 / step.root)
        }
    };
    let euler = xi - history.drift.times(t);
    let beyond = history.latest - std::mem::replace(&mut history.euler, euler);
    history.bounded(beyond.times_plus(V::all(step.growth()), euler))
}
