//! The march of sixteen early exercise premiums from expiry to now; the scheme is told in `premium_twin/march.py`.

use super::cell::{Cell, Solution};
use super::first_step::first_boundary;
use super::normal::ln;
use super::obstacle::{Contracts, Moment, Obstacle};
use super::plan::{Plan, Step};
use super::vector::{Vector, LANES};

/// Root of x^3 - 3 x^2 + 3 x/2 - 1/6: on the diagonal of both methods.
const STAGE: f64 = 0.435_866_521_508_459;
/// Of the third stage; near the least error and far from the unstable neighbourhood of 2 STAGE.
const THIRD_TIME: f64 = 1.15;
/// Of sqrt(t), between boundary and label 0.
const ACCEPTED_OFFSET: f64 = 0.5;
const TRIES: usize = 8;

/// A Runge-Kutta method with three implicit stages, the last at the step's end.
struct Tableau {
    /// Of the stages, in steps.
    times: [f64; 3],
    /// Of phi from stage to stage, if it grows in proportion to time.
    growth: [f64; 3],
    /// The stages' right-hand sides as sums of the state, `push`, and the first two stages, for one matrix.
    shares: [[f64; 4]; 3],
}

/// Alexander's three-stage method, for the step that has no du/dt to start from.
const SECOND_STEP: Tableau = Tableau::new(
    [STAGE, 0.5 * (1.0 + STAGE), 1.0],
    [0.0; 3],
    0.5 * (1.0 - STAGE) / STAGE,
    [
        -0.25 * (6.0 * STAGE * STAGE - 16.0 * STAGE + 1.0) / STAGE,
        0.25 * (6.0 * STAGE * STAGE - 20.0 * STAGE + 5.0) / STAGE,
    ],
);
/// With an explicit first stage: stages of order two, of order three at the end.
const LATER_STEPS: Tableau = {
    let (c2, c3) = (2.0 * STAGE, THIRD_TIME);
    let a32 = (0.5 * c3 * c3 - STAGE * c3) / c2;
    let b3 = ((1.0 / 3.0 - STAGE) - c2 * (0.5 - STAGE)) / (c3 * (c3 - c2));
    let b2 = ((0.5 - STAGE) - b3 * c3) / c2;
    Tableau::new(
        [c2, c3, 1.0],
        [STAGE, c3 - STAGE - a32, 1.0 - b2 - b3 - STAGE],
        a32 / STAGE,
        [b2 / STAGE, b3 / STAGE],
    )
};

impl Tableau {
    /// From the weights of du/dt at the start, and of the increments of the stages before, divided by `STAGE`.
    const fn new(times: [f64; 3], explicit: [f64; 3], second: f64, third: [f64; 2]) -> Self {
        let [e1, e2, e3] = explicit;
        let [by_first, by_second] = third;
        Self {
            times,
            growth: [0.0, times[1] / times[0], times[2] / times[1]],
            shares: [
                [1.0, e1, 0.0, 0.0],
                [1.0 - second, e2 - second * e1, second, 0.0],
                [
                    1.0 - by_first - by_second * (1.0 - second),
                    e3 - by_first * e1 - by_second * (e2 - second * e1),
                    by_first - by_second * second,
                    by_second,
                ],
            ],
        }
    }
}

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

/// The arrays of a march, kept from group to group.
pub struct Workspace<V> {
    pub base: Arrays<V>,
    /// The derivatives by rate, dividend and spread, along the labels.
    pub tangents: [Arrays<V>; 3],
    /// 12 dx `u_xi` at the labels at the start of a step.
    differences: Vec<V>,
    /// What the derivatives of the stages' equations by the speed take from the solved stages.
    by_speed: [Vec<V>; 3],
}

/// Quantities at the labels 0 .. nodes + 2.
pub struct Arrays<V> {
    pub state: Vec<V>,
    /// h du/dt at the start of a step; between steps, what the last stage added.
    push: Vec<V>,
    /// u after the three stages; before the substitution, what the elimination left.
    stages: [Vec<V>; 3],
}

impl<V: Vector> Workspace<V> {
    #[inline(always)]
    pub fn new() -> Self {
        Self {
            base: Arrays::new(),
            tangents: [Arrays::new(), Arrays::new(), Arrays::new()],
            differences: Vec::new(),
            by_speed: [Vec::new(), Vec::new(), Vec::new()],
        }
    }
}

