//! What a march leaves behind for the walk back.

use std::any::Any;
use std::cell::RefCell;

use super::event::Kinks;
use super::line::Contact;
use crate::lanes::vector::{Vector, LANES};

/// The largest array that a thread keeps for its next march, bytes: that of one contract to a usual tolerance. To get a
/// fresh one from the system each time takes a sixth of the time of such a march and its walk.
const LARGEST_KEPT: usize = 1 << 22;

thread_local! {
    static KEPT: RefCell<Vec<Box<dyn Any>>> = const { RefCell::new(Vec::new()) };
}

/// An empty array with room for so many numbers, one that was kept where there is one.
fn array<V: 'static>(count: usize) -> Vec<V> {
    let kept = KEPT.with_borrow_mut(|kept| {
        let at = kept.iter().position(|one| one.is::<Vec<V>>())?;
        kept.swap_remove(at).downcast::<Vec<V>>().ok()
    });
    let mut array = kept.map_or_else(Vec::new, |array| *array);
    array.reserve_exact(count);
    array
}

/// Keep an array that is done with.
fn keep<V: 'static>(mut array: Vec<V>) {
    if array.capacity() * size_of::<V>() <= LARGEST_KEPT {
        array.clear();
        KEPT.with_borrow_mut(|kept| kept.push(Box::new(array)));
    }
}

/// The values at every stage, the rates at the start of every step, and what every segment started from.
pub struct Record<V: 'static> {
    /// V at the nodes, stage by stage.
    values: Vec<V>,
    /// The rates at the nodes, step by step.
    rates: Vec<V>,
    nodes: usize,
    /// At every stage how far the contact set reaches, in numbers of nodes; infinite where it was not asked.
    pub reach: Vec<[f64; LANES]>,
    /// At every step the first inner node of each lane that was looked at; before it the rates at the start were 0.
    pub first: Vec<[usize; LANES]>,
    /// By lane and by the segment's number.
    pub starts: Vec<Vec<Option<Start>>>,
}

/// What the first step of a segment started from.
pub struct Start {
    /// The value at the nodes just before what happens at the segment's end.
    pub values: Vec<f64>,
    /// What takes its place in the first step, see `start`.
    pub begun: Vec<f64>,
    pub kinks: Kinks,
    /// The value at the nodes just after it and its contact set; None at expiry.
    pub later: Option<(Vec<f64>, Contact)>,
}

impl<V: Vector> Record<V> {
    /// Room for so many steps.
    pub fn new(nodes: usize, steps: usize, segments: impl Iterator<Item = usize>) -> Self {
        Self {
            values: array(3 * steps * nodes),
            rates: array(steps * nodes),
            nodes,
            reach: Vec::new(),
            first: Vec::new(),
            starts: segments
                .map(|count| (0..count).map(|_| None).collect())
                .collect(),
        }
    }

    /// Keep the rates at the start of one more step.
    pub fn begin(&mut self, rates: &[V]) {
        self.rates.extend_from_slice(rates);
    }

    /// Keep the values of one more stage.
    pub fn push(&mut self, values: &[V], reach: [f64; LANES]) {
        self.values.extend_from_slice(values);
        self.reach.push(reach);
    }

    /// The values of a stage.
    pub fn stage(&self, number: usize) -> &[V] {
        &self.values[number * self.nodes..][..self.nodes]
    }

    /// The rates at the start of a step.
    pub fn rates(&self, step: usize) -> &[V] {
        &self.rates[step * self.nodes..][..self.nodes]
    }
}

impl<V: 'static> Drop for Record<V> {
    fn drop(&mut self) {
        keep(std::mem::take(&mut self.values));
        keep(std::mem::take(&mut self.rates));
    }
}

/// The size of the record of so many steps, bytes.
pub const fn record_size(cells: usize, steps: usize) -> usize {
    4 * steps * (cells + 1) * size_of::<[f64; LANES]>()
}

/// Set what lies before each lane's first node to 0, from the one before the `first` of all on; a lane whose own is `cells`
/// has none, and with 1 nothing lies before it.
#[inline(always)]
#[allow(clippy::cast_precision_loss)]
pub fn clear_before<V: Vector>(rates: &mut [V], first: usize, own: &[usize; LANES], cells: usize) {
    let furthest = own.iter().copied().filter(|own| *own < cells).max();
    let begins = V::from_lanes(own.map(|own| if own > 1 { own as f64 } else { 0.0 }));
    let end = furthest.unwrap_or(first);
    for (i, rate) in rates.iter_mut().enumerate().take(end).skip(first - 1) {
        let is_before = -begins.plus(-(i as f64));
        *rate = is_before.negative(V::zero(), *rate);
    }
}
