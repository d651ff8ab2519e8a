//! The march over a segment: known values, complementarity, both solvers against each other, and what is refused.

use std::sync::atomic::{AtomicUsize, Ordering};

use crate::interrupt::never;
use crate::lanes::dispatch::{forced, InstructionSet};

use super::{
    march_segment, sweep_schedule, sweep_schedules, KernelError, March, Part, Schedule, Scheme,
    Segment, Surface, Sweep, Task, Terms,
};

/// A Black-Scholes operator in s and the payoff on nodes that lie closer together around the strike.
struct Case {
    nodes: Vec<f64>,
    lower: Vec<f64>,
    diagonal: Vec<f64>,
    upper: Vec<f64>,
    payoff: Vec<f64>,
    sign: f64,
    rate: f64,
    dividend_yield: f64,
    contact_at: [bool; 2],
}

const VOLATILITY: f64 = 0.3;

impl Case {
    fn new(sign: f64, rate: f64, dividend_yield: f64, contact_at: [bool; 2]) -> Self {
        let node = |k: i32| (1.8 * (f64::from(k) / 60.0 - 1.0)).sinh().exp();
        let nodes: Vec<f64> = (0..=120).map(node).collect();
        let (mut lower, mut diagonal, mut upper) = (vec![], vec![], vec![]);
        for w in nodes.windows(3) {
            let (left, right) = (w[1] - w[0], w[2] - w[1]);
            let diffusion = 0.5 * VOLATILITY * VOLATILITY * w[1] * w[1];
            let drift = (rate - dividend_yield) * w[1];
            let (below, above) = (
                (2.0 * diffusion - drift * right) / (left * (left + right)),
                (2.0 * diffusion + drift * left) / (right * (left + right)),
            );
            lower.push(below);
            upper.push(above);
            diagonal.push(-below - above - rate);
        }
        let payoff = nodes.iter().map(|s| (sign * (1.0 - s)).max(0.0)).collect();
        Self {
            nodes,
            lower,
            diagonal,
            upper,
            payoff,
            sign,
            rate,
            dividend_yield,
            contact_at,
        }
    }

    fn segment(&self, exercisable: bool) -> Segment<'_> {
        let held = [self.sign, -self.sign];
        let lines = if self.sign > 0.0 {
            [held, [0.0, 0.0]]
        } else {
            [[0.0, 0.0], held]
        };
        Segment {
            nodes: &self.nodes,
            lower: &self.lower,
            diagonal: &self.diagonal,
            upper: &self.upper,
            sign: self.sign,
            escrow: 0.0,
            rate: self.rate,
            dividend_yield: self.dividend_yield,
            exercisable,
            lines,
            contact_at: self.contact_at,
        }
    }

    fn march(&self, exercisable: bool, scheme: Scheme, times: &[f64]) -> March {
        let contact = vec![false; self.lower.len()];
        march_segment(
            &self.segment(exercisable),
            times,
            scheme,
            &self.payoff,
            &contact,
            &[],
            &never,
        )
        .unwrap()
        .unwrap()
    }
}

fn put() -> Case {
    Case::new(1.0, 0.05, 0.0, [true, false])
}

fn times(steps: u32) -> Vec<f64> {
    let part = |k| f64::from(k) / f64::from(steps);
    (0..=steps).map(|k| part(k) * part(k)).collect()
}

fn at_the_money(march: &March) -> f64 {
    march.values[60]
}

fn assert_close(found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (a, b) in found.iter().zip(expected) {
        assert!((a - b).abs() <= tolerance, "{a} is not {b}");
    }
}

#[test]
fn a_european_put_is_worth_its_formula() {
    // Black-Scholes, S = K = 1, r = 5 %, sigma = 30 %, one year.
    let march = put().march(false, Scheme::Sdirk2, &times(60));
    assert!((at_the_money(&march) - 0.093_542_0).abs() < 2e-4);
    assert_eq!(march.residual.to_bits(), 0.0_f64.to_bits());
    assert!(march
        .slack
        .iter()
        .chain(&march.multiplier)
        .all(|x| *x == 0.0));
    assert!(march.regions.iter().all(|r| r[0] > r[1]));
}

