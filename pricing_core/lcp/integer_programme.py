"""Any solvable LCP by mixed-integer linear programming, for problems that no pivoting method has solved."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, milp

from pricing_core.arrays import Vector
from pricing_core.errors import IterationLimitError, NotFoundError
from pricing_core.lcp.problem import DEFAULT_TOLERANCE, LCP, LCPSolution, verified
from pricing_core.lcp.scaling import equilibrate

MOST_NODES = 500
LEAST_SCALE = 1e-7  # of the solution: HiGHS answers to about 1e-9
REFINEMENTS, RANK = 3, 1e-12
REMEDY = "use another method"


def solve_by_integer_programme(problem: LCP, *, time_limit: float | None = None) -> LCPSolution:
    """Solve an LCP of moderate order whatever its matrix, in exponential time at worst.

    The greatest a with 0 <= M x + q a <= 1 - y, 0 <= x <= y, 0 <= a <= 1 and y of zeros and ones is positive iff the
    LCP has a solution, which then is x / a. HiGHS proposes x / a; the nearest
    point with the same zeros and w = 0 elsewhere counts if it solves the problem.

    Raises
    ------
    IterationLimitError
        500 nodes or the time limit, in seconds, were not enough.
    NotFoundError
        Floating point says that there is no solution, or its proposal is none: nothing is proved.

    Notes
    -----
    Source: Pardalos and Rosen 1988, global optimization approach to the linear complementarity problem.

    Examples
    --------
    >>> solve_by_integer_programme(LCP([[0.0, 1.0], [1.0, 0.0]], [-1.0, -2.0])).z
    array([2., 1.])
    """
    scaled, n = equilibrate(problem), problem.size
    M, q = scaled.M, scaled.q[:, None]
    eye, nothing = np.eye(n), np.zeros((n, n))
    # The unknowns are x, y and a.
    rows = np.vstack([np.hstack([M, nothing, q]), np.hstack([M, eye, q]), np.hstack([eye, -eye, 0.0 * q])])
    least = np.concatenate([np.zeros(n), np.full(2 * n, -np.inf)])
    most = np.concatenate([np.full(n, np.inf), np.ones(n), np.zeros(n)])
    found = milp(
        np.append(np.zeros(2 * n), -1.0),
        constraints=LinearConstraint(rows, least, most),
        bounds=Bounds(0.0, 1.0),
        integrality=np.repeat([0, 1, 0], [n, n, 1]),
        options={"node_limit": MOST_NODES, "time_limit": math.inf if time_limit is None else time_limit},
    )
    if found.x is None or found.x[-1] <= LEAST_SCALE:
        if found.status == 1:
            raise IterationLimitError(
                "the integer programme did not end within its limits: raise the time limit"
            )
        raise NotFoundError(
            "the integer programme, in floating point, found no solution, which proves nothing"
        )
    z = scaled.original(_refined(LCP(scaled.M, scaled.q), found.x[:n] / found.x[-1]))
    nodes = int(found.mip_node_count)
    return verified(problem, z, nodes, "integer-programme", DEFAULT_TOLERANCE, REMEDY)


def _refined(problem: LCP, z: Vector) -> Vector:
    """Return the point near z that is zero where z is, to its accuracy, and has w = 0 elsewhere, where there is one."""
    basic_set = z > LEAST_SCALE
    block = problem.dense()[np.ix_(basic_set, basic_set)]
    refined = np.where(basic_set, z, 0.0)
    for _ in range(REFINEMENTS):
        refined[basic_set] -= np.linalg.lstsq(block, problem.slack(refined)[basic_set], rcond=RANK)[0]
    return refined
