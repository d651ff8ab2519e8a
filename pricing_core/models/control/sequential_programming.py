"""Sequential quadratic programming with an exact penalty, each step by Clarabel."""

from __future__ import annotations

from dataclasses import dataclass

import clarabel
import numpy as np
from scipy.sparse import csc_matrix, eye_array, triu, vstack

from pricing_core.arrays import Vector
from pricing_core.errors import IterationLimitError, NumericalError
from pricing_core.models.control.nonlinear_programme import NonlinearProgramme, QuadraticModel, Values

MOST_HALVINGS = 25
DECREASE = 1e-4
STEADY = 1e-9  # weight of |d|^2, so that every step is unique
SOLVED = ("Solved", "AlmostSolved")


@dataclass(frozen=True, slots=True, eq=False)
class Optimum:
    """Where the steps ended: a point that satisfies the first-order conditions to the tolerance."""

    v: Vector
    costate: Vector  # (N n,)
    duals: Vector
    values: Values
    iterations: int


def minimise(programme: NonlinearProgramme, v: Vector, tolerance: float, most: int) -> Optimum:
    """Take quadratic steps with a line search on loss + weight (|defects|_1 + |negative slacks|_1).

    Raises
    ------
    NumericalError
        A linearised problem has no solution, or no step makes progress.
    IterationLimitError
        After `most` steps.
    """
    values = programme.values(v)
    costate, duals = np.zeros(values.defects.size), np.zeros(values.slacks.size)
    weight = 1.0
    for iteration in range(1, most + 1):
        model = programme.model(programme.expansion(v, costate.reshape(programme.N, -1), duals))
        step, costate, duals = _step(model, values)
        largest = float(np.max(np.abs(np.concatenate([costate, duals])), initial=0.0))
        weight = max(weight, 1.5 * largest)
        if float(np.max(np.abs(step))) <= tolerance * (1.0 + float(np.max(np.abs(v)))):
            last = programme.values(v + step)
            return Optimum(v + step, costate, duals, last, iteration)
        v, values = _search(programme, v, values, step, model, weight)
    raise IterationLimitError(
        f"{most} quadratic steps did not reach tolerance = {tolerance:g}; give a better start, or fewer intervals"
    )


def violation(values: Values) -> float:
    """Return the sum of the defects' sizes and of the negative slacks'."""
    return float(np.sum(np.abs(values.defects)) - np.sum(np.minimum(values.slacks, 0.0)))


def _search(
    programme: NonlinearProgramme,
    v: Vector,
    values: Values,
    step: Vector,
    model: QuadraticModel,
    weight: float,
) -> tuple[Vector, Values]:
    merit = values.loss + weight * violation(values)
    slope = float(model.gradient @ step) - weight * violation(values)
    share = 1.0
    for _ in range(MOST_HALVINGS):
        trial = programme.values(v + share * step)
        allowed = DECREASE * share * min(slope, 0.0) + 1e-12 * (1.0 + abs(merit))
        if np.isfinite(trial.loss) and trial.loss + weight * violation(trial) <= merit + allowed:
            return v + share * step, trial
        share *= 0.5
    raise NumericalError("no step along the search direction makes progress; are the functions smooth?")


def _step(model: QuadraticModel, values: Values) -> tuple[Vector, Vector, Vector]:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    solution = clarabel.DefaultSolver(
        csc_matrix(triu(model.W + STEADY * eye_array(model.gradient.size))),
        model.gradient,
        csc_matrix(vstack([model.equations, -model.inequalities])),
        np.concatenate([-values.defects, values.slacks]),
        [clarabel.ZeroConeT(values.defects.size), clarabel.NonnegativeConeT(values.slacks.size)],
        settings,
    ).solve()
    if str(solution.status) not in SOLVED:
        raise NumericalError(
            f"a linearised problem ended with status {solution.status}: the constraints contradict "
            "one another near the start; give another start"
        )
    dual = np.array(solution.z)
    return np.array(solution.x), dual[: values.defects.size], dual[values.defects.size :]
