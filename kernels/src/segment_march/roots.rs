//! The zero of a function of one variable between two points where its signs differ.

/// The largest number of steps; chosen: bisection alone gains 18 digits in as many.
const MOST_STEPS: usize = 60;
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

#[cfg(test)]
mod tests {
    use super::find_root;

    #[test]
    fn a_root_is_found_from_either_side() {
        for (a, b) in [(0.0, 2.0), (2.0, 0.0)] {
            assert!((find_root(|x| x * x * x - 2.0, a, b, 1e-13) - 2f64.cbrt()).abs() < 1e-12);
        }
    }
}
