//! One schedule from expiry to now, segment by segment.

use super::boundary::Boundary;
use super::boundary_query::BoundaryQuery;
use super::boundary_solver::{find_boundary, solve_alike};
use super::contact_onset::ContactOnset;
use super::degree_control::{distribution, DegreeControl, ErrorTotal};
use super::event_transfer::{at_expiry, before_event, Transferred};
use super::fineness::{Fineness, FINENESS, LEVELS};
use super::forecast::{forecasts, Forecast, Later};
use super::onset_search::OnsetSearch;
use super::panels::{Interval, Kink, PanelWidths};
use super::profile::Profile;
use super::schedule::Schedule;
use super::segment::{Segment, OVERHANGING};
use super::segment_value::SegmentValue;
use super::solved_part::{SolvedPart, RELEVANT};
use super::unsettled::Unsettled;

/// The largest width of a panel where the contact set begins at nodes, in standard deviations of ln S over the segment;
/// calibrated on random contracts.
const FINE_PANEL: f64 = 0.4;
/// The distance from the boundary out of the contact set at which value and payoff are compared, in standard deviations of
/// ln S over the segment; chosen.
const CHECKED: f64 = 0.5;
/// The largest amount by which waiting may be worth less than exercise outside the contact set, in strikes; chosen.
const LARGEST_VIOLATION: f64 = 1e-4;
/// The largest distance from the forward at which boundaries are looked for, the one now and any that is asked for, in
/// standard deviations of ln S at expiry; chosen.
const BOUNDARY_REACH: f64 = 2.5;
/// How much further, in standard deviations of ln S, the value is held where a path there and then to the strike is what is
/// unlikely: beyond, nothing is known of its derivatives. Chosen.
const HELD_REACH: f64 = 1.0;
/// The largest number of cuts of one segment, and of one whose contact set may begin between two spots: more do not help there.
/// Chosen.
const MOST_CUTS: usize = 7;
const MOST_CUTS_BETWEEN: usize = 4;
/// The place where a segment is cut whose boundary no degree follows closely enough, as a share of its duration from the
/// onset of its contact set; chosen.
const NEXT_TO_EVENT: f64 = 0.1;
/// The same where the contact set begins some time after the event; chosen.
const AFTER_ONSET: f64 = 0.5;
/// The largest width of the interval of x, in standard deviations of ln S over what is cut off: a wider one needs too many
/// panels. Chosen.
const MOST_SPREADS: f64 = 600.0;
/// The largest sum over all segments of what the intervals of x are wider than the law of the spot at expiry, each in
/// standard deviations of ln S over the segment: wider ones, where dividends move the spot by many of them, take more
/// panels than other methods take nodes. Chosen.
const MOST_EXCESS: f64 = 4e4;
/// The distance from what is relevant within which an end of a contact set is taken to be beyond it, in standard
/// deviations of ln S over the segment; chosen.
const MARGIN: f64 = 0.25;
/// The number of degrees in a row that fail or bring nothing after which a segment is cut; chosen.
const MOST_STALLS: usize = 2;
/// The share of what is left of the tolerance that one boundary may use; chosen.
const SHARE: f64 = 0.5;
/// The share of the tolerance that is kept for all boundaries together; chosen.
const KEPT_SHARE: f64 = 0.2;
/// The share of the violation inside a contact set in the error estimate; calibrated on random contracts.
const VIOLATION_SHARE: f64 = 0.7;
/// The same where the lower end of the contact set is neglected: the boundary makes up for what that leaves inside.
/// Calibrated on random contracts.
const OVERHANGING_SHARE: f64 = 0.2;
/// The distance from the spots that an event takes whole in which the contact set of a put is neglected, where it begins
/// between two spots; chosen.
const PAID_OUT: f64 = 0.3;
/// The same in standard deviations of ln S over the segment; chosen.
const SPREADS_OF_PAID_OUT: f64 = 2.5;
/// The largest standard deviation of ln S over a segment whose contact set begins between two spots; measured. A wider one is
/// cut there.
const WIDEST_BETWEEN: f64 = 0.4;
/// The smallest one that such a segment is cut at; measured.
const NARROWEST_BETWEEN: f64 = 0.1;
/// The share of the tolerance that what is neglected in one segment may take before the segment is cut nearer to its event, and
/// by which share of its width then; chosen.
const NEGLECTED_SHARE: f64 = 0.15;
const NARROWER: f64 = 0.7;
/// The smallest distance of such spots from the forward, in standard deviations of ln S at the segment's end; measured.
const LEAST_NEGLECTED: f64 = 3.5;
/// The probability that a spot is below some place at any time of a segment, over that at its end: two by reflection, and what
/// is left out of `neglected`; calibrated on random contracts.
const AT_SOME_TIME: f64 = 3.0;
/// The share of the dividends paid so far by which the spot is displaced from a lognormal one: the early ones fall with
/// it, the late ones do not. Chosen.
const DISPLACED_SHARE: f64 = 0.5;
/// The total of as many equal errors as segments are still to come, over one of them, from which on a boundary's share of the
/// tolerance shrinks; chosen.
const FEW_SEGMENTS: f64 = 6.0;
/// The state of the recursion between two segments.
#[allow(clippy::struct_excessive_bools)] // facts that have little to do with each other
pub struct BackwardRecursion<'a> {
    /// A solution whose cuts and degrees are taken.
    similar: Option<&'a [SolvedPart]>,
    level: usize,
    fineness: &'a Fineness,
    tolerance: f64,
    /// The part of the tolerance that every boundary may use, in strikes.
    smallest_budget: f64,
    /// The standard deviation of ln S at expiry.
    deviation: f64,
    /// Whether the option may ever be exercised early, or before the dividends of the last day.
    exercised: bool,
    /// The parts that are solved, from expiry on.
    pub solved: Vec<SolvedPart>,
    /// Where the value of the last one is not smooth.
    kinks: Vec<Kink>,
    /// The time from now to the end of the next segment, years.
    end: f64,
    /// Whether the contact set of the next segment may begin between two spots.
    overhangs: bool,
    /// Whether it does, and its far end is neglected.
    neglects_far_end: bool,
    /// Whether that of the last segment may have begun so, and has not reached to a spot of zero by its beginning.
    waits_for_cash: bool,
    /// The x up to which its contact set is neglected then, for the event takes smaller spots whole.
    least_relevant: f64,
    /// Whether a contact set had two ends anywhere.
    has_far_ends: bool,
    /// The largest violation of complementarity so far, in strikes.
    pub violation: f64,
    /// The error estimates so far.
    pub error: ErrorTotal,
    /// What the intervals of x so far are wider than the law of the spot at expiry, in standard deviations of ln S over
    /// their segments.
    excess: f64,
}

