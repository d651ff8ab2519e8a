//! From the value just after an event to that just before it: the spot's drop, then the holder's choice.

use super::continuation::Continuation;
use super::exercise_choice::{
    choose, contact_end, is_payoff, joined, payoff_piece, Choice, Chosen, SAME_END,
};
use super::panels::{append_nodes, Interval, Kink, PanelWidths};
use super::profile::{Piece, PieceKind, Profile};
use super::segment::Segment;
use super::segment_value::SegmentValue;
use super::spot_drop::{logarithm, SpotDrop};
use super::unsettled::Unsettled;

/// The number of panels for which room is made at once; chosen: few profiles have more.
const USUAL_PANELS: usize = 40;
/// The width of the kink where the event takes the whole spot, in standard deviations of ln S over the segment; chosen.
const PAID_OUT_WIDTH: f64 = 0.25;

/// The smallest width of a line of the value of waiting that is taken as one, in standard deviations of ln S over the segment;
/// chosen: each of its ends costs as much as two panels.
pub const NARROWEST_LINE: f64 = 8.0;

/// The value at a segment's end, before the event.
pub struct Transferred {
    pub profile: Profile,
    /// The end of the contact set that reaches to the far side (spot 0 for a put, infinity for a call), x, infinite
    /// without one.
    pub contact: f64,
    /// The end of that contact set which is far from the strike, x, where it goes on through the end and has one that
    /// matters; -sign infinity otherwise.
    pub far: f64,
    /// Where the value is not smooth.
    pub kinks: Vec<Kink>,
    /// The value at spot zero.
    pub at_zero: f64,
}

fn piece(kind: PieceKind, lower: f64, upper: f64, constant: f64, slope: f64) -> Piece {
    Piece {
        kind,
        lower,
        upper,
        constant,
        slope,
    }
}

fn sharp_kink(place: f64) -> Kink {
    Kink { place, width: 0.0 }
}

/// The value at expiry: the payoff after the dividends of that time, or what exercise just before them is worth.
pub fn at_expiry(segment: &Segment) -> Transferred {
    let sign = segment.sign;
    let mut pieces = payoff_after_dividends(segment);
    let mut kinks: Vec<f64> = pieces
        .iter()
        .flat_map(|p| [p.lower, p.upper])
        .filter(|x| x.is_finite())
        .collect();
    let mut exercised = Vec::new();
    if segment.exercise_at_end {
        (pieces, exercised) = choose(&pieces, segment);
    }
    let (contact, ends) = contact_end(&exercised, sign);
    kinks.extend(ends);
    kinks.sort_by(f64::total_cmp);
    kinks.dedup();
    pieces.retain(|p| p.constant != 0.0 || p.slope != 0.0);
    Transferred {
        profile: Profile::new(&pieces, Vec::new(), Vec::new(), Vec::new()),
        contact,
        far: -sign * f64::INFINITY,
        kinks: kinks.into_iter().map(sharp_kink).collect(),
        at_zero: if sign > 0.0 { 1.0 } else { 0.0 },
    }
}

/// The payoff as a function of the spot before the dividends of that time.
fn payoff_after_dividends(segment: &Segment) -> Vec<Piece> {
    let (sign, keep, amount) = (segment.sign, 1.0 - segment.fraction, segment.amount);
    if keep <= 0.0 {
        let at_zero = if sign > 0.0 { 1.0 } else { 0.0 };
        return vec![piece(
            PieceKind::Other,
            f64::NEG_INFINITY,
            f64::INFINITY,
            at_zero,
            0.0,
        )];
    }
    let (strike, paid_out) = (logarithm((1.0 + amount) / keep), logarithm(amount / keep));
    if sign < 0.0 {
        return vec![
            piece(
                PieceKind::LaterPayoff,
                strike,
                f64::INFINITY,
                -1.0 - amount,
                keep,
            ),
            piece(PieceKind::Other, f64::NEG_INFINITY, strike, 0.0, 0.0),
        ];
    }
    let mut pieces = vec![
        piece(
            PieceKind::LaterPayoff,
            paid_out,
            strike,
            1.0 + amount,
            -keep,
        ),
        piece(PieceKind::Other, strike, f64::INFINITY, 0.0, 0.0),
    ];
    if paid_out > f64::NEG_INFINITY {
        pieces.insert(
            0,
            piece(PieceKind::Other, f64::NEG_INFINITY, paid_out, 1.0, 0.0),
        );
    }
    pieces
}

