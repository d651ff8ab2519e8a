//! The engines on each instruction set that this machine has, against each other and against known values.

use crate::interrupt::never;
use crate::lanes::dispatch::{forced, InstructionSet};
use crate::obstacle_march;
use crate::premium_march::{march_boundaries, solve_puts, Puts, Solved, COLUMNS, STEPS, VALUES};

/// The largest difference between two instruction sets in values and their derivatives, in strikes: fused products and
/// other orders of sums differ by rounding, which the derivatives magnify; 1e-13 is attained.
const AGREEMENT: f64 = 1e-12;
/// The same for second derivatives.
const SECOND_AGREEMENT: f64 = 1e-10;

/// American puts: r T, q T, sigma sqrt(T), ln(S/K).
const PUTS: [[f64; 4]; 20] = [
    [0.05, 0.0, 0.2, 0.0],
    [0.05, 0.0, 0.2, -0.1],
    [0.05, 0.0, 0.2, -0.4],
    [0.05, 0.0, 0.2, 0.35],
    [0.05, 0.05, 0.25, 0.0],
    [0.03, 0.07, 0.3, 0.05],
    [0.08, 0.02, 0.15, -0.02],
    [0.02, 0.0, 0.6, 0.3],
    [0.15, 0.1, 0.8, -0.6],
    [0.3, 0.0, 0.5, 0.1],
    [0.004, 0.002, 0.08, 0.01],
    [0.001, 0.0, 0.05, 0.0],
    [0.05, -0.02, 0.2, 0.0],
    [0.1, 0.3, 0.4, 0.2],
    [0.02, 0.02, 0.1, -0.15],
    [0.06, 0.03, 0.35, 0.5],
    [0.05, 0.0, 1.0, 0.0],
    [0.09, 0.045, 0.45, -0.25],
    [0.0125, 0.01, 0.12, 0.03],
    [0.05, 0.051, 0.2, 0.0],
];

/// The stack of a thread that solves, in bytes: without optimisation every number of a march has a place of its own.
const STACK: usize = 1 << 28;

/// Call the function on one instruction set, with room on the stack.
fn on<R: Send>(set: InstructionSet, function: impl FnOnce() -> R + Send) -> R {
    let work = || forced::with(set, function);
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().stack_size(STACK);
        thread.spawn_scoped(scope, work).unwrap().join().unwrap()
    })
}

struct SolvedPuts {
    count: usize,
    numbers: Vec<f64>,
    settled: Vec<bool>,
    boundary: Vec<f64>,
}

impl SolvedPuts {
    /// What was found of each put.
    fn rows(&self) -> Vec<&[f64]> {
        self.numbers
            .chunks(self.numbers.len() / self.count)
            .collect()
    }
}
fn puts(set: InstructionSet, rows: &[[f64; 4]], tolerance: f64) -> SolvedPuts {
    puts_by(solve_puts, set, rows, tolerance)
}

fn puts_by(
    solve_puts: fn(Puts, usize) -> Solved,
    set: InstructionSet,
    rows: &[[f64; 4]],
    tolerance: f64,
) -> SolvedPuts {
    let column = |k: usize| rows.iter().map(|put| put[k]).collect::<Vec<f64>>();
    let (rate, dividend, spread, x) = (column(0), column(1), column(2), column(3));
    let count = rows.len();
    let first: Vec<usize> = (0..=count).collect();
    let limits = vec![1.0; VALUES * count];
    let puts = Puts {
        rate: &rate,
        dividend: &dividend,
        spread: &spread,
        first: &first,
        x: &x,
        tolerance: &vec![tolerance; count],
        limits: Some(&limits),
        spread_step: Some(0.2),
        levels: (2, STEPS.len() - 1),
        interrupt: &never,
    };
    on(set, || {
        let solved = solve_puts(puts, 1);
        SolvedPuts {
            count,
            numbers: solved.numbers,
            settled: solved.settled,
            boundary: march_boundaries(puts, 8).0,
        }
    })
}

fn assert_agree(found: &[f64], expected: &[f64], names: (InstructionSet, InstructionSet)) {
    assert_agree_to(AGREEMENT, found, expected, names);
}

