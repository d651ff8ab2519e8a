"""The methods compared: how the value is formulated, stepped in time, and kept above the payoff."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from benchmarks.classic_sets import Problem
from benchmarks.explicit_projection import ExplicitProjection
from pricing_core.american import Resolution
from pricing_core.american.flat.crank_nicolson import DAMPED_STEPS, CrankNicolson, damped_until
from pricing_core.american.flat.engine import settled_domain
from pricing_core.american.flat.grid import Domain, make_grid
from pricing_core.american.flat.resolution import Formulation, Scheme, Solution, TimeMesh, solve_at
from pricing_core.american.flat.semidiscrete import ValueForm
from pricing_core.american.flat.time_mesh import square_root_mesh, uniform_mesh
from pricing_core.american.flat.tridiagonal_step import LCPMethod, OptionState, TridiagonalStage, start_state
from pricing_core.stepping import FixedStep, ImplicitEuler, OneStepMethod, integrate

Peer: TypeAlias = Literal["explicit projection", "undamped"]
STEPPER_NAMES: dict[Scheme, str] = {
    "implicit-euler": "implicit Euler",
    "sdirk2": "SDIRK2",
    "crank-nicolson": "Crank-Nicolson",
}
COARSEST = Resolution(intervals=32, steps=8)
DOMAIN_TOLERANCE = 1e-8


@dataclass(frozen=True, slots=True)
class Method:
    """One way to step the semidiscrete option through time.

    Parameters
    ----------
    label : str
    scheme, time_mesh, formulation
        As in `pricing_core.american.Resolution`.
    peer : {"explicit projection", "undamped"}, optional
        What this project does not do itself: to project in place of solving the complementarity problem, or
        to begin Crank-Nicolson without Rannacher's damping. In the value formulation, on prescribed steps.
    """

    label: str
    scheme: Scheme
    time_mesh: TimeMesh
    formulation: Formulation = "value"
    peer: Peer | None = None

    def solve(
        self,
        problem: Problem,
        domain: Domain,
        intervals: int,
        steps: int,
        lcp_method: LCPMethod = "tridiagonal",
    ) -> Solution:
        """Solve the problem on `domain`."""
        resolution = Resolution(intervals, steps, self.time_mesh, self.scheme, self.formulation)
        if self.peer is not None:
            return _solve_peer(self.peer, problem, domain, resolution)
        return solve_at(problem.option, problem.market, domain, resolution, lcp_method=lcp_method)

    def implicit_solves(self, solution: Solution) -> int:
        """Return how many linear or complementarity problems a solution took.

        Damped steps take two; that is not counted where the steps are adaptive.
        """
        stages = 2 if self.scheme == "sdirk2" else 1
        if self.time_mesh == "adaptive":  # step doubling: one step and its two halves
            return 3 * stages * (solution.integration.accepted + solution.integration.rejected)
        damped = DAMPED_STEPS if self.scheme == "crank-nicolson" and self.peer != "undamped" else 0
        return stages * solution.integration.accepted + damped


def domain_of(problem: Problem) -> Domain:
    """Return the domain on which every method solves the problem; 32, 64, ... cells put a node on the strike."""
    return settled_domain(problem.option, problem.market, DOMAIN_TOLERANCE, COARSEST, None)


def _solve_peer(peer: Peer, problem: Problem, domain: Domain, resolution: Resolution) -> Solution:
    option = problem.option
    grid = make_grid(domain, resolution.intervals)
    form = ValueForm.discretise(option, problem.market, domain, grid)
    mesh_of = square_root_mesh if resolution.time_mesh == "square-root" else uniform_mesh
    mesh = mesh_of(option.expiry, resolution.steps)
    stage = TridiagonalStage(form) if peer == "undamped" else ExplicitProjection(form)
    stepper: OneStepMethod[OptionState] = ImplicitEuler(stage)
    if resolution.scheme == "crank-nicolson":
        stepper = CrankNicolson(stage, 0.0 if peer == "undamped" else damped_until(mesh.tolist()))
    integration = integrate(
        stepper, start_state(form), (0.0, option.expiry), controller=FixedStep(), stop_times=mesh[1:]
    )
    return Solution(resolution, form, integration)
