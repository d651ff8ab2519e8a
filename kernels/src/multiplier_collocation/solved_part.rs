//! A part of a segment that the recursion has solved.

use super::forecast::Forecast;
use super::segment_value::SegmentValue;

/// The largest distance from the forward at which a contact set matters, in standard deviations of ln S at its time;
/// chosen.
pub const RELEVANT: f64 = 5.0;

/// A solved part of a segment.
pub struct SolvedPart {
    /// The place of the segment in the schedule.
    pub index: usize,
    /// The number of cuts of the segment so far.
    pub cuts: usize,
    /// The forecast at the part's beginning.
    pub beginning: Forecast,
    /// The time from the part's end to that of its segment, years.
    pub offset: f64,
    pub value: SegmentValue,
    /// The end of the contact set at the part's end, x, infinite without one.
    pub contact: f64,
}

impl SolvedPart {
    /// The end of the contact set at the part's beginning, x, NaN without one where the spot may come.
    pub fn relevant_end(&self) -> f64 {
        let (end, beginning) = (self.value.boundary_now(), &self.beginning);
        let reach = RELEVANT * beginning.deviation().hypot(self.value.segment.spread());
        if (end - beginning.forward).abs() < reach {
            end
        } else {
            f64::NAN
        }
    }
}
