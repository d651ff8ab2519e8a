//! American, Bermudan and European options with whatever happens to them, by one march from expiry to now.
//!
//! The equation `V_tau` = D `V_xx` + m `V_x` - r V + u with 0 <= u, V >= exercise, one of them tight, in x = ln S, on the
//! compact scheme of fourth order, with the complementarity condition averaged over a cell; `docs/obstacle.md` has the
//! mathematics, and the library's folder `obstacle` the same march in `NumPy` for any obstacle problem. Here as many
//! contracts are marched side by side as a vector has lanes.
//!
//! A put's contact set lies at the left, a call's at the right end, which is turned to the left. With the elimination
//! from the far end, and the substitution from the near one settling node by node how much of its cell lies in the
//! contact set, one sweep solves a stage (Brennan and Schwartz 1977 with the averaged condition).

// Every operation must be compiled into the one function that has the instruction set.
#![allow(clippy::inline_always)]
#![allow(clippy::similar_names, clippy::many_single_char_names)] // the formulas' names

mod contract;
mod event;
mod line;
mod local_terms;
mod march;
mod mesh;
mod newton;
mod record;
mod settings;
mod solve;
mod stage;
mod start;
mod steps;
mod surface;
mod tableau;
mod terms;
mod walk_back;

pub use contract::{Contract, Segment};
pub use march::End;
pub use settings::Settings;
pub use solve::{solve, Changing, Found, Greeks, LOCAL};
pub use surface::{Local, Surface};
pub use walk_back::BySegment;

#[cfg(test)]
mod tests {
    use super::march::{Group, Marched};
    use super::{solve, Contract, Found, Greeks, Local, Segment, Settings, Surface};
    use crate::interrupt::never;
    use crate::lanes::dispatch::{dispatch, forced, InstructionSet};

    fn segment(duration: f64) -> Segment {
        Segment {
            duration,
            rate: 0.05,
            dividend_yield: 0.02,
            volatility: 0.25,
            exercisable: true,
            exercise_at_end: true,
            fraction: 0.0,
            amount: 0.0,
            escrow: 0.0,
        }
    }

    fn contract<'a>(sign: f64, places: &'a [f64], segments: &'a [Segment]) -> Contract<'a> {
        Contract {
            sign,
            places,
            segments,
            mesh: segments,
            european: false,
            local: None,
        }
    }

    /// The first of contracts that are marched side by side on a grid of so many cells, walked back or not.
    fn marched(contracts: Vec<Contract>, cells: usize, walked: usize) -> Marched {
        let group = Group {
            contracts,
            cells,
            settings: Settings::default(),
            walked,
            interrupt: &never,
        };
        dispatch(group).expect("nothing interrupts")[0].clone()
    }

    fn solved(contracts: &[Contract], tolerance: f64) -> Vec<Found> {
        let tolerance = vec![tolerance; contracts.len()];
        solve(
            contracts,
            &tolerance,
            Settings::default(),
            Greeks::None,
            1,
            &never,
        )
    }

    /// True values by other engines of the library, to 1e-8.
    #[test]
    fn options_have_their_values() {
        let mut paid = [segment(0.3), segment(0.5)];
        paid[0].amount = 0.04;
        let mut two_boundaries = [segment(1.0)];
        let only = &mut two_boundaries[0];
        (only.rate, only.dividend_yield, only.volatility) = (-0.02, -0.06, 0.1);
        for (sign, segments, value) in [
            (1.0, &paid[..], 0.097_696_62),
            (-1.0, &paid[..], 0.080_357_57),
            (1.0, &two_boundaries[..], 0.027_445_32),
        ] {
            let contract = contract(sign, &[0.0], segments);
            let found = &solved(&[contract], 1e-6)[0];
            assert!(found.met && found.settled);
            assert!(
                (found.value - value).abs() < found.error + 1e-8,
                "{value} {found:?}"
            );
        }
    }

    /// Rows that are told node by node are those of constants, and so are the derivatives.
    #[test]
    fn a_flat_surface_is_a_constant_volatility() {
        let mut segments = [segment(0.3), segment(0.5)];
        segments[0].amount = 0.04;
        let surface = Surface {
            times: vec![0.1],
            logs: vec![-0.2, 0.1],
            values: vec![0.25; 2],
            slopes: vec![0.0; 2],
        };
        let local = Local {
            surface: &surface,
            log_strike: 0.0,
            reference: 0.25,
        };
        for sign in [1.0, -1.0] {
            let constant = contract(sign, &[-0.05], &segments);
            let flat = Contract {
                local: Some(local),
                ..constant
            };
            let [even, uneven] = [constant, flat].map(|contract| marched(vec![contract], 64, 1));
            assert_eq!(even.steps, uneven.steps);
            for (one, other) in even.values.iter().zip(&uneven.values) {
                assert!((one - other).abs() < 1e-12, "{one} {other}");
            }
            for (one, other) in even.by_segment.iter().zip(&uneven.by_segment) {
                for (a, b) in one.numbers().iter().zip(other.numbers()) {
                    assert!((a - b).abs() < 1e-9, "{one:?} {other:?}");
                }
            }
        }
    }

