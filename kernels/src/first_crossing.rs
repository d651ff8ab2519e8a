//! The first place in [0, end] at which a polynomial falls below a level, with no excursion missed.
//!
//! In Bernstein form the least coefficient of a polynomial is a lower bound of its values: where that is not below the
//! level nothing can have happened, and elsewhere the interval is halved until the bound or a value decides.

/// The highest power.
pub const DEGREE: usize = 26;
const MOST_HALVINGS: u32 = 60;
const NEWTON_STEPS: u32 = 60;
const CLOSE: f64 = 1e-16;
/// Share of the step within which roots are one event.
pub const SAME_TIME: f64 = 1e-13;
const INTERVALS: u32 = 64;

/// A polynomial by its coefficients, the lowest power first, without vanishing ones at the end.
#[derive(Clone, Copy)]
pub struct Polynomial {
    coefficients: [f64; DEGREE + 1],
    degree: usize,
}

/// The coefficients in the Bernstein basis on some interval.
#[derive(Clone, Copy)]
pub struct Bernstein {
    values: [f64; DEGREE + 1],
    degree: usize,
}

impl Polynomial {
    /// At most 27 coefficients.
    pub fn new(given: &[f64]) -> Self {
        let mut coefficients = [0.0; DEGREE + 1];
        coefficients[..given.len()].copy_from_slice(given);
        let degree = given.iter().rposition(|&entry| entry != 0.0).unwrap_or(0);
        Self {
            coefficients,
            degree,
        }
    }

    /// The value and the slope at x.
    pub fn at(&self, x: f64) -> (f64, f64) {
        let (mut value, mut slope) = (0.0, 0.0);
        for coefficient in self.coefficients[..=self.degree].iter().rev() {
            slope = slope * x + value;
            value = value * x + coefficient;
        }
        (value, slope)
    }

    /// The Bernstein coefficients on [0, end], between whose least and largest the polynomial stays there.
    ///
    /// The i-th is the sum of C(i, j) a(j) / C(n, j) over j: they have the forward differences a(j) / C(n, j) at the start.
    pub fn bernstein(&self, end: f64) -> Bernstein {
        let n = self.degree;
        let mut differences = [0.0; DEGREE + 1];
        let (mut power, mut binomial) = (1.0, 1.0);
        let given = self.coefficients[..=n].iter();
        for (j, (difference, coefficient)) in differences.iter_mut().zip(given).enumerate() {
            *difference = coefficient * power / binomial;
            power *= end;
            #[allow(clippy::cast_precision_loss)]
            let (above, below) = ((n - j) as f64, (j + 1) as f64);
            binomial *= above / below;
        }
        let mut values = [0.0; DEGREE + 1];
        for (i, value) in values[..=n].iter_mut().enumerate() {
            *value = differences[0];
            for j in 0..n - i {
                differences[j] += differences[j + 1];
            }
        }
        Bernstein { values, degree: n }
    }

    /// The zero between a place where the polynomial is positive and one where it is negative.
    ///
    /// Where both are one place, a positive value before it is looked for; without one the polynomial has fallen since 0.
    fn root_between(&self, mut low: f64, mut high: f64) -> f64 {
        if low >= high {
            match places_before(high).find(|&place| self.at(place).0 > 0.0) {
                Some(place) => low = place,
                None => return 0.0,
            }
        }
        let mut place = high;
        for _ in 0..NEWTON_STEPS {
            let (value, slope) = self.at(place);
            if value == 0.0 {
                return place;
            }
            if value > 0.0 {
                low = place;
            } else {
                high = place;
            }
            let newton = if slope < 0.0 {
                place - value / slope
            } else {
                f64::NAN
            };
            let following = if low < newton && newton < high {
                newton
            } else {
                0.5 * (low + high)
            };
            if (following - place).abs() <= CLOSE * place.max(1e-3) {
                return following;
            }
            place = following;
        }
        place
    }

    /// Whether the polynomial, looked at from 0 to `end`, turns upwards somewhere inside.
    pub fn turns(&self, end: f64) -> bool {
        let value = |i: u32| self.at(end * f64::from(i) / f64::from(INTERVALS)).0;
        let (mut before, mut here) = (value(0), value(1));
        for i in 2..=INTERVALS {
            let after = value(i);
            if here <= before && here <= after {
                return true;
            }
            (before, here) = (here, after);
        }
        false
    }
}

impl Bernstein {
    fn values(&self) -> &[f64] {
        &self.values[..=self.degree]
    }