/// What became of one part of a segment.
enum Part {
    /// It is solved; its contact set ends at `contact` at its end, infinite without one.
    Solved {
        value: Box<SegmentValue>,
        contact: f64,
    },
    /// It has to be cut at this time to its end.
    Cut(f64),
}

impl<'a> BackwardRecursion<'a> {
    /// Go from expiry to now, with the cuts and the degrees of a `similar` solution where one is given.
    pub fn run(
        schedule: &Schedule<'a>,
        similar: Option<&'a [SolvedPart]>,
        query: &mut BoundaryQuery,
    ) -> Result<BackwardRecursion<'a>, Unsettled> {
        let segments = schedule.segments;
        let forecasts = forecasts(segments, schedule.x);
        if forecasts.iter().any(|here| !here.forward.is_finite()) {
            return Err(Unsettled); // the dividends take the spot to nothing, many times over
        }
        let smallest_budget =
            KEPT_SHARE * schedule.tolerance / ErrorTotal::of_equals(segments.len());
        let mut recursion = BackwardRecursion {
            similar,
            level: schedule.level,
            fineness: &FINENESS[schedule.level],
            tolerance: schedule.tolerance,
            smallest_budget,
            deviation: forecasts.last().map_or(0.0, |f| f.variance).sqrt(),
            exercised: segments
                .iter()
                .any(|segment| segment.exercisable || segment.exercise_at_end),
            solved: Vec::with_capacity(segments.len()),
            kinks: Vec::new(),
            end: segments.iter().map(|segment| segment.duration).sum(),
            overhangs: false,
            neglects_far_end: false,
            waits_for_cash: false,
            least_relevant: f64::NEG_INFINITY,
            has_far_ends: false,
            violation: 0.0,
            error: ErrorTotal::default(),
            excess: 0.0,
        };
        for index in (0..segments.len()).rev() {
            if (schedule.interrupt)() {
                return Err(Unsettled);
            }
            let later = Later::from(segments, &forecasts, index);
            recursion.solve_segment(index, &later, query)?;
        }
        Ok(recursion)
    }

    /// The part of the similar solution that the next part is like.
    fn next_similar(&self) -> Option<&'a SolvedPart> {
        self.similar?.get(self.solved.len())
    }

    /// The largest number of cuts of the next segment.
    fn most_cuts(&self) -> usize {
        if self.overhangs {
            MOST_CUTS_BETWEEN
        } else {
            MOST_CUTS
        }
    }

    /// The value after the event of the next segment; None at expiry.
    pub fn later(&self) -> Option<&SegmentValue> {
        self.solved.last().map(|part| &part.value)
    }

    /// Solve a segment, the first of `later`, cut into parts where its boundary needs that.
    fn solve_segment(
        &mut self,
        index: usize,
        later: &Later,
        query: &mut BoundaryQuery,
    ) -> Result<(), Unsettled> {
        let (segment, here) = (&later.segments[0], &later.forecasts[0]);
        let overhang = segment.overhang();
        let goes_on = self.waits_for_cash && segment.dynamics.dividend < 0.0;
        if goes_on && segment.dynamics.rate <= 0.0 {
            return Err(Unsettled);
        }
        self.overhangs = overhang > OVERHANGING || goes_on;
        self.neglects_far_end = overhang > 0.0 && !self.overhangs;
        let mut waiting = vec![*segment];
        if self.overhangs {
            let mut least = segment.paid_out_below() + PAID_OUT;
            if goes_on {
                least = least.max(self.least_relevant);
            }
            let room = here.forward - LEAST_NEGLECTED * here.deviation() - least;
            let widest = WIDEST_BETWEEN.min(room / SPREADS_OF_PAID_OUT);
            let mut spread = segment.spread().min(widest);
            if spread < NARROWEST_BETWEEN.min(segment.spread()) {
                return Err(Unsettled);
            }
            let relevant = |spread: f64| least + SPREADS_OF_PAID_OUT * spread;
            let allowed = NEGLECTED_SHARE * self.tolerance;
            while allowed > 0.0
                && NARROWER * spread >= NARROWEST_BETWEEN
                && neglected(segment, here, relevant(spread)) > allowed
            {
                spread *= NARROWER;
            }
            self.least_relevant = relevant(spread);
            self.error
                .add(neglected(segment, here, self.least_relevant));
            if spread < segment.spread() {
                let share = spread / segment.spread();
                let (earlier, later) = segment.split(share * share * segment.duration);
                waiting = vec![earlier, later];
            }
        }
        if let Some(similar) = self.similar {
            waiting = split_alike(*segment, &similar[self.solved.len()..], index);
        }
        let mut cuts = 0;
        let mut part_end = *here;
        let mut offset = 0.0;
        while let Some(part) = waiting.pop() {
            if part.exercisable && part.is_two_sided() {
                return Err(Unsettled);
            }
            cuts = self.next_similar().map_or(cuts, |similar| similar.cuts);
            match self.solve_part((index, part), (later, part_end), cuts, query)? {
                Part::Solved { value, contact } => {
                    part_end = part_end.before(&part);
                    self.solved.push(SolvedPart {
                        index,
                        cuts,
                        beginning: part_end,
                        offset,
                        value: *value,
                        contact,
                    });
                    offset += part.duration;
                }
                Part::Cut(s) => {
                    cuts += 1;
                    let (earlier, later) = part.split(s);
                    waiting.extend([earlier, later]); // the later one needs panels of its own width
                }
            }
        }
        let waits = |now: &SegmentValue| now.boundary.is_none() || now.far.is_finite();
        self.waits_for_cash = self.overhangs && self.later().is_some_and(waits);
        Ok(())
    }

    /// Solve one part of a segment, the first of `later`; `part_end` is the forecast at the part's end.
    fn solve_part(
        &mut self,
        (index, part): (usize, Segment),
        (later, part_end): (&Later, Forecast),
        cuts: usize,
        query: &mut BoundaryQuery,
    ) -> Result<Part, Unsettled> {
        let here = &later.forecasts[0];
        let ends = self.interval(&part, later, &part_end);
        let ordinary = 2.0 * self.fineness.reach * self.deviation;
        self.excess += (ends.1 - ends.0 - ordinary).max(0.0) / part.spread();
        if self.excess > MOST_EXCESS {
            return Err(Unsettled);
        }
        let asked = if query.times.is_empty() {
            0.0
        } else {
            BOUNDARY_REACH * self.deviation
        };
        let reach = asked.max(RELEVANT * here.deviation());
        let furthest = self.furthest(&part, here, reach);
        let (mut transferred, relevant) = self.transfer(&part, ends, furthest)?;
        let found = self
            .onset_search(&transferred, &part, relevant, cuts > 0)
            .find()?;
        self.has_far_ends |= found.onsets.len() > 1;
        let boundary = if let Some(similar) = self.next_similar() {
            boundary_alike(&transferred.profile, &part, &found.onsets, similar)?
        } else {
            if found.split > 0.0 && cuts < self.most_cuts() {
                return Ok(Part::Cut(found.split));
            }
            if found.split > 0.0 && found.onsets.is_empty() {
                return Err(Unsettled);
            }
            let beginning = part_end.before(&part);
            let control = self.degree_control(index, &beginning, cuts);
            let first = found.onsets.first();
            let boundary =
                first.map(|_| find_boundary(&transferred.profile, &part, &found.onsets, &control));
            let cut_off = part.spread() * NEXT_TO_EVENT.sqrt();
            let may_cut = cuts < self.most_cuts() && ends.1 - ends.0 <= MOST_SPREADS * cut_off;
            let is_close = |b: &Boundary| b.is_found() && !b.exceeds_budget(&control);
            if may_cut && !boundary.as_ref().is_none_or(is_close) {
                let since = first.map_or(0.0, |onset| onset.time);
                let share = if since > 0.0 {
                    AFTER_ONSET
                } else {
                    NEXT_TO_EVENT
                };
                return Ok(Part::Cut(since + share * (part.duration - since)));
            }
            boundary
        };
        if let Some(boundary) = &boundary {
            self.violation = self.violation.max(boundary.violation);
            self.error.add(boundary.error);
        }
        let (contact, kinks) = (transferred.contact, std::mem::take(&mut transferred.kinks));
        let now = self.value_at_beginning(transferred, (part, relevant), boundary)?;
        if self.has_far_ends && !query.times.is_empty() {
            return Err(Unsettled); // a query knows one end
        }
        query.answer(self.end, contact, &now);
        self.end -= part.duration;
        self.kinks = now.kinks_from(&kinks);
        Ok(Part::Solved {
            value: Box::new(now),
            contact,
        })
    }

    /// The interval of x that matters at a segment's end: where the spot may be then and the value is not a line in it, and as
    /// far as a boundary may be.
    fn interval(&self, part: &Segment, later: &Later, part_end: &Forecast) -> Interval {
        let (reach, here) = (self.fineness.reach, &later.forecasts[0]);
        let near = reach * here.deviation();
        let (mut lower, mut upper) = (here.forward - near, here.forward + near);
        if self.exercised {
            let far = reach.min(BOUNDARY_REACH) * (self.deviation - here.deviation());
            (lower, upper) = (here.forward.min(0.0) - near, here.forward.max(0.0) + near);
            if part.sign > 0.0 {
                lower -= far;
            } else {
                upper += far;
            }
        }
        if part.sign > 0.0 {
            let least = self.fineness.smallest_spot.min(here.forward.exp());
            lower = lower.min(here.lowest(reach, least)).max(least.ln());
        }
        let held = reach + HELD_REACH;
        if let Some(furthest) = part_end.furthest_held(later, held) {
            let beyond_strike = RELEVANT * part.spread();
            if part.sign > 0.0 {
                upper = upper.min(furthest.max(beyond_strike));
            } else {
                lower = lower.max(furthest.min(-beyond_strike));
            }
        }
        (lower, upper)
    }

    /// The value at a part's end, with finer panels where its contact set begins at nodes, and the x beyond which that
    /// does not matter.
    fn transfer(
        &self,
        part: &Segment,
        ends: Interval,
        furthest: f64,
    ) -> Result<(Transferred, f64), Unsettled> {
        let mut widths = PanelWidths {
            spread: part.spread(),
            points: self.fineness.panel_points,
            largest: self.fineness.largest_panel,
            kink_factor: self.fineness.kink_factor,
        };
        let transfer = |widths: &PanelWidths| match self.later() {
            None => Ok(at_expiry(part)),
            Some(later) => before_event(later, part, &self.kinks, ends, widths),
        };
        let mut transferred = transfer(&widths)?;
        let relevant = self.relevant(&transferred, part, furthest);
        let search = self.onset_search(&transferred, part, relevant, false);
        if search.nodes_only && search.has_contact() {
            widths.largest = FINE_PANEL;
            transferred = transfer(&widths)?;
        }
        Ok((transferred, relevant))
    }

    /// The furthest x to the side of exercise at which a contact set matters, and boundaries are looked for.
    fn furthest(&self, part: &Segment, here: &Forecast, reach: f64) -> f64 {
        let sign = part.sign;
        let far = sign * ((sign * here.forward).min(0.0) - reach);
        if sign < 0.0 {
            return far;
        }
        far.min(here.lowest(RELEVANT, self.fineness.smallest_spot))
    }

    /// The x beyond which, on the side of exercise, the contact set does not matter while it begins.
    fn relevant(&self, transferred: &Transferred, part: &Segment, furthest: f64) -> f64 {
        let (sign, furthest) = (part.sign, part.sign * furthest);
        let sharp = transferred.kinks.iter().filter(|kink| kink.width <= 0.0);
        let seen = sharp
            .map(|kink| sign * kink.place)
            .filter(|&x| x > furthest);
        let kink = seen.reduce(f64::min).unwrap_or(0.0);
        let relevant = furthest.min(kink - RELEVANT * part.spread());
        if sign < 0.0 {
            return -relevant;
        }
        if self.overhangs {
            return furthest.max(self.least_relevant);
        }
        relevant.max(self.fineness.smallest_spot.ln())
    }

    fn onset_search<'b>(
        &self,
        transferred: &'b Transferred,
        part: &'b Segment,
        relevant: f64,
        is_cut: bool,
    ) -> OnsetSearch<'b> {
        OnsetSearch {
            profile: &transferred.profile,
            segment: part,
            contact: transferred.contact,
            far: transferred.far,
            overhangs: self.overhangs,
            relevant,
            nodes_only: self.later().is_some_and(|later| later.boundary.is_none()),
            is_cut,
        }
    }

    /// How far the degree of the next boundary is raised; `beginning` is the forecast at the part's beginning.
    fn degree_control(&self, index: usize, beginning: &Forecast, cuts: usize) -> DegreeControl {
        let tolerance = self.tolerance;
        let left = (1.0 - KEPT_SHARE) * tolerance - self.error.total();
        let share = SHARE * (FEW_SEGMENTS / ErrorTotal::of_equals(index + 1)).min(1.0);
        DegreeControl {
            last: if tolerance > 0.0 {
                LEVELS - 1
            } else {
                self.level
            },
            budget: (tolerance > 0.0).then(|| self.smallest_budget.max(share * left)),
            tolerance,
            patience: if cuts < self.most_cuts() {
                MOST_STALLS
            } else {
                LEVELS
            },
            violation_share: if self.neglects_far_end {
                OVERHANGING_SHARE
            } else {
                VIOLATION_SHARE
            },
            centre: beginning.forward,
            deviation: beginning.variance.max(0.0).sqrt(),
            displacement: DISPLACED_SHARE * beginning.paid,
        }
    }

    /// The value at the part's beginning, checked.
    fn value_at_beginning(
        &self,
        transferred: Transferred,
        (part, relevant): (Segment, f64),
        boundary: Option<Boundary>,
    ) -> Result<SegmentValue, Unsettled> {
        let mut at_zero = transferred.at_zero * (-part.dynamics.rate * part.duration).exp();
        if part.exercisable && part.sign > 0.0 {
            at_zero = at_zero.max(part.strike(part.duration));
        }
        let far = boundary.as_ref().and_then(Boundary::far);
        let far = far
            .map(|end| end.at_beginning)
            .filter(|&x| x > relevant + MARGIN * part.spread());
        let near = boundary.as_ref().map(|b| b.near().at_beginning);
        let is_reversed = |(far, near): (f64, f64)| part.sign * (near - far) <= 0.0;
        if far.zip(near).is_some_and(is_reversed) {
            return Err(Unsettled);
        }
        let later_is_monotone = self.later().is_none_or(|later| later.is_monotone);
        let now = SegmentValue {
            profile: transferred.profile,
            points: self.fineness.panel_points,
            segment: part,
            boundary,
            far: far.unwrap_or(-part.sign * f64::INFINITY),
            at_zero,
            is_monotone: part.dynamics.dividend >= 0.0 && later_is_monotone,
        };
        if let Some(boundary) = &now.boundary {
            if !boundary.is_found() {
                return Err(Unsettled);
            }
            check_outside(&now, boundary)?;
        }
        Ok(now)
    }
}

