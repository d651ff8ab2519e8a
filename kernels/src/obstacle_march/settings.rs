//! The numbers of the march, in one place.

/// What the march can be told to do otherwise.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Cells of the coarsest grid over its width.
    pub cells: usize,
    /// Half the width of the grid in standard deviations.
    pub width: f64,
    /// Steps for each standard deviation of a segment and cell.
    pub steps: f64,
    /// By which the steps may be more when their number is rounded.
    pub rounded: f64,
    /// The fewest steps of a segment over the cells, for who asks what happens between its ends.
    pub fewest: f64,
}

/// Numbers for tests; those of the library are its own, and handed over.
#[cfg(test)]
impl Default for Settings {
    fn default() -> Self {
        Self {
            cells: 32,
            width: 5.5,
            steps: 1.4,
            rounded: 1.07,
            fewest: 0.0,
        }
    }
}
