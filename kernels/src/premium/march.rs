//! The march of sixteen early exercise premiums from expiry to now; the scheme is told in `premium_twin/march.py`.

use super::cell::{Cell, Solution};
use super::first_step::first_boundary;
use super::labels::{by_speed, Known, WienerHopf, Workspace};
use super::obstacle::{Contracts, Moment, Obstacle};
use super::plan::{Plan, Step};
use super::tableau::{Tableau, LATER_STEPS, SECOND_STEP, STAGE};
use super::track::Track;
use crate::lanes::vector::{Part, Vector, LANES};

/// Of sqrt(t), between boundary and label 0.
const ACCEPTED_OFFSET: f64 = 0.5;
const TRIES: usize = 8;

/// What a march leaves beside the premium: label i is at `frame` + i dx.
#[derive(Clone, Copy)]
pub struct Marched<V> {
    pub frame: V,
    /// Its derivatives: at fixed xi those of u are less by `u_xi` times these than along the labels.
    pub frame_by: [V; 3],
    /// Where the first step put the boundary.
    pub first: V,
    /// ln(S*/K).
    pub boundary: V,
    /// Whether the boundary stayed in its frame.
    pub settled: [bool; LANES],
}

/// March to now; the profile is left in `work`, with derivatives where D. `half` is where the march with half the
/// steps put the boundary in its first step.
#[inline(always)]
pub fn march<V: Vector, const D: bool>(
    plan: &Plan,
    contracts: &Contracts<V>,
    half: Option<V>,
    work: &mut Workspace<V>,
) -> Marched<V> {
    let mut track = Track::new(contracts);
    let mut at = first_step::<V, D>(plan, contracts, &mut track, work);
    let first = at.frame;
    let mut settled = [true; LANES];
    for n in 2..=plan.count() {
        let step = plan.step(n);
        if step.coarsens {
            work.base.coarsen();
            if D {
                for tangent in &mut work.tangents {
                    tangent.coarsen();
                }
            }
        }
        let accepted = V::apart(RungeKuttaStep::<V, D> {
            step: &step,
            contracts,
            track: &mut track,
            at: &mut at,
            half,
            work,
        });
        for (settled, accepted) in settled.iter_mut().zip(accepted) {
            *settled &= accepted;
        }
    }
    Marched {
        frame: at.frame,
        frame_by: at.frame_by,
        first,
        boundary: track.held * contracts.spread,
        settled,
    }
}

/// Where label 0 is after a step.
#[derive(Clone, Copy)]
struct Place<V> {
    root: f64,
    frame: V,
    frame_by: [V; 3],
}

/// Implicit Euler from u = 0: u = G(X) e^{-lam (xi - X)}.
#[inline(always)]
fn first_step<V: Vector, const D: bool>(
    plan: &Plan,
    contracts: &Contracts<V>,
    track: &mut Track<V>,
    work: &mut Workspace<V>,
) -> Place<V> {
    let step = plan.step(1);
    let (root, t) = (step.root, step.root * step.root);
    let lam = std::f64::consts::SQRT_2 / root;
    let moment = Moment::new(contracts, t, root);
    let frame = first_boundary(contracts, &moment, lam);
    let obstacle = Obstacle::at(contracts, &moment, frame);
    let decay = (-lam * step.dx).exp();
    work.base
        .start(plan.nodes, step.active, obstacle.value, decay);

    let [by_rate, by_dividend, by_spread] = obstacle.tangents;
    let spread = contracts.spread;
    let inverse = V::all(-1.0) / obstacle.slope.times_plus(V::all(lam), obstacle.curvature);
    let slope_by_spread = spread.times_plus(by_spread, obstacle.slope / spread);
    let frame_by = [
        by_rate.times(lam) * inverse,
        by_dividend * spread.plus(lam) * inverse,
        by_spread.times_plus(V::all(lam), slope_by_spread) * inverse,
    ];
    if D {
        for (j, tangent) in work.tangents.iter_mut().enumerate() {
            let along = obstacle.slope.times_plus(frame_by[j], obstacle.tangents[j]);
            tangent.start(plan.nodes, step.active, along, decay);
        }
        for array in &mut work.by_speed {
            array.resize(plan.nodes + 3, V::zero());
        }
    }
    work.differences.resize(plan.nodes + 3, V::zero());
    track.remember(frame - track.drift.times(t), frame_by, root);
    Place {
        root,
        frame,
        frame_by,
    }
}

/// One Runge-Kutta step, again with a corrected frame where the boundary left it too far behind; says where it did not.
struct RungeKuttaStep<'a, V, const D: bool> {
    step: &'a Step<'a>,
    contracts: &'a Contracts<V>,
    track: &'a mut Track<V>,
    at: &'a mut Place<V>,
    half: Option<V>,
    work: &'a mut Workspace<V>,
}

