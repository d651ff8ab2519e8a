//! The march of sixteen early exercise premiums from expiry to now; the scheme is told in `premium_twin/march.py`.

use super::cell::Cell;
use super::first_step::first_boundary;
use super::normal::ln;
use super::obstacle::{Contracts, Moment, Obstacle};
use super::plan::{Plan, Step};
use super::vector::{Vector, LANES};

/// Root of x^3 - 3 x^2 + 3 x/2 - 1/6: Alexander's three-stage method.
const STAGE: f64 = 0.435_866_521_508_459;
const STAGE_TIMES: [f64; 3] = [STAGE, 0.5 * (1.0 + STAGE), 1.0];
/// Of phi from stage to stage, if it grows in proportion to time.
const GROWTH: [f64; 3] = [0.0, 0.5 * (1.0 + STAGE) / STAGE, 2.0 / (1.0 + STAGE)];
/// The right-hand sides as sums of the state and the stages before: from the tableau, for one matrix.
const SECOND: f64 = 0.5 * (1.0 - STAGE) / STAGE;
const THIRD: [f64; 2] = [
    -0.25 * (6.0 * STAGE * STAGE - 16.0 * STAGE + 1.0) / STAGE,
    0.25 * (6.0 * STAGE * STAGE - 20.0 * STAGE + 5.0) / STAGE,
];
const SHARES: [[f64; 3]; 3] = [
    [1.0, 0.0, 0.0],
    [1.0 - SECOND, SECOND, 0.0],
    [
        1.0 - THIRD[0] - THIRD[1] * (1.0 - SECOND),
        THIRD[0] - THIRD[1] * SECOND,
        THIRD[1],
    ],
];
/// Of sqrt(t), between boundary and label 0.
const ACCEPTED_OFFSET: f64 = 0.5;
const TRIES: usize = 8;

/// What a march leaves beside the premium: label i is at `frame` + i dx.
#[derive(Clone, Copy)]
pub struct Marched<V> {
    pub frame: V,
    /// ln(S*/K).
    pub boundary: V,
    /// Whether the boundary stayed in its frame.
    pub settled: [bool; LANES],
}

/// The arrays of a march, kept from group to group.
pub struct Workspace<V, const C: usize> {
    /// u (and its derivatives) at the labels 0 .. nodes + 1.
    pub state: Vec<[V; C]>,
    /// The same after the three stages; before the substitution, what the elimination left.
    stages: [Vec<[V; C]>; 3],
}

impl<V: Vector, const C: usize> Workspace<V, C> {
    #[inline(always)]
    pub fn new() -> Self {
        Self {
            state: Vec::new(),
            stages: [Vec::new(), Vec::new(), Vec::new()],
        }
    }

    /// Hold `nodes` + 2 labels; the arrays keep their memory.
    #[inline(always)]
    fn resize(&mut self, nodes: usize) {
        let [first, second, third] = &mut self.stages;
        for array in [&mut self.state, first, second, third] {
            array.resize(nodes + 2, [V::zero(); C]);
        }
    }

    /// Drop every second label.
    #[inline(always)]
    fn coarsen(&mut self) {
        let kept = self.state.len().div_ceil(2);
        for i in 0..kept {
            self.state[i] = self.state[2 * i];
        }
        self.state[kept..].fill([V::zero(); C]);
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
    /// ln(S*/K)/spread after the last step.
    held: V,
    /// (ln(S*/K)/spread - start)/sqrt(t) after the last three, newest first.
    reduced: [V; 3],
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
        Self {
            drift,
            start,
            perpetual,
            held: start,
            reduced: [V::zero(); 3],
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

    #[inline(always)]
    fn remember(&mut self, x: V, root: f64) {
        self.held = x;
        let newest = (x - self.start).times(1.0 / root);
        self.reduced = [newest, self.reduced[0], self.reduced[1]];
    }
}

/// The factors kappa (1 - rho E)(1 - pi E^-1) of m u - h (`u_xixi`/2 + speed `u_xi`), E the right shift.
struct WienerHopf<V> {
    lower: V,
    middle: V,
    upper: V,
    pi: V,
    rho: V,
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
        }
    }
}

