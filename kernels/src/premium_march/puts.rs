//! Puts in their dimensionless parameters, and what a solver finds of them.

use crate::interrupt::Interrupt;

/// The number of values of each spot: V/K, its first and second derivative by x = ln(S/K), the European V/K, and the
/// derivatives of V/K by rate, dividend and spread.
pub const VALUES: usize = 7;
/// The number of second derivatives of V/K that one march gives: by x and each of rate, dividend and spread.
pub const CROSS: usize = 3;

/// The `VALUES` that are derivatives: of V/K by x, once and twice, and by rate, dividend and spread.
pub const DERIVATIVES: [usize; 5] = [1, 2, 4, 5, 6];
/// The number of numbers found for each spot in any case: its `VALUES`, the error estimate of V/K, ln(S*/K), and the error
/// estimate of that.
pub const PLAIN: usize = VALUES + 3;
/// Those, and how far the derivatives of the last two marches are apart.
pub const COLUMNS: usize = PLAIN + DERIVATIVES.len();
/// The number of second derivatives found for each spot where they are wanted: by x and each of rate, dividend and
/// spread, and by spread twice.
pub const SECOND: usize = CROSS + 1;
/// Those, and how far each is apart in the last two marches.
pub const SECOND_COLUMNS: usize = 2 * SECOND;

/// The number of spots that are solved at a time: enough to fill the lanes, few enough for what is kept of them to stay in
/// a core's cache; measured.
pub const SPOTS_AT_ONCE: usize = 2048;

/// Puts in their dimensionless parameters: runs of spots that share a march.
#[derive(Clone, Copy)]
pub struct Puts<'a> {
    /// r T of each run, (runs,).
    pub rate: &'a [f64],
    /// q T of each run, (runs,).
    pub dividend: &'a [f64],
    /// sigma sqrt(T) of each run, (runs,).
    pub spread: &'a [f64],
    /// The first spot of each run, and the number of spots; increasing, (runs + 1,).
    pub first: &'a [usize],
    /// ln(S/K) of each spot, (spots,).
    pub x: &'a [f64],
    /// The largest error allowed in V/K, (spots,).
    pub tolerance: &'a [f64],
    /// The largest error allowed in each of the `VALUES` numbers of a spot, (spots x `VALUES`,); None leaves out the
    /// derivatives by the parameters.
    pub limits: Option<&'a [f64]>,
    /// The step of the spread, as a share of it, for the second derivative of V/K by the spread; None leaves that out.
    pub spread_step: Option<f64>,
    /// The smallest and the largest level of the finest solve of a put.
    pub levels: (usize, usize),
    /// Ends the work; asked within every march.
    pub interrupt: Interrupt<'a>,
}

impl Puts<'_> {
    /// The number of numbers that are found for each spot.
    fn numbers_per_spot(&self) -> usize {
        match (self.limits, self.spread_step) {
            (_, Some(_)) => COLUMNS + SECOND_COLUMNS,
            (Some(_), None) => COLUMNS,
            (None, None) => PLAIN,
        }
    }
}

/// The results, by spot; nothing of a spot that is not settled may be used.
pub struct Solved {
    /// For each spot `per_spot` numbers side by side: the first `PLAIN`, and where there are limits, `COLUMNS` in all, the
    /// differences of the derivatives. Where there is a step of the spread `SECOND_COLUMNS` follow, not a number in the
    /// exercise region: the derivatives by x and each of rate, dividend and spread, and by spread twice, and how far each
    /// is apart in the last two marches.
    pub numbers: Vec<f64>,
    /// How many numbers there are for each spot.
    pub per_spot: usize,
    /// Whether the spot is in the exercise region.
    pub exercised: Vec<bool>,
    /// False where x is not finite, the march does not serve, a march lost the boundary, or an interrupt came before.
    pub settled: Vec<bool>,
    /// The number of time steps of the finest march; 0 where the march does not serve.
    pub steps: Vec<i64>,
}

impl Solved {
    /// Nothing found yet of these puts.
    #[must_use]
    pub fn new(puts: &Puts) -> Self {
        let (count, per_spot) = (puts.x.len(), puts.numbers_per_spot());
        Self {
            numbers: vec![f64::NAN; per_spot * count],
            per_spot,
            exercised: vec![false; count],
            settled: vec![false; count],
            steps: vec![0; count],
        }
    }
}
