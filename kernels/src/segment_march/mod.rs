//! A schedule by the method of lines, segment by segment: a tridiagonal complementarity problem per stage.
//!
//! Between two events the value v, in units of the strike, satisfies on the grid of s = S/K
//!
//! v' = L v + e(t) + u, 0 <= u, 0 <= v - g(t), u (v - g) = 0, g(t) = sign (1 - A e^{-rt} - s),
//!
//! with t in years before the segment's end. e holds what the values at the two end nodes add to the
//! rows next to them; a line a + b s at an end is a e^{-rt} + b s e^{-qt} after t years, or exercised
//! where that is more. A stage of size h solves (I - hL) v = base + h e + h u. In z = v - g that is
//! 0 <= z, 0 <= w = M z + q with M = I - hL and w = h u. M is an M-matrix where 1 + h r > 0 and L has no
//! negative entry beside its diagonal; the march is meant for those.
//!
//! Derivatives by parameters are carried along (`tangents`): the contact set held fast, they are linear.
//!
//! `sweep` goes from expiry to now: `event` carries the value over what happens at the end of a segment (between the
//! nodes `grid_function` knows it), `operator` is L, `stage` solves one stage, `boundary_cell` places the exercise
//! boundary inside its cell, `elimination` and `free_system` hold the linear solves of both, and `region` reads the
//! boundary off the slack. `lane_march` does many sweeps side by side, their stages by `lane_rows`, with the same bits.

mod boundary_cell;
mod elimination;
mod event;
mod free_system;
mod grid_function;
mod lane_march;
mod lane_rows;
mod operator;
mod region;
mod roots;
mod stage;
mod sweep;
mod tangents;
#[cfg(test)]
mod tests;

use std::f64::consts::FRAC_1_SQRT_2;

use crate::error::{check_length, KernelError};
use crate::interrupt::Interrupt;
pub use lane_march::{sweep_schedules, Task};
use stage::Stage;
pub use sweep::{sweep_schedule, Direction, Part, Schedule, Surface, Sweep, Terms};
use tangents::Tangents;

/// The implicit weight of SDIRK2 (Alexander 1977), which makes it L-stable.
const SDIRK2_THETA: f64 = 1.0 - FRAC_1_SQRT_2;

/// A one-step method.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scheme {
    /// y+ = y + h F(y+).
    ImplicitEuler,
    /// y1 = y + theta h F(y1), y+ = y + (1 - theta) h F(y1) + theta h F(y+), theta = 1 - 1/sqrt(2).
    Sdirk2,
}

/// The semidiscrete option between two events.
#[derive(Clone, Copy, Debug)]
pub struct Segment<'a> {
    /// s = S/K, increasing, n + 2 numbers.
    pub nodes: &'a [f64],
    /// L's entries at the node below, per year, one for each of the n interior nodes.
    pub lower: &'a [f64],
    /// L's entries at the node itself, per year.
    pub diagonal: &'a [f64],
    /// L's entries at the node above, per year.
    pub upper: &'a [f64],
    /// 1 for a put, -1 for a call.
    pub sign: f64,
    /// A at the segment's end, in units of the strike.
    pub escrow: f64,
    /// Continuously compounded, per year.
    pub rate: f64,
    /// Continuously compounded, per year.
    pub dividend_yield: f64,
    /// Whether the holder may exercise throughout the segment.
    pub exercisable: bool,
    /// (a, b) of the line a + b s at the lower and the upper end of the grid, at the segment's end.
    pub lines: [[f64; 2]; 2],
    /// Whether the lower and the upper end of the grid lie in the exercise region.
    pub contact_at: [bool; 2],
}

/// The derivative of the option by one parameter, marked by a prime.
#[derive(Clone, Debug)]
pub struct Tangent {
    /// v' at all nodes, at the first of the times.
    pub values: Vec<f64>,
    /// The entries of L' at the node below, per year.
    pub lower: Vec<f64>,
    /// The entries of L' at the node itself, per year.
    pub diagonal: Vec<f64>,
    /// The entries of L' at the node above, per year.
    pub upper: Vec<f64>,
    /// r'.
    pub rate: f64,
    /// q'.
    pub dividend_yield: f64,
    /// A' at the segment's end.
    pub escrow: f64,
    /// (a', b') at the two ends of the grid, at the segment's end.
    pub lines: [[f64; 2]; 2],
}

