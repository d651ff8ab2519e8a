//! How finely the value is held between the boundaries: the levels of `solve_schedules`.

use super::degree_control::DEGREES;

/// The number of levels, and of degrees of a boundary.
pub const LEVELS: usize = DEGREES.len();

/// One level.
#[derive(Clone, Copy)]
pub struct Fineness {
    /// The number of Gauss nodes of a panel.
    pub panel_points: usize,
    /// The largest width of a panel, in standard deviations of ln S over the segment before.
    pub largest_panel: f64,
    /// The largest width of a panel, in distances from a kink.
    pub kink_factor: f64,
    /// Half the width of the interval of x, in standard deviations of ln S at its time as seen from now.
    pub reach: f64,
    /// The smallest spot that matters to a put, in strikes: below it the value is a line in the spot.
    pub smallest_spot: f64,
}

const fn level(
    panel_points: usize,
    largest_panel: f64,
    kink_factor: f64,
    reach: f64,
    smallest_spot: f64,
) -> Fineness {
    Fineness {
        panel_points,
        largest_panel,
        kink_factor,
        reach,
        smallest_spot,
    }
}

/// The levels, from coarse to fine; calibrated on random contracts so that the value is as accurate as the degree of
/// `DEGREES` at the same place.
pub const FINENESS: [Fineness; LEVELS] = [
    level(5, 2.0, 1.5, 4.6, 1e-3),
    level(7, 2.2, 1.4, 4.9, 4e-4),
    level(8, 2.2, 1.3, 5.6, 5e-5),
    level(8, 1.6, 1.1, 6.4, 1e-5),
    level(10, 1.6, 1.1, 6.9, 2e-6),
    level(10, 1.4, 1.0, 7.3, 4e-7),
    level(12, 1.4, 1.0, 7.6, 1e-7),
];
