"""How far price, delta, gamma and exercise boundary are from what they should be."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.classic_sets import Outputs, Problem
from pricing_core.american.boundary import boundaries_at
from pricing_core.american.flat.exercise_region import region_at_expiry
from pricing_core.american.flat.resolution import Solution
from pricing_core.american.flat.spot_values import region_of, values_at

OUTPUTS = ("price", "delta", "gamma", "boundary")
UNITS = {
    "price": "fraction of the strike",
    "delta": "absolute",
    "gamma": "times the strike",
    "boundary": "fraction of the boundary",
}


class Error(NamedTuple):
    """Of one output, over all spots or times of all problems."""

    rmse: float
    largest: float


def outputs_of(solution: Solution, problem: Problem) -> Outputs:
    """Return what a solution says at the spots and times of its problem, where that is compared."""
    region, spots = region_of(solution), problem.spots
    rows = np.array([values_at(solution, region, x)[0] for x in np.log(spots).tolist()])
    gamma = (rows[:, 2] - rows[:, 1]) / spots**2
    limit = region_at_expiry(problem.option, problem.market)
    return Outputs(
        price=rows[:, 0],
        delta=rows[:, 1] / spots,
        gamma=np.where(np.isnan(problem.true.gamma), np.nan, gamma),
        boundary=boundaries_at(solution, problem.boundary_times, limit)[:, 0],
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
