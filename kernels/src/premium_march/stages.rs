//! The three stages of one Runge-Kutta step, for the premium and then for its derivatives.

use super::boundary_cell::{BoundaryCell, CellSolution};
use super::boundary_history::BoundaryHistory;
use super::cell_tangents::CellTangents;
use super::contracts::Contracts;
use super::first_step::FirstNode;
use super::grid_values::{array_of, Workspace};
use super::mesh::TimeStep;
use super::obstacle::TimeFactors;
use super::stage_equations::{speed_source, RightHandSide};
use super::tableau::{Tableau, LATER_STEPS, SECOND_STEP, STAGE};
use super::wiener_hopf::WienerHopf;
use crate::lanes::vector::{Part, Vector};

/// The solved cells of the three stages.
pub type SolvedCells<'a, V> = [Option<(BoundaryCell<'a, V>, CellSolution<V>)>; 3];

/// The stages of one step, in which node 0 goes from one place to another at a constant speed. What ends in `_by` has
/// the derivatives by rate, dividend and spread.
pub struct Stages<'a, V> {
    /// t at the start of the step.
    start: f64,
    /// The length of the step in t.
    h: f64,
    step: &'a TimeStep<'a>,
    contracts: &'a Contracts<V>,
    pub tableau: &'static Tableau,
    /// As in `BoundaryHistory`; the step does not change these.
    drift: V,
    at_expiry: V,
    drift_by: [V; 3],
    at_expiry_by: [V; 3],
    from: FirstNode<V>,
    to: FirstNode<V>,
    matrix: WienerHopf<V>,
    /// The derivative of the reduced boundary by ln sqrt(t) at the end of the step, for a boundary at node 0.
    slope: V,
    slope_by: [V; 3],
    /// The derivatives of the speed of the nodes.
    pub speed_by: [V; 3],
    /// What is new in these since the last step.
    faster_by: [V; 3],
}

impl<'a, V: Vector> Stages<'a, V> {
    /// The stages of `step`, after `history`, whose speed is that of this step already.
    #[inline(always)]
    pub fn new(
        step: &'a TimeStep<'a>,
        contracts: &'a Contracts<V>,
        history: &BoundaryHistory<V>,
        from: FirstNode<V>,
        to: FirstNode<V>,
    ) -> Self {
        let (start, end) = (from.root * from.root, to.root * to.root);
        let h = end - start;
        let newest = to.xi - history.drift.times(end) - history.at_expiry;
        let [newest_weight, weight, oldest_weight] = *step.slope;
        let newest_weight = newest_weight / to.root;
        let (mut slope_by, mut speed_by, mut faster_by) = (to.xi_by, to.xi_by, to.xi_by);
        for j in 0..3 {
            let unreduced = history.drift_by[j].times_plus(V::all(end), history.at_expiry_by[j]);
            slope_by[j] = (to.xi_by[j] - unreduced).times(newest_weight)
                + history.reduced_by[0][j].times(weight)
                + history.reduced_by[1][j].times(oldest_weight);
            speed_by[j] = (to.xi_by[j] - from.xi_by[j]).times(1.0 / h);
            faster_by[j] = speed_by[j] - history.speed_by[j];
        }
        Self {
            start,
            h,
            step,
            contracts,
            tableau: if step.number == 2 {
                &SECOND_STEP
            } else {
                &LATER_STEPS
            },
            drift: history.drift,
            at_expiry: history.at_expiry,
            drift_by: history.drift_by,
            at_expiry_by: history.at_expiry_by,
            from,
            to,
            matrix: WienerHopf::new(history.speed, STAGE * h, step.dx),
            slope: newest.times(newest_weight)
                + history.reduced[0].times(weight)
                + history.reduced[1].times(oldest_weight),
            slope_by,
            speed_by,
            faster_by,
        }
    }

    /// Solve all three stages, one after the other, and return phi of the last; what derivatives need of them is kept
    /// where D > 0.
    #[inline(always)]
    pub fn solve<const D: usize>(
        &self,
        solved: &mut SolvedCells<'a, V>,
        work: &mut Workspace<V>,
    ) -> V {
        let mut phi = V::zero();
        for (number, solved) in solved.iter_mut().enumerate() {
            let (cell, solution) = self.take(number, phi, work);
            phi = solution.phi;
            if D > 0 {
                *solved = Some((cell, solution));
            }
        }
        phi
    }

