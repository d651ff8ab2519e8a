//! The holder's choice at one instant: where the payoff is worth more than waiting.

use super::continuation::Continuation;
use super::panels::Interval;
use super::profile::{Piece, PieceKind};
use super::roots::{find_crossing, find_root, CLOSEST};
use super::segment::Segment;
use super::segment_value::SegmentValue;
use super::spot_drop::SpotDrop;

/// The number of intervals in which the choice is looked at where it may change more than once; chosen.
const SCANNED: u32 = 48;
/// The last step of Newton's method to the end of a contact set, in x; chosen: it leaves nothing but rounding.
const LAST_STEP: f64 = 1e-8;
/// The difference of two values that is rounding, in strikes.
const INDIFFERENT: f64 = 1e-14;
/// The distance in x, and in strikes, within which two ends are the same; chosen.
pub const SAME_END: f64 = 1e-12;

/// The piece that is the payoff on an interval.
pub fn payoff_piece(segment: &Segment, (lower, upper): Interval) -> Piece {
    Piece {
        kind: PieceKind::Payoff,
        lower,
        upper,
        constant: segment.sign * segment.strike(0.0),
        slope: -segment.sign,
    }
}

/// Whether the piece is the payoff.
pub fn is_payoff(piece: &Piece, segment: &Segment) -> bool {
    (piece.constant - segment.sign * segment.strike(0.0)).abs() < SAME_END
        && (piece.slope + segment.sign).abs() < SAME_END
}

/// The larger of linear pieces and payoff, and the intervals of the latter.
pub fn choose(pieces: &[Piece], segment: &Segment) -> (Vec<Piece>, Vec<Interval>) {
    let (sign, strike) = (segment.sign, segment.strike(0.0));
    let (mut chosen, mut exercised) = (Vec::new(), Vec::new());
    for p in pieces {
        // The payoff less the piece.
        let (constant, slope) = (sign * strike - p.constant, -sign - p.slope);
        let crossing = if slope != 0.0 && -constant / slope > 0.0 {
            (-constant / slope).ln()
        } else {
            f64::NAN
        };
        let mut cuts = vec![p.lower, p.upper];
        if p.lower + SAME_END < crossing && crossing < p.upper - SAME_END {
            cuts.insert(1, crossing);
        }
        for pair in cuts.windows(2) {
            let (lower, upper) = (pair[0], pair[1]);
            let middle = between(lower, upper).exp();
            let pays = sign * (strike - middle) > 0.0;
            if pays && constant + slope * middle >= -INDIFFERENT {
                exercised.push((lower, upper));
                chosen.push(payoff_piece(segment, (lower, upper)));
            } else {
                chosen.push(Piece { lower, upper, ..*p });
            }
        }
    }
    (chosen, joined(exercised))
}

/// A place between two, next to the finite one where the other is infinite.
fn between(a: f64, b: f64) -> f64 {
    match (a.is_finite(), b.is_finite()) {
        (true, true) => 0.5 * (a + b),
        (true, false) => a + 1.0,
        (false, true) => b - 1.0,
        (false, false) => 0.0,
    }
}

/// The value of waiting through an event, against the payoff before it.
pub struct Choice<'a> {
    /// The value after the event.
    pub later: &'a SegmentValue,
    pub continuation: &'a Continuation<'a>,
    pub drop: SpotDrop,
    /// The segment that the event ends.
    pub segment: &'a Segment,
}

/// Where the option is held, and where it is exercised.
#[derive(Default)]
pub struct Chosen {
    pub waiting: Vec<Interval>,
    pub exercised: Vec<Interval>,
}

