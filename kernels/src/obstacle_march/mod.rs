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
mod march;
mod mesh;
mod newton;
mod record;
mod settings;
mod solve;
mod stage;
mod steps;
mod tableau;
mod terms;
mod walk_back;

pub use contract::{Contract, Segment};
pub use settings::Settings;
pub use solve::{solve, Changing, Found, Greeks, LOCAL};
pub use walk_back::BySegment;

#[cfg(test)]
mod tests {
    use super::{solve, Contract, Found, Greeks, Segment, Settings};
    use crate::interrupt::never;
    use crate::lanes::dispatch::{forced, InstructionSet};

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
            let contract = Contract {
                sign,
                x: 0.0,
                segments,
                mesh: segments,
            };
            let found = &solved(&[contract], 1e-6)[0];
            assert!(found.met && found.settled);
            assert!(
                (found.value - value).abs() < found.error + 1e-8,
                "{value} {found:?}"
            );
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
            .map(|(k, segments)| Contract {
                sign: if k % 3 == 0 { -1.0 } else { 1.0 },
                x: 0.0,
                segments,
                mesh: segments,
            })
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
        let contract = Contract {
            sign: 1.0,
            x: 0.0,
            segments: &segments,
            mesh: &segments,
        };
        let settings = Settings::default();
        let found = solve(&[contract], &[1e-4], settings, Greeks::None, 1, &|| true);
        assert!(found[0].value.is_nan() && !found[0].settled);
    }
}
