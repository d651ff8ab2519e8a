//! A local volatility, given at nodes of the time and of the spot.

/// At each of the times a monotone cubic in ln S, in between the square is linear in time; flat outside the nodes.
#[derive(Clone, Debug)]
pub struct Surface {
    /// Years from now, increasing.
    pub times: Vec<f64>,
    /// ln of the spots, increasing.
    pub logs: Vec<f64>,
    /// The volatilities, by time and then by spot.
    pub values: Vec<f64>,
    /// Their slopes by ln S.
    pub slopes: Vec<f64>,
}

/// Where a time lies: the times before and behind it, and its share of the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Moment {
    pub before: usize,
    pub behind: usize,
    pub share: f64,
}

impl Surface {
    /// Where a time lies among those of the surface.
    pub(super) fn moment(&self, time: f64) -> Moment {
        let behind = self.times.partition_point(|known| *known <= time);
        let last = self.times.len() - 1;
        if behind == 0 || behind > last {
            let at = behind.min(last);
            return Moment {
                before: at,
                behind: at,
                share: 0.0,
            };
        }
        let before = behind - 1;
        Moment {
            before,
            behind,
            share: (time - self.times[before]) / (self.times[behind] - self.times[before]),
        }
    }

    /// The volatility at one of the times.
    pub(super) fn at_time(&self, number: usize, log: f64) -> f64 {
        let (count, x) = (self.logs.len(), &self.logs);
        let values = &self.values[number * count..][..count];
        let slopes = &self.slopes[number * count..][..count];
        if log <= x[0] {
            return values[0];
        }
        if log >= x[count - 1] {
            return values[count - 1];
        }
        let k = x.partition_point(|known| *known <= log) - 1;
        let h = x[k + 1] - x[k];
        let u = (log - x[k]) / h;
        let (low, high) = (values[k], values[k + 1]);
        let cubic = low
            + u * u * (3.0 - 2.0 * u) * (high - low)
            + u * (1.0 - u) * h * ((1.0 - u) * slopes[k] - u * slopes[k + 1]);
        cubic.clamp(low.min(high), low.max(high))
    }
}

/// The surface of a contract.
#[derive(Clone, Copy, Debug)]
pub struct Local<'a> {
    /// The volatility at its spots.
    pub surface: &'a Surface,
    /// ln of the strike, in the money of the surface's spots.
    pub log_strike: f64,
    /// The number that stands for it in the segments: what a segment's volatility exceeds that by is added.
    pub reference: f64,
}

impl Local<'_> {
    /// The volatility at one of the surface's times and at x, given that of the segment.
    pub(super) fn at_time(&self, number: usize, x: f64, of_segment: f64) -> f64 {
        self.surface.at_time(number, x + self.log_strike) + of_segment - self.reference
    }
}

#[cfg(test)]
mod tests {
    use super::Surface;

    /// At its nodes it is what was given, in between it does not leave the neighbours' range, outside it is flat.
    #[test]
    fn a_surface_goes_through_its_nodes() {
        let surface = Surface {
            times: vec![0.5, 1.0],
            logs: vec![-0.2, 0.0, 0.3],
            values: vec![0.3, 0.2, 0.25, 0.4, 0.3, 0.2],
            slopes: vec![-0.7, 0.0, 0.2, -0.6, -0.4, -0.3],
        };
        for (number, row) in surface.values.chunks(3).enumerate() {
            for (log, value) in surface.logs.iter().zip(row) {
                assert!((surface.at_time(number, *log) - value).abs() < 1e-15);
            }
            assert!(surface.at_time(number, 9.0).total_cmp(&row[2]).is_eq());
            assert!((0.2..=0.4).contains(&surface.at_time(number, 0.1)));
        }
        let at = surface.moment(0.6);
        assert!(at.before == 0 && at.behind == 1 && (at.share - 0.2).abs() < 1e-15);
        assert!(surface.moment(0.1).behind == 0 && surface.moment(2.0).before == 1);
    }
}
