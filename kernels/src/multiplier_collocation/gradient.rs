//! The derivatives of a schedule's value and slope by the numbers of its segments.

/// The number of functionals that are differentiated: the value now and its derivative by x.
pub const FUNCTIONALS: usize = 2;
/// One number for each functional.
pub type Weights = [f64; FUNCTIONALS];

/// The number of derivatives in `SegmentGradient`.
pub const PARAMETERS: usize = 6;

/// The derivatives of the functionals by the numbers of one segment, in strikes.
#[derive(Clone, Copy, Debug, Default)]
pub struct SegmentGradient {
    pub rate: Weights,
    pub dividend: Weights,
    pub volatility: Weights,
    /// By the amount and the escrow at the segment's end, strikes.
    pub amount: Weights,
    pub escrow: Weights,
    /// What exercise on the segment contributes to the functionals themselves.
    pub exercise: Weights,
    /// What the functionals change by one more step of Newton's method for the boundary; not among `PARAMETERS`.
    pub last_step: Weights,
}

impl SegmentGradient {
    /// Add other derivatives by the same numbers.
    pub fn increase(&mut self, other: &SegmentGradient) {
        add(&mut self.rate, 1.0, &other.rate);
        add(&mut self.dividend, 1.0, &other.dividend);
        add(&mut self.volatility, 1.0, &other.volatility);
        add(&mut self.amount, 1.0, &other.amount);
        add(&mut self.escrow, 1.0, &other.escrow);
        add(&mut self.exercise, 1.0, &other.exercise);
        add(&mut self.last_step, 1.0, &other.last_step);
    }

    /// What the value of the option changes by one more step of Newton's method for all boundaries.
    pub fn last_step_of_value(by_segment: &[SegmentGradient]) -> f64 {
        by_segment
            .iter()
            .map(|gradient| gradient.last_step[0])
            .sum()
    }

    /// How far all derivatives of one functional are from others.
    pub fn distance(&self, other: &SegmentGradient, functional: usize) -> [f64; PARAMETERS] {
        let (here, there) = (self.of(functional), other.of(functional));
        std::array::from_fn(|k| (here[k] - there[k]).abs())
    }

    /// All derivatives of one functional.
    pub fn of(&self, functional: usize) -> [f64; PARAMETERS] {
        [
            self.rate,
            self.dividend,
            self.volatility,
            self.amount,
            self.escrow,
            self.exercise,
        ]
        .map(|weights| weights[functional])
    }
}

/// Add a number times weights.
#[inline(always)]
pub fn add(total: &mut Weights, factor: f64, weights: &Weights) {
    for (total, weight) in total.iter_mut().zip(weights) {
        *total += factor * weight;
    }
}
