"""How finely an option is solved, and one solve at that resolution."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.market import FlatMarket
from pricing_core.american.flat.crank_nicolson import CrankNicolson, damped_until
from pricing_core.american.flat.grid import LARGEST_STRETCHING, Domain, make_grid
from pricing_core.american.flat.semidiscrete import PremiumForm, SemidiscreteForm, ValueForm
from pricing_core.american.flat.time_mesh import square_root_mesh, uniform_mesh
from pricing_core.american.flat.tridiagonal_step import (
    LCPMethod,
    OptionStage,
    OptionState,
    TridiagonalStage,
    start_state,
)
from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError
from pricing_core.stepping import (
    FixedStep,
    ImplicitEuler,
    Integration,
    OneStepMethod,
    PIController,
    Sdirk2,
    StepDoubling,
    integrate,
)

TimeMesh: TypeAlias = Literal["square-root", "uniform", "adaptive"]
Formulation: TypeAlias = Literal["premium", "value"]
Scheme: TypeAlias = Literal["sdirk2", "implicit-euler", "crank-nicolson"]

LEAST_INTERVALS, LEAST_STEPS, MOST = 8, 4, 20_000
LOCAL_TOLERANCE = 0.02  # adaptive steps: local error of v per step, times steps**3


@dataclass(frozen=True, slots=True)
class Resolution:
    """Grid cells and time steps of one solve.

    Parameters
    ----------
    intervals : int
        Cells of the grid, 8 to 20,000.
    steps : int
        Time steps, 4 to 20,000; with "adaptive" the size of the local tolerance, 0.02/steps**3 of the strike,
        which leads to about as many.
    time_mesh : {"square-root", "uniform", "adaptive"}
        Equal steps in sqrt(tau), equal steps in tau, or step-size control by step doubling and a PI
        controller.
    scheme : {"sdirk2", "implicit-euler", "crank-nicolson"}, optional
        The one-step method; by default "sdirk2".
    formulation : {"premium", "value"}
        Solve for the early exercise premium, or for the value as in (11.63), which carries no vega and rhos.
    stretching : float
        0: uniform grid; see `pricing_core.american.flat.grid.make_grid`.
    """

    intervals: int = 400
    steps: int = 100
    time_mesh: TimeMesh = "square-root"
    scheme: Scheme | None = None
    formulation: Formulation = "premium"
    stretching: float = 0.0

    def __post_init__(self) -> None:
        for field, least in (("intervals", LEAST_INTERVALS), ("steps", LEAST_STEPS)):
            value = getattr(self, field)
            if not isinstance(value, int) or not least <= value <= MOST:
                raise InvalidInputError(field, value, f"an integer from {least} to {MOST}")
        if not 0.0 <= self.stretching <= LARGEST_STRETCHING:
            raise InvalidInputError(
                "stretching", self.stretching, f"a number from 0 to {LARGEST_STRETCHING:g}"
            )
        choices = {
            "time_mesh": ("square-root", "uniform", "adaptive"),
            "scheme": (None, "sdirk2", "implicit-euler", "crank-nicolson"),
            "formulation": ("premium", "value"),
        }
        for field, allowed in choices.items():
            if getattr(self, field) not in allowed:
                raise InvalidInputError(field, getattr(self, field), "one of " + ", ".join(map(str, allowed)))

    def refined(self) -> "Resolution":
        """Return twice the cells and twice the steps."""
        return replace(self, intervals=2 * self.intervals, steps=2 * self.steps)

    def coarsened(self) -> "Resolution | None":
        """Return half the cells and half the steps, None where there are too few."""
        if self.intervals < 2 * LEAST_INTERVALS or self.steps < 2 * LEAST_STEPS:
            return None
        return replace(self, intervals=self.intervals // 2, steps=self.steps // 2)


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """The semidiscrete option and its states at increasing times to expiry tau."""

    resolution: Resolution
    form: SemidiscreteForm
    integration: Integration[OptionState]

    @property
    def tau(self) -> Vector:
        """Times to expiry, from 0, shape (m + 1,)."""
        return self.integration.t

    @property
    def last(self) -> OptionState:
        """The state now, tau = expiry."""
        return self.integration.states[-1]

    @property
    def finished(self) -> bool:
        """False where the run was interrupted."""
        return self.integration.status == "finished"


def solve_at(
    option: Option,
    market: FlatMarket,
    domain: Domain,
    resolution: Resolution,
    *,
    lcp_method: LCPMethod = "tridiagonal",
    tangents: bool = False,
    interrupt: Callable[[], bool] | None = None,
) -> Solution:
    """Solve the semidiscrete option from expiry to now.

    Parameters
    ----------
    tangents : bool
        Carry the derivatives by volatility, rate and yield along (premium formulation only).
    """
    grid = make_grid(domain, resolution.intervals, resolution.stretching)
    form_class = PremiumForm if resolution.formulation == "premium" else ValueForm
    form = form_class.discretise(option, market, domain, grid)
    integration = integrate_stage(
        TridiagonalStage(form, lcp_method),
        start_state(form, tangents=tangents),
        option.expiry,
        resolution.steps,
        resolution,
        interrupt=interrupt,
    )
    return Solution(resolution, form, integration)


def integrate_stage(
    stage: OptionStage,
    state: OptionState,
    duration: float,
    steps: int,
    resolution: Resolution,
    *,
    stop_times: Iterable[float] = (),
    interrupt: Callable[[], bool] | None = None,
) -> Integration[OptionState]:
    """Step from `state` over `duration` years by the scheme and on the mesh of times that the resolution asks for.

    Parameters
    ----------
    steps : int
        Instead of the resolution's own.
    stop_times : iterable of float
        Times from the start at which a step must end besides those of the mesh.
    """
    mesh = (square_root_mesh if resolution.time_mesh == "square-root" else uniform_mesh)(duration, steps)
    methods: dict[Scheme, OneStepMethod[OptionState]] = {
        "sdirk2": Sdirk2(stage),
        "implicit-euler": ImplicitEuler(stage),
        "crank-nicolson": CrankNicolson(stage, damped_until(mesh.tolist())),
    }
    method = methods[resolution.scheme or "sdirk2"]
    adaptive = resolution.time_mesh == "adaptive"
    local = LOCAL_TOLERANCE / steps ** (method.order + 1)
    return integrate(
        StepDoubling(method) if adaptive else method,
        state,
        (0.0, duration),
        controller=PIController(0.0, local, start=1.0 / steps**2) if adaptive else FixedStep(),
        stop_times=[*stop_times] if adaptive else [*stop_times, *mesh[1:].tolist()],
        interrupt=interrupt,
    )


def align(domain: Domain, intervals: int, stretching: float) -> Domain:
    """Widen the domain by less than a cell so that x = 0, the strike, is a node of every uniform grid on it."""
    width = (domain.right - domain.left) / intervals
    if stretching or not domain.left < 0.0 < domain.right:
        return domain
    left_cells = int(np.ceil(-domain.left / width))
    right_cells = intervals - left_cells
    if right_cells < 1:
        return domain
    width = max(-domain.left / left_cells, domain.right / right_cells)
    return replace(domain, left=-left_cells * width, right=right_cells * width)
