//! Gauss panels on an interval of x, fine where the value is not smooth.

use super::unsettled::Unsettled;
use crate::gauss_legendre::legendre;

/// The largest number of kinks that panels are fitted to, the newest ones; chosen: older ones are smooth by then.
const MOST_KINKS: usize = 12;
/// The smallest width of a kink, in standard deviations of ln S over the segment; chosen.
const SMALLEST_PANEL: f64 = 0.04;

/// The largest number of panels at one event, which take 15 MB: an interval that needs more is not worth its time. Chosen.
const MOST_PANELS: usize = 1 << 16;

/// An interval of x; its ends may be infinite.
pub type Interval = (f64, f64);

/// A place x where the value bends within `width`.
#[derive(Clone, Copy, Debug)]
pub struct Kink {
    pub place: f64,
    pub width: f64,
}

/// How wide panels may be.
#[derive(Clone, Copy)]
pub struct PanelWidths {
    /// The standard deviation of ln S over the segment before.
    pub spread: f64,
    /// The number of Gauss nodes of a panel.
    pub points: usize,
    /// The largest width of a panel, in spreads.
    pub largest: f64,
    /// The largest width of a panel, in distances from a kink.
    pub kink_factor: f64,
}

/// The middle of a panel and half its width, in x.
#[derive(Clone, Copy, Debug)]
pub struct Panel {
    pub middle: f64,
    pub half: f64,
}

/// Append the panels of an interval, each as wide as the kinks near it allow, and their Gauss nodes and weights; unsettled
/// where these are too many.
pub fn append_nodes(
    interval: Interval,
    kinks: &[Kink],
    widths: &PanelWidths,
    panels: &mut Vec<Panel>,
    nodes: &mut Vec<f64>,
    weights: &mut Vec<f64>,
) -> Result<(), Unsettled> {
    let smallest = SMALLEST_PANEL * widths.spread;
    let rule = legendre(widths.points);
    let recent = &kinks[kinks.len().saturating_sub(MOST_KINKS)..];
    let (mut a, stop) = interval;
    while a < stop {
        if panels.len() == MOST_PANELS {
            return Err(Unsettled);
        }
        let mut width = widths.largest * widths.spread;
        for kink in recent {
            let smallest_width = widths.kink_factor * kink.width.max(smallest);
            let allowed = if kink.place > a {
                widths.kink_factor / (1.0 + widths.kink_factor) * (kink.place - a)
            } else {
                widths.kink_factor * (a - kink.place)
            };
            width = width.min(allowed.max(smallest_width));
        }
        // The last two panels share what is left, so that none is tiny.
        let left = stop - a;
        if left <= width {
            width = left;
        } else if left < 2.0 * width {
            width = 0.5 * left;
        }
        let b = if width < left { a + width } else { stop };
        let (half, middle) = (0.5 * (b - a), 0.5 * (a + b));
        panels.push(Panel { middle, half });
        for (point, weight) in rule {
            nodes.push(middle + half * point);
            weights.push(half * weight);
        }
        a = b;
    }
    Ok(())
}
