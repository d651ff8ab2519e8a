//! American puts and calls in a flat market: as puts in their dimensionless parameters, and what the march finds of them
//! in money.
//!
//! Three numbers are left of a put: r T, q T and sigma sqrt(T). A call is the put with spot and strike, and rate and yield,
//! exchanged.

use super::mesh::STEPS;
use super::puts::{Puts, Solved, COLUMNS, PLAIN, SECOND, SPOTS_AT_ONCE, VALUES};
use super::solve::solve_puts;
use crate::interrupt::Interrupt;

/// The errors allowed to Greeks, in tolerances; chosen.
const GREEKS_SHARE: f64 = 10.0;
/// The rounding error of a marched value, in strikes of its put; measured.
const ROUNDING: f64 = 1e-14;
/// The smallest error of a value, as a share of it; two units in the last place.
const LEAST_ERROR: f64 = 4e-16;
/// The step of the difference for volga, as a share of the volatility; calibrated.
const SPREAD_STEP: f64 = 0.002;

/// The errors of the derivatives by x, by x twice, by rate, dividend and spread: shares of their change from one march to
/// the next, and of the value's error over the spread, or over its square; calibrated on random puts.
const OF_CHANGES: [f64; 5] = [0.47, 0.5, 0.76, 0.7, 0.5];
const OF_VALUES: [f64; 5] = [0.37, 0.6, 1.4, 1.3, 0.5];
const OVER_SQUARE: [bool; 5] = [false, true, true, true, false];
/// The same of vanna, volga and charm.
const OF_CROSS_CHANGES: f64 = 0.5;
const OF_CROSS_VALUES: [f64; 3] = [1.0, 1.0, 0.4];
/// What the derivatives by x, by x twice, by rate, dividend and spread are off by next to the exercise boundary, and vanna,
/// volga and charm: shares of `BesideBoundary::moved`; calibrated on random puts within 3 % of the boundary.
const OF_BOUNDARY: [f64; 5] = [0.2, 1.5, 0.4, 0.4, 0.2];
const OF_BOUNDARY_CROSS: [f64; 3] = [3.5, 3.5, 0.4];
/// How fast that falls with the distance from the boundary, over one deviation of ln S; calibrated on the same.
const FALL: f64 = 5.0;
/// How far ln(S*/K) moves with the spread, at most; measured on random puts.
const BOUNDARY_SPEED: f64 = 2.3;
/// The share of the boundary's error within which the spot may as well lie on its other side; calibrated on the same.
const OTHER_SIDE: f64 = 0.5;
/// The levels of the finest march of a put: 2 to 384 steps, 4 or more where derivatives are wanted.
const LEVELS: (usize, usize) = (0, STEPS.len() - 1);

/// Which Greeks are found.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Greeks {
    /// Those by the spot and time, which come with the price, without error estimates.
    None,
    /// Also those by the parameters, all with error estimates.
    Standard,
    /// Also vanna, volga and charm.
    Extended,
}

/// The names of the numbers found of each option, in order: without Greeks the first `UNASKED`, with the standard ones the
/// first `STANDARD`, with the extended ones all.
pub const NAMES: [&str; 23] = [
    "value",
    "european",
    "error",
    "delta",
    "gamma",
    "theta",
    "boundary",
    "boundary_error",
    "vega",
    "rho",
    "dividend_rho",
    "delta_error",
    "gamma_error",
    "theta_error",
    "vega_error",
    "rho_error",
    "dividend_rho_error",
    "vanna",
    "volga",
    "charm",
    "vanna_error",
    "volga_error",
    "charm_error",
];
const UNASKED: usize = 8;
const STANDARD: usize = 17;
const SECOND_ERRORS: usize = 20;

impl Greeks {
    /// The number of numbers found of each option.
    #[must_use]
    pub fn numbers(self) -> usize {
        match self {
            Self::None => UNASKED,
            Self::Standard => STANDARD,
            Self::Extended => NAMES.len(),
        }
    }
}

/// Options that may be exercised at any time; every column has one number for each.
#[derive(Clone, Copy)]
pub struct Options<'a> {
    /// Whether it is a put; a call otherwise.
    pub is_put: &'a [bool],
    /// Money.
    pub spot: &'a [f64],
    /// Money.
    pub strike: &'a [f64],
    /// Years.
    pub expiry: &'a [f64],
    /// 1/year, continuously compounded.
    pub rate: &'a [f64],
    /// 1/year, continuously compounded.
    pub dividend_yield: &'a [f64],
    /// 1/sqrt(year).
    pub volatility: &'a [f64],
    /// The largest error allowed in the price, in strikes.
    pub tolerance: &'a [f64],
}