/// The value at the end of `segment`, before its event, from that after it, whose kinks are `kinks`.
///
/// `ends` is the interval of x that matters; beyond it the value is continued as a line in the spot. Unsettled where it
/// takes too many panels.
pub fn before_event(
    later: &SegmentValue,
    segment: &Segment,
    kinks: &[Kink],
    ends: Interval,
    widths: &PanelWidths,
) -> Result<Transferred, Unsettled> {
    if segment.fraction >= 1.0 {
        return Ok(paid_out_whole(later, segment));
    }
    let drop = SpotDrop {
        keep: 1.0 - segment.fraction,
        amount: segment.amount,
    };
    let mut boundary = drop.before(later.boundary_now());
    if !(ends.0 < boundary && boundary < ends.1) {
        boundary = f64::NAN; // a contact set that far away is continued like the value of waiting
    }
    let mut far = f64::NEG_INFINITY;
    if later.far.is_finite() && ends.0 < drop.before(later.far) && !boundary.is_nan() {
        far = drop.before(later.far);
    }
    let (mut pieces, open_ends) = known_pieces(later, segment, drop, (far, boundary));
    let mut kinks = moved(kinks, drop);
    let sharp = [far, boundary].into_iter().filter(|end| end.is_finite());
    kinks.extend(sharp.map(sharp_kink));
    if segment.paid_out_below() > ends.0 {
        kinks.push(Kink {
            place: segment.paid_out_below(),
            width: PAID_OUT_WIDTH * widths.spread,
        });
    }
    let inside = (open_ends.0.max(ends.0), open_ends.1.min(ends.1));
    let mut waiting: Vec<Interval> = if far > inside.0 {
        vec![(inside.0, far), (boundary, inside.1)]
    } else {
        vec![inside]
    };
    waiting.retain(|interval| interval.0 < interval.1);
    for line in later.lines() {
        let line = before_drop(&line, drop);
        waiting = without_line(&waiting, &line, (inside, open_ends), widths, &mut pieces);
    }
    let mut goes_on = false;
    let mut contact = -segment.sign * f64::INFINITY;
    let continuation = later.continuation();
    if segment.exercise_at_end {
        let same_strike = (later.strike() - segment.strike(0.0)).abs() < SAME_END;
        if segment.is_continuous() && !boundary.is_nan() && same_strike {
            (contact, goes_on) = (boundary, true);
            kinks.push(sharp_kink(boundary));
        } else {
            let choice = Choice {
                later,
                continuation: &continuation,
                drop,
                segment,
            };
            let exercised = exercise(&choice, &mut pieces, &mut waiting, (inside, open_ends));
            let (end, places) = contact_end(&exercised, segment.sign);
            contact = end;
            kinks.extend(places.into_iter().map(sharp_kink));
        }
    }
    let sample = Sample {
        later,
        drop,
        waiting: &waiting,
        open_ends,
        inside,
    };
    Ok(Transferred {
        profile: sample.profile(&continuation, pieces, &kinks, widths)?,
        contact,
        far: if goes_on {
            far
        } else {
            -segment.sign * f64::INFINITY
        },
        kinks,
        at_zero: at_zero(later, segment),
    })
}