#[test]
fn an_american_put_is_complementary_and_its_boundary_falls() {
    let march = put().march(true, Scheme::Sdirk2, &times(60));
    assert!((at_the_money(&march) - 0.098_70).abs() < 3e-4);
    assert!(march.residual < 1e-12);
    assert!(march.contact[0] && !march.contact[118]);
    for (i, contact) in march.contact.iter().enumerate() {
        assert!(march.slack[i] >= 0.0 && march.multiplier[i] >= 0.0);
        assert!(!contact || march.slack[i] == 0.0);
    }
    assert!(march.regions.iter().all(|r| r[0] == f64::NEG_INFINITY));
    assert!(march
        .regions
        .windows(2)
        .all(|pair| pair[1][1] <= pair[0][1] + 1e-9));
}

#[test]
fn portions_give_what_the_whole_gives() {
    let case = put();
    let times = times(24);
    for scheme in [Scheme::ImplicitEuler, Scheme::Sdirk2] {
        let whole = case.march(true, scheme, &times);
        let first = case.march(true, scheme, &times[..10]);
        let segment = case.segment(true);
        let rest = march_segment(
            &segment,
            &times[9..],
            scheme,
            &first.values,
            &first.contact,
            &[],
            &never,
        );
        let rest = rest.unwrap().unwrap();
        assert_eq!(whole.values, rest.values);
        assert_eq!(whole.contact, rest.contact);
        assert_eq!(whole.regions[9..], rest.regions);
    }
}

#[test]
fn the_elimination_gives_what_policy_iteration_gives() {
    let sides = [
        (put(), 1.0),
        (Case::new(-1.0, 0.02, 0.06, [false, true]), -1.0),
    ];
    for (case, sign) in sides {
        let direct = case.march(true, Scheme::Sdirk2, &times(30));
        let [low, high] = case.contact_at; // eliminated towards the wrong end, the set is found by iteration
        let general = Case::new(sign, case.rate, case.dividend_yield, [high, low]);
        let iterated = general.march(true, Scheme::Sdirk2, &times(30));
        assert_close(&direct.values, &iterated.values, 1e-12);
        assert_close(&direct.multiplier, &iterated.multiplier, 1e-9);
        assert_eq!(direct.contact, iterated.contact);
        assert!(direct.contact.contains(&true));
    }
}

#[test]
fn a_put_with_two_boundaries_is_exercised_between_them() {
    let case = Case::new(1.0, -0.02, -0.06, [false, false]);
    let march = case.march(true, Scheme::Sdirk2, &times(40));
    let [lower, upper] = march.regions[39];
    assert!(
        0.2 < lower && lower < upper && upper < 1.0,
        "{lower} {upper}"
    );
    assert!(march.residual < 1e-12);
}

#[test]
fn nothing_is_marched_between_fewer_than_two_times() {
    let case = put();
    for times in [&[][..], &[0.0]] {
        let march = case.march(true, Scheme::Sdirk2, times);
        assert_eq!(march.values[1..120], case.payoff[1..120]);
        assert!(march.regions.is_empty());
        assert!(march.multiplier.iter().all(|u| *u == 0.0));
    }
}

#[test]
fn nan_is_not_hidden() {
    let mut case = put();
    case.payoff[70] = f64::NAN;
    for exercisable in [true, false] {
        let march = case.march(exercisable, Scheme::Sdirk2, &times(3));
        assert!(march.values[70].is_nan());
    }
}

