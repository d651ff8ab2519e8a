//! The boundary of a segment: the degree of its polynomial is raised until the value's error estimate is small enough.

use super::boundary::{dot, Boundary, BoundaryEnd, FACTORS};
use super::chebyshev::interpolation;
use super::collocation_nodes::{collocation_nodes, CollocationNodes};
use super::collocation_system::CollocationSystem;
use super::contact_onset::ContactOnset;
use super::degree_control::{DegreeControl, CELLS, DEGREES, SMALLEST_RESIDUAL};
use super::newton::{newton, Stopping};
use super::profile::Profile;
use super::segment::Segment;

/// The largest last step of Newton's method, in x; chosen: the method doubles the digits once more.
const SETTLED: f64 = 1e-6;
/// The same for a degree that is only a start for the next one; chosen.
const COARSELY_SETTLED: f64 = 1e-4;
/// The residual that is small enough on the first degree, over that of the others: the first is hardly ever the last, and
/// the next begins from there. Chosen.
const SKETCH: f64 = 20.0;
/// The number of cells next to the boundary whose probability multiplies the violation inside the contact set; chosen.
const NEXT_CELLS: usize = 4;
/// The share of the change from one degree to the next that is left as error; calibrated on random contracts: each degree
/// gains a factor of nearly three at least.
const CHANGE_SHARE: f64 = 0.6;
/// The largest share of the last error that a degree may leave if it is to count as a gain; chosen.
const GAIN: f64 = 0.7;
/// The number of budgets below which any error counts as a gain; chosen.
const WITHIN_REACH: f64 = 10.0;

/// The cells next to the boundary in which two degrees are compared, at the segment's beginning.
#[derive(Default)]
struct ComparisonCells {
    /// The ends of the first degree, none while unknown.
    origins: Vec<f64>,
    probabilities: Vec<f64>,
}

/// The boundary of the contact set whose ends have these onsets; its residual says whether it was found. Where smooth
/// pasting does not find it, the equation of the value is tried.
pub fn find_boundary(
    profile: &Profile,
    segment: &Segment,
    onsets: &[ContactOnset],
    control: &DegreeControl,
) -> Boundary {
    let found = solve_boundary(profile, segment, onsets, control);
    if found.is_found() || onsets[0].is_from_crossing() {
        return found;
    }
    let mut onsets = onsets.to_vec();
    onsets[0] = value_onset(profile, segment, &onsets[0]);
    solve_boundary(profile, segment, &onsets, control)
}

/// The residual that is small enough for all ends, in strikes.
fn enough(onsets: &[ContactOnset], control: &DegreeControl) -> f64 {
    let each = onsets
        .iter()
        .map(|onset| control.enough(onset.representation));
    each.fold(f64::INFINITY, f64::min)
}

/// The boundary by the equation that belongs to its representation.
fn solve_boundary(
    profile: &Profile,
    segment: &Segment,
    onsets: &[ContactOnset],
    control: &DegreeControl,
) -> Boundary {
    // Without a budget the lower degrees are only the way to the last one: every other of them is enough.
    let stride = if control.budget.is_some() { 1 } else { 2 };
    let mut degree = control.last % stride;
    let mut last: Option<Boundary> = None;
    let mut cells = ComparisonCells::default();
    let (mut curvature, mut stalls) = (f64::INFINITY, 0);
    let least = enough(onsets, control);
    loop {
        let mut now = solve_degree(
            (profile, segment, onsets),
            degree,
            control,
            last.as_ref(),
            &mut curvature,
        );
        if let Some(budget) = control.budget {
            estimate_error(&mut now, last.as_ref(), control, &mut cells);
            if now.residual <= least && !now.exceeds_budget(control) {
                now.other = last.map(Box::new);
                return now;
            }
            if let Some(before) = &last {
                let gains = now.error < (GAIN * before.error).max(WITHIN_REACH * budget);
                stalls = if gains { 0 } else { stalls + 1 };
            }
        }
        // Where a degree fails or brings nothing, the one before stays.
        let mut other = last.take();
        if let Some(before) = &mut other {
            let is_better = before.residual <= least && before.error <= now.error;
            if control.budget.is_some() && is_better {
                std::mem::swap(before, &mut now);
            }
            before.other = None;
        }
        let mut kept = now;
        if control.budget.is_some() {
            kept.other = other.map(Box::new);
        }
        if degree >= control.last || stalls == control.patience {
            return kept;
        }
        last = Some(kept);
        degree += stride;
    }
}

/// The boundary of one degree (a place in `DEGREES`), from the one before, without its error estimate.
fn solve_degree(
    (profile, segment, onsets): (&Profile, &Segment, &[ContactOnset]),
    degree: usize,
    control: &DegreeControl,
    last: Option<&Boundary>,
    curvature: &mut f64,
) -> Boundary {
    let (m, points, _) = DEGREES[degree];
    let nodes = collocation_nodes(m, points);
    let start = last.map(|before| {
        let ends = before.ends.iter();
        ends.flat_map(|end| refined(end, before.nodes, nodes))
            .collect()
    });
    let is_start = degree < control.last && control.budget.is_none();
    let is_sketch = degree == 0
        && control.budget.is_some()
        && !onsets.iter().any(ContactOnset::is_from_crossing);
    let least = enough(onsets, control);
    let stopping = Stopping {
        settled: if is_start { COARSELY_SETTLED } else { SETTLED },
        enough: if is_sketch { SKETCH * least } else { least },
    };
    let mut now = solve_equations(
        (profile, segment, onsets),
        nodes,
        start,
        stopping,
        curvature,
    );
    if !is_start {
        now.sample_contact_sets(profile);
        now.violation = now.violation_inside(profile);
    }
    now
}