    /// On one grid, by the rate, the yield, the volatility and the amount of each segment, under a volatility that changes
    /// with the place and the time; beside it the contract without early exercise, which looks at every node.
    #[test]
    fn derivatives_are_differences() {
        let mut segments = [segment(0.3), segment(0.5)];
        segments[0].amount = 0.02;
        let surface = Surface {
            times: vec![0.1, 0.6],
            logs: vec![-0.3, 0.0, 0.3],
            values: vec![0.36, 0.25, 0.2, 0.3, 0.22, 0.23],
            slopes: vec![-0.4, -0.24, -0.1, -0.3, 0.0, 0.03],
        };
        let local = Local {
            surface: &surface,
            log_strike: 0.0,
            reference: 0.25,
        };
        let march = |sign: f64, own: &[Segment; 2], walked: usize| {
            let held = own.map(Segment::held);
            let contracts = [own, &held].map(|of| Contract {
                mesh: &segments,
                local: Some(local),
                ..contract(sign, &[-0.03], of)
            });
            marched(contracts.to_vec(), 128, walked)
        };
        let numbers: [fn(&mut Segment) -> &mut f64; 4] = [
            |one| &mut one.rate,
            |one| &mut one.dividend_yield,
            |one| &mut one.volatility,
            |one| &mut one.amount,
        ];
        for sign in [1.0, -1.0] {
            let found = march(sign, &segments, 1);
            for (k, own) in found.by_segment.iter().enumerate() {
                for (name, number) in [0, 1, 2, 4].into_iter().zip(numbers) {
                    if name == 4 && k == 1 {
                        continue; // nothing is paid at expiry
                    }
                    let moved = |by: f64| {
                        let mut other = segments;
                        *number(&mut other[k]) += by;
                        march(sign, &other, 0).line().at((-0.03_f64).exp())
                    };
                    let step = 1e-5;
                    let difference = (moved(step) - moved(-step)) / (2.0 * step);
                    let derivative = own.numbers()[name];
                    assert!(
                        (derivative - difference).abs() < 2e-5,
                        "sign {sign} segment {k} number {name}: {derivative} {difference}"
                    );
                }
            }
        }
    }

    /// Neither on what is marched beside it, nor on the instruction set, but for rounding.
    #[test]
    fn a_contract_depends_on_itself_alone() {
        let books: Vec<Vec<Segment>> = (0..21_u32)
            .map(|k| {
                let mut segments = vec![segment(0.1 + 0.03 * f64::from(k)), segment(0.4)];
                segments[0].amount = 0.002 * f64::from(k);
                segments[1].volatility = 0.15 + 0.02 * f64::from(k);
                if k % 4 == 3 {
                    (segments[1].rate, segments[1].dividend_yield) = (-0.02, -0.05);
                }
                segments
            })
            .collect();
        let contracts: Vec<Contract> = books
            .iter()
            .enumerate()
            .map(|(k, segments)| contract(if k % 3 == 0 { -1.0 } else { 1.0 }, &[0.0], segments))
            .collect();
        let together = solved(&contracts, 1e-4);
        for (contract, beside) in contracts.iter().zip(&together) {
            let alone = &solved(&[*contract], 1e-4)[0];
            assert!((alone.value - beside.value).abs() < 1e-11);
            assert_eq!(alone.cells, beside.cells);
        }
        for set in InstructionSet::available() {
            let own = forced::with(set, || solved(&contracts, 1e-4));
            for (one, other) in own.iter().zip(&together) {
                assert!((one.value - other.value).abs() < 1e-11, "{}", set.name());
            }
        }
    }

    #[test]
    fn an_interrupt_ends_the_work() {
        let segments = [segment(1.0)];
        let contract = contract(1.0, &[0.0], &segments);
        let settings = Settings::default();
        let found = solve(&[contract], &[1e-4], settings, Greeks::None, 1, &|| true);
        assert!(found[0].value.is_nan() && !found[0].settled);
    }

    /// At the near end of an option that is not exercised: strike and spot discounted.
    #[test]
    fn the_end_of_the_grid_is_that_of_the_forward() {
        let segments = [segment(1.0).held()];
        let [held] = segments;
        for sign in [1.0, -1.0] {
            let marched = marched(vec![contract(sign, &[0.0], &segments)], 256, 0);
            for node in 0..8 {
                let spot = marched.grid.spot(node) * (-held.dividend_yield).exp();
                let forward = sign * ((-held.rate).exp() - spot);
                let value = marched.values[node];
                assert!((value - forward).abs() < 1e-8, "{node} {value} {forward}");
            }
        }
    }
}