#[test]
fn one_interior_node_is_enough() {
    let (nodes, one) = ([0.5, 1.0, 1.5], [0.36]);
    let segment = Segment {
        nodes: &nodes,
        lower: &one,
        diagonal: &[-0.72],
        upper: &one,
        sign: 1.0,
        escrow: 0.0,
        rate: 0.0,
        dividend_yield: 0.0,
        exercisable: true,
        lines: [[1.0, -1.0], [0.0, 0.0]],
        contact_at: [true, false],
    };
    let march = march_segment(
        &segment,
        &[0.0, 1.0],
        Scheme::ImplicitEuler,
        &[0.5, 0.0, 0.0],
        &[false],
        &[],
        &never,
    );
    // 1.72 v = 0.36 * 0.5
    assert!((march.unwrap().unwrap().values[1] - 0.18 / 1.72).abs() < 1e-15);
}

#[test]
fn wrong_lengths_and_zero_pivots_are_named() {
    let case = put();
    let segment = case.segment(true);
    let refused = |segment: &Segment<'_>, values: &[f64], contact: &[bool]| {
        march_segment(
            segment,
            &[0.0, 1.0],
            Scheme::ImplicitEuler,
            values,
            contact,
            &[],
            &never,
        )
        .unwrap_err()
    };
    let contact = [false; 119];
    let error = refused(&segment, &case.payoff[1..], &contact);
    assert_eq!(error.to_string(), "values has length 120: must be 121");
    let error = refused(&segment, &case.payoff, &contact[1..]);
    assert_eq!(error.to_string(), "contact has length 118: must be 119");
    let short = Segment {
        nodes: &case.nodes[1..],
        ..segment
    };
    let error = refused(&short, &case.payoff, &contact);
    assert_eq!(error.to_string(), "nodes has length 120: must be 121");
    let empty = Segment {
        diagonal: &[],
        ..segment
    };
    assert_eq!(refused(&empty, &case.payoff, &contact), KernelError::Empty);
    // 1 - h L has the diagonal 0.
    let (zero, one) = (vec![0.0; 119], vec![1.0; 119]);
    let singular = Segment {
        lower: &zero,
        upper: &zero,
        diagonal: &one,
        ..segment
    };
    for contact_at in [[true, false], [false, false]] {
        let singular = Segment {
            contact_at,
            ..singular
        };
        let error = refused(&singular, &case.payoff, &contact);
        assert!(matches!(error, KernelError::ZeroPivot { .. }));
    }
}

/// Marches with dividends, dates and grids of their own.
struct Book {
    nodes: Vec<Vec<f64>>,
    times: Vec<Vec<f64>>,
    /// Sign, whether it may be exercised, and the numbers of every segment.
    contracts: Vec<(f64, bool, Vec<Terms<'static>>)>,
}

impl Book {
    fn new(count: u32) -> Self {
        let mut state = 12_345_u64;
        let mut random = |low: f64, high: f64| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            low + (high - low) * f64::from(u32::try_from(state >> 33).unwrap())
                / f64::from(1_u32 << 31)
        };
        let (mut nodes, mut steps, mut contracts) = (vec![], vec![], vec![]);
        for k in 0..count {
            let (low, high) = (random(0.1, 0.7), random(1.5, 5.0));
            let size = if k % 5 == 0 { 25 } else { 40 };
            let place = |i: u32| low * (high / low).powf(f64::from(i) / f64::from(size));
            nodes.push((0..=size).map(place).collect());
            steps.push(times(4 + k % 7));
            let terms = |amount: f64| Terms {
                rate: random(-0.02, 0.1),
                dividend_yield: random(-0.02, 0.08),
                volatility: random(0.1, 0.5),
                amount,
                escrow: if k % 3 == 0 { 0.05 } else { 0.0 },
                surface: None,
            };
            let segments = [0.03, 0.0, 0.6][..=(k as usize % 3)].iter();
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            contracts.push((sign, k % 4 != 3, segments.copied().map(terms).collect()));
        }
        Self {
            nodes,
            times: steps,
            contracts,
        }
    }

