//! From the value just after an event to the profile just before it: the spot's drop, then the holder's choice.

use super::held::Held;
use super::panels::{append_nodes, Feature, Fineness};
use super::profile::{Piece, Profile};
use super::roots::{find_crossing, find_root, CLOSE};
use super::stretch::Stretch;
use super::values::Continuation;
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::normal::{exp, ln};
use crate::lanes::vector::{Vector, LANES};

/// Room is made for so many at once.
const USUAL_PANELS: usize = 40;
/// Intervals in which the holder's choice may change.
const SCANNED: u32 = 48;
/// Of a place: so short a step of Newton's method leaves nothing but rounding.
const NEAR: f64 = 1e-8;
/// In strikes, instead of nothing: its logarithm is finite.
const LEAST_SPOT: f64 = 1e-300;
const INDIFFERENT: f64 = 1e-14;
const SAME_END: f64 = 1e-12;

type Interval = (f64, f64);

/// The profile at a stretch's end, and what it shows.
pub struct Transferred {
    pub profile: Profile,
    /// The end of the contact set that reaches to the far side (0 for a put, infinity for a call), infinite without one.
    pub contact: f64,
    pub features: Vec<Feature>,
    pub at_zero: f64,
}

/// The payoff, after the dividends of that time, or what exercise just before them brings.
pub fn at_expiry(stretch: &Stretch) -> Transferred {
    let (sign, keep, amount) = (stretch.sign, 1.0 - stretch.fraction, stretch.amount);
    let at_zero = if sign > 0.0 { 1.0 } else { 0.0 };
    let mut pieces = vec![piece(f64::NEG_INFINITY, f64::INFINITY, at_zero, 0.0)];
    if keep > 0.0 {
        let (strike, gone) = (logarithm((1.0 + amount) / keep), logarithm(amount / keep));
        pieces = if sign > 0.0 {
            vec![
                piece(gone, strike, 1.0 + amount, -keep),
                piece(strike, f64::INFINITY, 0.0, 0.0),
            ]
        } else {
            vec![
                piece(strike, f64::INFINITY, -1.0 - amount, keep),
                piece(f64::NEG_INFINITY, strike, 0.0, 0.0),
            ]
        };
        if sign > 0.0 && gone > f64::NEG_INFINITY {
            pieces.insert(0, piece(f64::NEG_INFINITY, gone, 1.0, 0.0));
        }
    }
    let mut bends: Vec<f64> = pieces
        .iter()
        .flat_map(|p| [p.lower, p.upper])
        .filter(|x| x.is_finite())
        .collect();
    let mut exercised = Vec::new();
    if stretch.exercise_at_end {
        (pieces, exercised) = choose(&pieces, stretch);
    }
    let (contact, edges) = contact(&exercised, sign);
    bends.extend(edges);
    bends.sort_by(f64::total_cmp);
    bends.dedup();
    pieces.retain(|p| p.constant != 0.0 || p.slope != 0.0);
    Transferred {
        profile: Profile::new(&pieces, Vec::new(), Vec::new(), Vec::new()),
        contact,
        features: bends.into_iter().map(bend).collect(),
        at_zero,
    }
}

fn piece(lower: f64, upper: f64, constant: f64, slope: f64) -> Piece {
    Piece {
        lower,
        upper,
        constant,
        slope,
    }
}

fn bend(place: f64) -> Feature {
    Feature { place, scale: 0.0 }
}

fn logarithm(x: f64) -> f64 {
    if x > 0.0 {
        x.ln()
    } else {
        f64::NEG_INFINITY
    }
}

/// x after the event as a function of x before it.
#[derive(Clone, Copy)]
struct Drop {
    keep: f64,
    amount: f64,
}

impl Drop {
    fn after(self, x: f64) -> f64 {
        (self.keep * x.exp() - self.amount).max(LEAST_SPOT).ln()
    }