/// One option, and the put that is marched in its place.
#[derive(Clone, Copy)]
struct Row {
    is_put: bool,
    spot: f64,
    strike: f64,
    expiry: f64,
    rate: f64,
    dividend_yield: f64,
    volatility: f64,
    root: f64,
}

/// Its dimensionless parameters.
#[derive(Clone, Copy)]
struct Put {
    x: f64,
    rate: f64,
    dividend: f64,
    spread: f64,
}

/// What is found of options; nothing of one that is not settled may be used.
pub struct Priced {
    /// The `NAMES` that were asked for, each with one number for each option.
    pub columns: Vec<(&'static str, Vec<f64>)>,
    /// Whether the spot is in the exercise region, and exercise pays.
    pub exercised: Vec<bool>,
    /// As in `Solved`.
    pub settled: Vec<bool>,
    /// As in `Solved`.
    pub steps: Vec<i64>,
}

/// Price options to their tolerances. With `shared` rows that differ in spot and strike alone share their solves.
#[must_use]
pub fn price_options(
    options: Options,
    greeks: Greeks,
    shared: bool,
    threads: usize,
    interrupt: Interrupt,
) -> Priced {
    let count = options.spot.len();
    let order = shared.then(|| options.side_by_side());
    let row_of = |place: usize| order.as_ref().map_or(place, |order| order[place]);
    let mut priced = Priced::nothing(count, greeks);
    // Rows that share solves stay together.
    let block = if shared { count } else { SPOTS_AT_ONCE };
    for start in (0..count).step_by(block.max(1)) {
        let places = start..count.min(start + block);
        let mut columns = Columns::with_capacity(places.len(), greeks);
        let mut last: Option<Put> = None;
        for at in places.map(row_of) {
            let row = options.row(at);
            let put = row.put();
            let continues = shared && last.is_some_and(|last| last.compare(&put).is_eq());
            columns.push(&row, &put, options.tolerance[at], continues);
            last = Some(put);
        }
        columns.first.push(columns.x.len());
        let found = solve_puts(columns.as_puts(greeks, interrupt), threads);
        for (place, at) in (start..).take(found.steps.len()).map(row_of).enumerate() {
            priced.keep(at, &options.row(at), &found, place, greeks);
        }
    }
    priced
}

/// The puts as columns, in the order in which they are marched.
struct Columns {
    x: Vec<f64>,
    rate: Vec<f64>,
    dividend: Vec<f64>,
    spread: Vec<f64>,
    first: Vec<usize>,
    tolerance: Vec<f64>,
    limits: Option<Vec<f64>>,
}

impl Columns {
    fn with_capacity(count: usize, greeks: Greeks) -> Self {
        let column = || Vec::with_capacity(count);
        Self {
            x: column(),
            rate: column(),
            dividend: column(),
            spread: column(),
            first: Vec::with_capacity(count + 1),
            tolerance: column(),
            limits: (greeks != Greeks::None).then(|| Vec::with_capacity(VALUES * count)),
        }
    }

    /// Add a spot, of the run before where it `continues` that.
    fn push(&mut self, row: &Row, put: &Put, tolerance: f64, continues: bool) {
        if !continues {
            self.first.push(self.x.len());
            self.rate.push(put.rate);
            self.dividend.push(put.dividend);
            self.spread.push(put.spread);
        }
        self.x.push(put.x);
        let of_put = tolerance * (row.strike / row.scale());
        let is_certain = row.is_exercised_even_without_expiry(put);
        self.tolerance
            .push(if is_certain { tolerance } else { of_put });
        if let Some(limits) = &mut self.limits {
            limits.extend(row.limits(of_put));
        }
    }

    fn as_puts<'a>(&'a self, greeks: Greeks, interrupt: Interrupt<'a>) -> Puts<'a> {
        Puts {
            rate: &self.rate,
            dividend: &self.dividend,
            spread: &self.spread,
            first: &self.first,
            x: &self.x,
            tolerance: &self.tolerance,
            limits: self.limits.as_deref(),
            spread_step: (greeks == Greeks::Extended).then_some(SPREAD_STEP),
            levels: LEVELS,
            interrupt,
        }
    }
}

impl Put {
    /// Which comes first where puts of one march lie side by side.
    fn compare(&self, other: &Self) -> std::cmp::Ordering {
        self.rate
            .total_cmp(&other.rate)
            .then(self.dividend.total_cmp(&other.dividend))
            .then(self.spread.total_cmp(&other.spread))
    }
}

impl Options<'_> {
    /// An order of the rows in which puts of one march lie side by side.
    fn side_by_side(&self) -> Vec<usize> {
        let puts: Vec<Put> = (0..self.spot.len()).map(|at| self.row(at).put()).collect();
        let mut order: Vec<usize> = (0..puts.len()).collect();
        order.sort_by(|&a, &b| puts[a].compare(&puts[b]).then(a.cmp(&b)));
        order
    }

