//! The two Runge-Kutta methods of the march.

/// The weight of the own derivative in every stage of both methods, in steps; derived: the root of
/// x^3 - 3 x^2 + 3 x/2 - 1/6 = 0 that makes a third-order method L-stable.
pub const STAGE: f64 = 0.435_866_521_508_459;
/// The time of the third stage from the start of the step, in steps; chosen near the smallest error constant, far from
/// the unstable neighbourhood of 2 STAGE.
const THIRD_TIME: f64 = 1.15;

/// A Runge-Kutta method with three implicit stages, the last at the end of the step.
pub struct Tableau {
    /// The times of the stages from the start of the step, in steps.
    pub times: [f64; 3],
    /// What phi of the stage before is multiplied by to guess that of a stage, as if phi grew in proportion to time.
    pub growth: [f64; 3],
    /// The weights of the state, of h du/dt at the start, and of the first two stages in the right-hand side of each
    /// stage, so that one matrix serves all of them.
    pub rhs_weights: [[f64; 4]; 3],
}

/// Alexander's three-stage method (1977), for the step that has no du/dt to start from.
pub const SECOND_STEP: Tableau = Tableau::new(
    [STAGE, 0.5 * (1.0 + STAGE), 1.0],
    [0.0; 3],
    0.5 * (1.0 - STAGE) / STAGE,
    [
        -0.25 * (6.0 * STAGE * STAGE - 16.0 * STAGE + 1.0) / STAGE,
        0.25 * (6.0 * STAGE * STAGE - 20.0 * STAGE + 5.0) / STAGE,
    ],
);
/// The method with an explicit first stage (Kennedy and Carpenter 2016, section 5.1): the order conditions
/// `sum_j a_ij c_j` = `c_i`^2/2 make every stage accurate to second order, and the end of the step to third.
pub const LATER_STEPS: Tableau = {
    let (c2, c3) = (2.0 * STAGE, THIRD_TIME);
    let a32 = (0.5 * c3 * c3 - STAGE * c3) / c2;
    let b3 = ((1.0 / 3.0 - STAGE) - c2 * (0.5 - STAGE)) / (c3 * (c3 - c2));
    let b2 = ((0.5 - STAGE) - b3 * c3) / c2;
    Tableau::new(
        [c2, c3, 1.0],
        [STAGE, c3 - STAGE - a32, 1.0 - b2 - b3 - STAGE],
        a32 / STAGE,
        [b2 / STAGE, b3 / STAGE],
    )
};

impl Tableau {
    /// The tableau with these weights of du/dt at the start and of the increments of the stages before, the latter divided
    /// by `STAGE`.
    const fn new(times: [f64; 3], explicit: [f64; 3], second: f64, third: [f64; 2]) -> Self {
        let [e1, e2, e3] = explicit;
        let [by_first, by_second] = third;
        Self {
            times,
            growth: [0.0, times[1] / times[0], times[2] / times[1]],
            rhs_weights: [
                [1.0, e1, 0.0, 0.0],
                [1.0 - second, e2 - second * e1, second, 0.0],
                [
                    1.0 - by_first - by_second * (1.0 - second),
                    e3 - by_first * e1 - by_second * (e2 - second * e1),
                    by_first - by_second * second,
                    by_second,
                ],
            ],
        }
    }
}
