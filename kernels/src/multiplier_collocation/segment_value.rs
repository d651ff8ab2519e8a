//! A solved segment: the value at its beginning as a function of x = ln(S/K).

use super::boundary::Boundary;
use super::continuation::Continuation;
use super::panels::Kink;
use super::profile::{Piece, PieceKind, Profile};
use super::propagation::{Transition, LARGEST_DEVIATION};
use super::segment::Segment;

/// The value at the beginning of a segment, in strikes.
pub struct SegmentValue {
    /// The value at the segment's end, after what the holder may do there.
    pub profile: Profile,
    /// The number of nodes of each of its panels.
    pub points: usize,
    pub segment: Segment,
    /// None where the option is not exercised at the beginning.
    pub boundary: Option<Boundary>,
    /// The end of the contact set at the beginning that is far from the strike, x; -sign infinity without one that matters.
    pub far: f64,
    /// The value at spot zero.
    pub at_zero: f64,
    /// Whether the option gains or loses no more than the spot does: there is no negative yield from here on.
    pub is_monotone: bool,
}

impl SegmentValue {
    /// Whether the option is exercised at the beginning if the spot is zero.
    pub fn is_exercised_at_zero(&self) -> bool {
        let segment = &self.segment;
        segment.exercisable && segment.sign > 0.0 && self.at_zero <= self.strike()
    }

    /// The end of the contact set, NaN without one.
    pub fn boundary_now(&self) -> f64 {
        self.boundary
            .as_ref()
            .map_or(f64::NAN, |b| b.near().at_beginning)
    }

    /// Whether x is in the contact set.
    fn is_exercised(&self, x: f64) -> bool {
        let sign = self.segment.sign;
        sign * (self.boundary_now() - x) >= 0.0 && sign * (x - self.far) >= 0.0
    }

    /// The strike less the escrow, in strikes.
    pub fn strike(&self) -> f64 {
        self.segment.strike(self.segment.duration)
    }

    /// The value of waiting, prepared for many places.
    pub fn continuation(&self) -> Continuation<'_> {
        let contact_blocks = self
            .boundary
            .as_ref()
            .map_or(&[][..], |boundary| &boundary.contact_blocks);
        Continuation::new(&self.profile, self.points, &self.segment, contact_blocks)
    }

    /// The value at increasing places: the payoff on the contact set.
    pub fn values(&self, continuation: &Continuation, places: &[f64]) -> Vec<f64> {
        let mut values = continuation.values(places);
        if self.boundary.is_some() {
            let (sign, strike) = (self.segment.sign, self.strike());
            for (value, &x) in values.iter_mut().zip(places) {
                if self.is_exercised(x) {
                    *value = sign * (strike - x.exp());
                }
            }
        }
        values
    }

    /// The value of waiting at x, its slope and its second derivative.
    pub fn waiting(&self, x: f64) -> [f64; 3] {
        let mut out = self
            .profile
            .propagate(&self.segment.dynamics, x, self.segment.duration);
        if let Some(boundary) = &self.boundary {
            let part = boundary.contribution(x);
            for (total, part) in out.iter_mut().zip(part) {
                *total += part;
            }
        }
        out
    }

    /// The value at x, its slope and its second derivative: those of the payoff on the contact set.
    pub fn value(&self, x: f64) -> [f64; 3] {
        let sign = self.segment.sign;
        if self.is_exercised(x) {
            let paid = -sign * x.exp();
            return [sign * self.strike() + paid, paid, paid];
        }
        self.waiting(x)
    }

    /// Where the value of waiting is a line in the spot but for rounding: where the spot does not leave a line of the profile,
    /// nor come to the contact sets.
    pub fn lines(&self) -> Vec<Piece> {
        let (segment, spread) = (&self.segment, self.segment.spread());
        let transition = Transition::new(&segment.dynamics, segment.duration);
        let away = (LARGEST_DEVIATION + spread) * spread;
        let nearest = self
            .boundary
            .as_ref()
            .map_or(-segment.sign * f64::INFINITY, Boundary::furthest_effect);
        let known = self.profile.pieces.iter();
        let known = known.filter(|p| !matches!(p.kind, PieceKind::AtZero | PieceKind::Other));
        let lines = known.map(|piece| {
            let (mut lower, mut upper) = (
                piece.lower - transition.shift + away,
                piece.upper - transition.shift - away,
            );
            if segment.sign > 0.0 {
                lower = lower.max(nearest);
            } else {
                upper = upper.min(nearest);
            }
            Piece {
                kind: PieceKind::Waiting,
                lower,
                upper,
                constant: transition.bond * piece.constant,
                slope: transition.discount * piece.slope,
            }
        });
        lines.filter(|line| line.lower < line.upper).collect()
    }

    /// The kinks of the value: those at the segment's end, moved by the drift and smoothed, and the end of the contact
    /// set.
    pub fn kinks_from(&self, at_end: &[Kink]) -> Vec<Kink> {
        let spread = self.segment.spread();
        let shift = self.segment.dynamics.drift() * self.segment.duration;
        let mut kinks: Vec<Kink> = at_end
            .iter()
            .map(|kink| Kink {
                place: kink.place - shift,
                width: kink.width.hypot(spread),
            })
            .collect();
        let ends = [self.boundary_now(), self.far];
        let ends = ends.into_iter().filter(|end| end.is_finite());
        kinks.extend(ends.map(|place| Kink { place, width: 0.0 }));
        kinks
    }
}