    fn row(&self, at: usize) -> Row {
        Row {
            is_put: self.is_put[at],
            spot: self.spot[at],
            strike: self.strike[at],
            expiry: self.expiry[at],
            rate: self.rate[at],
            dividend_yield: self.dividend_yield[at],
            volatility: self.volatility[at],
            root: self.expiry[at].sqrt(),
        }
    }
}

impl Row {
    /// The first of the two for a put, the second for a call.
    fn choose<T>(&self, of_put: T, of_call: T) -> T {
        if self.is_put {
            of_put
        } else {
            of_call
        }
    }

    /// The put: a call is one with spot and strike, and rate and yield, exchanged.
    fn put(&self) -> Put {
        let x = (self.spot / self.strike).ln();
        Put {
            x: self.choose(x, -x),
            rate: self.choose(self.rate, self.dividend_yield) * self.expiry,
            dividend: self.choose(self.dividend_yield, self.rate) * self.expiry,
            spread: self.volatility * self.root,
        }
    }

    /// Whether even the put without expiry would be exercised: then the boundary alone is needed.
    fn is_exercised_even_without_expiry(&self, put: &Put) -> bool {
        let (spot, strike) = (
            self.choose(self.spot, self.strike),
            self.choose(self.strike, self.spot),
        );
        if spot >= strike {
            return false;
        }
        let drift = (put.rate - put.dividend) / put.spread - 0.5 * put.spread;
        let decay = drift + (drift * drift + 2.0 * put.rate).sqrt();
        spot * (1.0 + put.spread / decay) <= strike
    }

    /// The strike of the put.
    fn scale(&self) -> f64 {
        self.choose(self.strike, self.spot)
    }

    /// What the dimensionless values may be off by for Greeks to ten tolerances: delta, and theta, vega and the rhos over the
    /// strike; strike times gamma to a thousand tolerances. `tolerance` is that of the put's value.
    fn limits(&self, tolerance: f64) -> [f64; VALUES] {
        let allowed = GREEKS_SHARE * tolerance;
        let moneyness = self.spot / self.strike;
        let by_spot = allowed * moneyness; // delta = K/S v_x or v - v_x; its scale is 1, not the strike
        let curvature =
            (2.0 * allowed / self.volatility.powi(2)).min(100.0 * allowed * moneyness * moneyness);
        let by_rate = allowed / self.expiry;
        [
            f64::INFINITY,
            by_spot,
            curvature,
            f64::INFINITY,
            by_rate,
            by_rate,
            allowed / self.root,
        ]
    }

    /// What is found of the option; see `NAMES`. `error` is the estimated error of v.
    fn numbers(&self, found: &Found, greeks: Greeks) -> [f64; NAMES.len()] {
        let (scale, spot) = (self.scale(), self.spot);
        let [v, by_x, by_xx, european, ..] = found.values.map(|value| scale * value);
        let least = european.max(self.payoff());
        let estimated = scale
            * if found.exercised {
                found.error
            } else {
                found.error + ROUNDING
            };
        let delta = self.choose(by_x, v - by_x) / spot;
        let gamma = (by_xx - by_x) / spot / spot;
        // What a held value lacks of a bound that it cannot be below counts as error.
        let value = larger(v, least);
        let error = larger(estimated, least - v);
        let theta = [
            self.rate,
            -(self.rate - self.dividend_yield) * spot,
            -0.5 * (self.volatility * spot).powi(2),
        ];
        let boundary = self.strike * self.choose(found.boundary, -found.boundary).exp();
        let mut numbers = [0.0; NAMES.len()];
        numbers[..UNASKED].copy_from_slice(&[
            value,
            european,
            error,
            delta,
            gamma,
            theta[0] * value + theta[1] * delta + theta[2] * gamma,
            boundary,
            boundary * found.boundary_error,
        ]);
        if greeks != Greeks::None {
            let by_parameters = [4, 5, 6].map(|at| scale * found.values[at]);
            numbers[UNASKED..11].copy_from_slice(&self.by_parameters(by_parameters));
            let beside = self.beside_boundary(found);
            let errors = self.errors(found, &beside);
            numbers[11..13].copy_from_slice(&errors[..2]);
            let by_others = larger(theta[1].abs() * errors[0], theta[2].abs() * errors[1]);
            let terms = larger(theta[0].abs() * error, by_others);
            numbers[13] = terms;
            numbers[14..STANDARD].copy_from_slice(&errors[2..]);
            if greeks == Greeks::Extended {
                numbers[STANDARD..].copy_from_slice(&self.second_order(found, &beside));
            }
        }
        if found.exercised {
            numbers[0] = self.payoff();
            numbers[2] = estimated;
            numbers[3] = self.choose(-1.0, 1.0);
            numbers[4..6].fill(0.0);
            numbers[UNASKED..11].fill(0.0);
            numbers[STANDARD..SECOND_ERRORS].fill(0.0);
            let (put, error) = (self.put(), found.boundary_error);
            let is_sure = (put.x - found.boundary).abs() > error
                || self.is_exercised_even_without_expiry(&put);
            if is_sure {
                numbers[UNASKED + 3..STANDARD].fill(0.0);
                numbers[SECOND_ERRORS..].fill(0.0);
            }
        }
        numbers[2] = larger(numbers[2], LEAST_ERROR * numbers[0]);
        numbers
    }

