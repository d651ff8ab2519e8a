//! The march over a segment: known values, complementarity, both solvers against each other, and what is refused.

use crate::interrupt::never;

use super::{march_segment, KernelError, March, Scheme, Segment};

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
