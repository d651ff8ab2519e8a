//! How far the degree of a boundary's polynomial is raised: the table of degrees, the error that the value may have, and
//! where the spot is likely to be.

use super::collocation_nodes::{collocation_nodes, CollocationNodes};
use super::contact_onset::Representation;
use super::segment::Segment;

/// The degrees of the polynomial. For each: the degree, the number of nodes of each of its integrals, and that of the
/// integral for the value, which sees the youngest contact sets closely near the boundary. Chosen; the nodes so that the
/// integrals are more accurate than the polynomial.
pub const DEGREES: [(usize, usize, usize); 7] = [
    (2, 4, 8),
    (3, 5, 12),
    (4, 6, 16),
    (6, 8, 20),
    (8, 12, 24),
    (12, 16, 32),
    (16, 24, 40),
];
/// The largest of the degrees.
pub const LARGEST_DEGREE: usize = DEGREES[DEGREES.len() - 1].0;

/// The nodes at which the value at the segment's beginning sees the contact sets of a boundary of this degree.
pub fn value_nodes(degree: usize) -> &'static CollocationNodes {
    let row = DEGREES.iter().find(|row| row.0 == degree);
    collocation_nodes(degree, row.map_or(0, |row| row.2))
}

/// The number of cells in which two boundaries are compared; chosen.
pub const CELLS: usize = 8;
/// The width of a cell, in standard deviations of ln S over the segment; chosen.
pub const CELL: f64 = 0.6;
/// The standard deviation by which the places are blurred, in those of ln S over the segment; calibrated on random
/// contracts.
const BLUR: f64 = 0.5;
/// The largest residual that is small enough, as a share of the tolerance, of the slope: where that is a little wrong, so
/// is the boundary, and the value by a few hundredths of that. Calibrated on random contracts.
const ENOUGH_OF_SLOPE: f64 = 0.5;
/// The largest residual that is small enough, as a share of the tolerance, of the value; calibrated on random contracts.
const ENOUGH_OF_VALUE: f64 = 0.05;
/// The residual that is always small enough, in strikes; chosen.
pub const SMALLEST_RESIDUAL: f64 = 1e-9;

/// The share of the sum of the error estimates of all boundaries that counts in full, as if all erred to one side; the rest is
/// added in quadrature. Calibrated on random contracts.
const ONE_SIDED: f64 = 0.2;

/// The error estimates of all boundaries together, in strikes.
#[derive(Clone, Copy, Default)]
pub struct ErrorTotal {
    sum: f64,
    squares: f64,
}

impl ErrorTotal {
    /// Add the error estimate of one more boundary.
    pub fn add(&mut self, error: f64) {
        self.sum += error;
        self.squares += error * error;
    }

    /// The error of the value.
    pub fn total(&self) -> f64 {
        ONE_SIDED * self.sum + (1.0 - ONE_SIDED) * self.squares.sqrt()
    }

    /// The total of so many equal errors over one of them.
    #[allow(clippy::cast_precision_loss)]
    pub fn of_equals(count: usize) -> f64 {
        ONE_SIDED * count as f64 + (1.0 - ONE_SIDED) * (count as f64).sqrt()
    }
}

/// How far the degree is raised.
#[derive(Clone, Copy)]
pub struct DegreeControl {
    /// The place of the last degree in `DEGREES`.
    pub last: usize,
    /// The largest error estimate of the value now, in strikes, at which the degree is not raised further; None for the
    /// last degree alone.
    pub budget: Option<f64>,
    /// The tolerance of the whole value, in strikes; 0 where no budget is given.
    pub tolerance: f64,
    /// The number of degrees in a row that bring nothing after which no further one is tried.
    pub patience: usize,
    /// The share of the violation inside the contact set in the error estimate.
    pub violation_share: f64,
    /// The expectation of x at the segment's beginning, as seen from now, and its standard deviation.
    pub centre: f64,
    pub deviation: f64,
    /// What dividends add to the spot so that it is lognormal, as seen from now, in strikes.
    pub displacement: f64,
}

impl DegreeControl {
    /// The largest residual that is small enough, in strikes: of the slope, or of the value.
    pub fn enough(&self, representation: Representation) -> f64 {
        let share = if representation == Representation::FromCrossing {
            ENOUGH_OF_VALUE
        } else {
            ENOUGH_OF_SLOPE
        };
        SMALLEST_RESIDUAL.max(share * self.tolerance)
    }

    /// The probabilities of being in each of the cells from `origin` outwards at the segment's beginning; `outward` is the
    /// direction of x out of the contact set.
    pub fn probabilities(&self, segment: &Segment, outward: f64, origin: f64) -> [f64; CELLS] {
        let spread = segment.spread();
        let deviation = self.deviation.hypot(BLUR * spread);
        let displaced = |x: f64| (x.exp() + self.displacement).ln();
        let centre = displaced(self.centre);
        #[allow(clippy::cast_precision_loss)]
        let below = |cell: usize| {
            let place = displaced(origin + outward * CELL * spread * cell as f64);
            distribution(outward * (place - centre) / deviation)
        };
        std::array::from_fn(|cell| below(cell + 1) - below(cell))
    }
}

/// The normal distribution function N(z).
pub fn distribution(z: f64) -> f64 {
    0.5 * libm::erfc(-z * std::f64::consts::FRAC_1_SQRT_2)
}
