//! A profile's nodes replaced by far fewer numbers: one polynomial for each panel.
//!
//! The part of a panel in the Gaussian integral is the sum of f n(z + t) over its nodes, z being its middle and t their
//! distances from it, in standard deviations. It is n(z) times a polynomial in z, for
//! `n(z + t) = n(z) sum_k (-t)^k He_k(z)/k!`.

use std::sync::OnceLock;

use super::panels::Panel;
use super::profile::Profile;
use crate::gauss_legendre::legendre;
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::vector::{Vector, LANES};

/// The number of terms of the widest panel, which has half a width of one standard deviation; derived from `LEFT_OUT`.
const TERMS: usize = 24;
/// The largest part that the series leaves out, as a share of the value: 1/sqrt(24!).
const LEFT_OUT: f64 = 2e-12;

/// One panel and its polynomial in z.
pub struct PanelPolynomial<'a> {
    pub panel: Panel,
    /// The coefficients, lowest power first, an even number of them, `LANES` numbers apart.
    pub coefficients: &'a [f64],
    pub terms: usize,
}

/// The polynomials of all panels of a profile.
pub struct PanelPolynomials<'a> {
    panels: &'a [Panel],
    /// The number of coefficients of each panel.
    terms: Vec<usize>,
    /// The coefficients of sixteen panels side by side, (panels/16, `TERMS`, 16).
    coefficients: Vec<f64>,
}

impl<'a> PanelPolynomials<'a> {
    /// The polynomials of a profile with `points` nodes in each panel, for a standard deviation `spread` of ln S.
    pub fn new(profile: &'a Profile, points: usize, spread: f64) -> Self {
        let panels = profile.panels.as_slice();
        let inverse = 1.0 / spread;
        let mut polynomials = PanelPolynomials {
            panels,
            terms: panels
                .iter()
                .map(|panel| terms(panel.half * inverse))
                .collect(),
            coefficients: vec![0.0; panels.len().div_ceil(LANES) * TERMS * LANES],
        };
        dispatch(Expansion {
            profile,
            points,
            inverse,
            polynomials: &mut polynomials,
        });
        polynomials
    }

    /// All of them, in the order of the panels.
    pub fn iter(&self) -> impl Iterator<Item = PanelPolynomial<'_>> {
        self.panels
            .iter()
            .zip(&self.terms)
            .enumerate()
            .map(|(k, (panel, terms))| PanelPolynomial {
                panel: *panel,
                coefficients: &self.coefficients[k / LANES * TERMS * LANES + k % LANES..],
                terms: *terms,
            })
    }
}

/// The number of terms that a panel needs, by half its width t in standard deviations: t^n/sqrt(n!) bounds the n-th.
#[allow(clippy::cast_precision_loss)]
fn terms(half: f64) -> usize {
    let (mut count, mut term) = (0, 1.0);
    while term > LEFT_OUT && count < TERMS {
        term *= half * half / (((count + 1) * (count + 2)) as f64).sqrt();
        count += 2;
    }
    count
}

struct Expansion<'a, 'b> {
    profile: &'a Profile,
    points: usize,
    inverse: f64,
    polynomials: &'b mut PanelPolynomials<'a>,
}

impl Work for Expansion<'_, '_> {
    type Result = ();

    #[inline(always)]
    #[allow(clippy::cast_precision_loss)]
    fn run<V: Vector>(self) {
        let points = self.points;
        let hermite = hermite();
        let groups = self.polynomials.coefficients.chunks_mut(TERMS * LANES);
        for (group, out) in groups.enumerate() {
            let panels = group * LANES..((group + 1) * LANES).min(self.polynomials.panels.len());
            let terms = self.polynomials.terms[panels.clone()]
                .iter()
                .copied()
                .max()
                .unwrap_or(0);
            let mut half = [0.0; LANES];
            for (half, panel) in half
                .iter_mut()
                .zip(&self.polynomials.panels[panels.clone()])
            {
                *half = -panel.half * self.inverse;
            }
            let half = V::from_lanes(half);
            // (-1)^k/k! sum_j w_j t_j^k
            let mut moments = [V::zero(); TERMS];
            for (j, (point, _)) in legendre(points).iter().enumerate() {
                let mut weighted = [0.0; LANES];
                for (weighted, panel) in weighted.iter_mut().zip(panels.clone()) {
                    *weighted = self.profile.weighted_panel(panel, points)[j];
                }
                let t = half.times(*point);
                let mut term = V::from_lanes(weighted);
                for (k, moment) in moments[..terms].iter_mut().enumerate() {
                    *moment = *moment + term;
                    term = term * t.times(1.0 / (k + 1) as f64);
                }
            }
            for (power, out) in out.chunks_mut(LANES).enumerate().take(terms) {
                let mut total = V::zero();
                for k in (power..terms).step_by(2) {
                    total = moments[k].times_plus(V::all(hermite[k][power]), total);
                }
                out.copy_from_slice(&total.lanes());
            }
        }
    }
}

/// The coefficients of the Hermite polynomials, lowest power first: `He_{k+1} = z He_k - k He_{k-1}`.
#[allow(clippy::cast_precision_loss)]
fn hermite() -> &'static [[f64; TERMS]; TERMS] {
    static TABLE: OnceLock<[[f64; TERMS]; TERMS]> = OnceLock::new();
    TABLE.get_or_init(|| {
        let mut table = [[0.0; TERMS]; TERMS];
        table[0][0] = 1.0;
        table[1][1] = 1.0;
        for k in 1..TERMS - 1 {
            for power in 0..TERMS {
                let raised = if power > 0 { table[k][power - 1] } else { 0.0 };
                table[k + 1][power] = raised - k as f64 * table[k - 1][power];
            }
        }
        table
    })
}