/// March to now; the profile is left in `work.state`.
#[inline(always)]
pub fn march<V: Vector, const C: usize>(
    plan: &Plan,
    contracts: &Contracts<V>,
    work: &mut Workspace<V, C>,
) -> Marched<V> {
    work.resize(plan.nodes);
    let mut track = Track::new(contracts);
    let first = plan.step(1);
    let mut frame = first_step(&first, contracts, work);
    track.remember(
        frame - track.drift.times(first.root * first.root),
        first.root,
    );
    let mut settled = [true; LANES];
    let mut before = first.root;
    for n in 2..=plan.count() {
        let step = plan.step(n);
        if step.coarsens {
            work.coarsen();
        }
        let (arrived, accepted) =
            runge_kutta_step(before, &step, contracts, &mut track, frame, work);
        frame = arrived;
        before = step.root;
        for (settled, accepted) in settled.iter_mut().zip(accepted) {
            *settled &= accepted;
        }
    }
    Marched {
        frame,
        boundary: track.held * contracts.spread,
        settled,
    }
}

/// Implicit Euler from u = 0: u = G(X) e^{-lam (xi - X)}.
#[inline(always)]
fn first_step<V: Vector, const C: usize>(
    step: &Step,
    contracts: &Contracts<V>,
    work: &mut Workspace<V, C>,
) -> V {
    let lam = std::f64::consts::SQRT_2 / step.root;
    let moment = Moment::new(contracts, step.root * step.root, step.root);
    let frame = first_boundary(contracts, &moment, lam);
    let obstacle = Obstacle::at(contracts, &moment, frame);
    let mut value = [obstacle.value; C];
    value[1..].copy_from_slice(&obstacle.tangents[..C - 1]);
    let decay = (-lam * step.dx).exp();
    work.state.fill([V::zero(); C]);
    for label in &mut work.state[..=step.active] {
        *label = value;
        for u in &mut value {
            *u = u.times(decay);
        }
    }
    frame
}

/// One Runge-Kutta step, again with a corrected frame where the boundary left it too far behind.
#[inline(always)]
fn runge_kutta_step<V: Vector, const C: usize>(
    before: f64,
    step: &Step,
    contracts: &Contracts<V>,
    track: &mut Track<V>,
    from: V,
    work: &mut Workspace<V, C>,
) -> (V, [bool; LANES]) {
    let t = step.root * step.root;
    let moved = track.drift.times(t);
    let mut x = if step.number == 2 {
        // One step says nothing of where the boundary goes: one implicit Euler step to here does.
        let moment = Moment::new(contracts, t, step.root);
        first_boundary(contracts, &moment, std::f64::consts::SQRT_2 / step.root) - moved
    } else {
        track.start + track.predicted(step).times(step.root)
    };
    x = track.bounded(x);
    let mut frame = x + moved;
    let mut open = V::all(1.0); // -1 where the step is accepted
    for _ in 0..TRIES {
        let stages = Stages::new(before, step, contracts, track, from, frame);
        let mut offset = V::zero();
        for number in 0..STAGE_TIMES.len() {
            offset = stages.take(number, offset, work);
        }
        x = open.negative(x, offset.times_plus(V::all(step.dx), frame) - moved);
        let excess = offset
            .abs()
            .times(step.dx)
            .plus(-ACCEPTED_OFFSET * step.root);
        open = excess.negative(V::all(-1.0), open);
        if open.lanes().iter().all(|&o| o < 0.0) {
            break;
        }
        x = open.negative(x, track.bounded(x));
        frame = open.negative(frame, x + moved);
    }
    std::mem::swap(&mut work.state, &mut work.stages[2]);
    track.remember(x, step.root);
    let mut accepted = [false; LANES];
    for (own, open) in accepted.iter_mut().zip(open.lanes()) {
        *own = open < 0.0;
    }
    (frame, accepted)
}

/// The three stages of one step towards a frame.
struct Stages<'a, V> {
    start: f64,
    h: f64,
    step: &'a Step<'a>,
    contracts: &'a Contracts<V>,
    drift: V,
    /// ln(S*/K)/spread just before expiry.
    begin: V,
    from: V,
    frame: V,
    matrix: WienerHopf<V>,
    /// d reduced / d ln sqrt(t) at the end of the step.
    slope: V,
}