    fn after_all(self, places: &[f64]) -> Vec<f64> {
        let mut after = vec![0.0; places.len()];
        dispatch(Dropping {
            drop: self,
            places,
            after: &mut after,
        });
        after
    }

    #[allow(clippy::float_cmp)] // no event at all
    fn before(self, x: f64) -> f64 {
        if self.amount == 0.0 && self.keep == 1.0 {
            return x;
        }
        logarithm((x.exp() + self.amount) / self.keep)
    }
}

struct Dropping<'a> {
    drop: Drop,
    places: &'a [f64],
    after: &'a mut [f64],
}

impl Work for Dropping<'_> {
    type Result = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let chunks = self.places.chunks(LANES).zip(self.after.chunks_mut(LANES));
        for (places, after) in chunks {
            let mut lanes = [places[0]; LANES];
            lanes[..places.len()].copy_from_slice(places);
            let spot = exp(V::from_lanes(lanes)).times(self.drop.keep);
            let left = spot.plus(-self.drop.amount).max(V::all(LEAST_SPOT));
            after.copy_from_slice(&ln(left).lanes()[..places.len()]);
        }
    }
}

/// The profile at the end of `stretch`, before its event.
///
/// `ends` is the interval of x that matters; beyond it the value is continued linearly in the spot.
pub fn before_event(
    later: &Held,
    stretch: &Stretch,
    features: &[Feature],
    ends: Interval,
    fineness: &Fineness,
) -> Transferred {
    if stretch.fraction >= 1.0 {
        return worthless(later, stretch);
    }
    let drop = Drop {
        keep: 1.0 - stretch.fraction,
        amount: stretch.amount,
    };
    let sign = stretch.sign;
    let mut edge = drop.before(later.edge());
    if !(ends.0 < edge && edge < ends.1) {
        edge = f64::NAN; // a contact set that far away is continued like what is held
    }
    let gone = stretch.gone();
    let (mut lower, mut upper) = (gone, f64::INFINITY);
    let mut pieces = Vec::new();
    if gone > f64::NEG_INFINITY {
        pieces.push(piece(f64::NEG_INFINITY, gone, later.at_zero, 0.0));
    }
    if !edge.is_nan() {
        let (constant, slope) = (sign * (later.strike() + drop.amount), -sign * drop.keep);
        if sign > 0.0 {
            pieces.push(piece(lower, edge, constant, slope));
            lower = edge;
        } else {
            pieces.push(piece(edge, f64::INFINITY, constant, slope));
            upper = edge;
        }
    }
    let mut bends = moved(features, drop);
    if edge.is_finite() {
        bends.push(bend(edge));
    }
    if gone > ends.0 {
        bends.push(Feature {
            place: gone,
            scale: 0.25 * fineness.spread,
        });
    }
    let inside = (lower.max(ends.0), upper.min(ends.1));
    let mut held: Vec<Interval> = Vec::new();
    if inside.0 < inside.1 {
        held.push(inside);
    }
    let mut contact_end = -sign * f64::INFINITY;
    let continuation = Continuation::new(later);
    if stretch.exercise_at_end {
        let same = (later.strike() - stretch.strike(0.0)).abs() < SAME_END;
        if stretch.is_continuous() && !edge.is_nan() && same {
            contact_end = edge;
            bends.push(bend(edge));
        } else {
            let (chosen, mut exercised) = choose(&pieces, stretch);
            pieces = chosen;
            if let Some(&interval) = held.first() {
                held.clear();
                split_held(
                    later,
                    &continuation,
                    drop,
                    stretch,
                    interval,
                    (lower, upper),
                    &mut held,
                    &mut exercised,
                );
            }
            let exercised = joined(exercised);
            pieces.retain(|p| !is_paid(p, stretch));
            let strike = stretch.strike(0.0);
            pieces.extend(
                exercised
                    .iter()
                    .map(|&(a, b)| piece(a, b, sign * strike, -sign)),
            );
            let (end, edges) = contact(&exercised, sign);
            contact_end = end;
            bends.extend(edges.into_iter().map(bend));
        }
    }
    let sample = Sample {
        later,
        drop,
        held: &held,
        open_ends: (lower, upper),
        inside,
    };
    Transferred {
        profile: sample.profile(&continuation, pieces, &bends, fineness),
        contact: contact_end,
        features: bends,
        at_zero: at_zero(later, stretch),
    }
}