impl<V: Vector> Arrays<V> {
    #[inline(always)]
    fn new() -> Self {
        Self {
            state: Vec::new(),
            push: Vec::new(),
            stages: [Vec::new(), Vec::new(), Vec::new()],
        }
    }

    /// Start with a state that falls by `decay` from label to label up to `active`; the arrays keep their memory.
    #[inline(always)]
    fn start(&mut self, nodes: usize, active: usize, mut value: V, decay: f64) {
        let [first, second, third] = &mut self.stages;
        for array in [&mut self.state, &mut self.push, first, second, third] {
            array.resize(nodes + 3, V::zero());
        }
        self.state.fill(V::zero());
        self.push.fill(V::zero());
        for label in &mut self.state[..=active] {
            *label = value;
            value = value.times(decay);
        }
    }

    /// Drop every second label.
    #[inline(always)]
    fn coarsen(&mut self) {
        let kept = self.state.len().div_ceil(2);
        for array in [&mut self.state, &mut self.push] {
            for i in 0..kept {
                array[i] = array[2 * i];
            }
            array[kept..].fill(V::zero());
        }
    }
}

/// What a march remembers of the boundary, in units of spread.
struct Track<V> {
    /// (r - q - sigma^2/2) T / spread.
    drift: V,
    /// Just before expiry.
    start: V,
    /// Of the option without expiry.
    perpetual: V,
    /// ln(S*/K)/spread after the last step, and its derivatives by rate, dividend and spread.
    held: V,
    held_by: [V; 3],
    /// (ln(S*/K)/spread - start)/sqrt(t) after the last three, newest first.
    reduced: [V; 3],
    /// The derivatives of `drift`, `start`, and of the newest two of `reduced`.
    drift_by: [V; 3],
    start_by: [V; 3],
    reduced_by: [[V; 3]; 2],
    /// The time that made the change in `push` (1 at first), and the speed of the labels in the last step.
    change_time: f64,
    speed: V,
    speed_by: [V; 3],
}

impl<V: Vector> Track<V> {
    #[inline(always)]
    fn new(contracts: &Contracts<V>) -> Self {
        let Contracts {
            rate,
            dividend,
            spread,
        } = *contracts;
        let drift = (rate - dividend - (spread * spread).times(0.5)) / spread;
        let early = ln((-dividend).negative(rate / dividend, V::all(1.0)));
        let start = early.min(V::zero()) / spread;
        let decay = drift + (drift * drift + rate + rate).sqrt();
        let perpetual = -(ln((spread / decay).plus(1.0)) / spread);
        let inverse = V::all(1.0) / spread;
        let zero = V::zero();
        Self {
            drift,
            start,
            perpetual,
            held: start,
            held_by: [zero; 3],
            reduced: [zero; 3],
            drift_by: [inverse, -inverse, -(drift * inverse).plus(1.0)],
            start_by: [
                early.negative(inverse / rate, zero),
                early.negative(-(inverse / dividend), zero),
                early.negative(-(start * inverse), zero),
            ],
            reduced_by: [[zero; 3]; 2],
            change_time: 1.0,
            speed: zero,
            speed_by: [zero; 3],
        }
    }

    /// Between the perpetual boundary and that of the last step.
    #[inline(always)]
    fn bounded(&self, x: V) -> V {
        x.min(self.held).max(self.perpetual)
    }

    /// Extrapolate (ln(S*/K)/spread - start)/sqrt(t) to the end of a step.
    #[inline(always)]
    fn predicted(&self, step: &Step) -> V {
        self.reduced[0].times(step.prediction[0])
            + self.reduced[1].times(step.prediction[1])
            + self.reduced[2].times(step.prediction[2])
    }

    /// How label 0 moves with the parameters at a step's end. Any motion serves; this is the boundary's, a step before.
    #[inline(always)]
    fn following(&self, t: f64) -> [V; 3] {
        let mut by = self.held_by;
        for (by, drift) in by.iter_mut().zip(self.drift_by) {
            *by = drift.times_plus(V::all(t), *by);
        }
        by
    }

    /// Keep a place of the boundary and how the parameters move it in xi.
    #[inline(always)]
    fn remember(&mut self, x: V, found_by: [V; 3], root: f64) {
        self.held = x;
        let newest = (x - self.start).times(1.0 / root);
        self.reduced = [newest, self.reduced[0], self.reduced[1]];
        let mut by = found_by;
        for (j, by) in by.iter_mut().enumerate() {
            self.held_by[j] = *by - self.drift_by[j].times(root * root);
            *by = (self.held_by[j] - self.start_by[j]).times(1.0 / root);
        }
        self.reduced_by = [by, self.reduced_by[0]];
    }
}