    /// The least coefficient.
    pub fn least(&self) -> f64 {
        self.values().iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// The largest coefficient.
    pub fn largest(&self) -> f64 {
        self.values()
            .iter()
            .copied()
            .fold(f64::NEG_INFINITY, f64::max)
    }

    /// The coefficients on the two halves (de Casteljau).
    fn halves(&self) -> (Self, Self) {
        let (n, mut left, mut right) = (self.degree, *self, *self);
        for i in 0..n {
            left.values[i] = right.values[0];
            for j in 0..n - i {
                right.values[j] = 0.5 * (right.values[j] + right.values[j + 1]);
            }
        }
        left.values[n] = right.values[0];
        (left, right)
    }

    /// The first interval in [0, 1] at whose ends the polynomial is positive and below the level.
    ///
    /// Where it falls below the level without having been positive, both ends are the place where it does.
    fn first_bracket(self, level: f64) -> Option<(f64, f64)> {
        let mut waiting = vec![(0.0, 1.0, self, 0)];
        while let Some((start, width, b, depth)) = waiting.pop() {
            if b.least() >= level {
                continue;
            }
            let (first, last) = (b.values[0], b.values[b.degree]);
            if first < level {
                return Some((start, start));
            }
            let changes = b
                .values()
                .windows(2)
                .filter(|pair| (pair[0] >= level) != (pair[1] >= level));
            if changes.count() == 1 && last < level && first > 0.0 {
                return Some((start, start + width)); // one sign change: one crossing
            }
            if depth == MOST_HALVINGS {
                if last < level {
                    return Some((start, start));
                }
                continue;
            }
            let (left, right) = b.halves();
            waiting.push((start + 0.5 * width, 0.5 * width, right, depth + 1));
            waiting.push((start, 0.5 * width, left, depth + 1));
        }
        None
    }
}

/// Places in (0, high): ever farther from `high`, then ever nearer to 0, where bounces die out.
fn places_before(high: f64) -> impl Iterator<Item = f64> {
    let far = std::iter::successors(Some(SAME_TIME), |back| Some(2.0 * back))
        .take_while(move |&back| back < high)
        .map(move |back| high - back);
    let near = std::iter::successors(Some(0.5 * high), |place| Some(0.5 * place));
    far.chain(near.take(MOST_HALVINGS as usize))
}

/// The place in [0, end] from which on the polynomial falls below `-tolerance`: its zero, where it was positive before.
pub fn first_crossing(
    polynomial: &Polynomial,
    bounds: Bernstein,
    end: f64,
    tolerance: f64,
) -> Option<f64> {
    let (low, high) = bounds.first_bracket(-tolerance)?;
    Some(polynomial.root_between(low * end, high * end))
}

#[cfg(test)]
mod tests {
    use super::{first_crossing, Polynomial};

    fn crossing(coefficients: &[f64], end: f64) -> Option<f64> {
        let polynomial = Polynomial::new(coefficients);
        first_crossing(&polynomial, polynomial.bernstein(end), end, 1e-12)
    }

    #[test]
    fn a_line_crosses_at_its_zero() {
        assert_eq!(crossing(&[1.0, -4.0], 1.0), Some(0.25));
        assert_eq!(crossing(&[1.0, -4.0], 0.2), None);
        assert_eq!(crossing(&[0.0, -1.0], 1.0), Some(0.0));
        assert_eq!(crossing(&[0.0, 0.0], 1.0), None);
    }

    #[test]
    fn a_short_excursion_is_not_missed() {
        // (x - 1/2)^2 - 1e-8 is negative for |x - 1/2| < 1e-4, and touches at the level of rounding without the second.
        let found = crossing(&[0.25 - 1e-8, -1.0, 1.0], 1.0).unwrap();
        assert!((found - 0.4999).abs() < 1e-12);
        assert_eq!(crossing(&[0.25, -1.0, 1.0], 1.0), None);
        assert!(Polynomial::new(&[0.25, -1.0, 1.0]).turns(1.0));
        assert!(!Polynomial::new(&[0.25, -1.0, 1.0]).turns(0.4));
    }

    #[test]
    fn bernstein_coefficients_bound_the_values() {
        let polynomial = Polynomial::new(&[0.3, -2.0, 1.5, 0.7, -0.2]);
        let bounds = polynomial.bernstein(0.8);
        for i in 0..=100 {
            let (value, _) = polynomial.at(0.8 * f64::from(i) / 100.0);
            assert!(bounds.least() <= value + 1e-15 && value <= bounds.largest() + 1e-15);
        }
    }
}