/// What the option is worth at spot zero, after what its holder may do then.
fn at_zero(later: &Held, stretch: &Stretch) -> f64 {
    if stretch.exercise_at_end && stretch.sign > 0.0 {
        later.at_zero.max(stretch.strike(0.0))
    } else {
        later.at_zero
    }
}

/// The value where it is held, to be sampled at Gauss nodes.
struct Sample<'a> {
    later: &'a Held,
    drop: Drop,
    held: &'a [Interval],
    open_ends: Interval,
    inside: Interval,
}

impl Sample<'_> {
    /// The pieces, the nodes, and the lines in the spot that continue the value beyond the ends where it is held.
    fn profile(
        &self,
        continuation: &Continuation,
        mut pieces: Vec<Piece>,
        bends: &[Feature],
        fineness: &Fineness,
    ) -> Profile {
        let room = USUAL_PANELS * fineness.points;
        let mut panels = Vec::with_capacity(USUAL_PANELS);
        let (mut nodes, mut weighted) = (Vec::with_capacity(room), Vec::with_capacity(room));
        for &interval in self.held {
            append_nodes(
                interval,
                bends,
                fineness,
                &mut panels,
                &mut nodes,
                &mut weighted,
            );
        }
        let after = self.drop.after_all(&nodes);
        for (weight, value) in weighted
            .iter_mut()
            .zip(self.later.values(continuation, &after))
        {
            *weight *= value;
        }
        let ((lower, upper), (start, stop)) = (self.open_ends, self.inside);
        if let (Some(first), Some(last)) = (self.held.first(), self.held.last()) {
            if first.0.total_cmp(&start).is_eq() && start > lower {
                let (constant, slope) = tangent(self.later, self.drop, start);
                pieces.push(piece(lower, start, constant, slope));
            }
            if last.1.total_cmp(&stop).is_eq() && stop < upper {
                let (constant, slope) = tangent(self.later, self.drop, stop);
                pieces.push(piece(stop, upper, constant, slope));
            }
        }
        Profile::new(&pieces, panels, nodes, weighted)
    }
}

/// The profile where the whole spot is paid out.
fn worthless(later: &Held, stretch: &Stretch) -> Transferred {
    let mut pieces = vec![piece(f64::NEG_INFINITY, f64::INFINITY, later.at_zero, 0.0)];
    let mut exercised = Vec::new();
    if stretch.exercise_at_end {
        (pieces, exercised) = choose(&pieces, stretch);
    }
    let (contact, edges) = contact(&exercised, stretch.sign);
    Transferred {
        profile: Profile::new(&pieces, Vec::new(), Vec::new(), Vec::new()),
        contact,
        features: edges.into_iter().map(bend).collect(),
        at_zero: at_zero(later, stretch),
    }
}

/// The features where they are before the event; their scales shrink as logarithm(spot) does.
fn moved(features: &[Feature], drop: Drop) -> Vec<Feature> {
    features
        .iter()
        .map(|feature| {
            let spot = feature.place.exp();
            Feature {
                place: drop.before(feature.place),
                scale: feature.scale * spot / (spot + drop.amount),
            }
        })
        .collect()
}

/// Whether the piece is the payoff.
fn is_paid(piece: &Piece, stretch: &Stretch) -> bool {
    (piece.constant - stretch.sign * stretch.strike(0.0)).abs() < SAME_END
        && (piece.slope + stretch.sign).abs() < SAME_END
}

