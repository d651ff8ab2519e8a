"""One contract's problem at nodes, stepped from expiry to now: each stage is the complementarity problem (11.65)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from pricing_core.american.book.resolution import Resolution, Scheme, TimeMesh
from pricing_core.arrays import Vector
from pricing_core.lcs.time_stepping import LCSState
from pricing_core.obstacle import ObstacleProblem
from pricing_core.obstacle.as_lcs import NodalSolver, NodalStage
from pricing_core.obstacle.grid import Grid, GridMap, grid_map
from pricing_core.obstacle.interval import choose_map
from pricing_core.obstacle.moment import Segment
from pricing_core.obstacle.problem import just_before
from pricing_core.obstacle.profile import Profile, contact_sets
from pricing_core.obstacle.transfer import Known, before, payoff_of
from pricing_core.stepping import (
    IMPLICIT_EULER,
    SDIRK2,
    DiagonallyImplicit,
    FixedStep,
    Integration,
    OneStepMethod,
    PIController,
    RannacherStart,
    StepDoubling,
    integrate,
    theta_method,
)

# The power p of tau_k = T (k/M)**p; adaptive steps take no more than the end of the damped ones from a mesh.
POWERS: dict[TimeMesh, int] = {"uniform": 1, "square-root": 2, "cube-root": 3, "adaptive": 2}
DAMPED_STEPS = (
    2  # Number of steps of Crank-Nicolson replaced by two implicit Euler half steps (Rannacher 1984).
)
LOCAL_TOLERANCE = 0.02  # Local error of v per adaptive step, in strikes, times steps**3; calibrated.
SMALLEST_SHARE = 0.125  # Smallest share of the steps, for a segment however short; chosen.
SAME_TIME = 1e-9  # Largest distance of two times that are one, as a share of the horizon; chosen.


@dataclass(frozen=True, slots=True, eq=False)
class NodalRun:
    """A contract's values at the nodes now.

    Parameters
    ----------
    now : Profile
    resolution : Resolution
    steps : int
    residual : float
        Natural residual of the complementarity problem now, in strikes.
    fitted : bool
        Whether the drift dominates the diffusion in a cell, so that the scheme is of first order there.
    ends : dict of float to (float, float)
        The ends of the contact set as places, the one nearer the strike first, at the times asked for and now; NaN
        where there is none.
    """

    now: Profile
    resolution: Resolution
    steps: int
    residual: float
    fitted: bool
    ends: dict[float, tuple[float, float]]


def nodal_grid(problem: ObstacleProblem, place: float, resolution: Resolution) -> Grid:
    """Return the grid of a resolution around a place, with the strike on a node unless it is stretched."""
    chosen, cells, s = choose_map(problem, np.array([place])), resolution.intervals, resolution.stretching
    left, right = chosen.left, chosen.right
    if s > 0.0 or chosen.spline is not None:
        from scipy.interpolate import BSpline, make_interp_spline  # noqa: PLC0415  even grids do without it
    if s > 0.0:  # d sinh(s u), u equally spaced
        scale = max(-left, right) / math.sinh(s)
        u = np.linspace(math.asinh(left / scale), math.asinh(right / scale), cells + 1)
        spline = make_interp_spline(np.arange(cells + 1.0), scale * np.sinh(u), k=5)
        return Grid.of(GridMap(left, right, cells, spline), 1)
    if chosen.spline is None:
        strike = np.array([0.0] if left < 0.0 < right else [])
        given = problem.interval[0] is not None, problem.interval[1] is not None
        return Grid.of(grid_map(left, right, cells, strike, given), 1)
    of = chosen.spline
    return Grid.of(GridMap(left, right, cells, BSpline(of.t * (cells / chosen.cells), of.c, of.k)), 1)


def nodal_run(
    problem: ObstacleProblem,
    grid: Grid,
    resolution: Resolution,
    scheme: Scheme,
    solver: NodalSolver,
    *,
    is_put: bool,
    times: tuple[float, ...] = (),
    interrupt: Callable[[], bool] | None = None,
) -> NodalRun | None:
    """Step a problem from its horizon to now, segment by segment; None where interrupted.

    Parameters
    ----------
    is_put : bool
        Whether the contact set lies on the left of the strike.
    times : tuple of float
        Years from now, at which a step ends and the ends of the contact set are wanted.
    """
    after, steps, asked = payoff_of(problem, grid), 0, sorted({0.0, *times})
    ends: dict[float, tuple[float, float]] = {}
    for start, end in problem.segments:
        value = before(problem, grid, end, after).value(grid.x)
        if end in asked:
            ends[end] = _ends(problem, grid, end, value, is_put=is_put)
        inside = [t for t in problem.diffusion.breaks[::-1] if start < t < end]
        for late, early in pairwise([end, *inside, start]):
            segment = Segment(problem, grid, early, late, "right-angle")
            share = max(SMALLEST_SHARE, segment.duration / problem.horizon)
            run = _integrated(
                NodalStage(segment, solver),
                _state(segment, value[1:-1]),
                max(math.ceil(resolution.steps * share), 2),
                resolution,
                scheme,
                [late - t for t in asked if early < t < late],
                interrupt,
            )
            if run.status == "interrupted":
                return None
            steps += run.accepted
            for t in (t for t in asked if early <= t < late):
                reached = run.states[int(np.argmin(np.abs(late - run.t - t)))]
                whole = segment.at(t).with_ends(reached.value)
                ends[t] = _ends(problem, grid, t, whole, is_put=is_put, acts=segment.acting[0] is not None)
            moment, last = segment.at(early), run.states[-1]
            value = moment.with_ends(last.value)
        profile = Profile(problem, grid, start, value, contact_sets(moment, value, np.zeros(value.size - 2)))
        edges = [e for sets in profile.contacts for pair in sets for e in pair if math.isfinite(e)]
        after = Known(profile, grid.place(np.array(edges)) if edges else np.zeros(0), profile.nodal)
    natural = np.minimum(last.slack, last.multiplier) if last.slack.size else np.zeros(1)
    fitted = bool((np.abs(moment.scheme.peclet) > 2.0).any())
    return NodalRun(profile, resolution, steps, float(np.abs(natural).max()), fitted, ends)


def _state(segment: Segment, value: Vector) -> LCSState:
    """Return the state that a segment starts from at its end."""
    contact = segment.at(just_before(segment.end)).contact
    slack = value - contact.lower if segment.acting[0] is not None else np.zeros(0)
    return LCSState(value, np.zeros(slack.size), slack)


def _integrated(
    stage: NodalStage,
    state: LCSState,
    steps: int,
    resolution: Resolution,
    scheme: Scheme,
    stops: list[float],
    interrupt: Callable[[], bool] | None,
) -> Integration[LCSState]:
    """Step through a segment by the scheme and on the mesh of times that the resolution asks for."""
    duration = stage.segment.duration
    mesh = duration * np.linspace(0.0, 1.0, steps + 1) ** POWERS[resolution.time_mesh]
    damped = mesh.item(min(DAMPED_STEPS, steps))
    euler: OneStepMethod[LCSState] = DiagonallyImplicit(stage, IMPLICIT_EULER)
    method = {
        "sdirk2": DiagonallyImplicit(stage, SDIRK2),
        "implicit-euler": euler,
        "crank-nicolson": RannacherStart(DiagonallyImplicit(stage, theta_method(0.5)), euler, damped),
    }[scheme]
    adaptive = resolution.time_mesh == "adaptive"
    local = LOCAL_TOLERANCE / steps ** (method.order + 1)
    asked = np.unique(np.array(stops)) if stops else np.zeros(0)
    if asked.size:  # a time of the mesh next to one that is asked for gives way to it
        nearest = np.abs(mesh[:, None] - asked).min(axis=1)
        mesh = mesh[(nearest > SAME_TIME * duration) | (mesh == 0.0) | (mesh == duration)]
    return integrate(
        StepDoubling(method) if adaptive else method,
        state,
        (0.0, duration),
        controller=PIController(0.0, local, start=1.0 / steps**2) if adaptive else FixedStep(),
        stop_times=stops if adaptive else [*mesh[1:].tolist(), *stops],
        interrupt=interrupt,
    )


def _ends(
    problem: ObstacleProblem, grid: Grid, t: float, value: Vector, *, is_put: bool, acts: bool = True
) -> tuple[float, float]:
    """Return the ends of the contact set next to the strike as places.

    Inside the cell next to the last node in contact an end lies where the root of V - obstacle, a straight line through
    the second and the third free node, vanishes.
    """
    obstacle = problem.lower
    if obstacle is None or not acts or not obstacle.acts_at(t):
        return math.nan, math.nan
    bound = obstacle(grid.x, just_before(t) if t > 0.0 else t)
    slack = np.maximum(value - bound, 0.0)
    held = (slack == 0.0) & (bound > 0.0)
    if not held.any():
        return math.nan, math.nan
    order = 1 if is_put else -1  # seen from the far end to the strike
    slack, held, x = slack[::order], held[::order], grid.x[::order]
    last = int(np.flatnonzero(held)[-1])
    first = int(np.flatnonzero(~held[:last])[-1]) + 1 if (~held[:last]).any() else -1
    near = _zero(x[last:], slack[last:])
    far = math.nan if first < 0 else _zero(x[first::-1], slack[first::-1])
    return near, far


def _zero(x: Vector, slack: Vector) -> float:
    """Return where the slack ends to be 0, from a node in contact to free ones."""
    if x.size < 4:
        return float(x[0])
    second, third = np.sqrt(slack[2:4]).tolist()
    found = x[2] - second * (x[3] - x[2]) / (third - second) if third > second else x[0]
    low, high = sorted((float(x[0]), float(x[1])))
    return min(max(float(found), low), high)
