//! The exercise boundary inside a cell: what makes the error of a stage regular wherever the boundary lies.
//!
//! Next to the boundary b the slack is the parabola J (x - b)^2/2 on the free side. The stencil of the last
//! free node m reads z = 0 at the first contact node, a distance d away, where the continuation of the
//! parabola is J d^2 (1 - theta)^2/2, theta = (b - x)/d at the node m: its row lacks h l times that, l the
//! stencil's entry. Adding it, z = z0 + J d^2/2 c (1 - theta)^2 with c = h l times the diagonal entry of
//! M^-1 must be J d^2/2 theta^2 at m: a quadratic equation for theta.

use super::elimination::{Bands, Factors};
use super::free_system::FreeSystem;
use super::Segment;
use crate::error::KernelError;
use crate::positive_part;

/// The largest number of contact sets that are tried; they settle in one or two.
pub(super) const PASSES: u32 = 4;

/// An end of a run of contact nodes: the last free node, and the contact node next to it.
#[derive(Clone, Copy)]
pub(super) struct Edge {
    pub free: usize,
    pub contact: usize,
}

/// A boundary between two nodes, theta of their distance away from the free one.
#[derive(Clone, Copy)]
pub(super) struct Placed {
    pub free: usize,
    pub contact: usize,
    pub theta: f64,
}

/// A state with its boundaries placed, and the buffers for it.
pub(super) struct Correction {
    pub slack: Vec<f64>,
    pub w: Vec<f64>,
    pub contact: Vec<bool>,
    pub placed: Vec<Placed>,
    edges: Vec<Edge>,
    lower_edges: Vec<Edge>,
    /// Rows, and what they lack.
    lifts: Vec<(usize, f64)>,
    /// Nodes that change sides, and whether to contact.
    moves: Vec<(usize, bool)>,
    free_system: FreeSystem,
}

impl Correction {
    pub fn new(size: usize) -> Self {
        Self {
            slack: vec![0.0; size],
            w: vec![0.0; size],
            contact: vec![false; size],
            placed: Vec::new(),
            edges: Vec::new(),
            lower_edges: Vec::new(),
            lifts: Vec::new(),
            moves: Vec::new(),
            free_system: FreeSystem::new(size),
        }
    }

    /// Write slack and contact set; take off q what the rows next to a boundary lack.
    ///
    /// `solved` is the slack, where elimination found it and the contact set. False, and q as it was, where the
    /// contact set does not settle.
    pub fn settle(
        &mut self,
        segment: &Segment<'_>,
        bands: &Bands,
        factors: &Factors,
        q: &mut [f64],
        contact: &[bool],
        mut solved: Option<&[f64]>,
    ) -> Result<bool, KernelError> {
        self.contact.copy_from_slice(contact);
        for _ in 0..PASSES {
            self.find_edges(segment);
            self.free_system.solve(
                bands,
                factors,
                q,
                &self.contact,
                solved.take(),
                &mut self.slack,
            )?;
            if self.place_all(segment, bands, factors) {
                continue;
            }
            for &(row, missing) in &self.lifts {
                q[row] -= missing;
            }
            for z in &mut self.slack {
                *z = positive_part(*z);
            }
            return Ok(true);
        }
        Ok(false)
    }

    /// Find the ends of the exercise region at which holding costs something: upper ends, then lower ends.
    fn find_edges(&mut self, segment: &Segment<'_>) {
        self.edges.clear();
        let contact = &self.contact;
        let last = contact.len() - 1;
        let counts = |edge: &Edge| {
            let alone = edge.free > 0
                && edge.free < last
                && contact[edge.free - 1]
                && contact[edge.free + 1];
            !alone && segment.curvature(edge.contact) > 0.0
        };
        for (k, pair) in contact.windows(2).enumerate() {
            let (edges, edge) = match (pair[0], pair[1]) {
                (true, false) => (&mut self.edges, [k + 1, k]),
                (false, true) => (&mut self.lower_edges, [k, k + 1]),
                _ => continue,
            };
            let [free, contact] = edge;
            let edge = Edge { free, contact };
            if counts(&edge) {
                edges.push(edge);
            }
        }
        self.edges.append(&mut self.lower_edges);
    }

    /// Place the boundary at every edge; return whether that changed the contact set instead.
    fn place_all(&mut self, segment: &Segment<'_>, bands: &Bands, factors: &Factors) -> bool {
        self.lifts.clear();
        self.placed.clear();
        self.moves.clear();
        for index in 0..self.edges.len() {
            let edge = self.edges[index];
            let response = self
                .free_system
                .respond(bands, factors, &self.contact, edge.free);
            let (theta, missing) = place(segment, bands.h, edge, self.slack[edge.free], response);
            if theta > 1.0 {
                self.moves.push((edge.contact, false));
            } else if theta < 0.0 {
                self.moves.push((edge.free, true));
            } else {
                self.free_system.add(missing, &mut self.slack);
                self.lifts.push((edge.free, missing));
                let Edge { free, contact } = edge;
                self.placed.push(Placed {
                    free,
                    contact,
                    theta,
                });
            }
        }
        for &(node, contact) in &self.moves {
            self.contact[node] = contact;
        }
        !self.moves.is_empty()
    }
}

/// Return theta, and what the free node's row lacks.
pub(super) fn place(
    segment: &Segment<'_>,
    h: f64,
    edge: Edge,
    z: f64,
    response: f64,
) -> (f64, f64) {
    let entry = if edge.contact < edge.free {
        segment.lower[edge.free]
    } else {
        segment.upper[edge.free]
    };
    let d = segment.nodes[edge.contact + 1] - segment.nodes[edge.free + 1];
    let full = 0.5 * segment.curvature(edge.contact) * (d * d);
    let c = h * entry * response;
    let relative = z / full;
    // (1 - c) theta^2 + 2 c theta - (c + relative) = 0
    let discriminant = c * c + (1.0 - c) * (c + relative);
    if relative < -c || discriminant < 0.0 {
        return (-1.0, 0.0);
    }
    let theta = (c + relative) / (c + discriminant.sqrt());
    let rest = 1.0 - theta;
    (theta, h * entry * full * (rest * rest))
}
