//! Contracts as the march takes them: money in strikes, segments between the times at which something happens.

use super::surface::Local;

/// By how much what is escrowed changes, in strikes, where nothing is paid.
const SAME_ESCROW: f64 = 1e-12;

/// An interval of time in which nothing happens, and what happens at its end.
#[derive(Clone, Copy, Debug)]
pub struct Segment {
    /// Years.
    pub duration: f64,
    /// Per year.
    pub rate: f64,
    /// Per year.
    pub dividend_yield: f64,
    /// Per square root of a year, above 0.
    pub volatility: f64,
    /// Whether the holder may exercise throughout.
    pub exercisable: bool,
    /// Whether the holder may exercise at the end, before the dividends there.
    pub exercise_at_end: bool,
    /// The share of the spot by which it drops at the end.
    pub fraction: f64,
    /// The amount by which it drops then, to 0 at the least.
    pub amount: f64,
    /// What escrowed dividends still due are worth at the end, before those paid there.
    pub escrow: f64,
}

impl Segment {
    /// The drift of ln S.
    pub(super) fn drift(&self) -> f64 {
        self.rate - self.dividend_yield - 0.5 * self.volatility * self.volatility
    }

    /// What the escrowed dividends still due are worth so many years before the end.
    pub(super) fn escrow_before_end(&self, years: f64) -> f64 {
        if self.escrow == 0.0 {
            0.0
        } else {
            self.escrow * (-self.rate * years).exp()
        }
    }

    /// The strike less what is escrowed at the beginning.
    pub(super) fn strike_at_beginning(&self) -> f64 {
        1.0 - self.escrow_before_end(self.duration)
    }

    /// The same without exercise.
    pub(super) fn held(self) -> Self {
        Self {
            exercisable: false,
            exercise_at_end: false,
            ..self
        }
    }

    /// Whether the spot drops at the end.
    pub(super) fn drops(&self) -> bool {
        self.fraction > 0.0 || self.amount > 0.0
    }

    /// The spot after the drop at the end.
    pub(super) fn after_drop(&self, spot: f64) -> f64 {
        (spot * (1.0 - self.fraction) - self.amount).max(0.0)
    }

    /// The spot before a drop at the end, after which it is above 0.
    pub(super) fn before_drop(&self, spot: f64) -> f64 {
        (spot + self.amount) / (1.0 - self.fraction)
    }
}

/// A put or a call with strike 1.
#[derive(Clone, Copy, Debug)]
pub struct Contract<'a> {
    /// 1 for a put, -1 for a call.
    pub sign: f64,
    /// ln of the spots that diffuse, of which the value is wanted; at least one.
    pub places: &'a [f64],
    /// From now to expiry, at least one.
    pub segments: &'a [Segment],
    /// Those that tell the grid and the steps: its own, or for a difference those of a contract next to it.
    pub mesh: &'a [Segment],
    /// Whether the value without early exercise is wanted as well.
    pub european: bool,
    /// The local volatility; what a segment's exceeds the number by that stands for it is added.
    pub local: Option<Local<'a>>,
}

impl Contract<'_> {
    /// The lowest and the highest of the places.
    pub(super) fn span(&self) -> (f64, f64) {
        self.places
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
                (low.min(*x), high.max(*x))
            })
    }

    /// The square of the volatility at a time, years from now, and at x, given that of the segment.
    pub(super) fn variance(&self, time: f64, x: f64, of_segment: f64) -> f64 {
        let Some(local) = &self.local else {
            return of_segment * of_segment;
        };
        let at = local.surface.moment(time);
        let square = |number| local.at_time(number, x, of_segment).powi(2);
        let before = square(at.before);
        at.share.mul_add(square(at.behind) - before, before)
    }

    /// Whether neither the spot nor what exercise brings changes at the end of a segment that is not the last.
    pub(super) fn goes_on(&self, number: usize) -> bool {
        let (now, next) = (&self.segments[number], &self.segments[number + 1]);
        let change = now.escrow - next.escrow_before_end(next.duration);
        !now.drops() && change.abs() < SAME_ESCROW
    }

    /// Years from now to the end of a segment.
    pub(super) fn end_of(&self, number: usize) -> f64 {
        self.segments[..=number]
            .iter()
            .map(|one| one.duration)
            .sum()
    }
}