    /// Solve one stage, from phi of the stage before; its premium stays in `GridValues::stages`.
    #[inline(always)]
    fn take(
        &self,
        number: usize,
        last_phi: V,
        work: &mut Workspace<V>,
    ) -> (BoundaryCell<'a, V>, CellSolution<V>) {
        let c = self.tableau.times[number];
        let t = self.start + c * self.h;
        let root = t.sqrt();
        let xi = (self.to.xi - self.from.xi).times_plus(V::all(c), self.from.xi);
        let reduced = (xi - self.drift.times(t) - self.at_expiry).times(1.0 / root);
        let (weights, active) = (&self.tableau.rhs_weights[number], self.step.active);
        let no_source = (&[][..], self.drift);
        work.premium
            .eliminate::<false>(number, weights, &self.matrix, active, no_source);
        let cell = BoundaryCell {
            contracts: self.contracts,
            time: TimeFactors::new(self.contracts, t, root),
            xi,
            dx: self.step.dx,
            velocity: (reduced + self.slope).times(0.5 / root) + self.drift,
            velocity_by_phi: 0.5 * self.step.dx * (1.0 + self.step.slope[0]) / (root * root),
            pi: self.matrix.pi,
        };
        let solution = cell.solve(
            work.premium.stages[number][1],
            last_phi.times(self.tableau.growth[number]),
            number == 0,
        );
        work.premium
            .substitute(number, &self.matrix, active, solution.contact());
        (cell, solution)
    }

    /// Take the step for the derivatives, one array after the other, so that each fits the cache; return those of the last
    /// phi. The solved stages have decided everything else.
    #[inline(always)]
    fn differentiate<const D: usize>(
        &self,
        solved: &SolvedCells<'a, V>,
        scale: f64,
        faster: V,
        work: &mut Workspace<V>,
    ) -> [V; 3] {
        let (active, dx) = (self.step.active, self.step.dx);
        let mut cells = [const { None }; 3];
        for (tangents, stage) in cells.iter_mut().zip(solved) {
            if let Some((cell, solution)) = stage {
                *tangents = Some(CellTangents::new(cell, solution));
            }
        }
        for number in 0..3 {
            let rhs = RightHandSide::new(
                &self.tableau.rhs_weights[number],
                active,
                &work.premium.state,
                &work.premium.increment,
                &work.premium.stages[..number],
            );
            let stage = &work.premium.stages[number][..active + 2];
            speed_source(&rhs, stage, &self.matrix, &mut work.speed_sources[number]);
        }
        let mut phi_by = [V::zero(); 3];
        for (j, tangent) in work.tangents[..D].iter_mut().enumerate() {
            if self.step.number > 2 {
                let faster_by = array_of::<V, D>(j, self.faster_by).times(self.h / dx);
                tangent.update_increment::<true>(
                    (scale, faster, faster_by),
                    active,
                    &mut work.differences,
                );
            }
            let speed_by = array_of::<V, D>(j, self.speed_by);
            for (number, cell) in cells.iter().flatten().enumerate() {
                let weights = &self.tableau.rhs_weights[number];
                let source = (&work.speed_sources[number][..], speed_by);
                tangent.eliminate::<true>(number, weights, &self.matrix, active, source);
                let (place_by, velocity_by) = self.node_tangents::<D>(j, number, cell.t, cell.root);
                let eliminated = tangent.stages[number][1];
                let (contact, found) = cell.tangent::<D>(j, eliminated, place_by, velocity_by);
                tangent.substitute(number, &self.matrix, active, contact);
                phi_by[j] = found;
            }
            tangent.finish(self.step, &self.tableau.rhs_weights[2]);
        }
        if D == 1 {
            let in_lanes = phi_by[0];
            phi_by = [0, 1, 2].map(|lane| V::all(in_lanes.lane(lane)));
        }
        phi_by
    }

    /// The derivatives in array j of the place of node 0 at a stage, and of a boundary's velocity there.
    #[inline(always)]
    fn node_tangents<const D: usize>(&self, j: usize, number: usize, t: f64, root: f64) -> (V, V) {
        let of = |by| array_of::<V, D>(j, by);
        let (from, drift_by) = (of(self.from.xi_by), of(self.drift_by));
        let c = self.tableau.times[number];
        let place_by = (of(self.to.xi_by) - from).times_plus(V::all(c), from);
        let unreduced = drift_by.times_plus(V::all(t), of(self.at_expiry_by));
        let slope_by = of(self.slope_by);
        let reduced_by = (place_by - unreduced).times_plus(V::all(1.0 / root), slope_by);
        let velocity_by = reduced_by.times_plus(V::all(0.5 / root), drift_by);
        (place_by, velocity_by)
    }
}

/// The derivatives of a step: work of its own, see `Vector::apart`.
pub struct Differentiation<'w, 'a, V, const D: usize> {
    pub stages: &'w Stages<'a, V>,
    pub solved: &'w SolvedCells<'a, V>,
    /// The arguments of `GridValues::update_increment` for the premium.
    pub scale: f64,
    pub faster: V,
    pub work: &'w mut Workspace<V>,
}

impl<V: Vector, const D: usize> Part<V> for Differentiation<'_, '_, V, D> {
    type Result = [V; 3];

    #[inline(always)]
    fn run(self) -> [V; 3] {
        self.stages
            .differentiate::<D>(self.solved, self.scale, self.faster, self.work)
    }
}
