//! Functions of s = S/K that are known at nodes, and what is known of them between.

/// The number of nodes whose quartic gives a slope.
pub(super) const STENCIL: usize = 5;
/// The largest slope over the smaller neighbouring chord with which a cubic is monotone; derived.
const STEEPEST: f64 = 3.0;

/// A place where the slope jumps.
#[derive(Clone, Copy)]
pub(super) struct Kink {
    pub place: f64,
    pub jump: f64,
}

/// Weights of the derivative of the quartic through five neighbouring nodes, at each node.
pub(super) struct SlopeWeights {
    weights: Vec<[f64; STENCIL]>,
}

impl SlopeWeights {
    /// At least five nodes.
    pub fn new(nodes: &[f64]) -> Self {
        let weights = (0..nodes.len()).map(|node| {
            let start = start_of(node, nodes.len());
            let (x, own) = (&nodes[start..start + STENCIL], node - start);
            let mut weights = [0.0; STENCIL];
            for j in (0..STENCIL).filter(|j| *j != own) {
                let (mut above, mut below) = (1.0, 1.0);
                for k in (0..STENCIL).filter(|k| *k != j) {
                    above *= if k == own { 1.0 } else { nodes[node] - x[k] };
                    below *= x[j] - x[k];
                }
                weights[j] = above / below;
            }
            weights[own] = -weights.iter().sum::<f64>();
            weights
        });
        Self {
            weights: weights.collect(),
        }
    }

    /// The derivatives of values given at the nodes.
    pub fn slopes(&self, values: &[f64]) -> Vec<f64> {
        let slope = |(node, weights): (usize, &[f64; STENCIL])| {
            let near = &values[start_of(node, values.len())..][..STENCIL];
            near.iter().zip(weights).map(|(v, w)| v * w).sum()
        };
        self.weights.iter().enumerate().map(slope).collect()
    }
}

fn start_of(node: usize, count: usize) -> usize {
    node.saturating_sub(STENCIL / 2).min(count - STENCIL)
}

/// A point of a grid: its cell, the cell's width, and how far inside it lies, from 0 to 1.
#[derive(Clone, Copy)]
pub(super) struct Place {
    s: f64,
    cell: usize,
    width: f64,
    inside: f64,
}

impl Place {
    pub fn of(s: f64, nodes: &[f64]) -> Self {
        Self::within(s, cell_of(s, nodes), nodes)
    }

    /// The cell is the one that `cell_of` finds.
    fn within(s: f64, cell: usize, nodes: &[f64]) -> Self {
        let width = nodes[cell + 1] - nodes[cell];
        Self {
            s,
            cell,
            width,
            inside: ((s - nodes[cell]) / width).clamp(0.0, 1.0),
        }
    }
}

/// The cell that s lies in, the first or the last one where it lies outside.
pub(super) fn cell_of(s: f64, nodes: &[f64]) -> usize {
    let above = nodes.partition_point(|node| *node <= s);
    above.saturating_sub(1).min(nodes.len() - 2)
}

/// A piecewise cubic through values at nodes; linear from 0 to the first node and beyond the last.
pub(super) struct GridFunction<'a> {
    pub nodes: &'a [f64],
    pub values: &'a [f64],
    pub slopes: Vec<f64>,
    pub at_zero: f64,
}

impl<'a> GridFunction<'a> {
    /// The function with fourth-order slopes, limited so that it is monotone where the values are.
    pub fn monotone(
        nodes: &'a [f64],
        values: &'a [f64],
        at_zero: f64,
        weights: &SlopeWeights,
    ) -> Self {
        let mut slopes = weights.slopes(values);
        let last = nodes.len() - 1;
        let chord =
            |cell: usize| (values[cell + 1] - values[cell]) / (nodes[cell + 1] - nodes[cell]);
        for (node, slope) in slopes.iter_mut().enumerate() {
            let (before, after) = (chord(node.saturating_sub(1)), chord(node.min(last - 1)));
            let limit = STEEPEST * before.abs().min(after.abs());
            *slope = if before * after <= 0.0 || *slope * after < 0.0 {
                0.0
            } else {
                slope.max(-limit).min(limit) // a NaN stays one, where clamp panics
            };
        }
        Self {
            nodes,
            values,
            slopes,
            at_zero,
        }
    }

    pub fn value(&self, place: Place) -> f64 {
        let last = self.nodes.len() - 1;
        if place.s < self.nodes[0] {
            return self.at_zero + place.s * self.first_chord();
        }
        if place.s > self.nodes[last] {
            return self.values[last] + (place.s - self.nodes[last]) * self.last_chord();
        }
        let Place {
            cell,
            width,
            inside: u,
            ..
        } = place;
        let (a, b) = (self.values[cell], self.values[cell + 1]);
        let (da, db) = (width * self.slopes[cell], width * self.slopes[cell + 1]);
        // With the chord taken out first, a straight line is met to rounding.
        let bend = u * (1.0 - u) * ((1.0 - u) * (da - (b - a)) - u * (db - (b - a)));
        a + u * (b - a) + bend
    }

    pub fn slope(&self, place: Place) -> f64 {
        if place.s < self.nodes[0] {
            return self.first_chord();
        }
        if place.s > self.nodes[self.nodes.len() - 1] {
            return self.last_chord();
        }
        let (cell, u) = (place.cell, place.inside);
        let chord = (self.values[cell + 1] - self.values[cell]) / place.width;
        let (da, db) = (self.slopes[cell] - chord, self.slopes[cell + 1] - chord);
        chord + (1.0 - u) * (1.0 - 3.0 * u) * da - u * (2.0 - 3.0 * u) * db
    }

    fn first_chord(&self) -> f64 {
        if self.nodes[0] > 0.0 {
            (self.values[0] - self.at_zero) / self.nodes[0]
        } else {
            0.0
        }
    }

    fn last_chord(&self) -> f64 {
        let last = self.nodes.len() - 1;
        (self.values[last] - self.values[last - 1]) / (self.nodes[last] - self.nodes[last - 1])
    }
}

/// The value just after an event.
pub(super) enum ValueFunction<'a> {
    /// max(sign (1 - s), 0).
    Payoff(f64),
    /// The value at the start of the next segment.
    Grid(GridFunction<'a>),
}

impl ValueFunction<'_> {
    pub fn kinks(&self) -> Vec<Kink> {
        match self {
            Self::Payoff(_) => vec![Kink {
                place: 1.0,
                jump: 1.0,
            }],
            Self::Grid(_) => Vec::new(),
        }
    }

    pub fn value(&self, s: f64) -> f64 {
        match self {
            Self::Payoff(sign) => (sign * (1.0 - s)).max(0.0),
            Self::Grid(function) => function.value(Place::of(s, function.nodes)),
        }
    }

    /// The values at numbers that do not fall.
    pub fn values(&self, rising: impl Iterator<Item = f64>) -> Vec<f64> {
        let Self::Grid(function) = self else {
            return rising.map(|s| self.value(s)).collect();
        };
        let (nodes, mut cell) = (function.nodes, 0);
        let value = |s: f64| {
            while cell + 2 < nodes.len() && nodes[cell + 1] <= s {
                cell += 1;
            }
            function.value(Place::within(s, cell, nodes))
        };
        rising.map(value).collect()
    }

    pub fn slope(&self, s: f64) -> f64 {
        match self {
            Self::Payoff(sign) if sign * (1.0 - s) > 0.0 => -sign,
            Self::Payoff(_) => 0.0,
            Self::Grid(function) => function.slope(Place::of(s, function.nodes)),
        }
    }
}