/// The pieces that are lines without approximation, below a spot that the event takes whole and on the later contact
/// set, which ends at `boundary` (NaN without one) and for a put begins at `far` (-infinity without such an end); and the
/// interval beside them.
fn known_pieces(
    later: &SegmentValue,
    segment: &Segment,
    drop: SpotDrop,
    (far, boundary): Interval,
) -> (Vec<Piece>, Interval) {
    let sign = segment.sign;
    let paid_out = segment.paid_out_below();
    let (mut lower, mut upper) = (paid_out, f64::INFINITY);
    let mut pieces = Vec::new();
    if paid_out > f64::NEG_INFINITY {
        pieces.push(piece(
            PieceKind::AtZero,
            f64::NEG_INFINITY,
            paid_out,
            later.at_zero,
            0.0,
        ));
    }
    if !boundary.is_nan() {
        let (constant, slope) = (sign * (later.strike() + drop.amount), -sign * drop.keep);
        if sign > 0.0 {
            pieces.push(piece(
                PieceKind::LaterPayoff,
                lower.max(far),
                boundary,
                constant,
                slope,
            ));
            if far <= lower {
                lower = boundary;
            }
        } else {
            pieces.push(piece(
                PieceKind::LaterPayoff,
                boundary,
                f64::INFINITY,
                constant,
                slope,
            ));
            upper = boundary;
        }
    }
    (pieces, (lower, upper))
}

/// The interval, which reaches to the open end where it covers an end of what is `inside`.
fn opened(interval: Interval, inside: Interval, open_ends: Interval) -> Interval {
    let lower = if interval.0 <= inside.0 {
        open_ends.0
    } else {
        interval.0
    };
    let upper = if interval.1 >= inside.1 {
        open_ends.1
    } else {
        interval.1
    };
    (lower, upper)
}

/// A line in the spot after a drop as one in the spot before it.
fn before_drop(line: &Piece, drop: SpotDrop) -> Piece {
    Piece {
        lower: drop.before(line.lower),
        upper: drop.before(line.upper),
        constant: line.constant - line.slope * drop.amount,
        slope: line.slope * drop.keep,
        ..*line
    }
}

/// What is left of the intervals of waiting beside a line, which is added to the pieces where it spares enough panels; from an end
/// of what is `inside` it is continued to the open end.
fn without_line(
    waiting: &[Interval],
    line: &Piece,
    (inside, open_ends): (Interval, Interval),
    widths: &PanelWidths,
    pieces: &mut Vec<Piece>,
) -> Vec<Interval> {
    let mut left = Vec::with_capacity(waiting.len() + 1);
    for &(start, stop) in waiting {
        let (lower, upper) = (line.lower.max(start), line.upper.min(stop));
        if upper - lower < NARROWEST_LINE * widths.spread {
            left.push((start, stop));
            continue;
        }
        let ends = opened((lower, upper), inside, open_ends);
        pieces.push(Piece {
            lower,
            upper,
            ..*line
        });
        let beyond = [(ends.0, lower), (upper, ends.1)].into_iter();
        pieces.extend(beyond.filter(|rest| rest.0 < rest.1).map(|rest| Piece {
            kind: PieceKind::Other,
            lower: rest.0,
            upper: rest.1,
            ..*line
        }));
        left.extend(
            [(start, lower), (upper, stop)]
                .into_iter()
                .filter(|rest| rest.0 < rest.1),
        );
    }
    left
}

/// Replace pieces and intervals of waiting by the payoff where that is larger; return where it is.
fn exercise(
    choice: &Choice,
    pieces: &mut Vec<Piece>,
    waiting: &mut Vec<Interval>,
    (inside, open_ends): (Interval, Interval),
) -> Vec<Interval> {
    let segment = choice.segment;
    let (chosen, mut exercised) = choose(pieces, segment);
    *pieces = chosen;
    for interval in std::mem::take(waiting) {
        let split: Chosen = choice.split(interval, opened(interval, inside, open_ends));
        waiting.extend(split.waiting);
        exercised.extend(split.exercised);
    }
    let exercised = joined(exercised);
    pieces.retain(|p| !is_payoff(p, segment));
    pieces.extend(exercised.iter().map(|&ends| payoff_piece(segment, ends)));
    exercised
}

