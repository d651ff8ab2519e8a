//! What a march leaves behind for the walk back.

use super::event::Kinks;
use super::line::Contact;
use crate::lanes::vector::LANES;

/// The values at every stage, and what every segment started from.
pub struct Record {
    /// V at the nodes, stage by stage.
    values: Vec<[f64; LANES]>,
    nodes: usize,
    /// At every stage how far the contact set reaches, in numbers of nodes; infinite where it was not asked.
    pub reach: Vec<[f64; LANES]>,
    /// By lane and by the segment's number.
    pub starts: Vec<Vec<Option<Start>>>,
}

/// What the first step of a segment started from.
pub struct Start {
    /// The value at the nodes just before what happens at the segment's end.
    pub values: Vec<f64>,
    pub kinks: Kinks,
    /// The value at the nodes just after it and its contact set; None at expiry.
    pub later: Option<(Vec<f64>, Contact)>,
}

impl Record {
    pub fn new(nodes: usize, segments: impl Iterator<Item = usize>) -> Self {
        Self {
            values: Vec::new(),
            nodes,
            reach: Vec::new(),
            starts: segments
                .map(|count| (0..count).map(|_| None).collect())
                .collect(),
        }
    }

    /// The size of the values of so many steps.
    pub const fn bytes(cells: usize, steps: usize) -> usize {
        3 * steps * (cells + 1) * size_of::<[f64; LANES]>()
    }

    /// Keep the values of one more stage.
    pub fn push(&mut self, values: &[[f64; LANES]], reach: [f64; LANES]) {
        self.values.extend_from_slice(values);
        self.reach.push(reach);
    }

    /// The values of a stage.
    pub fn stage(&self, number: usize) -> &[[f64; LANES]] {
        &self.values[number * self.nodes..][..self.nodes]
    }
}