    fn parts(&self) -> Vec<Vec<Part<'_>>> {
        let of = |((_, exercisable, segments), times): (
            &(f64, bool, Vec<Terms<'static>>),
            &'_ Vec<f64>,
        )| {
            let part = |terms: &Terms<'static>| Part {
                terms: *terms,
                fraction: 0.02,
                exercisable: *exercisable,
                exercise_at_end: *exercisable,
                times: &self.times[self.times.iter().position(|t| t == times).unwrap()],
            };
            segments.iter().map(part).collect()
        };
        self.contracts.iter().zip(&self.times).map(of).collect()
    }

    fn schedules<'a>(&self, parts: &'a [Vec<Part<'a>>]) -> Vec<Schedule<'a>> {
        let of = |((sign, _, _), parts): (&(f64, bool, Vec<Terms<'static>>), &'a Vec<Part<'a>>)| {
            Schedule {
                sign: *sign,
                parts,
                directions: &[],
            }
        };
        self.contracts.iter().zip(parts).map(of).collect()
    }

    fn tasks<'a>(&'a self, schedules: &'a [Schedule<'a>]) -> Vec<Task<'a>> {
        let of = |((k, schedule), nodes): ((usize, &'a Schedule<'a>), &'a Vec<f64>)| Task {
            schedule,
            nodes,
            scheme: [Scheme::Sdirk2, Scheme::ImplicitEuler][usize::from(k % 9 == 0)],
            watched: &[1.0],
        };
        schedules
            .iter()
            .enumerate()
            .zip(&self.nodes)
            .map(of)
            .collect()
    }
}

fn bits(sweep: &Sweep) -> Vec<u64> {
    let regions = sweep.regions.iter().flatten().flatten();
    let numbers = sweep
        .values
        .iter()
        .chain(regions)
        .chain([&sweep.residual, &sweep.at_zero]);
    numbers.map(|x| (x + 0.0).to_bits()).collect() // zero has no sign
}

#[test]
fn a_sweep_in_a_lane_has_the_bits_of_the_one_alone_with_any_instruction_set() {
    let book = Book::new(60);
    let parts = book.parts();
    let schedules = book.schedules(&parts);
    let tasks = book.tasks(&schedules);
    let alone = |task: &Task<'_>| {
        let Task {
            schedule,
            nodes,
            scheme,
            watched,
        } = *task;
        sweep_schedule(schedule, nodes, scheme, watched, &never)
            .unwrap()
            .unwrap()
    };
    let expected: Vec<Sweep> = tasks.iter().map(alone).collect();
    assert!(
        expected
            .iter()
            .filter(|sweep| sweep.contact.contains(&true))
            .count()
            > 10
    );
    for set in InstructionSet::available() {
        for first in [0, 45] {
            let some = &tasks[first..];
            let found = forced::with(set, || sweep_schedules(some, &never)).unwrap();
            for (sweep, expected) in found.into_iter().zip(&expected[first..]) {
                let sweep = sweep.unwrap();
                assert_eq!(bits(&sweep), bits(expected));
                assert_eq!(sweep.contact, expected.contact);
            }
        }
    }
}

#[test]
fn lanes_ask_the_interrupt_before_every_step_and_every_segment() {
    let book = Book::new(40);
    let parts = book.parts();
    let schedules = book.schedules(&parts);
    let tasks = book.tasks(&schedules);
    let asked = AtomicUsize::new(0);
    let count = || {
        asked.fetch_add(1, Ordering::Relaxed);
        false
    };
    assert!(sweep_schedules(&tasks, &count).is_some());
    let segments: usize = parts.iter().map(Vec::len).sum();
    let longest = parts
        .iter()
        .map(|p| p.iter().map(|p| p.times.len() - 1).sum::<usize>())
        .max();
    assert!(asked.load(Ordering::Relaxed) >= segments + longest.unwrap());
    for end in [0, 7, 60] {
        let asked = AtomicUsize::new(0);
        let ends = || asked.fetch_add(1, Ordering::Relaxed) == end;
        assert!(sweep_schedules(&tasks, &ends).is_none());
        assert_eq!(asked.load(Ordering::Relaxed), end + 1);
    }
}

