"""Errors of price, delta, gamma and exercise boundary."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.method_of_lines.stepping_methods import Solution
from benchmarks.problems.classic_sets import Outputs, Problem
from pricing_core.american.engines.method_of_lines.spot_values import at_spot

OUTPUTS = ("price", "delta", "gamma", "boundary")
UNITS = {
    "price": "fraction of the strike",
    "delta": "absolute",
    "gamma": "times the strike",
    "boundary": "fraction of the boundary",
}


class Error(NamedTuple):
    """The error of one output, over all spots or times of all problems."""

    rmse: float
    largest: float


def outputs_of(solution: Solution, problem: Problem) -> Outputs:
    """Return the outputs of a solution at the spots and times at which its problem is compared."""
    now = solution.now()
    price, delta, gamma = np.array([at_spot(now, spot)[0, :3] for spot in problem.spots.tolist()]).T
    return Outputs(
        price,
        delta,
        np.where(np.isnan(problem.true.gamma), np.nan, gamma),
        solution.boundary(problem.boundary_times),
    )


def extrapolated(coarse: Outputs, fine: Outputs) -> Outputs:
    """Return (4 fine - coarse)/3; the boundary's error is too irregular for that and is taken from `fine`."""
    return Outputs(
        price=(4.0 * fine.price - coarse.price) / 3.0,
        delta=(4.0 * fine.delta - coarse.delta) / 3.0,
        gamma=(4.0 * fine.gamma - coarse.gamma) / 3.0,
        boundary=fine.boundary,
    )


def errors(found: Sequence[Outputs], reference: Sequence[Outputs]) -> dict[str, Error]:
    """Return the error of every output where the reference is not NaN, the boundary's as a fraction of itself."""
    measured = {}
    for name in OUTPUTS:
        differences = [
            (getattr(one, name) - getattr(true, name)) / (true.boundary if name == "boundary" else 1.0)
            for one, true in zip(found, reference, strict=True)
        ]
        known = ~np.isnan(np.concatenate([getattr(true, name) for true in reference]))
        absolute = np.abs(np.concatenate(differences)[known])
        measured[name] = Error(float(np.sqrt(np.mean(np.square(absolute)))), float(np.max(absolute)))
    return measured
