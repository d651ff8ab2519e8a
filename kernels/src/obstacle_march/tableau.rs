//! The two Runge-Kutta methods of the march: three implicit stages with one weight, the last at the step's end.

/// The weight of the own rate in every stage of both methods, in steps.
pub const GAMMA: f64 = 0.435_866_521_508_459;

/// The times of the stages and the weights of the rates before, those at the step's start first, in steps.
pub struct Tableau {
    pub times: [f64; 3],
    pub weights: [[f64; 3]; 3],
}

/// Alexander 1977, for the first step after something has happened.
pub const FIRST: Tableau = Tableau {
    times: [GAMMA, 0.5 * (1.0 + GAMMA), 1.0],
    weights: [
        [0.0; 3],
        [0.0, 0.5 * (1.0 - GAMMA), 0.0],
        [
            0.0,
            -1.5 * GAMMA * GAMMA + 4.0 * GAMMA - 0.25,
            1.5 * GAMMA * GAMMA - 5.0 * GAMMA + 1.25,
        ],
    ],
};
/// Kennedy and Carpenter 2016, ESDIRK3(2)4L[2]SA: its first stage is the rate at the step's start.
pub const LATER: Tableau = Tableau {
    times: [2.0 * GAMMA, 0.6, 1.0],
    weights: [[GAMMA, 0.0, 0.0], [A31, A32, 0.0], [A41, A42, A43]],
};
const A31: f64 = 2_746_238_789_719.0 / 10_658_868_560_708.0;
const A32: f64 = -640_167_445_237.0 / 6_845_629_431_997.0;
const A41: f64 = 1_471_266_399_579.0 / 7_840_856_788_654.0;
const A42: f64 = -4_482_444_167_858.0 / 7_529_755_066_697.0;
const A43: f64 = 11_266_239_266_428.0 / 11_593_286_722_821.0;

#[cfg(test)]
mod tests {
    use super::{Tableau, FIRST, GAMMA, LATER};

    /// The order conditions of third order; of the methods' rates those at the start count with time 0.
    #[test]
    fn both_are_of_third_order_and_the_later_one_of_stage_order_two() {
        for (tableau, stage_order) in [(&FIRST, false), (&LATER, true)] {
            let Tableau { times, weights } = tableau;
            let c = [0.0, times[0], times[1], times[2]];
            for (i, row) in weights.iter().enumerate() {
                let sum = |power: i32| {
                    let known: f64 = row.iter().zip(&c).map(|(w, c)| w * c.powi(power)).sum();
                    known + GAMMA * times[i].powi(power)
                };
                assert!((sum(0) - times[i]).abs() < 1e-9);
                if stage_order || i == 2 {
                    assert!((sum(1) - times[i] * times[i] / 2.0).abs() < 1e-9);
                }
                if i == 2 {
                    assert!((sum(2) - 1.0 / 3.0).abs() < 1e-9);
                }
            }
        }
    }
}
