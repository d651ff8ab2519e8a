//! The boundary of a segment: the degree of its polynomial is raised until the value's error estimate is small enough.

use super::boundary::{dot, Boundary};
use super::chebyshev::interpolation;
use super::collocation_nodes::{collocation_nodes, CollocationNodes};
use super::collocation_system::CollocationSystem;
use super::contact_onset::{ContactOnset, Representation};
use super::degree_control::{DegreeControl, CELLS, DEGREES};
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
struct ComparisonCells {
    /// The boundary of the first degree, NaN while unknown.
    origin: f64,
    probabilities: [f64; CELLS],
}

/// The boundary of the contact set with this onset; its residual says whether it was found. Where smooth pasting does not
/// find it, the equation of the value is tried.
pub fn find_boundary(
    profile: &Profile,
    segment: &Segment,
    onset: ContactOnset,
    control: &DegreeControl,
) -> Boundary {
    let found = solve_boundary(profile, segment, &onset, control);
    if found.is_found() || onset.representation == Representation::FromCrossing {
        return found;
    }
    let onset = ContactOnset::from_crossing(profile, segment, onset.time, onset.place);
    solve_boundary(profile, segment, &onset, control)
}

/// The boundary by the equation that belongs to its representation.
fn solve_boundary(
    profile: &Profile,
    segment: &Segment,
    onset: &ContactOnset,
    control: &DegreeControl,
) -> Boundary {
    let mut degree = 0;
    let mut last: Option<Boundary> = None;
    let mut cells = ComparisonCells {
        origin: f64::NAN,
        probabilities: [0.0; CELLS],
    };
    let (mut curvature, mut stalls) = (f64::INFINITY, 0);
    let least = control.enough(onset.representation);
    loop {
        let mut now = solve_degree(
            (profile, segment, onset),
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
        degree += 1;
    }
}

/// The boundary of one degree (a place in `DEGREES`), from the one before, without its error estimate.
fn solve_degree(
    (profile, segment, onset): (&Profile, &Segment, &ContactOnset),
    degree: usize,
    control: &DegreeControl,
    last: Option<&Boundary>,
    curvature: &mut f64,
) -> Boundary {
    let (m, points, value_points) = DEGREES[degree];
    let nodes = collocation_nodes(m, points);
    let mut system = CollocationSystem::new(profile, segment, onset, nodes);
    let mut coefficients = match last {
        None => system.guess(),
        Some(before) => refined(before, nodes, onset.first_coefficient()),
    };
    let is_start = degree < control.last && control.budget.is_none();
    let is_sketch = degree == 0
        && control.budget.is_some()
        && onset.representation != Representation::FromCrossing;
    let least = control.enough(onset.representation);
    let stopping = Stopping {
        settled: if is_start { COARSELY_SETTLED } else { SETTLED },
        enough: if is_sketch { SKETCH * least } else { least },
    };
    let residual = newton(&mut system, &mut coefficients, stopping, curvature);
    let (at_beginning, _) = system.stage_boundary(m - 1, coefficients[m]);
    let mut now = Boundary {
        segment: *segment,
        onset: *onset,
        nodes,
        contact_blocks: Vec::new(),
        coefficients,
        at_beginning,
        residual,
        enough: stopping.enough,
        exercise_values: [0.0; CELLS],
        violation: 0.0,
        error: 0.0,
        other: None,
    };
    if !is_start {
        now.sample_contact_sets(profile, collocation_nodes(m, value_points));
        now.violation = now.violation_inside(profile);
    }
    now
}

/// Fill in the error estimate of the value now: what is left of the change from one degree to the next, and of the
/// violation inside the contact set, at the segment's beginning, times the probability of being there.
fn estimate_error(
    now: &mut Boundary,
    last: Option<&Boundary>,
    control: &DegreeControl,
    cells: &mut ComparisonCells,
) {
    if cells.origin.is_nan() {
        cells.origin = now.at_beginning;
        cells.probabilities = control.probabilities(&now.segment, cells.origin);
    }
    now.sample_exercise_values(cells.origin);
    let near = cells.probabilities[..NEXT_CELLS].iter().sum::<f64>() * now.violation;
    now.error = change(now, last, &cells.probabilities) + control.violation_share * near;
}

/// The share that is left of the expected change of the value from one degree to the next, in strikes; without another
/// degree, all that exercise on this segment is worth.
fn change(now: &Boundary, before: Option<&Boundary>, probabilities: &[f64; CELLS]) -> f64 {
    if !(now.is_found() && before.is_none_or(Boundary::is_found)) {
        return f64::INFINITY;
    }
    let left = if before.is_none() { 1.0 } else { CHANGE_SHARE };
    let before = before.map_or([0.0; CELLS], |before| before.exercise_values);
    let changes = now.exercise_values.iter().zip(before);
    let change: f64 = changes
        .zip(probabilities)
        .map(|((now, before), probability)| (now - before).abs() * probability)
        .sum();
    left * change
}

/// The coefficients at the nodes of a higher degree.
fn refined(before: &Boundary, nodes: &CollocationNodes, first: f64) -> Vec<f64> {
    let mut weights = vec![0.0; before.coefficients.len()];
    let mut after: Vec<f64> = nodes
        .eta
        .iter()
        .map(|&eta| {
            interpolation(&before.nodes.eta, eta, &mut weights);
            dot(&weights, &before.coefficients)
        })
        .collect();
    after[0] = first;
    after
}
