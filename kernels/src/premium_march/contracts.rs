//! The parameters of sixteen puts side by side.

use super::puts::Puts;
use crate::lanes::normal::ln;
use crate::lanes::vector::{Vector, LANES};

/// The parameters of sixteen puts: r T >= 0 and q T, of which one earns by exercise, sigma sqrt(T) > 0.
#[derive(Clone, Copy)]
pub struct Contracts<V> {
    /// r T.
    pub rate: V,
    /// q T.
    pub dividend: V,
    /// sigma sqrt(T).
    pub spread: V,
}

impl<V: Vector> Contracts<V> {
    /// The limit of ln(S*/K) at expiry, which no boundary exceeds.
    #[inline(always)]
    pub fn boundary_at_expiry(&self) -> V {
        ln((-self.dividend).negative(self.rate / self.dividend, V::all(1.0))).min(V::zero())
    }

    /// The contracts of sixteen runs.
    #[inline(always)]
    pub fn gather(puts: Puts, runs: &[usize; LANES]) -> Self {
        Self {
            rate: gather(puts.rate, runs),
            dividend: gather(puts.dividend, runs),
            spread: gather(puts.spread, runs),
        }
    }

    /// The contracts with another spread.
    #[inline(always)]
    pub fn with_spread_times(self, factor: f64) -> Self {
        Self {
            spread: self.spread.times(factor),
            ..self
        }
    }

    /// The most that exercise may earn until expiry as a share of the strike: r T, and -q T on a spot that costs to hold.
    #[inline(always)]
    pub fn earned(&self) -> V {
        self.rate + (-self.dividend).max(V::zero())
    }
}

#[inline(always)]
fn gather<V: Vector>(column: &[f64], rows: &[usize; LANES]) -> V {
    let mut numbers = [0.0; LANES];
    for (number, &row) in numbers.iter_mut().zip(rows) {
        *number = column[row];
    }
    V::from_lanes(numbers)
}