/// The most that it matters, in strikes, that a contact set which begins between two spots is taken to reach to a spot of zero
/// once it reaches to x = `least_relevant`, and that nothing is exercised at smaller spots before: times the probabilities of
/// such spots at any time of the segment, what waiting is worth there, and what it costs where the event takes the whole spot,
/// until interest earns more than the dividend.
fn neglected(segment: &Segment, here: &Forecast, least_relevant: f64) -> f64 {
    let below = |x: f64| AT_SOME_TIME * distribution((x - here.forward) / here.deviation());
    let dynamics = &segment.dynamics;
    let earned = (segment.amount + segment.escrow).ln_1p() / dynamics.rate;
    let h = segment.duration.min(earned);
    let gained = least_relevant.exp() * (-dynamics.dividend * h).exp_m1();
    let interest = -(-dynamics.rate * h).exp_m1();
    let taken = segment.paid_out_below().min(interest.ln());
    gained * below(least_relevant) + interest * below(taken)
}

/// The parts of a segment that `similar`, from its end on, was cut into, the last of them first.
fn split_alike(mut segment: Segment, similar: &[SolvedPart], index: usize) -> Vec<Segment> {
    let count = similar
        .iter()
        .take_while(|part| part.index == index)
        .count();
    let mut parts = Vec::with_capacity(count);
    for part in &similar[..count.saturating_sub(1)] {
        let (earlier, later) = segment.split(part.value.segment.duration);
        parts.push(later);
        segment = earlier;
    }
    parts.push(segment);
    parts.reverse();
    parts
}

