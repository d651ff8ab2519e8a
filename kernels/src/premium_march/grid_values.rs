//! The premium and its derivatives at the nodes of a march.

use crate::lanes::vector::{Vector, LANES};

/// The arrays of a march, kept from group to group.
pub struct Workspace<V> {
    /// The premium u.
    pub premium: GridValues<V>,
    /// The derivatives of u by rate, dividend and spread, along the moving nodes; see `array_of`.
    pub tangents: [GridValues<V>; 3],
    /// 12 dx `u_xi` at the nodes at the start of a step, (nodes + 3,).
    pub differences: Vec<V>,
    /// For each stage the derivative of its equations by the nodes' speed, (nodes + 3,).
    pub speed_sources: [Vec<V>; 3],
}

/// What the derivatives by rate, dividend and spread are in array j of D: with three arrays those by parameter j. Where
/// one put fills all the lanes, a single array holds the three in its first lanes, which takes a third of the work.
#[inline(always)]
pub fn array_of<V: Vector, const D: usize>(j: usize, by: [V; 3]) -> V {
    if D > 1 {
        return by[j];
    }
    let (mut first, mut second) = ([1.0; LANES], [1.0; LANES]);
    (first[0], second[1]) = (-1.0, -1.0);
    let [rate, dividend, spread] = by;
    let others = V::from_lanes(second).negative(dividend, spread);
    V::from_lanes(first).negative(rate, others)
}

/// One quantity at the nodes 0 .. nodes + 2, those beyond the free ones being zero.
pub struct GridValues<V> {
    /// The quantity at the start of a step, (nodes + 3,).
    pub state: Vec<V>,
    /// h du/dt at the start of a step; between steps, what the last stage added to its right-hand side.
    pub increment: Vec<V>,
    /// The quantity after each of the three stages; before the substitution, what the elimination left.
    pub stages: [Vec<V>; 3],
}

impl<V: Vector> Workspace<V> {
    /// Without memory yet.
    #[inline(always)]
    pub fn new() -> Self {
        Self {
            premium: GridValues::new(),
            tangents: [GridValues::new(), GridValues::new(), GridValues::new()],
            differences: Vec::new(),
            speed_sources: [Vec::new(), Vec::new(), Vec::new()],
        }
    }
}

impl<V: Vector> GridValues<V> {
    #[inline(always)]
    fn new() -> Self {
        Self {
            state: Vec::new(),
            increment: Vec::new(),
            stages: [Vec::new(), Vec::new(), Vec::new()],
        }
    }

    /// Start with a state that falls by `decay` from node to node up to `active`; the arrays keep their memory.
    #[inline(always)]
    pub fn start(&mut self, nodes: usize, active: usize, mut value: V, decay: f64) {
        let [first, second, third] = &mut self.stages;
        for array in [&mut self.state, &mut self.increment, first, second, third] {
            array.resize(nodes + 3, V::zero());
        }
        self.state.fill(V::zero());
        self.increment.fill(V::zero());
        for node in &mut self.state[..=active] {
            *node = value;
            value = value.times(decay);
        }
    }

    /// Drop every second node.
    #[inline(always)]
    pub fn coarsen(&mut self) {
        let kept = self.state.len().div_ceil(2);
        for array in [&mut self.state, &mut self.increment] {
            for i in 0..kept {
                array[i] = array[2 * i];
            }
            array[kept..].fill(V::zero());
        }
    }

    /// Make the increment h du/dt at the start of the step: scale it to the new step, and add `faster` dx `u_xi`, the
    /// part of a change of the nodes' speed; `faster` is h/dx times that change.
    ///
    /// The premium leaves its differences in `differences`. A tangent (T) adds `faster_by` times those, `faster_by`
    /// being h/dx times the derivative of the change. The differences are of fourth order, as the scheme in space; those
    /// of the first two nodes are taken to the right.
    #[inline(always)]
    pub fn update_increment<const T: bool>(
        &mut self,
        (scale, faster, faster_by): (f64, V, V),
        active: usize,
        differences: &mut [V],
    ) {
        let u = &self.state[..active + 3];
        let scale = V::all(scale);
        let (faster, faster_by) = (faster.times(1.0 / 12.0), faster_by.times(1.0 / 12.0));
        let increment = &mut self.increment[..=active];
        let differences = &mut differences[..=active];
        for i in 0..=active {
            let sum = if i == 0 {
                sum_of_first_five(u, [-25.0, 48.0, -36.0, 16.0, -3.0])
            } else if i == 1 {
                sum_of_first_five(u, [-3.0, -10.0, 18.0, -6.0, 1.0])
            } else {
                (u[i + 1] - u[i - 1]).times(8.0) - (u[i + 2] - u[i - 2])
            };
            let mut moved = faster * sum;
            if T {
                moved = faster_by.times_plus(differences[i], moved);
            } else {
                differences[i] = sum;
            }
            increment[i] = increment[i].times_plus(scale, moved);
        }
    }
}

/// The weighted sum of the first five nodes.
#[inline(always)]
fn sum_of_first_five<V: Vector>(u: &[V], weights: [f64; 5]) -> V {
    let mut sum = u[0].times(weights[0]);
    for (u, weight) in u[1..5].iter().zip(&weights[1..]) {
        sum = u.times_plus(V::all(*weight), sum);
    }
    sum
}