/// The option at the last of the times, and what was seen on the way.
#[derive(Clone, Debug)]
pub struct March {
    /// v at all nodes.
    pub values: Vec<f64>,
    /// v - g at the interior nodes; zeros where the segment is not exercisable.
    pub slack: Vec<f64>,
    /// Whether an interior node lies in the exercise region.
    pub contact: Vec<bool>,
    /// u at the interior nodes, per year.
    pub multiplier: Vec<f64>,
    /// The largest natural residual max |min(z, w/d)|/max(1, s) at the end of a step, d the diagonal of M.
    pub residual: f64,
    /// The ends of the exercise region in s after each step, see `region`.
    pub regions: Vec<[f64; 2]>,
    /// v' at all nodes, for each of the parameters.
    pub tangents: Vec<Vec<f64>>,
}

impl Segment<'_> {
    /// The number n of interior nodes.
    fn size(&self) -> usize {
        self.diagonal.len()
    }

    fn check(&self) -> Result<(), KernelError> {
        if self.diagonal.is_empty() {
            return Err(KernelError::Empty);
        }
        check_length("nodes", self.nodes, self.size() + 2)?;
        check_length("lower", self.lower, self.size())?;
        check_length("upper", self.upper, self.size())
    }

    /// 1 - A e^{-rt}, so that g = sign (that - s).
    fn strike_left(&self, t: f64) -> f64 {
        if self.escrow == 0.0 {
            return 1.0;
        }
        1.0 - self.escrow * (-self.rate * t).exp()
    }

    /// v at the two end nodes, t years before the segment's end.
    fn ends(&self, t: f64) -> [f64; 2] {
        let growth = [(-self.rate * t).exp(), (-self.dividend_yield * t).exp()];
        let strike_left = self.strike_left(t);
        let at = |[a, b]: [f64; 2], s: f64| {
            let held = a * growth[0] + b * growth[1] * s;
            let exercised = self.sign * (strike_left - s);
            if self.exercisable && held < exercised {
                exercised
            } else {
                held
            }
        };
        let last = self.nodes[self.size() + 1];
        [at(self.lines[0], self.nodes[0]), at(self.lines[1], last)]
    }

    /// What is held at an end node, the lower (0) or the upper one (1), and what exercise brings there.
    fn held_and_exercised_at(&self, end: usize, t: f64) -> (f64, f64) {
        let s = self.nodes[end * (self.size() + 1)];
        let [a, b] = self.lines[end];
        let held = a * (-self.rate * t).exp() + b * (-self.dividend_yield * t).exp() * s;
        (held, self.sign * (self.strike_left(t) - s))
    }

    /// The row at the end of the grid where the exercise region is expected: a put's lies low, a call's high.
    fn expected_end(&self) -> usize {
        match self.contact_at {
            [true, false] => 0,
            [false, true] => self.size() - 1,
            _ if self.sign > 0.0 => 0,
            _ => self.size() - 1,
        }
    }

    /// The row that elimination goes to: the expected end, unless the region lies elsewhere, in whose middle it is then.
    fn seed(&self, contact: &[bool]) -> usize {
        let end = self.expected_end();
        if self.contact_at[0] != self.contact_at[1] || contact[end] {
            return end;
        }
        let first = contact.iter().position(|c| *c);
        let last = contact.iter().rposition(|c| *c);
        first
            .zip(last)
            .map_or(end, |(first, last)| usize::midpoint(first, last))
    }

    /// Whether v at an end node is what exercise brings.
    fn is_exercised_at(&self, end: usize, t: f64) -> bool {
        let (held, exercised) = self.held_and_exercised_at(end, t);
        self.exercisable && held < exercised
    }

    /// J, the second derivative of v - g on the free side of a boundary at interior node `node`.
    ///
    /// sigma^2 s^2/2 J = sign (r - q s), what exercise earns and holding does not.
    fn curvature(&self, node: usize) -> f64 {
        let s = self.nodes[node + 1];
        let (left, right) = (s - self.nodes[node], self.nodes[node + 2] - s);
        let twice_diffusion = self.lower[node] * (left * left) + self.upper[node] * (right * right);
        if twice_diffusion > 0.0 {
            2.0 * self.sign * (self.rate - self.dividend_yield * s) / twice_diffusion
        } else {
            0.0
        }
    }
}