impl Choice<'_> {
    /// Split an interval; an exercised one at an outer end reaches to the open end.
    pub fn split(&self, interval: Interval, open_ends: Interval) -> Chosen {
        if self.later.is_monotone {
            self.split_once(interval, open_ends)
        } else {
            self.split_by_scan(interval, open_ends)
        }
    }

    /// The value of waiting less the payoff, in strikes.
    fn excess(&self, x: f64) -> f64 {
        let (sign, strike) = (self.segment.sign, self.segment.strike(0.0));
        self.later.value(self.drop.after(x))[0] - sign * (strike - x.exp())
    }

    /// The same with its slope.
    fn excess_and_slope(&self, x: f64) -> (f64, f64) {
        let (sign, strike) = (self.segment.sign, self.segment.strike(0.0));
        let after = self.drop.after(x);
        let [value, by_x, _] = self.later.value(after);
        let by_spot = self.drop.keep * by_x * (-after).exp() + sign;
        (value - sign * (strike - x.exp()), by_spot * x.exp())
    }

    /// Split where the value of waiting less the payoff falls towards the side of exercise, so that there is one end.
    fn split_once(&self, (start, stop): Interval, open_ends: Interval) -> Chosen {
        let sign = self.segment.sign;
        let mut chosen = Chosen::default();
        let (far, near) = if sign > 0.0 {
            (start, stop)
        } else {
            (stop, start)
        };
        if self.excess(far) > INDIFFERENT {
            chosen.waiting.push((start, stop));
            return chosen;
        }
        if self.excess(near) <= INDIFFERENT {
            chosen.exercised.push(open_ends);
            return chosen;
        }
        let excess = |x: f64| self.excess_and_slope(x);
        let end = find_crossing(excess, (start, stop), sign > 0.0, LAST_STEP);
        if sign > 0.0 {
            chosen.exercised.push((open_ends.0, end));
            chosen.waiting.push((end, stop));
        } else {
            chosen.waiting.push((start, end));
            chosen.exercised.push((end, open_ends.1));
        }
        chosen
    }

    /// Split where the sign of the value of waiting less the payoff changes between scanned places.
    fn split_by_scan(&self, (start, stop): Interval, open_ends: Interval) -> Chosen {
        let (sign, strike) = (self.segment.sign, self.segment.strike(0.0));
        let scanned: Vec<f64> = (0..=SCANNED)
            .map(|i| start + (stop - start) * f64::from(i) / f64::from(SCANNED))
            .collect();
        let after = self.drop.after_all(&scanned);
        let better: Vec<bool> = self
            .later
            .values(self.continuation, &after)
            .iter()
            .zip(&scanned)
            .map(|(value, x)| value - sign * (strike - x.exp()) > INDIFFERENT)
            .collect();
        let mut cuts = vec![start];
        for k in 0..better.len() - 1 {
            if better[k] != better[k + 1] {
                let excess = |x: f64| self.excess(x);
                cuts.push(find_root(excess, scanned[k], scanned[k + 1], CLOSEST));
            }
        }
        cuts.push(stop);
        let last = cuts.len() - 2;
        let mut chosen = Chosen::default();
        for (k, pair) in cuts.windows(2).enumerate() {
            let (a, b) = (pair[0], pair[1]);
            if self.excess(0.5 * (a + b)) > INDIFFERENT {
                chosen.waiting.push((a, b));
                continue;
            }
            chosen.exercised.push((
                if k == 0 { open_ends.0 } else { a },
                if k == last { open_ends.1 } else { b },
            ));
        }
        chosen
    }
}

/// The union of intervals that may touch, in order.
pub fn joined(mut intervals: Vec<Interval>) -> Vec<Interval> {
    intervals.sort_by(|x, y| x.0.total_cmp(&y.0));
    let mut joined: Vec<Interval> = Vec::new();
    for (a, b) in intervals {
        match joined.last_mut() {
            Some(last) if a <= last.1 + SAME_END => last.1 = last.1.max(b),
            _ => joined.push((a, b)),
        }
    }
    joined
}

/// The end of the exercised interval that reaches to the far side (x = -infinity for a put, infinity for a call),
/// infinite without one, and all finite ends.
pub fn contact_end(exercised: &[Interval], sign: f64) -> (f64, Vec<f64>) {
    let mut contact = -sign * f64::INFINITY;
    let mut ends = Vec::new();
    for &(a, b) in exercised {
        if sign > 0.0 && a == f64::NEG_INFINITY {
            contact = b;
        }
        if sign < 0.0 && b == f64::INFINITY {
            contact = a;
        }
        ends.extend([a, b].into_iter().filter(|x| x.is_finite()));
    }
    (contact, ends)
}
