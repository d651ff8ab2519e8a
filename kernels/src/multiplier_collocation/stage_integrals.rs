//! The integrals over the contact sets as seen from every stage of a collocation, node by node.

use super::multiplier::{age_blocks, integrands, AgeBlock, Places};
use super::segment::Dynamics;
use crate::lanes::dispatch::{dispatch, Work};
use crate::lanes::normal::exp;
use crate::lanes::vector::{Vector, LANES};

/// The nodes of all stages, each a contact set that is seen from the place of its stage.
pub struct StageIntegrals {
    blocks: Vec<NodeBlock>,
}

#[derive(Clone, Copy)]
struct NodeBlock {
    ages: AgeBlock,
    /// The place of the stage.
    x: [f64; LANES],
    /// e^x.
    spot: [f64; LANES],
    /// Where the contact set ended.
    boundary: [f64; LANES],
    /// The columns of `NodeContribution`.
    found: [[f64; LANES]; 5],
}

/// What one node contributes, weighted: value, slope and second derivative, and the derivatives of value and slope by
/// the boundary of its contact set.
#[derive(Clone, Copy)]
pub struct NodeContribution {
    pub value: f64,
    pub by_x: f64,
    pub by_xx: f64,
    pub value_by_boundary: f64,
    pub slope_by_boundary: f64,
}

impl StageIntegrals {
    /// The integrals with nodes (age, weight), both in years.
    pub fn new(dynamics: &Dynamics, nodes: &[(f64, f64)]) -> Self {
        let blocks = age_blocks(dynamics, nodes)
            .into_iter()
            .map(|ages| NodeBlock {
                ages,
                x: [0.0; LANES],
                spot: [1.0; LANES],
                boundary: [0.0; LANES],
                found: [[0.0; LANES]; 5],
            });
        StageIntegrals {
            blocks: blocks.collect(),
        }
    }

    /// Put node `index`, whose contact set ended at `boundary`, where it is seen from x = ln(spot).
    pub fn place(&mut self, index: usize, x: f64, spot: f64, boundary: f64) {
        let (block, lane) = (&mut self.blocks[index / LANES], index % LANES);
        (block.x[lane], block.spot[lane]) = (x, spot);
        block.boundary[lane] = boundary;
    }

    /// Evaluate what all nodes contribute; to the value only if that is asked for.
    pub fn integrate(&mut self, sign: f64, dynamics: &Dynamics, with_value: bool) {
        dispatch(Integration {
            sign,
            dynamics,
            with_value,
            blocks: &mut self.blocks,
        });
    }

    /// What node `index` contributes.
    pub fn node(&self, index: usize) -> NodeContribution {
        let found = &self.blocks[index / LANES].found;
        let [value, by_x, by_xx, value_by_boundary, slope_by_boundary] =
            std::array::from_fn(|column| found[column][index % LANES]);
        NodeContribution {
            value,
            by_x,
            by_xx,
            value_by_boundary,
            slope_by_boundary,
        }
    }
}

struct Integration<'a> {
    sign: f64,
    dynamics: &'a Dynamics,
    with_value: bool,
    blocks: &'a mut [NodeBlock],
}

impl Work for Integration<'_> {
    type Result = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        for block in self.blocks {
            let boundary = V::from_lanes(block.boundary);
            let places = Places {
                x: V::from_lanes(block.x),
                spot: V::from_lanes(block.spot),
                boundary,
                boundary_spot: exp(boundary),
            };
            let found = integrands(
                self.sign,
                self.dynamics,
                &block.ages,
                &places,
                self.with_value,
            );
            block.found = [
                found.value.lanes(),
                found.by_x.lanes(),
                found.by_xx.lanes(),
                found.value_by_boundary.lanes(),
                found.slope_by_boundary.lanes(),
            ];
        }
    }
}