/// March v backward in time from the first to the last of the times; None where interrupted.
///
/// `times` are years before the segment's end, increasing; a step leads from each to the next. `values`
/// are v at the first of them, at all nodes, of which the two at the ends do not matter; `contact` is a
/// guess of the contact set after the first stage. A segment may be marched in portions: values, contact
/// and last time of one begin the next. Cost O(n) per step unless the contact set changes in many rows.
///
/// # Errors
/// An array does not have the length that the others ask for, or a pivot is zero, which it cannot be for
/// an M-matrix.
pub fn march_segment(
    segment: &Segment<'_>,
    times: &[f64],
    scheme: Scheme,
    values: &[f64],
    contact: &[bool],
    tangents: &[Tangent],
    interrupt: Interrupt<'_>,
) -> Result<Option<March>, KernelError> {
    segment.check()?;
    let size = segment.size();
    check_length("values", values, size + 2)?;
    check_length("contact", contact, size)?;
    for tangent in tangents {
        check_length("tangents", &tangent.values, size + 2)?;
        check_length("tangents", &tangent.lower, size)?;
        check_length("tangents", &tangent.diagonal, size)?;
        check_length("tangents", &tangent.upper, size)?;
    }
    let mut following = Tangents::new(segment, tangents);
    let mut stage = Stage::new(segment, &values[1..=size], contact, interrupt);
    let (mut value, mut base) = (vec![0.0; size], vec![0.0; size]);
    let mut residual = 0.0;
    let mut regions = Vec::with_capacity(times.len());
    for pair in times.windows(2) {
        if interrupt() {
            return Ok(None);
        }
        let (start, end) = (pair[0], pair[1]);
        let h = end - start;
        value.copy_from_slice(&stage.value);
        stage.begin_step();
        match scheme {
            Scheme::ImplicitEuler => {
                stage.solve(end, h, &value)?;
                following.follow(&stage, end, h, None)?;
            }
            Scheme::Sdirk2 => {
                let (middle, h) = (start + SDIRK2_THETA * h, SDIRK2_THETA * h);
                stage.solve(middle, h, &value)?;
                if stage.interrupted {
                    return Ok(None);
                }
                following.follow(&stage, middle, h, None)?;
                let ahead = (1.0 - SDIRK2_THETA) / SDIRK2_THETA;
                for ((b, v), first) in base.iter_mut().zip(&value).zip(&stage.value) {
                    *b = v + ahead * (first - v);
                }
                stage.solve(end, h, &base)?;
                following.follow(&stage, end, h, Some(ahead))?;
            }
        }
        if stage.interrupted {
            return Ok(None);
        }
        residual = larger(residual, stage.residual);
        regions.push(region::region(segment, &stage.slack, &stage.contact));
    }
    let mut values = values.to_vec();
    values[1..=size].copy_from_slice(&stage.value);
    if let Some(&t) = times.last() {
        [values[0], values[size + 1]] = segment.ends(t);
    }
    let last = times.last().copied().unwrap_or(0.0);
    Ok(Some(March {
        tangents: following.values(tangents.len(), last),
        values,
        multiplier: stage.multiplier(),
        slack: stage.slack,
        contact: stage.contact,
        residual,
        regions,
    }))
}

/// The larger of two numbers; NaN stays NaN.
#[inline]
fn larger(a: f64, b: f64) -> f64 {
    if b > a || b.is_nan() {
        b
    } else {
        a
    }
}
