"""Gamma along the spot and the boundary's error along time, on one grid: details that averages hide."""

from typing import NamedTuple

import numpy as np

from benchmarks.method_of_lines.stepping_methods import Method, span_of
from benchmarks.problems.classic_sets import Problem
from benchmarks.problems.integral_equation import put_values, solve_put_boundary
from pricing_core.american.engines.method_of_lines.spot_values import at_spot
from pricing_core.arrays import Vector

POINTS = 160
METHODS = (
    Method("SDIRK2, square-root steps, boundary in its cell", "sdirk2", "square-root", "cell"),
    Method("SDIRK2, square-root steps", "sdirk2", "square-root"),
    Method("Crank-Nicolson, square-root steps", "crank-nicolson", "square-root"),
    Method("Crank-Nicolson, uniform steps", "crank-nicolson", "uniform"),
    Method("Crank-Nicolson without damping, uniform steps", "crank-nicolson", "uniform", damped=False),
    Method("Crank-Nicolson, uniform steps, explicit projection", "crank-nicolson", "uniform", "projection"),
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
        now = method.solve(problem, span_of(problem), intervals, steps).now()
        gamma = np.array([at_spot(now, spot)[0, 2] for spot in spots.tolist()])
        profiles.append(Profile(method.label, spots, gamma - true))
    return tuple(profiles)


def boundary_errors(problem: Problem, intervals: int, steps: int) -> tuple[Profile, ...]:
    """Return the error of a put's exercise boundary, as a fraction of itself, along the time to expiry in years."""
    tau = problem.option.expiry * np.linspace(0.1, 1.0, POINTS) ** 2
    true = solve_put_boundary(problem.market, problem.option.expiry).at(tau)
    profiles = []
    for method in METHODS:
        found = method.solve(problem, span_of(problem), intervals, steps).boundary(tau)
        profiles.append(Profile(method.label, tau, found / true - 1.0))
    return tuple(profiles)