    fn payoff(&self) -> f64 {
        self.choose(self.strike - self.spot, self.spot - self.strike)
            .max(0.0)
    }

    /// Vega, rho and dividend rho from the derivatives by the put's rate, dividend and spread, money.
    fn by_parameters(&self, [by_rate, by_dividend, by_spread]: [f64; 3]) -> [f64; 3] {
        [
            self.root * by_spread,
            self.expiry * self.choose(by_rate, by_dividend),
            self.expiry * self.choose(by_dividend, by_rate),
        ]
    }

    /// How fast r T, q T and sigma sqrt(T) of the put grow with the time to expiry.
    fn aging(&self) -> [f64; 3] {
        [
            self.choose(self.rate, self.dividend_yield),
            self.choose(self.dividend_yield, self.rate),
            0.5 * self.volatility / self.root,
        ]
    }

    /// The errors of delta, gamma, vega, rho and dividend rho.
    fn errors(&self, found: &Found, beside: &BesideBoundary) -> [f64; 5] {
        let scale = self.scale();
        let spread = self.volatility * self.root;
        let value = scale * (found.error + ROUNDING);
        let [by_x, by_xx, parameters @ ..]: [f64; 5] = std::array::from_fn(|k| {
            let over_spread = value / spread;
            let (of_value, of_boundary) = if OVER_SQUARE[k] {
                (over_spread / spread, beside.moved / spread)
            } else {
                (over_spread, beside.moved)
            };
            let far = OF_CHANGES[k] * scale * found.changes[k].abs() + OF_VALUES[k] * of_value;
            larger(beside.factor * far, scale * OF_BOUNDARY[k] * of_boundary)
        });
        let by_xx = by_xx + scale * beside.jump;
        let [vega, rho, dividend_rho] = self.by_parameters(parameters);
        let delta = self.choose(by_x, value + by_x) / self.spot;
        let gamma = (by_xx + by_x) / self.spot / self.spot;
        [delta, gamma, vega, rho, dividend_rho]
    }

    /// What the exercise boundary's error does to the derivatives next to it.
    fn beside_boundary(&self, found: &Found) -> BesideBoundary {
        let put = self.put();
        let cost = put.rate - put.dividend * found.boundary.exp();
        let rise = 2.0 * larger(cost, 0.0) / put.spread.powi(2);
        let away = (put.x - found.boundary).abs();
        let weight = 1.0 / (1.0 + FALL * away / put.spread);
        let is_unsure = away < OTHER_SIDE * found.boundary_error;
        BesideBoundary {
            factor: 1.0 + weight,
            moved: weight * rise * found.boundary_error,
            jump: if is_unsure { rise } else { 0.0 },
        }
    }