/// The boundary of a part as that of a similar one was found; unsettled where it is not like that. None where only one of them
/// has a contact set, which then only just begins to matter.
fn boundary_alike(
    profile: &Profile,
    part: &Segment,
    onsets: &[ContactOnset],
    similar: &SolvedPart,
) -> Result<Option<Boundary>, Unsettled> {
    let Some(boundary) = similar
        .value
        .boundary
        .as_ref()
        .filter(|_| !onsets.is_empty())
    else {
        return Ok(None);
    };
    let found = solve_alike(profile, part, onsets, boundary);
    found.map(Some).ok_or(Unsettled)
}

/// Refuse a value of waiting that is less than the payoff outside the contact set: next to it, and where it has left.
fn check_outside(now: &SegmentValue, boundary: &Boundary) -> Result<(), Unsettled> {
    let (sign, spread) = (now.segment.sign, now.segment.spread());
    let near = boundary.near();
    let (onset, end) = (near.onset.place, near.at_beginning);
    let mut places = vec![end + sign * CHECKED * spread];
    places.extend(
        boundary
            .far()
            .map(|far| far.at_beginning - sign * CHECKED * spread),
    );
    if sign * (onset - end) > spread {
        places.extend([0.5 * (onset + end), onset]);
    }
    for x in places {
        if now.waiting(x)[0] - sign * (now.strike() - x.exp()) < -LARGEST_VIOLATION {
            return Err(Unsettled);
        }
    }
    Ok(())
}