/// The boundary at these nodes from coefficients to start from, without what is sampled of it.
fn solve_equations(
    (profile, segment, onsets): (&Profile, &Segment, &[ContactOnset]),
    nodes: &'static CollocationNodes,
    start: Option<Vec<f64>>,
    stopping: Stopping,
    curvature: &mut f64,
) -> Boundary {
    let m = nodes.degree;
    let mut system = CollocationSystem::new(profile, segment, onsets, nodes);
    let mut coefficients = start.unwrap_or_else(|| system.guess());
    let residual = newton(&mut system, &mut coefficients, stopping, curvature);
    let each = onsets.iter().zip(coefficients.chunks(m + 1)).enumerate();
    let ends = each.map(|(end, (onset, coefficients))| BoundaryEnd {
        onset: *onset,
        coefficients: coefficients.to_vec(),
        at_beginning: system.stage_boundary(end, m - 1, coefficients[m]).0,
    });
    Boundary {
        segment: *segment,
        ends: ends.collect(),
        nodes,
        contact_blocks: Vec::new(),
        residual,
        enough: stopping.enough,
        exercise_values: Vec::new(),
        violation: 0.0,
        error: 0.0,
        other: None,
    }
}

/// The boundary of a contact set with these onsets by the equations that gave a `similar` one, from its solution; None where
/// the contact set begins otherwise.
pub fn solve_alike(
    profile: &Profile,
    segment: &Segment,
    onsets: &[ContactOnset],
    similar: &Boundary,
) -> Option<Boundary> {
    let mut onsets = onsets.to_vec();
    for (onset, end) in onsets.iter_mut().zip(&similar.ends) {
        if onset.is_from_crossing() {
            continue;
        }
        if end.onset.is_from_crossing() {
            *onset = value_onset(profile, segment, onset);
        } else {
            // A small change may turn a boundary that begins smoothly into one that begins like a root.
            onset.representation = end.onset.representation;
        }
    }
    let representations = similar.ends.iter().map(|end| end.onset.representation);
    if !representations.eq(onsets.iter().map(|onset| onset.representation)) {
        return None;
    }
    let nodes = similar.nodes;
    let start = similar.ends.iter().zip(&onsets).flat_map(|(end, onset)| {
        let stages = end.coefficients[1..].iter().copied();
        std::iter::once(onset.first_coefficient()).chain(stages)
    });
    let stopping = Stopping {
        settled: SETTLED,
        enough: SMALLEST_RESIDUAL,
    };
    let mut curvature = f64::INFINITY;
    let mut found = solve_equations(
        (profile, segment, &onsets),
        nodes,
        Some(start.collect()),
        stopping,
        &mut curvature,
    );
    found.enough = similar.enough;
    found.sample_contact_sets(profile);
    found.is_found().then_some(found)
}

/// The onset measured from the payoff crossing, so that the equation is that of the value.
fn value_onset(profile: &Profile, segment: &Segment, onset: &ContactOnset) -> ContactOnset {
    ContactOnset::from_crossing(profile, segment, segment.sign, (onset.time, onset.place))
}

/// Fill in the error estimate of the value now: what is left of the change from one degree to the next, and of the
/// violation inside the contact set, at the segment's beginning, times the probability of being there.
fn estimate_error(
    now: &mut Boundary,
    last: Option<&Boundary>,
    control: &DegreeControl,
    cells: &mut ComparisonCells,
) {
    if cells.origins.is_empty() {
        cells.origins = now.ends.iter().map(|end| end.at_beginning).collect();
        let (segment, origins) = (&now.segment, cells.origins.iter().zip(FACTORS));
        cells.probabilities = origins
            .flat_map(|(&origin, factor)| {
                control.probabilities(segment, factor * segment.sign, origin)
            })
            .collect();
    }
    now.sample_exercise_values(&cells.origins);
    let near = cells.probabilities[..NEXT_CELLS].iter().sum::<f64>() * now.violation;
    now.error = change(now, last, &cells.probabilities) + control.violation_share * near;
}

/// The share that is left of the expected change of the value from one degree to the next, in strikes; without another
/// degree, all that exercise on this segment is worth.
fn change(now: &Boundary, before: Option<&Boundary>, probabilities: &[f64]) -> f64 {
    if !(now.is_found() && before.is_none_or(Boundary::is_found)) {
        return f64::INFINITY;
    }
    let left = if before.is_none() { 1.0 } else { CHANGE_SHARE };
    let nothing = [0.0; 2 * CELLS];
    let before = before.map_or(&nothing[..], |before| &before.exercise_values);
    let changes = now.exercise_values.iter().zip(before);
    let change: f64 = changes
        .zip(probabilities)
        .map(|((now, before), probability)| (now - before).abs() * probability)
        .sum();
    left * change
}

/// The coefficients of an end at the nodes of a higher degree than that of `from`.
fn refined(end: &BoundaryEnd, from: &CollocationNodes, nodes: &CollocationNodes) -> Vec<f64> {
    let mut weights = vec![0.0; end.coefficients.len()];
    let mut after: Vec<f64> = nodes
        .eta
        .iter()
        .map(|&eta| {
            interpolation(&from.eta, eta, &mut weights);
            dot(&weights, &end.coefficients)
        })
        .collect();
    after[0] = end.onset.first_coefficient();
    after
}
