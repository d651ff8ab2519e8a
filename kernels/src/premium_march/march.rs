//! The march of sixteen early exercise premiums from expiry to now; see `premium_march` for the scheme.

use super::boundary_history::BoundaryHistory;
use super::contracts::Contracts;
use super::first_step::first_step;
use super::grid_values::Workspace;
use super::mesh::Mesh;
use super::runge_kutta_step::RungeKuttaStep;
use crate::interrupt::Interrupt;
use crate::lanes::vector::{Part, Vector, LANES};

/// The number of steps between two questions whether the work shall end; chosen: they take less than a millisecond.
/// Shorter marches leave the question to `refinement`.
const STEPS_BETWEEN_QUESTIONS: usize = 16;

/// What a march leaves beside the premium at the nodes; node i is at xi = `node` + i dx.
#[derive(Clone, Copy)]
pub struct Marched<V> {
    /// xi of node 0.
    pub node: V,
    /// The derivatives of `node` by rate, dividend and spread: at fixed xi those of u are less by `u_xi` times these than
    /// along the nodes.
    pub node_by: [V; 3],
    /// xi of the boundary after the first step.
    pub first_boundary: V,
    /// ln(S*/K).
    pub boundary: V,
    /// Whether the boundary stayed close to node 0 in every step.
    pub settled: [bool; LANES],
}

/// March to now; the premium is left in `work`, with its derivatives by the parameters in D arrays, see `array_of`. None
/// where it is told to end.
///
/// `coarser_first` is `first_boundary` of the march with half as many steps. One function for each vector type and D,
/// whoever calls it: compiled into each caller it would take most of the crate's build.
#[inline(always)]
pub fn march<V: Vector, const D: usize>(
    mesh: &Mesh,
    contracts: &Contracts<V>,
    coarser_first: Option<V>,
    work: &mut Workspace<V>,
    interrupt: Interrupt,
) -> Option<Marched<V>> {
    V::call(March::<V, D> {
        mesh,
        contracts,
        coarser_first,
        work,
        interrupt,
    })
}

/// What a march is made from.
struct March<'a, V, const D: usize> {
    mesh: &'a Mesh,
    contracts: &'a Contracts<V>,
    coarser_first: Option<V>,
    work: &'a mut Workspace<V>,
    interrupt: Interrupt<'a>,
}

impl<V: Vector, const D: usize> Part<V> for March<'_, V, D> {
    type Result = Option<Marched<V>>;

    #[inline(always)]
    fn run(self) -> Option<Marched<V>> {
        let Self {
            mesh,
            contracts,
            coarser_first,
            work,
            interrupt,
        } = self;
        let mut history = BoundaryHistory::new(contracts);
        let mut node = first_step::<V, D>(mesh, contracts, &mut history, work);
        let first_boundary = node.xi;
        let mut settled = [true; LANES];
        for n in 2..=mesh.step_count() {
            if n % STEPS_BETWEEN_QUESTIONS == 0 && interrupt() {
                return None;
            }
            let step = mesh.step(n);
            if step.coarsens {
                work.premium.coarsen();
                for tangent in &mut work.tangents[..D] {
                    tangent.coarsen();
                }
            }
            let accepted = V::apart(RungeKuttaStep::<V, D> {
                step: &step,
                contracts,
                history: &mut history,
                node: &mut node,
                coarser_first,
                work,
            });
            for (settled, accepted) in settled.iter_mut().zip(accepted) {
                *settled &= accepted;
            }
        }
        Some(Marched {
            node: node.xi,
            node_by: node.xi_by,
            first_boundary,
            boundary: history.latest * contracts.spread,
            settled,
        })
    }
}
