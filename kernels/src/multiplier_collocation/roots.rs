//! The zero of a function of one variable between two points where its signs differ.

/// The largest number of steps; chosen: bisection alone gains 18 digits in as many.
const MOST_STEPS: usize = 60;
/// The smallest relative distance to which a zero is found, in 1 + |x|; chosen near rounding.
pub const CLOSEST: f64 = 1e-13;

/// A zero between a and b by the Illinois variant of false position, to a distance of `close` times 1 + |x|.
#[allow(clippy::float_cmp)] // zeros and ties of the function
pub fn find_root(mut function: impl FnMut(f64) -> f64, mut a: f64, mut b: f64, close: f64) -> f64 {
    let (mut at_a, mut at_b) = (function(a), function(b));
    if at_a == 0.0 {
        return a;
    }
    for _ in 0..MOST_STEPS {
        if (b - a).abs() <= close * (1.0 + b.abs()) || at_b == 0.0 || at_a == at_b {
            break;
        }
        let mut x = b - at_b * (b - a) / (at_b - at_a);
        if !(a.min(b) < x && x < a.max(b)) {
            x = 0.5 * (a + b);
        }
        let at_x = function(x);
        if (at_x < 0.0) == (at_b < 0.0) {
            at_a *= 0.5;
        } else {
            a = b;
            at_a = at_b;
        }
        b = x;
        at_b = at_x;
    }
    b
}

/// The zero between a < b of a function that rises, or falls, from its values and slopes: Newton's steps inside the
/// interval, halves of it where they leave it, until one is below `close`.
pub fn find_crossing(
    mut function: impl FnMut(f64) -> (f64, f64),
    (mut a, mut b): (f64, f64),
    rises: bool,
    close: f64,
) -> f64 {
    let mut x = 0.5 * (a + b);
    for _ in 0..MOST_STEPS {
        let (value, slope) = function(x);
        if (value > 0.0) == rises {
            b = x;
        } else {
            a = x;
        }
        let newton = x - value / slope;
        let next = if a <= newton && newton <= b {
            newton
        } else {
            0.5 * (a + b)
        };
        let step = (next - x).abs();
        x = next;
        if step <= close {
            break;
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::{find_crossing, find_root, CLOSEST};

    #[test]
    fn a_crossing_is_found_whether_the_function_rises_or_falls() {
        for sign in [1.0, -1.0] {
            let cubic = |x: f64| (sign * (x * x * x - 2.0), sign * 3.0 * x * x);
            let root = find_crossing(cubic, (0.0, 2.0), sign > 0.0, 1e-8);
            assert!((root - 2f64.cbrt()).abs() < 1e-15 * 4.0);
        }
    }

    #[test]
    fn a_root_is_found_from_either_side() {
        for (a, b) in [(0.0, 2.0), (2.0, 0.0)] {
            assert!((find_root(|x| x * x * x - 2.0, a, b, CLOSEST) - 2f64.cbrt()).abs() < 1e-12);
        }
    }
}