/// The factors kappa (1 - rho E)(1 - pi E^-1) of m u - h (`u_xixi`/2 + speed `u_xi`), E the right shift.
struct WienerHopf<V> {
    lower: V,
    middle: V,
    upper: V,
    pi: V,
    rho: V,
    /// What the derivative by the speed takes: of the differences across of u - rhs, u and the second one of u.
    lean_by: V,
    drift_by: V,
    bend_by: V,
}

impl<V: Vector> WienerHopf<V> {
    #[inline(always)]
    fn new(speed: V, h: f64, dx: f64) -> Self {
        let flow = (speed * speed)
            .times_plus(V::all(dx * dx / 6.0), V::all(0.5))
            .times(h / (dx * dx));
        let lean = speed.times(dx / 12.0);
        let (mass_lower, mass_upper) = (-lean.plus(-1.0 / 12.0), lean.plus(1.0 / 12.0));
        let carried = speed.times(h / (2.0 * dx));
        let lower = flow - carried - mass_lower;
        let upper = flow + carried - mass_upper;
        let diagonal = (flow + flow).plus(10.0 / 12.0);
        let kappa =
            (diagonal + (diagonal * diagonal - (lower * upper).times(4.0)).sqrt()).times(0.5);
        let inverse = V::all(1.0) / kappa;
        Self {
            lower: mass_lower * inverse,
            middle: inverse.times(10.0 / 12.0),
            upper: mass_upper * inverse,
            pi: lower * inverse,
            rho: upper * inverse,
            lean_by: inverse.times(-dx / 12.0),
            drift_by: inverse.times(0.5 * h / dx),
            bend_by: (speed * inverse).times(h / 3.0),
        }
    }
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
        let accepted = runge_kutta_step::<V, D>(&step, contracts, &mut track, &mut at, half, work);
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

/// One Runge-Kutta step, again with a corrected frame where the boundary left it too far behind.
#[inline(always)]
fn runge_kutta_step<V: Vector, const D: bool>(
    step: &Step,
    contracts: &Contracts<V>,
    track: &mut Track<V>,
    at: &mut Place<V>,
    half: Option<V>,
    work: &mut Workspace<V>,
) -> [bool; LANES] {
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
        let phi_by = stages.differentiate(&solved, scale, faster, work);
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

impl<V: Vector> Arrays<V> {
    /// Scale the push and add `faster` dx `u_xi`, what a change of the labels' speed adds to the rate of change, and
    /// `faster_by` times these differences of the premium itself where T, for a derivative's push; else leave them in
    /// `differences`. Of fourth order, as the scheme in space; the first two labels look to the right.
    #[inline(always)]
    fn push<const T: bool>(
        &mut self,
        (scale, faster, faster_by): (f64, V, V),
        active: usize,
        differences: &mut [V],
    ) {
        let u = &self.state[..active + 3];
        let scale = V::all(scale);
        let (faster, faster_by) = (faster.times(1.0 / 12.0), faster_by.times(1.0 / 12.0));
        let push = &mut self.push[..=active];
        let differences = &mut differences[..=active];
        for i in 0..=active {
            let sum = if i == 0 {
                weighted_sum(u, [-25.0, 48.0, -36.0, 16.0, -3.0])
            } else if i == 1 {
                weighted_sum(u, [-3.0, -10.0, 18.0, -6.0, 1.0])
            } else {
                (u[i + 1] - u[i - 1]).times(8.0) - (u[i + 2] - u[i - 2])
            };
            let mut moved = faster * sum;
            if T {
                moved = faster_by.times_plus(differences[i], moved);
            } else {
                differences[i] = sum;
            }
            push[i] = push[i].times_plus(scale, moved);
        }
    }

    /// From the far end: y with kappa (1 - rho E) y = m rhs, and with the multiple of a source where S; y vanishes
    /// beyond `active`.
    #[inline(always)]
    fn eliminate<const S: bool>(
        &mut self,
        stage: usize,
        shares: &[f64; 4],
        matrix: &WienerHopf<V>,
        active: usize,
        (source, multiple): (&[V], V),
    ) {
        let (known, found) = self.stages.split_at_mut(stage);
        let known = Known::new(shares, active, &self.state, &self.push, known);
        let eliminated = &mut found[0][..=active];
        let (mut above, mut here) = (known.at(active + 1), known.at(active));
        let mut y = V::zero();
        for i in (1..=active).rev() {
            let below = known.at(i - 1);
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

    /// From the boundary: `u_i` = `y_i` + pi `u_{i-1}`; beyond `active` nothing changes, or is zero after the last stage.
    #[inline(always)]
    fn substitute(&mut self, stage: usize, matrix: &WienerHopf<V>, active: usize, contact: V) {
        if stage < 2 {
            self.stages[stage][active + 1] = self.state[active + 1];
        } else {
            self.stages[stage][active + 1..].fill(V::zero());
        }
        let found = &mut self.stages[stage][..=active];
        let mut u = contact;
        found[0] = u;
        for label in &mut found[1..] {
            u = matrix.pi.times_plus(u, *label);
            *label = u;
        }
    }

    /// Make the last stage, with these shares, the state, and leave in the push what it added to its right-hand side,
    /// for the next step.
    #[inline(always)]
    fn finish(&mut self, step: &Step, shares: &[f64; 4]) {
        if !step.last {
            let [first, second, last] = &self.stages;
            for i in 0..=step.active {
                let push = self.push[i];
                let sum = weighted(2, shares, [self.state[i], push, first[i], second[i]]);
                self.push[i] = last[i] - sum;
            }
        }
        std::mem::swap(&mut self.state, &mut self.stages[2]);
    }
}

/// Of the first five labels.
#[inline(always)]
fn weighted_sum<V: Vector>(u: &[V], weights: [f64; 5]) -> V {
    let mut sum = u[0].times(weights[0]);
    for (u, weight) in u[1..5].iter().zip(&weights[1..]) {
        sum = u.times_plus(V::all(*weight), sum);
    }
    sum
}

/// A stage's right-hand side at one label, of the state, the push and the stages before.
#[inline(always)]
fn weighted<V: Vector>(stage: usize, shares: &[f64; 4], known: [V; 4]) -> V {
    let [state, push, first, second] = known;
    let mut sum = state.times_plus(V::all(shares[0]), push.times(shares[1]));
    if stage > 0 {
        sum = first.times_plus(V::all(shares[2]), sum);
    }
    if stage > 1 {
        sum = second.times_plus(V::all(shares[3]), sum);
    }
    sum
}

/// The arrays that a stage's right-hand side is made of.
struct Known<'a, V> {
    stage: usize,
    shares: &'a [f64; 4],
    arrays: [&'a [V]; 4],
}

impl<'a, V: Vector> Known<'a, V> {
    /// From the state, the push and the stages before; those that are not known yet are not read.
    #[inline(always)]
    fn new(
        shares: &'a [f64; 4],
        active: usize,
        state: &'a [V],
        push: &'a [V],
        stages: &'a [Vec<V>],
    ) -> Self {
        let labels = active + 2;
        let state = &state[..labels];
        let first = stages.first().map_or(state, |v| &v[..labels]);
        let second = stages.get(1).map_or(state, |v| &v[..labels]);
        Self {
            stage: stages.len(),
            shares,
            arrays: [state, &push[..labels], first, second],
        }
    }

    #[inline(always)]
    fn at(&self, i: usize) -> V {
        let [state, push, first, second] = self.arrays;
        weighted(
            self.stage,
            self.shares,
            [state[i], push[i], first[i], second[i]],
        )
    }
}

/// What the derivative of the factors by the speed takes from a solved stage.
#[inline(always)]
fn by_speed<V: Vector>(known: &Known<V>, u: &[V], matrix: &WienerHopf<V>, found: &mut [V]) {
    let active = u.len() - 2;
    let mut above = u[active + 1] - known.at(active + 1);
    let mut here = u[active] - known.at(active);
    for i in (1..=active).rev() {
        let below = u[i - 1] - known.at(i - 1);
        let bent = (u[i + 1] - u[i]) - (u[i] - u[i - 1]);
        let across = (u[i + 1] - u[i - 1]) * matrix.drift_by;
        let leaning = (above - below).times_plus(matrix.lean_by, across);
        found[i] = bent.times_plus(matrix.bend_by, leaning);
        (above, here) = (here, below);
    }
}