fn assert_agree_to(
    agreement: f64,
    found: &[f64],
    expected: &[f64],
    names: (InstructionSet, InstructionSet),
) {
    assert_eq!(found.len(), expected.len());
    for (k, (a, b)) in found.iter().zip(expected).enumerate() {
        let close = (a - b).abs() <= agreement * (1.0 + b.abs()) || (a.is_nan() && b.is_nan());
        assert!(close, "number {k}: {a} and {b} on {names:?}");
    }
}

#[test]
fn the_best_instruction_set_is_one_of_those_available() {
    let available = InstructionSet::available();
    assert_eq!(available[0].name(), "portable");
    assert_eq!(available.last(), Some(&InstructionSet::best()));
}

#[test]
fn marches_agree_on_every_instruction_set() {
    let portable = InstructionSet::available()[0];
    let expected = puts(portable, &PUTS, 1e-6);
    assert!(expected.settled.iter().all(|&settled| settled));
    for set in InstructionSet::available() {
        let found = puts(set, &PUTS, 1e-6);
        assert_eq!(found.settled, expected.settled);
        for (found, expected) in found.rows().into_iter().zip(expected.rows()) {
            let (numbers, second) = found.split_at(COLUMNS);
            let (expected, expected_second) = expected.split_at(COLUMNS);
            assert_agree(numbers, expected, (set, portable));
            assert_agree_to(SECOND_AGREEMENT, second, expected_second, (set, portable));
        }
        assert_agree(&found.boundary, &expected.boundary, (set, portable));
    }
}

/// The largest change of a price from single precision, in strikes; error estimates count twice as much.
const SINGLE_ROUNDING: f64 = 1e-7;

/// Random puts: r T, q T, sigma sqrt(T), ln(S/K), most of them ordinary.
fn random_puts(count: usize) -> Vec<[f64; 4]> {
    let mut state = 1_u64;
    let mut uniform = |low: f64, high: f64| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        low + (high - low) * f64::from(u32::try_from(state >> 32).unwrap()) / f64::from(u32::MAX)
    };
    let mut put = |_| {
        let spread = uniform(0.009_f64.ln(), 1.6_f64.ln()).exp();
        let rate = uniform(1e-6_f64.ln(), 0.6_f64.ln()).exp();
        let dividend = match uniform(0.0, 4.0) {
            kind if kind < 1.0 => 0.0,
            kind if kind < 2.0 => rate * uniform(0.99, 1.01),
            kind if kind < 3.0 => uniform(-0.05, 0.3),
            _ => uniform(1e-6_f64.ln(), 0.6_f64.ln()).exp(),
        };
        [rate, dividend, spread, uniform(-3.0, 3.0) * spread]
    };
    (0..count).map(&mut put).collect()
}

/// The prices alone of puts, and how many steps each took.
fn prices(set: InstructionSet, rows: &[[f64; 4]], tolerance: f64) -> (Vec<f64>, Vec<i64>) {
    let column = |k: usize| rows.iter().map(|put| put[k]).collect::<Vec<f64>>();
    let (rate, dividend, spread, x) = (column(0), column(1), column(2), column(3));
    let first: Vec<usize> = (0..=rows.len()).collect();
    let puts = Puts {
        rate: &rate,
        dividend: &dividend,
        spread: &spread,
        first: &first,
        x: &x,
        tolerance: &vec![tolerance; rows.len()],
        limits: None,
        spread_step: None,
        levels: (0, STEPS.len() - 1),
        interrupt: &never,
    };
    on(set, || {
        let solved = solve_puts(puts, 1);
        let rows = solved.numbers.chunks(solved.per_spot);
        (rows.map(|numbers| numbers[0]).collect(), solved.steps)
    })
}

#[test]
fn single_precision_changes_prices_by_less_than_is_counted() {
    let puts = random_puts(if cfg!(debug_assertions) { 600 } else { 4000 });
    let portable = InstructionSet::available()[0];
    for tolerance in [1e-2, 1e-4] {
        let (expected, steps) = prices(portable, &puts, tolerance);
        assert!(steps.iter().filter(|&&steps| steps == 2).count() > puts.len() / 3);
        for set in InstructionSet::available() {
            let (found, own_steps) = prices(set, &puts, tolerance);
            // Where the error estimate is next to the tolerance, rounding decides whether a put is refined.
            let same = (0..puts.len()).filter(|&k| steps[k] == own_steps[k]);
            assert!(same.clone().count() > puts.len() * 99 / 100);
            for k in same.filter(|&k| steps[k] > 0) {
                let difference = (found[k] - expected[k]).abs();
                let told = format!("{:?} on {set:?}: {difference:e}", puts[k]);
                assert!(difference <= SINGLE_ROUNDING, "{told}");
            }
        }
    }
}

