//! The puts to be priced, in their dimensionless parameters: as columns, and sixteen side by side.

use crate::interrupt::Interrupt;
use crate::lanes::normal::ln;
use crate::lanes::vector::{Vector, LANES};

/// Puts in their dimensionless parameters: runs of spots that share a march.
#[derive(Clone, Copy)]
pub struct Puts<'a> {
    /// r T of each run, (runs,).
    pub rate: &'a [f64],
    /// q T of each run, (runs,).
    pub dividend: &'a [f64],
    /// sigma sqrt(T) of each run, (runs,).
    pub spread: &'a [f64],
    /// The first spot of each run, and the number of spots; increasing, (runs + 1,).
    pub first: &'a [usize],
    /// ln(S/K) of each spot, (spots,).
    pub x: &'a [f64],
    /// The largest error allowed in V/K, (spots,).
    pub tolerance: &'a [f64],
    /// The largest error allowed in each of the `VALUES` numbers of a spot, (spots x `VALUES`,); None leaves out the
    /// derivatives by the parameters.
    pub limits: Option<&'a [f64]>,
    /// The step of the spread, as a share of it, for the second derivative of V/K by the spread; None leaves that out.
    pub spread_step: Option<f64>,
    /// The smallest and the largest level of the finest march of a put; places in `STEPS`.
    pub levels: (usize, usize),
    /// Ends the work; asked within every march.
    pub interrupt: Interrupt<'a>,
}

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
