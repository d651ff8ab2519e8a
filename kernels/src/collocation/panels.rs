//! Gauss panels on an interval of x, fine where the value is not smooth.

use super::tables::legendre;

const MOST_FEATURES: usize = 12;
/// Spreads of the stretch.
const SMALLEST_PANEL: f64 = 0.04;

/// A place where the value bends within `scale`.
#[derive(Clone, Copy, Debug)]
pub struct Feature {
    pub place: f64,
    pub scale: f64,
}

/// How wide panels may be.
#[derive(Clone, Copy)]
pub struct Fineness {
    /// sigma sqrt(h) of the stretch before.
    pub spread: f64,
    /// Gauss points of a panel.
    pub points: usize,
    /// Widest panel, in spreads.
    pub kernel: f64,
    /// Widest panel, in distances to a feature.
    pub feature: f64,
}

/// Middle and half the width of a panel.
#[derive(Clone, Copy, Debug)]
pub struct Panel {
    pub middle: f64,
    pub half: f64,
}

/// Append the interval's panels, halved until each is narrow enough, and their Gauss nodes and weights.
pub fn append_nodes(
    interval: (f64, f64),
    features: &[Feature],
    fineness: &Fineness,
    panels: &mut Vec<Panel>,
    nodes: &mut Vec<f64>,
    weights: &mut Vec<f64>,
) {
    let smallest = SMALLEST_PANEL * fineness.spread;
    let rule = legendre(fineness.points);
    let recent = &features[features.len().saturating_sub(MOST_FEATURES)..];
    let (mut a, stop) = interval;
    while a < stop {
        let mut width = fineness.kernel * fineness.spread;
        for feature in recent {
            let least = fineness.feature * feature.scale.max(smallest);
            let allowed = if feature.place > a {
                fineness.feature / (1.0 + fineness.feature) * (feature.place - a)
            } else {
                fineness.feature * (a - feature.place)
            };
            width = width.min(allowed.max(least));
        }
        // No crumb at the end.
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
}
