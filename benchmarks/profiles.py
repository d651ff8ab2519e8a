"""Gamma along the spot and the boundary's error along time, on one grid: what averages hide."""

from typing import NamedTuple

import numpy as np

from benchmarks.classic_sets import Problem
from benchmarks.integral_equation import put_values, solve_put_boundary
from benchmarks.stepping_methods import Method, domain_of
from pricing_core.american.boundary import boundaries_at
from pricing_core.american.flat.exercise_region import region_at_expiry
from pricing_core.american.flat.spot_values import region_of, values_at
from pricing_core.arrays import Vector

POINTS = 160
METHODS = (
    Method("SDIRK2, square-root steps", "sdirk2", "square-root"),
    Method("Crank-Nicolson, square-root steps", "crank-nicolson", "square-root"),
    Method("Crank-Nicolson, uniform steps", "crank-nicolson", "uniform"),
    Method("Crank-Nicolson without damping, uniform steps", "crank-nicolson", "uniform", peer="undamped"),
    Method(
        "Crank-Nicolson, uniform steps, explicit projection",
        "crank-nicolson",
        "uniform",
        peer="explicit projection",
    ),
)


class Profile(NamedTuple):
    """One curve."""

    label: str
    x: Vector
    y: Vector


def gamma_errors(problem: Problem, intervals: int, steps: int, furthest: float) -> tuple[Profile, ...]:
    """Return the error of a put's gamma, times the strike, from just above the boundary to `furthest` strikes."""
    boundary = solve_put_boundary(problem.market, problem.option.expiry)
    nearest = float(boundary.at(np.array([problem.option.expiry]))[0])
    spots = np.linspace(1.005 * nearest, furthest, POINTS)
    true = put_values(boundary, spots).gamma
    profiles = []
    for method in METHODS:
        solution = method.solve(problem, domain_of(problem), intervals, steps)
        region = region_of(solution)
        rows = np.array([values_at(solution, region, x)[0] for x in np.log(spots).tolist()])
        gamma = (rows[:, 2] - rows[:, 1]) / spots**2
        profiles.append(Profile(method.label, spots, gamma - true))
    return tuple(profiles)


def boundary_errors(problem: Problem, intervals: int, steps: int) -> tuple[Profile, ...]:
    """Return the error of a put's exercise boundary, as a fraction of itself, along the time to expiry in years."""
    tau = problem.option.expiry * np.linspace(0.1, 1.0, POINTS) ** 2
    true = solve_put_boundary(problem.market, problem.option.expiry).at(tau)
    limit = region_at_expiry(problem.option, problem.market)
    profiles = []
    for method in METHODS:
        solution = method.solve(problem, domain_of(problem), intervals, steps)
        found = boundaries_at(solution, tau, limit)[:, 0]
        profiles.append(Profile(method.label, tau, found / true - 1.0))
    return tuple(profiles)