#[test]
fn a_price_in_single_precision_has_the_same_bits_alone_and_beside_others() {
    let puts = random_puts(200);
    for set in InstructionSet::available() {
        let (beside, _) = prices(set, &puts, 1e-4);
        for (put, beside) in puts.iter().zip(beside) {
            let (alone, _) = prices(set, &[*put], 1e-4);
            assert_eq!(alone[0].to_bits(), beside.to_bits(), "{put:?} on {set:?}");
        }
    }
}

/// So many puts of one class of meshes are marched by a wide vector, one by a narrow one.
const COPIES: usize = 5;

#[test]
fn a_put_has_the_same_bits_alone_and_beside_others() {
    let beside: Vec<[f64; 4]> = PUTS.iter().flat_map(|put| [*put; COPIES]).collect();
    for set in InstructionSet::available() {
        let (beside, settled) = {
            let found = puts(set, &beside, 1e-6);
            let rows = found.rows().into_iter().step_by(COPIES);
            (rows.map(<[f64]>::to_vec).collect::<Vec<_>>(), found.settled)
        };
        for (k, (put, beside)) in PUTS.iter().zip(beside).enumerate() {
            let alone = puts(set, &[*put], 1e-6);
            let bits = |numbers: &[f64]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
            assert_eq!(alone.settled[0], settled[COPIES * k]);
            assert_eq!(bits(&alone.numbers), bits(&beside), "put {k} on {set:?}");
        }
    }
}

/// S = K = 100, r = 5 %, no yield, volatility 20 %, one year: 6.0903707.
const PUBLISHED_PUT: f64 = 0.060_903_707;

#[test]
fn marches_have_known_values_on_every_instruction_set() {
    for set in InstructionSet::available() {
        let found = puts(set, &PUTS, 1e-8);
        let rows = found.rows();
        assert!((rows[0][0] - PUBLISHED_PUT).abs() < 1e-8, "{set:?}");
        // r = q = 5 %, volatility 25 %: from an integral equation.
        assert!((rows[4][0] - 0.095_694_452_99).abs() < 1e-8, "{set:?}");
        // Black and Scholes of the first: 5.5735260.
        assert!((rows[0][3] - 0.055_735_260).abs() < 1e-9, "{set:?}");
    }
}

#[test]
fn the_marches_agree_on_flat_puts_and_on_the_calls_that_they_are_with_everything_exchanged() {
    let segment = |rate, dividend_yield, volatility| obstacle_march::Segment {
        duration: 1.0,
        rate,
        dividend_yield,
        volatility,
        exercisable: true,
        exercise_at_end: true,
        fraction: 0.0,
        amount: 0.0,
        escrow: 0.0,
    };
    let segments: Vec<_> = PUTS
        .iter()
        .map(|&[rate, dividend, spread, _]| {
            [
                segment(rate, dividend, spread),
                segment(dividend, rate, spread),
            ]
        })
        .collect();
    let places = PUTS.map(|put| [put[3], -put[3]]);
    let contracts: Vec<_> = places
        .iter()
        .zip(&segments)
        .flat_map(|(place, pair)| {
            [
                (1.0, &place[..1], &pair[..1]),
                (-1.0, &place[1..], &pair[1..]),
            ]
        })
        .map(|(sign, places, segments)| obstacle_march::Contract {
            sign,
            places,
            segments,
            mesh: segments,
            european: true,
            local: None,
        })
        .collect();
    let tolerance = vec![1e-6; contracts.len()];
    let settings = obstacle_march::Settings::default();
    for set in InstructionSet::available() {
        let premiums = puts(set, &PUTS, 1e-8);
        let premiums = premiums.rows();
        let found = on(set, || {
            let greeks = obstacle_march::Greeks::None;
            obstacle_march::solve(&contracts, &tolerance, settings, greeks, 1, &never)
        });
        for (k, pair) in found.chunks(2).enumerate() {
            for (one, share) in pair.iter().zip([1.0, PUTS[k][3].exp()]) {
                let difference = (premiums[k][0] - share * one.value).abs();
                assert!(difference < 2e-6, "put {k} on {set:?}: {difference}");
            }
        }
    }
}