impl<V: Vector, const D: bool> Part<V> for RungeKuttaStep<'_, V, D> {
    type Result = [bool; LANES];

    #[inline(always)]
    fn run(self) -> [bool; LANES] {
        let Self {
            step,
            contracts,
            track,
            at,
            half,
            work,
        } = self;
        let t = step.root * step.root;
        let h = t - at.root * at.root;
        let moved = track.drift.times(t);
        let mut x = if step.number == 2 {
            // One step says nothing of where the boundary goes: one implicit Euler step to here does.
            let frame = if let Some(half) = half {
                half
            } else {
                let moment = Moment::new(contracts, t, step.root);
                first_boundary(contracts, &moment, std::f64::consts::SQRT_2 / step.root)
            };
            frame - moved
        } else {
            track.start + track.predicted(step).times(step.root)
        };
        x = track.bounded(x);
        let mut to = Place {
            root: step.root,
            frame: x + moved,
            frame_by: track.following(t),
        };
        let mut open = V::all(1.0); // -1 where the step is accepted
        let mut tries = 0;
        let (scale, last_speed) = (h / track.change_time, track.speed);
        let (stages, solved) = loop {
            let speed = (to.frame - at.frame).times(1.0 / h);
            let faster = (speed - track.speed).times(h / step.dx);
            let scale = if tries == 0 { scale } else { 1.0 };
            if step.number > 2 {
                let terms = (scale, faster, faster);
                work.base
                    .push::<false>(terms, step.active, &mut work.differences);
            }
            track.speed = speed;
            let stages = Stages::new(step, contracts, track, *at, to);
            let mut solved = [const { None }; 3];
            let mut phi = V::zero();
            for (number, solved) in solved.iter_mut().enumerate() {
                let (cell, solution) = stages.take(number, phi, work);
                phi = solution.phi;
                *solved = Some((cell, solution));
            }
            x = open.negative(x, phi.times_plus(V::all(step.dx), to.frame) - moved);
            let excess = phi.abs().times(step.dx).plus(-ACCEPTED_OFFSET * step.root);
            open = excess.negative(V::all(-1.0), open);
            tries += 1;
            if tries == TRIES || open.lanes().iter().all(|&o| o < 0.0) {
                break (stages, solved);
            }
            x = open.negative(x, track.bounded(x));
            to.frame = open.negative(to.frame, x + moved);
        };
        let mut found_by = to.frame_by;
        if D {
            let faster = (track.speed - last_speed).times(h / step.dx);
            let phi_by = V::apart(Differentiation {
                stages: &stages,
                solved: &solved,
                scale,
                faster,
                work,
            });
            for (found, phi) in found_by.iter_mut().zip(phi_by) {
                *found = phi.times_plus(V::all(step.dx), *found);
            }
            track.speed_by = stages.speed_by;
        }
        let shares = &stages.tableau.shares[2];
        work.base.finish(step, shares);
        track.change_time = STAGE * h;
        track.remember(x, found_by, step.root);
        *at = to;
        let mut accepted = [false; LANES];
        for (own, open) in accepted.iter_mut().zip(open.lanes()) {
            *own = open < 0.0;
        }
        accepted
    }
}

/// The three stages of one step from one place of label 0 to another.
struct Stages<'a, V> {
    start: f64,
    h: f64,
    step: &'a Step<'a>,
    contracts: &'a Contracts<V>,
    tableau: &'static Tableau,
    /// The parts of `Track` that the step does not change.
    drift: V,
    begin: V,
    drift_by: [V; 3],
    begin_by: [V; 3],
    from: Place<V>,
    to: Place<V>,
    matrix: WienerHopf<V>,
    /// d reduced / d ln sqrt(t) at the end of the step, and its derivatives by the parameters.
    slope: V,
    slope_by: [V; 3],
    /// The derivatives of the labels' speed, and what is new in them.
    speed_by: [V; 3],
    faster_by: [V; 3],
}

impl<'a, V: Vector> Stages<'a, V> {
    #[inline(always)]
    fn new(
        step: &'a Step<'a>,
        contracts: &'a Contracts<V>,
        track: &Track<V>,
        from: Place<V>,
        to: Place<V>,
    ) -> Self {
        let (start, end) = (from.root * from.root, to.root * to.root);
        let h = end - start;
        let newest = to.frame - track.drift.times(end) - track.start;
        let [newest_weight, weight, oldest_weight] = *step.slope;
        let newest_weight = newest_weight / to.root;
        let (mut slope_by, mut speed_by, mut faster_by) = (to.frame_by, to.frame_by, to.frame_by);
        for j in 0..3 {
            let carried = track.drift_by[j].times_plus(V::all(end), track.start_by[j]);
            slope_by[j] = (to.frame_by[j] - carried).times(newest_weight)
                + track.reduced_by[0][j].times(weight)
                + track.reduced_by[1][j].times(oldest_weight);
            speed_by[j] = (to.frame_by[j] - from.frame_by[j]).times(1.0 / h);
            faster_by[j] = speed_by[j] - track.speed_by[j];
        }
        Self {
            start,
            h,
            step,
            contracts,
            tableau: if step.number == 2 {
                &SECOND_STEP
            } else {
                &LATER_STEPS
            },
            drift: track.drift,
            begin: track.start,
            drift_by: track.drift_by,
            begin_by: track.start_by,
            from,
            to,
            matrix: WienerHopf::new(track.speed, STAGE * h, step.dx),
            slope: newest.times(newest_weight)
                + track.reduced[0].times(weight)
                + track.reduced[1].times(oldest_weight),
            slope_by,
            speed_by,
            faster_by,
        }
    }