/// The larger of linear pieces and payoff, and the intervals of the latter.
fn choose(pieces: &[Piece], stretch: &Stretch) -> (Vec<Piece>, Vec<Interval>) {
    let (sign, strike) = (stretch.sign, stretch.strike(0.0));
    let (mut chosen, mut exercised) = (Vec::new(), Vec::new());
    for p in pieces {
        // What exercise brings more.
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
            let (a, b) = (pair[0], pair[1]);
            let middle = between(a, b).exp();
            let pays = sign * (strike - middle) > 0.0;
            if pays && constant + slope * middle >= -INDIFFERENT {
                exercised.push((a, b));
                chosen.push(piece(a, b, sign * strike, -sign));
            } else {
                chosen.push(piece(a, b, p.constant, p.slope));
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

/// Split the held interval where the payoff is larger; its outer ends go to the open ends.
#[allow(clippy::too_many_arguments)]
fn split_held(
    later: &Held,
    continuation: &Continuation,
    drop: Drop,
    stretch: &Stretch,
    (start, stop): Interval,
    open_ends: Interval,
    held: &mut Vec<Interval>,
    exercised: &mut Vec<Interval>,
) {
    let (sign, strike) = (stretch.sign, stretch.strike(0.0));
    let above = |x: f64| later.value(drop.after(x))[0] - sign * (strike - x.exp());
    if later.is_monotone {
        // What holding is worth more falls towards the side of exercise.
        let (far, near) = if sign > 0.0 {
            (start, stop)
        } else {
            (stop, start)
        };
        if above(far) > INDIFFERENT {
            held.push((start, stop));
            return;
        }
        if above(near) <= INDIFFERENT {
            exercised.push(open_ends);
            return;
        }
        let excess = |x: f64| {
            let after = drop.after(x);
            let [value, by_x, _] = later.value(after);
            let by_spot = drop.keep * by_x * (-after).exp() + sign;
            (value - sign * (strike - x.exp()), by_spot * x.exp())
        };
        let end = find_crossing(excess, (start, stop), sign > 0.0, NEAR);
        if sign > 0.0 {
            exercised.push((open_ends.0, end));
            held.push((end, stop));
        } else {
            held.push((start, end));
            exercised.push((end, open_ends.1));
        }
        return;
    }
    let scanned: Vec<f64> = (0..=SCANNED)
        .map(|i| start + (stop - start) * f64::from(i) / f64::from(SCANNED))
        .collect();
    let after = drop.after_all(&scanned);
    let better: Vec<bool> = later
        .values(continuation, &after)
        .iter()
        .zip(&scanned)
        .map(|(value, x)| value - sign * (strike - x.exp()) > INDIFFERENT)
        .collect();
    let mut cuts = vec![start];
    for k in 0..better.len() - 1 {
        if better[k] != better[k + 1] {
            cuts.push(find_root(&above, scanned[k], scanned[k + 1], CLOSE));
        }
    }
    cuts.push(stop);
    let last = cuts.len() - 2;
    for (k, pair) in cuts.windows(2).enumerate() {
        let (a, b) = (pair[0], pair[1]);
        if above(0.5 * (a + b)) > INDIFFERENT {
            held.push((a, b));
            continue;
        }
        exercised.push((
            if k == 0 { open_ends.0 } else { a },
            if k == last { open_ends.1 } else { b },
        ));
    }
}

/// The union of intervals that may touch, in order.
fn joined(mut intervals: Vec<Interval>) -> Vec<Interval> {
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

/// The end of the exercised interval on the far side, and all finite ends.
fn contact(exercised: &[Interval], sign: f64) -> (f64, Vec<f64>) {
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

/// Constant and slope of the tangent at x as a function of the spot.
fn tangent(later: &Held, drop: Drop, x: f64) -> (f64, f64) {
    let after = drop.after(x);
    let [value, by_x, _] = later.value(after);
    let slope = drop.keep * by_x * (-after).exp();
    (value - slope * x.exp(), slope)
}