    /// Vanna, volga and charm, and their errors.
    ///
    /// A call's delta is v - `v_x`, v being the put with spot and strike exchanged, and x its ln(K/S).
    fn second_order(&self, found: &Found, beside: &BesideBoundary) -> [f64; 6] {
        let (scale, spread) = (self.scale(), self.volatility * self.root);
        let value = found.error + ROUNDING;
        let aging = self.aging();
        let by_volatility = [0.0, 0.0, self.root];
        let of_delta = |weights: [f64; 3], by: &[f64], by_x: &[f64]| -> f64 {
            let terms = (0..3).map(|j| weights[j] * self.choose(by_x[j], by[j] - by_x[j]));
            terms.sum::<f64>() / self.spot
        };
        let (by, by_x) = (&found.values[4..], &found.seconds[..3]);
        let (changes, changes_by_x) = (&found.changes[2..], &found.second_changes[..3]);
        let volga_rounding = ROUNDING / (SPREAD_STEP * spread).powi(2);
        // Inside the exercise region no march looks for it.
        let volga_change = if found.exercised {
            0.0
        } else {
            found.second_changes[3].abs()
        };
        let errors = [
            (OF_CROSS_CHANGES * of_delta(by_volatility, changes, changes_by_x)).abs()
                + OF_CROSS_VALUES[0] * self.root * value / spread.powi(2) / self.spot,
            self.expiry
                * (OF_CROSS_CHANGES * volga_change
                    + OF_CROSS_VALUES[1] * value / spread.powi(2)
                    + volga_rounding),
            OF_CROSS_CHANGES * of_delta(aging, changes, changes_by_x).abs()
                + OF_CROSS_VALUES[2] * value / spread / (self.expiry * self.spot),
        ];
        // About how far the boundary moves: somewhat more than twice as far as the spread, and with the time as the spread does.
        let moved = [
            beside.moved / spread * self.root / self.spot,
            beside.moved / spread * self.expiry,
            beside.moved / (self.expiry * self.spot),
        ];
        let jumps = [
            BOUNDARY_SPEED * beside.jump * self.root / self.spot,
            BOUNDARY_SPEED.powi(2) * beside.jump * self.expiry,
            0.5 * BOUNDARY_SPEED * beside.jump * spread / (self.expiry * self.spot),
        ];
        let [vanna, volga, charm] = std::array::from_fn(|k| {
            larger(beside.factor * errors[k], OF_BOUNDARY_CROSS[k] * moved[k]) + jumps[k]
        });
        [
            of_delta(by_volatility, by, by_x),
            self.expiry * found.seconds[3],
            -of_delta(aging, by, by_x),
            vanna,
            volga,
            charm,
        ]
        .map(|number| scale * number)
    }
}

/// What the exercise boundary's error, and where it lies, do to the errors of derivatives.
struct BesideBoundary {
    /// The factor on what their changes tell.
    factor: f64,
    /// `V_xx` next to the boundary, in strikes, times the boundary's error, less further away.
    moved: f64,
    /// The jump of `V_xx` at the boundary, in strikes, where the spot may lie on its other side.
    jump: f64,
}

/// What the marches say of one put; see `Solved::numbers`.
struct Found {
    values: [f64; VALUES],
    error: f64,
    boundary: f64,
    boundary_error: f64,
    changes: [f64; 5],
    seconds: [f64; SECOND],
    second_changes: [f64; SECOND],
    exercised: bool,
}

impl Found {
    fn of(solved: &Solved, at: usize) -> Self {
        let numbers = &solved.numbers[at * solved.per_spot..(at + 1) * solved.per_spot];
        let number = |column: usize| numbers.get(column).copied().unwrap_or_default();
        let second = |column: usize| number(COLUMNS + column);
        Self {
            values: std::array::from_fn(number),
            error: number(VALUES),
            boundary: number(VALUES + 1),
            boundary_error: number(VALUES + 2),
            changes: std::array::from_fn(|k| number(PLAIN + k)),
            seconds: std::array::from_fn(second),
            second_changes: std::array::from_fn(|k| second(SECOND + k)),
            exercised: solved.exercised[at],
        }
    }
}

impl Priced {
    /// Nothing yet, of so many options.
    fn nothing(count: usize, greeks: Greeks) -> Self {
        let names = NAMES.into_iter().take(greeks.numbers());
        Self {
            columns: names.map(|name| (name, vec![f64::NAN; count])).collect(),
            exercised: vec![false; count],
            settled: vec![false; count],
            steps: vec![0; count],
        }
    }

    /// Keep what was found of a put, in the money of the row of its option.
    fn keep(&mut self, at: usize, row: &Row, solved: &Solved, place: usize, greeks: Greeks) {
        self.steps[at] = solved.steps[place];
        if !solved.settled[place] {
            return;
        }
        let found = Found::of(solved, place);
        let numbers = row.numbers(&found, greeks);
        for ((_, column), number) in self.columns.iter_mut().zip(numbers) {
            column[at] = number;
        }
        self.settled[at] = true;
        self.exercised[at] = found.exercised && row.payoff() > 0.0;
    }
}

/// The larger of two numbers; NaN where one is.
fn larger(a: f64, b: f64) -> f64 {
    if a > b || a.is_nan() {
        a
    } else {
        b
    }
}