    /// Take one; the last leaves the new state in `stages`.
    #[inline(always)]
    fn take(&self, number: usize, last: V, work: &mut Workspace<V>) -> (Cell<'a, V>, Solution<V>) {
        let c = self.tableau.times[number];
        let t = self.start + c * self.h;
        let root = t.sqrt();
        let xi = (self.to.frame - self.from.frame).times_plus(V::all(c), self.from.frame);
        let reduced = (xi - self.drift.times(t) - self.begin).times(1.0 / root);
        let (shares, active) = (&self.tableau.shares[number], self.step.active);
        let none = (&[][..], self.drift);
        work.base
            .eliminate::<false>(number, shares, &self.matrix, active, none);
        let cell = Cell {
            contracts: self.contracts,
            moment: Moment::new(self.contracts, t, root),
            xi,
            dx: self.step.dx,
            velocity: (reduced + self.slope).times(0.5 / root) + self.drift,
            turn: 0.5 * self.step.dx * (1.0 + self.step.slope[0]) / (root * root),
            pi: self.matrix.pi,
        };
        let solution = cell.solve(
            work.base.stages[number][1],
            last.times(self.tableau.growth[number]),
            number == 0,
        );
        work.base
            .substitute(number, &self.matrix, active, solution.contact());
        (cell, solution)
    }

    /// Take the step for the derivatives, which the solved stages decide, one after the other: each fits the cache.
    /// Returns those of the last phi.
    #[inline(always)]
    fn differentiate(
        &self,
        solved: &[Option<(Cell<V>, Solution<V>)>; 3],
        scale: f64,
        faster: V,
        work: &mut Workspace<V>,
    ) -> [V; 3] {
        let (active, dx) = (self.step.active, self.step.dx);
        let mut slopes = [const { None }; 3];
        for (slopes, stage) in slopes.iter_mut().zip(solved) {
            if let Some((cell, solution)) = stage {
                *slopes = Some(cell.differentiated(solution));
            }
        }
        for number in 0..3 {
            let known = Known::new(
                &self.tableau.shares[number],
                active,
                &work.base.state,
                &work.base.push,
                &work.base.stages[..number],
            );
            let stage = &work.base.stages[number][..active + 2];
            by_speed(&known, stage, &self.matrix, &mut work.by_speed[number]);
        }
        let mut phi_by = [V::zero(); 3];
        for (j, tangent) in work.tangents.iter_mut().enumerate() {
            if self.step.number > 2 {
                let faster_by = self.faster_by[j].times(self.h / dx);
                tangent.push::<true>((scale, faster, faster_by), active, &mut work.differences);
            }
            for (number, cell) in slopes.iter().flatten().enumerate() {
                let shares = &self.tableau.shares[number];
                let added = (&work.by_speed[number][..], self.speed_by[j]);
                tangent.eliminate::<true>(number, shares, &self.matrix, active, added);
                let from = self.from.frame_by[j];
                let c = self.tableau.times[number];
                let place_by = (self.to.frame_by[j] - from).times_plus(V::all(c), from);
                let (t, root) = (cell.t, cell.root);
                let carried = self.drift_by[j].times_plus(V::all(t), self.begin_by[j]);
                let curved = (place_by - carried).times_plus(V::all(1.0 / root), self.slope_by[j]);
                let velocity_by = curved.times_plus(V::all(0.5 / root), self.drift_by[j]);
                let eliminated = tangent.stages[number][1];
                let (contact, found) = cell.tangent(j, eliminated, place_by, velocity_by);
                tangent.substitute(number, &self.matrix, active, contact);
                phi_by[j] = found;
            }
            tangent.finish(self.step, &self.tableau.shares[2]);
        }
        phi_by
    }
}

/// The derivatives of a step by themselves.
struct Differentiation<'w, 'a, V> {
    stages: &'w Stages<'a, V>,
    solved: &'w [Option<(Cell<'a, V>, Solution<V>)>; 3],
    scale: f64,
    faster: V,
    work: &'w mut Workspace<V>,
}

impl<V: Vector> Part<V> for Differentiation<'_, '_, V> {
    type Result = [V; 3];

    #[inline(always)]
    fn run(self) -> [V; 3] {
        self.stages
            .differentiate(self.solved, self.scale, self.faster, self.work)
    }
}
