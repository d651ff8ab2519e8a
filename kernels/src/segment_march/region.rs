//! The exercise region of a state, its ends placed inside their cells.

use super::Segment;

/// The region that contains nothing.
pub(super) const EMPTY: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

/// The lower and the upper end of the exercise region in s; infinite where it reaches the grid's end.
pub(super) fn region(segment: &Segment<'_>, slack: &[f64], contact: &[bool]) -> [f64; 2] {
    let first = contact.iter().position(|c| *c);
    let last = contact.iter().rposition(|c| *c);
    let (Some(first), Some(last)) = (first, last) else {
        return EMPTY;
    };
    let lower = if first == 0 {
        f64::NEG_INFINITY
    } else {
        let far = first.checked_sub(2);
        boundary(segment, |node| slack[node], first, first - 1, far)
    };
    let upper = if last + 1 == contact.len() {
        f64::INFINITY
    } else {
        let far = (last + 2 < contact.len()).then_some(last + 2);
        boundary(segment, |node| slack[node], last, last + 1, far)
    };
    [lower, upper]
}

/// The boundary between a contact node and the free node next to it.
///
/// A distance x inside the free side sqrt(2 (v - g)/J) is x + k x^2; two free nodes give k and x.
pub(super) fn boundary(
    segment: &Segment<'_>,
    slack: impl Fn(usize) -> f64,
    contact: usize,
    near: usize,
    far: Option<usize>,
) -> f64 {
    let place = |node: usize| segment.nodes[node + 1];
    let curvature = segment.curvature(contact);
    let Some(far) = far.filter(|_| curvature > 0.0) else {
        return place(contact);
    };
    let root = |node: usize| (2.0 * slack(node).max(0.0) / curvature).sqrt();
    let (first, second) = (root(near), root(far));
    let d = (place(far) - place(near)).abs();
    // k = (first - x)/x^2 = (second - x - d)/(x + d)^2
    let (a, b) = (second + d - first, d * (2.0 * first - d));
    if a <= 0.0 {
        return place(contact);
    }
    let x = (b + (b * b + 4.0 * a * first * d * d).max(0.0).sqrt()) / (2.0 * a);
    let inside = place(contact) - place(near);
    place(near) + inside.signum() * x.min(inside.abs())
}
