//! The boundary at times that are asked for.

use super::segment_value::SegmentValue;

/// The distance in time within which two times are the same, in years and as a share; chosen.
const SAME_TIME: f64 = 1e-12;

/// Times from now, in years, at which the boundary is wanted, and the answers ln(S*/K), NaN without one.
pub struct BoundaryQuery<'a> {
    pub times: &'a [f64],
    pub found: &'a mut [f64],
}

impl BoundaryQuery<'_> {
    /// Fill in the answers at the times that fall on the end of a segment, `end` years from now, where its contact set ends
    /// at `contact`, or inside the segment and on its beginning.
    pub fn answer(&mut self, end: f64, contact: f64, now: &SegmentValue) {
        let duration = now.segment.duration;
        for (time, found) in self.times.iter().zip(self.found.iter_mut()) {
            if (time - end).abs() <= SAME_TIME * end.max(1.0) {
                *found = if contact.is_finite() {
                    contact
                } else {
                    f64::NAN
                };
            } else if end - duration - SAME_TIME <= *time && *time < end {
                if let Some(boundary) = &now.boundary {
                    *found = boundary.at(&now.profile, (end - time).min(duration));
                }
            }
        }
    }
}
