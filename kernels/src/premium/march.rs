//! The march of sixteen early exercise premiums from expiry to now; the scheme is told in `premium_twin/march.py`.

use super::cell::Cell;
use super::first_step::first_boundary;
use super::normal::{exp, ln};
use super::obstacle::{Contracts, Moment, Obstacle};
use super::plan::{Plan, Step};
use super::vector::{Vector, LANES};

/// Root of x^3 - 3 x^2 + 3 x/2 - 1/6: Alexander's three-stage method.
const STAGE: f64 = 0.435_866_521_508_459;
const STAGE_TIMES: [f64; 3] = [STAGE, 0.5 * (1.0 + STAGE), 1.0];
/// Weights of the increments of the stages before, already divided by `STAGE`.
const SECOND: f64 = 0.5 * (1.0 - STAGE) / STAGE;
const THIRD: [f64; 2] = [
    -0.25 * (6.0 * STAGE * STAGE - 16.0 * STAGE + 1.0) / STAGE,
    0.25 * (6.0 * STAGE * STAGE - 20.0 * STAGE + 5.0) / STAGE,
];
/// Of sqrt(t), between boundary and label 0.
const ACCEPTED_OFFSET: f64 = 0.15;
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
    next: Vec<[V; C]>,
    increments: [Vec<[V; C]>; 2],
    rhs: Vec<[V; C]>,
    eliminated: Vec<[V; C]>,
}

impl<V: Vector, const C: usize> Workspace<V, C> {
    #[inline(always)]
    pub fn new() -> Self {
        Self {
            state: Vec::new(),
            next: Vec::new(),
            increments: [Vec::new(), Vec::new()],
            rhs: Vec::new(),
            eliminated: Vec::new(),
        }
    }

