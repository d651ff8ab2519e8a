//! The Runge-Kutta methods of the march; told in `premium_twin/march.py`.

/// Root of x^3 - 3 x^2 + 3 x/2 - 1/6: on the diagonal of both methods.
pub const STAGE: f64 = 0.435_866_521_508_459;
/// Of the third stage; near the least error and far from the unstable neighbourhood of 2 STAGE.
const THIRD_TIME: f64 = 1.15;

/// A Runge-Kutta method with three implicit stages, the last at the step's end.
pub struct Tableau {
    /// Of the stages, in steps.
    pub times: [f64; 3],
    /// Of phi from stage to stage, if it grows in proportion to time.
    pub growth: [f64; 3],
    /// The stages' right-hand sides as sums of the state, `push`, and the first two stages, for one matrix.
    pub shares: [[f64; 4]; 3],
}

/// Alexander's three-stage method, for the step that has no du/dt to start from.
pub const SECOND_STEP: Tableau = Tableau::new(
    [STAGE, 0.5 * (1.0 + STAGE), 1.0],
    [0.0; 3],
    0.5 * (1.0 - STAGE) / STAGE,
    [
        -0.25 * (6.0 * STAGE * STAGE - 16.0 * STAGE + 1.0) / STAGE,
        0.25 * (6.0 * STAGE * STAGE - 20.0 * STAGE + 5.0) / STAGE,
    ],
);
/// With an explicit first stage: stages of order two, of order three at the end.
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
    /// From the weights of du/dt at the start, and of the increments of the stages before, divided by `STAGE`.
    const fn new(times: [f64; 3], explicit: [f64; 3], second: f64, third: [f64; 2]) -> Self {
        let [e1, e2, e3] = explicit;
        let [by_first, by_second] = third;
        Self {
            times,
            growth: [0.0, times[1] / times[0], times[2] / times[1]],
            shares: [
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