/// What one sweep gives where every segment has a surface of two times with the same volatility everywhere, which exceeds
/// its reference by what the segment's is smaller, and `rows` equal rows of weights.
fn with_surface(task: &Task<'_>, by: f64, rows: impl Fn(&Part<'_>) -> usize) -> Sweep {
    let variances = vec![0.09; 2 * (task.nodes.len() - 2)].leak();
    let split = |part: &Part<'_>| -> Part<'static> {
        let times = part.times.to_vec().leak();
        let weights = [0.25, 0.75].repeat(rows(part)).leak();
        let surface = Surface {
            variances,
            times: 2,
            weights,
            reference: 0.3 - by,
        };
        Part {
            terms: Terms {
                rate: part.terms.rate,
                dividend_yield: part.terms.dividend_yield,
                volatility: part.terms.volatility - by,
                amount: part.terms.amount,
                escrow: part.terms.escrow,
                surface: (!surface.weights.is_empty()).then_some(surface),
            },
            fraction: part.fraction,
            exercisable: part.exercisable,
            exercise_at_end: part.exercise_at_end,
            times,
        }
    };
    let parts: Vec<Part<'static>> = task.schedule.parts.iter().map(split).collect();
    let schedule = Schedule {
        sign: task.schedule.sign,
        parts: &parts,
        directions: &[],
    };
    let found = sweep_schedule(&schedule, task.nodes, task.scheme, task.watched, &never);
    found.unwrap().unwrap()
}

#[test]
fn a_volatility_by_nodes_that_is_the_same_everywhere_gives_what_one_number_gives() {
    let book = Book::new(20);
    let parts = book.parts();
    let schedules = book.schedules(&parts);
    for task in book.tasks(&schedules) {
        let expected = with_surface(&task, 0.0, |_| 0);
        for found in [
            with_surface(&task, 0.0625, |_| 1),
            with_surface(&task, 0.0625, |part| part.times.len() - 1),
        ] {
            for (value, other) in found.values.iter().zip(&expected.values) {
                assert!((value - other).abs() < 1e-12 * (1.0 + other.abs()));
            }
            assert_eq!(found.contact, expected.contact);
            assert_eq!(found.regions.len(), expected.regions.len());
        }
    }
}

#[test]
fn lanes_take_operators_that_change_from_step_to_step_with_the_bits_of_one_alone() {
    let mut book = Book::new(40);
    let count = book.nodes.len();
    for k in 0..count {
        book.nodes[k] = book.nodes[k - k % 2].clone(); // pairs on one grid
    }
    let parts = book.parts();
    let mut varied = parts.clone();
    for (k, parts) in varied.iter_mut().enumerate() {
        let size = book.nodes[k].len() - 2;
        let number = |i: usize| f64::from(u32::try_from(i).unwrap());
        let variance = |i: usize| 0.02 + 0.3 * number((7 * i + 3 * (k / 2)) % 11) / 11.0;
        let variances = (0..2 * size).map(variance).collect::<Vec<f64>>().leak();
        for part in parts.iter_mut() {
            let steps = part.times.len() - 1;
            let share = |step: usize| number(step) / number(steps);
            let weights = (0..steps).flat_map(|step| [share(step), 1.0 - share(step)]);
            part.terms.surface = Some(Surface {
                variances,
                times: 2,
                weights: weights.collect::<Vec<f64>>().leak(),
                reference: 0.3,
            });
        }
    }
    let schedules = book.schedules(&varied);
    let tasks = book.tasks(&schedules);
    for set in InstructionSet::available() {
        let found = forced::with(set, || sweep_schedules(&tasks, &never)).unwrap();
        for (task, found) in tasks.iter().zip(found) {
            let alone =
                sweep_schedule(task.schedule, task.nodes, task.scheme, task.watched, &never);
            assert_eq!(bits(&found.unwrap()), bits(&alone.unwrap().unwrap()));
        }
    }
}
