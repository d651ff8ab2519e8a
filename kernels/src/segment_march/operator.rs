//! The Black-Scholes operator on the nodes of a grid, and its derivatives by parameters.

/// The numbers of a schedule that the operator knows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Coefficients<'a> {
    pub rate: f64,
    pub dividend_yield: f64,
    pub volatility: f64,
    /// What the volatility at each interior node exceeds that by; nothing where it is the same everywhere.
    pub excess: &'a [f64],
}

/// The entries of a three-point operator at the interior nodes.
#[derive(Clone)]
pub(super) struct Rows {
    pub lower: Vec<f64>,
    pub diagonal: Vec<f64>,
    pub upper: Vec<f64>,
}

/// The central first and second differences on a grid.
pub(super) struct Differences<'a> {
    pub nodes: &'a [f64],
    first: Vec<[f64; 3]>,
    second: Vec<[f64; 3]>,
}

impl<'a> Differences<'a> {
    pub fn new(nodes: &'a [f64]) -> Self {
        let widths = |three: &[f64]| (three[1] - three[0], three[2] - three[1]);
        let first = |three: &[f64]| {
            let (left, right) = widths(three);
            let both = left + right;
            let (low, high) = (-right / (left * both), left / (right * both));
            [low, (right - left) / (left * right), high]
        };
        let second = |three: &[f64]| {
            let (left, right) = widths(three);
            let both = left + right;
            let (low, high) = (2.0 / (left * both), 2.0 / (right * both));
            [low, -2.0 / (left * right), high]
        };
        Self {
            nodes,
            first: nodes.windows(3).map(first).collect(),
            second: nodes.windows(3).map(second).collect(),
        }
    }

    /// L = sigma^2 s^2/2 d^2/ds^2 + (r - q) s d/ds - r, the diffusion raised where a cell is too coarse for the drift.
    pub fn operator(&self, of: Coefficients<'_>) -> Rows {
        let drift = of.rate - of.dividend_yield;
        self.rows(|i| self.diffusion(of, i).0, drift, of.rate)
    }

    /// The derivative of L between two sets of coefficients, 2 `step` apart.
    pub fn derivative(&self, up: Coefficients<'_>, down: Coefficients<'_>, step: f64) -> Rows {
        let by = |up: f64, down: f64| (up - down) / (2.0 * step);
        let rate = by(up.rate, down.rate);
        let drift = rate - by(up.dividend_yield, down.dividend_yield);
        let diffusion = |i| by(self.diffusion(up, i).0, self.diffusion(down, i).0);
        self.rows(diffusion, drift, rate)
    }

    /// Whether the diffusion is raised at the interior node next to one of the places.
    pub fn is_raised_at(&self, of: Coefficients<'_>, places: &[f64]) -> bool {
        let inside = &self.nodes[1..self.nodes.len() - 1];
        places.iter().any(|place| {
            let above = inside.partition_point(|s| s < place).min(inside.len() - 1);
            let below = above.saturating_sub(1);
            let is_above = (inside[above] - place).abs() < (inside[below] - place).abs();
            let nearest = if is_above { above } else { below };
            self.diffusion(of, nearest).1
        })
    }

    fn rows(&self, diffusion: impl Fn(usize) -> f64, drift: f64, rate: f64) -> Rows {
        let size = self.first.len();
        let mut rows = Rows {
            lower: vec![0.0; size],
            diagonal: vec![0.0; size],
            upper: vec![0.0; size],
        };
        for i in 0..size {
            let (a, m) = (diffusion(i), drift * self.nodes[i + 1]);
            let entry = |k: usize| a * self.second[i][k] + m * self.first[i][k];
            rows.lower[i] = entry(0);
            rows.diagonal[i] = entry(1) - rate;
            rows.upper[i] = entry(2);
        }
        rows
    }

    /// sigma^2 s^2/2 at an interior node, raised as Il'in does where |m| ds > sigma^2 s^2; and whether it is.
    fn diffusion(&self, of: Coefficients<'_>, i: usize) -> (f64, bool) {
        let [low, s, high] = [self.nodes[i], self.nodes[i + 1], self.nodes[i + 2]];
        let volatility = match of.excess.get(i) {
            Some(excess) => (of.volatility + excess).max(0.0),
            None => of.volatility,
        };
        let diffusion = 0.5 * (volatility * volatility) * (s * s);
        let half = 0.5 * (of.rate - of.dividend_yield).abs() * s * (s - low).max(high - s);
        if half > diffusion {
            ((1.0 + 1e-12) * half / (half / diffusion).tanh(), true)
        } else {
            (diffusion, false)
        }
    }
}
