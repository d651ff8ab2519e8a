//! The quantities at the labels, and the linear algebra of a step on them.

use super::plan::Step;
use crate::lanes::vector::Vector;

/// The arrays of a march, kept from group to group.
pub struct Workspace<V> {
    pub base: Arrays<V>,
    /// The derivatives by rate, dividend and spread, along the labels.
    pub tangents: [Arrays<V>; 3],
    /// 12 dx `u_xi` at the labels at the start of a step.
    pub differences: Vec<V>,
    /// What the derivatives of the stages' equations by the speed take from the solved stages.
    pub by_speed: [Vec<V>; 3],
}

/// Quantities at the labels 0 .. nodes + 2.
pub struct Arrays<V> {
    pub state: Vec<V>,
    /// h du/dt at the start of a step; between steps, what the last stage added.
    pub push: Vec<V>,
    /// u after the three stages; before the substitution, what the elimination left.
    pub stages: [Vec<V>; 3],
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
    pub fn start(&mut self, nodes: usize, active: usize, mut value: V, decay: f64) {
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
    pub fn coarsen(&mut self) {
        let kept = self.state.len().div_ceil(2);
        for array in [&mut self.state, &mut self.push] {
            for i in 0..kept {
                array[i] = array[2 * i];
            }
            array[kept..].fill(V::zero());
        }
    }
}

/// The factors kappa (1 - rho E)(1 - pi E^-1) of m u - h (`u_xixi`/2 + speed `u_xi`), E the right shift.
pub struct WienerHopf<V> {
    lower: V,
    middle: V,
    upper: V,
    pub pi: V,
    rho: V,
    /// What the derivative by the speed takes: of the differences across of u - rhs, u and the second one of u.
    lean_by: V,
    drift_by: V,
    bend_by: V,
}

impl<V: Vector> WienerHopf<V> {
    #[inline(always)]
    pub fn new(speed: V, h: f64, dx: f64) -> Self {
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

impl<V: Vector> Arrays<V> {
    /// Scale the push and add `faster` dx `u_xi`, what a change of the labels' speed adds to the rate of change, and
    /// `faster_by` times these differences of the premium itself where T, for a derivative's push; else leave them in
    /// `differences`. Of fourth order, as the scheme in space; the first two labels look to the right.
    #[inline(always)]
    pub fn push<const T: bool>(
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
    pub fn eliminate<const S: bool>(
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
    pub fn substitute(&mut self, stage: usize, matrix: &WienerHopf<V>, active: usize, contact: V) {
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
    pub fn finish(&mut self, step: &Step, shares: &[f64; 4]) {
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
pub struct Known<'a, V> {
    stage: usize,
    shares: &'a [f64; 4],
    arrays: [&'a [V]; 4],
}

impl<'a, V: Vector> Known<'a, V> {
    /// From the state, the push and the stages before; those that are not known yet are not read.
    #[inline(always)]
    pub fn new(
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
pub fn by_speed<V: Vector>(known: &Known<V>, u: &[V], matrix: &WienerHopf<V>, found: &mut [V]) {
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