impl<'a, V: Vector> Stages<'a, V> {
    #[inline(always)]
    fn new(
        before: f64,
        step: &'a Step<'a>,
        contracts: &'a Contracts<V>,
        track: &Track<V>,
        from: V,
        frame: V,
    ) -> Self {
        let (start, end) = (before * before, step.root * step.root);
        let h = end - start;
        let newest = (frame - track.drift.times(end) - track.start).times(1.0 / step.root);
        Self {
            start,
            h,
            step,
            contracts,
            drift: track.drift,
            begin: track.start,
            from,
            frame,
            matrix: WienerHopf::new((frame - from).times(1.0 / h), STAGE * h, step.dx),
            slope: newest.times(step.slope[0])
                + track.reduced[0].times(step.slope[1])
                + track.reduced[1].times(step.slope[2]),
        }
    }

    /// Take one; the last leaves the new state in `work.stages`. Returns phi, how many cells beyond label 0 the boundary is.
    #[inline(always)]
    fn take<const C: usize>(&self, number: usize, last: V, work: &mut Workspace<V, C>) -> V {
        let c = STAGE_TIMES[number];
        let t = self.start + c * self.h;
        let root = t.sqrt();
        let xi = (self.frame - self.from).times_plus(V::all(c), self.from);
        let reduced = (xi - self.drift.times(t) - self.begin).times(1.0 / root);
        eliminate(number, &self.matrix, self.step.active, work);
        let cell = Cell {
            contracts: self.contracts,
            moment: Moment::new(self.contracts, t, root),
            xi,
            dx: self.step.dx,
            velocity: (reduced + self.slope).times(0.5 / root) + self.drift,
            turn: 0.5 * self.step.dx * (1.0 + self.step.slope[0]) / (root * root),
            pi: self.matrix.pi,
        };
        let (contact, phi) = cell.solve(
            work.stages[number][1],
            last.times(GROWTH[number]),
            number == 0,
        );
        substitute(number, &self.matrix, self.step.active, contact, work);
        phi
    }
}

/// A weighted sum of the state and the stages before.
#[inline(always)]
fn right_hand_side<V: Vector, const C: usize>(
    stage: usize,
    known: [&[[V; C]]; 3],
    i: usize,
) -> [V; C] {
    let [state, first, second] = known;
    let mut sum = state[i];
    if stage > 0 {
        for c in 0..C {
            sum[c] =
                first[i][c].times_plus(V::all(SHARES[stage][1]), sum[c].times(SHARES[stage][0]));
        }
    }
    if stage > 1 {
        for c in 0..C {
            sum[c] = second[i][c].times_plus(V::all(SHARES[stage][2]), sum[c]);
        }
    }
    sum
}

/// From the far end: y with kappa (1 - rho E) y = m rhs; y vanishes beyond `active`.
#[inline(always)]
fn eliminate<V: Vector, const C: usize>(
    stage: usize,
    matrix: &WienerHopf<V>,
    active: usize,
    work: &mut Workspace<V, C>,
) {
    let (known, found) = work.stages.split_at_mut(stage);
    let state = &work.state[..active + 2];
    // Stages that are not known yet are not read.
    let first = known.first().map_or(state, |v| &v[..active + 2]);
    let second = known.get(1).map_or(state, |v| &v[..active + 2]);
    let known = [state, first, second];
    let eliminated = &mut found[0][..=active];
    let mut above = right_hand_side(stage, known, active + 1);
    let mut here = right_hand_side(stage, known, active);
    let mut y = [V::zero(); C];
    for i in (1..=active).rev() {
        let below = right_hand_side(stage, known, i - 1);
        for c in 0..C {
            let mean = matrix.middle.times_plus(here[c], matrix.upper * above[c]);
            y[c] = matrix
                .rho
                .times_plus(y[c], matrix.lower.times_plus(below[c], mean));
        }
        eliminated[i] = y;
        (above, here) = (here, below);
    }
}

/// From the boundary: `u_i` = `y_i` + pi `u_{i-1}`; beyond `active` nothing changes, or is zero after the last stage.
#[inline(always)]
fn substitute<V: Vector, const C: usize>(
    stage: usize,
    matrix: &WienerHopf<V>,
    active: usize,
    contact: [V; C],
    work: &mut Workspace<V, C>,
) {
    if stage < 2 {
        work.stages[stage][active + 1] = work.state[active + 1];
    } else {
        work.stages[stage][active + 1..].fill([V::zero(); C]);
    }
    let found = &mut work.stages[stage][..=active];
    let mut u = contact;
    found[0] = u;
    for label in &mut found[1..] {
        for c in 0..C {
            u[c] = matrix.pi.times_plus(u[c], label[c]);
        }
        *label = u;
    }
}