    /// Hold `nodes` + 2 labels; the arrays keep their memory.
    #[inline(always)]
    fn resize(&mut self, nodes: usize) {
        let [first, second] = &mut self.increments;
        for array in [
            &mut self.state,
            &mut self.next,
            first,
            second,
            &mut self.rhs,
            &mut self.eliminated,
        ] {
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
    let first = &plan.steps[0];
    let mut frame = first_step(first, contracts, work);
    track.remember(
        frame - track.drift.times(first.root * first.root),
        first.root,
    );
    let mut settled = [true; LANES];
    for (before, step) in plan.steps.iter().zip(&plan.steps[1..]) {
        if step.coarsens {
            work.coarsen();
        }
        let (arrived, accepted) =
            runge_kutta_step(before.root, step, contracts, &mut track, frame, work);
        frame = arrived;
        settled = std::array::from_fn(|l| settled[l] & accepted[l]);
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
    let decay = exp(V::all(-lam * step.dx));
    work.state.fill([V::zero(); C]);
    for label in &mut work.state[..=step.active] {
        *label = value;
        for u in &mut value {
            *u = *u * decay;
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
    let reduced = track.reduced[0].times(step.prediction[0])
        + track.reduced[1].times(step.prediction[1])
        + track.reduced[2].times(step.prediction[2]);
    let moved = track.drift.times(t);
    let mut x = track.bounded(track.start + reduced.times(step.root));
    let mut frame = x + moved;
    let mut open = V::all(1.0); // -1 where the step is accepted
    for _ in 0..TRIES {
        let offset = stages(before, step, contracts, track, from, frame, work);
        let found = offset.times_plus(V::all(step.dx), frame) - moved;
        x = open.negative(x, found);
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
    std::mem::swap(&mut work.state, &mut work.next);
    track.remember(x, step.root);
    (frame, open.lanes().map(|o| o < 0.0))
}

/// The three stages; the new state is left in `work.next`. Returns phi, the boundary's distance from label 0 in cells.
#[inline(always)]
fn stages<V: Vector, const C: usize>(
    before: f64,
    step: &Step,
    contracts: &Contracts<V>,
    track: &Track<V>,
    from: V,
    frame: V,
    work: &mut Workspace<V, C>,
) -> V {
    let (start, end) = (before * before, step.root * step.root);
    let h = end - start;
    let matrix = WienerHopf::new((frame - from).times(1.0 / h), STAGE * h, step.dx);
    let newest = (frame - track.drift.times(end) - track.start).times(1.0 / step.root);
    let slope = newest.times(step.slope[0])
        + track.reduced[0].times(step.slope[1])
        + track.reduced[1].times(step.slope[2]);
    let mut offset = V::zero();
    for (number, c) in STAGE_TIMES.into_iter().enumerate() {
        let t = start + c * h;
        let root = t.sqrt();
        let place = (frame - from).times_plus(V::all(c), from);
        let reduced = (place - track.drift.times(t) - track.start).times(1.0 / root);
        eliminate(number, &matrix, step.active, work);
        let cell = Cell {
            contracts,
            moment: Moment::new(contracts, t, root),
            xi: place,
            dx: step.dx,
            velocity: (reduced + slope).times(0.5 / root) + track.drift,
            pi: matrix.pi,
        };
        let (contact, phi) = cell.solve(work.eliminated[1]);
        substitute(number, &matrix, step.active, contact, work);
        offset = phi;
    }
    offset
}

/// The state plus the weighted increments of the stages before.
#[inline(always)]
fn right_hand_side<V: Vector, const C: usize>(
    stage: usize,
    history: [&[[V; C]]; 3],
    i: usize,
) -> [V; C] {
    let [state, first, second] = history;
    let mut sum = state[i];
    for c in 0..C {
        if stage == 1 {
            sum[c] = first[i][c].times_plus(V::all(SECOND), sum[c]);
        } else if stage == 2 {
            sum[c] = first[i][c].times_plus(V::all(THIRD[0]), sum[c]);
            sum[c] = second[i][c].times_plus(V::all(THIRD[1]), sum[c]);
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
    let (state, [first, second]) = (&work.state[..active + 2], &work.increments);
    let (first, second) = (&first[..active + 2], &second[..active + 2]);
    let history = [state, first, second];
    let (rhs, eliminated) = (&mut work.rhs[..=active], &mut work.eliminated[..=active]);
    let mut above = right_hand_side(stage, history, active + 1);
    let mut here = right_hand_side(stage, history, active);
    let mut y = [V::zero(); C];
    for i in (1..=active).rev() {
        let below = right_hand_side(stage, history, i - 1);
        for c in 0..C {
            let known = matrix.upper * above[c];
            let known = matrix
                .lower
                .times_plus(below[c], matrix.middle.times_plus(here[c], known));
            y[c] = matrix.rho.times_plus(y[c], known);
        }
        eliminated[i] = y;
        rhs[i] = here;
        (above, here) = (here, below);
    }
    rhs[0] = here;
}

/// From the boundary: `u_i` = `y_i` + pi `u_{i-1}`; the stages but the last leave their increment.
#[inline(always)]
fn substitute<V: Vector, const C: usize>(
    stage: usize,
    matrix: &WienerHopf<V>,
    active: usize,
    contact: [V; C],
    work: &mut Workspace<V, C>,
) {
    let eliminated = &work.eliminated[..=active];
    let rhs = &work.rhs[..=active];
    let mut u = contact;
    if stage == 2 {
        work.next[active + 1..].fill([V::zero(); C]);
        let next = &mut work.next[..=active];
        next[0] = u;
        for i in 1..=active {
            for c in 0..C {
                u[c] = matrix.pi.times_plus(u[c], eliminated[i][c]);
            }
            next[i] = u;
        }
        return;
    }
    work.increments[stage][active + 1] = [V::zero(); C];
    let increment = &mut work.increments[stage][..=active];
    for c in 0..C {
        increment[0][c] = u[c] - rhs[0][c];
    }
    for i in 1..=active {
        for c in 0..C {
            u[c] = matrix.pi.times_plus(u[c], eliminated[i][c]);
            increment[i][c] = u[c] - rhs[i][c];
        }
    }
}