/// The value at spot zero, after what the holder may do there.
fn at_zero(later: &SegmentValue, segment: &Segment) -> f64 {
    if segment.exercise_at_end && segment.sign > 0.0 {
        later.at_zero.max(segment.strike(0.0))
    } else {
        later.at_zero
    }
}

/// The value of waiting, to be sampled at Gauss nodes.
struct Sample<'a> {
    later: &'a SegmentValue,
    drop: SpotDrop,
    waiting: &'a [Interval],
    open_ends: Interval,
    inside: Interval,
}

impl Sample<'_> {
    /// The pieces, the nodes, and the lines in the spot that continue the value beyond the ends of the sample.
    fn profile(
        &self,
        continuation: &Continuation,
        mut pieces: Vec<Piece>,
        kinks: &[Kink],
        widths: &PanelWidths,
    ) -> Result<Profile, Unsettled> {
        let room = USUAL_PANELS * widths.points;
        let mut panels = Vec::with_capacity(USUAL_PANELS);
        let (mut nodes, mut weighted) = (Vec::with_capacity(room), Vec::with_capacity(room));
        for &interval in self.waiting {
            append_nodes(
                interval,
                kinks,
                widths,
                &mut panels,
                &mut nodes,
                &mut weighted,
            )?;
        }
        let after = self.drop.after_all(&nodes);
        for (weight, value) in weighted
            .iter_mut()
            .zip(self.later.values(continuation, &after))
        {
            *weight *= value;
        }
        let ((lower, upper), (start, stop)) = (self.open_ends, self.inside);
        if let (Some(first), Some(last)) = (self.waiting.first(), self.waiting.last()) {
            if first.0.total_cmp(&start).is_eq() && start > lower {
                let (constant, slope) = self.tangent(start);
                // A put on so small a spot is worth all but what it is worth on a spot of zero.
                let kind = if self.later.segment.sign > 0.0 {
                    PieceKind::AtZero
                } else {
                    PieceKind::Other
                };
                pieces.push(piece(kind, lower, start, constant, slope));
            }
            if last.1.total_cmp(&stop).is_eq() && stop < upper {
                let (constant, slope) = self.tangent(stop);
                pieces.push(piece(PieceKind::Other, stop, upper, constant, slope));
            }
        }
        Ok(Profile::new(&pieces, panels, nodes, weighted))
    }

    /// The constant and the slope of the tangent at x as a function of the spot.
    fn tangent(&self, x: f64) -> (f64, f64) {
        let after = self.drop.after(x);
        let [value, by_x, _] = self.later.value(after);
        let slope = self.drop.keep * by_x * (-after).exp();
        (value - slope * x.exp(), slope)
    }
}

/// The value before an event that takes the whole spot.
fn paid_out_whole(later: &SegmentValue, segment: &Segment) -> Transferred {
    let mut pieces = vec![piece(
        PieceKind::AtZero,
        f64::NEG_INFINITY,
        f64::INFINITY,
        later.at_zero,
        0.0,
    )];
    let mut exercised = Vec::new();
    if segment.exercise_at_end {
        (pieces, exercised) = choose(&pieces, segment);
    }
    let (contact, ends) = contact_end(&exercised, segment.sign);
    Transferred {
        profile: Profile::new(&pieces, Vec::new(), Vec::new(), Vec::new()),
        contact,
        far: -segment.sign * f64::INFINITY,
        kinks: ends.into_iter().map(sharp_kink).collect(),
        at_zero: at_zero(later, segment),
    }
}

/// The kinks where they are before the event; their widths shrink as distances in ln S do.
fn moved(kinks: &[Kink], drop: SpotDrop) -> Vec<Kink> {
    kinks
        .iter()
        .map(|kink| {
            let spot = kink.place.exp();
            Kink {
                place: drop.before(kink.place),
                width: kink.width * spot / (spot + drop.amount),
            }
        })
        .collect()
}
