//! Interpolation between the nodes: Newton's series of forward differences, of sixteen places side by side.

use crate::lanes::vector::{Vector, LANES};

/// The number of nodes in the interpolation; chosen: its error is below that of the scheme.
const STENCIL: usize = 6;

/// Places between nodes.
pub struct Interpolation<V> {
    /// The first of the nodes around each place.
    first: [usize; LANES],
    /// The distance of the place from that node, in cells.
    z: V,
    /// What is negative inside the nodes.
    beyond: V,
    /// The binomials of z, which multiply the differences by order.
    binomials: [V; STENCIL],
}

impl<V: Vector> Interpolation<V> {
    /// The interpolation at `cells` from node 0, in cells, among `nodes` free nodes.
    #[inline(always)]
    #[allow(clippy::cast_precision_loss)]
    pub fn new(cells: V, nodes: usize) -> Self {
        let y = cells.lanes();
        let (mut first, mut z) = ([0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            first[l] = first_node(y[l], nodes);
            z[l] = y[l] - first[l] as f64;
        }
        let z = V::from_lanes(z);
        let beyond = z.plus(3.0 - STENCIL as f64);
        let z = z.min(V::all(STENCIL as f64));
        let mut binomial = V::all(1.0);
        let mut binomials = [binomial; STENCIL];
        for (k, own) in binomials.iter_mut().enumerate().skip(1) {
            let (step, share) = (z.plus(1.0 - k as f64), 1.0 / k as f64);
            binomial = (binomial * step).times(share);
            *own = binomial;
        }
        Self {
            first,
            z,
            beyond,
            binomials,
        }
    }

    /// Negative where the place lies between nodes.
    #[inline(always)]
    pub fn inside(&self) -> V {
        self.beyond
    }

    /// The value and its first and second derivative by the cell; `lanes` says which lane of the nodes each place takes.
    #[inline(always)]
    #[allow(clippy::cast_precision_loss)]
    pub fn with_derivatives<S: Vector>(&self, state: &[S], lanes: &[usize; LANES]) -> (V, V, V) {
        let differences = self.differences(state, lanes);
        // The derivatives of the binomials.
        let (mut once, mut twice) = (V::zero(), V::zero());
        let mut value = differences[0];
        let (mut slope, mut curvature) = (V::zero(), V::zero());
        for (k, &difference) in differences.iter().enumerate().skip(1) {
            let (step, share) = (self.z.plus(1.0 - k as f64), 1.0 / k as f64);
            twice = (twice * step + once + once).times(share);
            once = (once * step + self.binomials[k - 1]).times(share);
            value = self.binomials[k].times_plus(difference, value);
            slope = slope + once * difference;
            curvature = curvature + twice * difference;
        }
        (value, slope, curvature)
    }

    /// The forward differences, by order, from the first nodes on.
    #[inline(always)]
    fn differences<S: Vector>(&self, state: &[S], lanes: &[usize; LANES]) -> [V; STENCIL] {
        let mut values = [V::zero(); STENCIL];
        for (k, value) in values.iter_mut().enumerate() {
            let mut numbers = [0.0; LANES];
            for l in 0..V::WIDTH {
                numbers[l] = state[self.first[l] + k].lane(lanes[l]);
            }
            *value = V::from_lanes(numbers);
        }
        for order in 1..STENCIL {
            for k in (order..STENCIL).rev() {
                values[k] = values[k] - values[k - 1];
            }
        }
        values
    }
}

/// The first of the nodes around y, at least 0, such that all of them exist.
#[inline(always)]
fn first_node(y: f64, nodes: usize) -> usize {
    let last = nodes + 1 - STENCIL;
    if y >= 2.0 {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
        let wanted = y.min(1e9) as usize - 2;
        wanted.min(last)
    } else {
        0
    }
}
