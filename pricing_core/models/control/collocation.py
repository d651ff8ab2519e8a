"""Direct collocation at the midpoints: the problem (11.21)-(11.23) as a sparse quadratic programme."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import clarabel
import numpy as np
from scipy.sparse import csc_matrix, diags_array, eye_array, hstack, kron, triu, vstack

from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import InfeasibleError, NumericalError
from pricing_core.models.control.infeasibility import least_energy
from pricing_core.models.control.problem import LQData

TOLERANCES = (1e-11, 1e-8)  # the second where the first is out of reach
UNREACHED = 1e-12  # what is left of a ray that proves infeasibility: large solutions look like rays above
KEPT = 1e-6  # largest violation of a constraint, as a share of the size of its slack
SOLVED = ("Solved", "AlmostSolved")
SETTLED = ("Solved", "PrimalInfeasible")
INFEASIBLE = ("PrimalInfeasible", "AlmostPrimalInfeasible")


@dataclass(frozen=True, slots=True, eq=False)
class Collocation:
    """The discrete optimum on N equal intervals of length h.

    Parameters
    ----------
    t : Vector, shape (N + 1,)
    x : Matrix, shape (N + 1, n)
    control : Matrix, shape (N, m)
        Constant in each interval.
    costate : Matrix, shape (N, n)
        The costate at the midpoints.
    masses : Matrix, shape (N + 1, k)
        The multiplier eta as a measure: the mass at each node; nothing at the first.
    cost : float
    """

    t: Vector
    x: Matrix
    control: Matrix
    costate: Matrix
    masses: Matrix
    cost: float


def collocate(data: LQData, intervals: int) -> Collocation:
    """Solve the problem on equal intervals by Clarabel's interior-point method.

    (x_(j+1) - x_j)/h = A xbar_j + B u_j with xbar_j the mean of both ends, C x_j >= bound at the nodes j >= 1, and the
    cost (h/2) sum xbar_j^T Q xbar_j + u_j^T u_j. The multipliers of the equations approximate lambda at the midpoints.

    Raises
    ------
    InfeasibleError
        No control, piecewise constant or not, satisfies the constraints: proved by the dual ray.
    NumericalError
        The solver stopped for another reason; the message says what the dual ray proves.

    Notes
    -----
    Second order in h without constraints. Cost: linear in the number of intervals.

    Examples
    --------
    x' = u from 1, Q = 0, x >= 0: nothing to do.

    >>> one = np.ones((1, 1))
    >>> abs(round(collocate(LQData(0 * one, one, one, 0 * one, one[0], 0 * one[0], 1.0), 4).cost, 9))
    0.0
    """
    n, m, k, N = data.states, data.B.shape[1], data.C.shape[0], intervals
    h = data.horizon / N
    size = max(float(np.max(np.abs(data.x0))), float(np.max(np.abs(data.bound), initial=0.0))) or 1.0
    x0, bound = data.x0 / size, data.bound / size  # the solver sees numbers of order 1
    weights, equations, inequalities = _programme(data, N, h)
    rhs = np.zeros(N * n)
    rhs[:n] = (np.eye(n) + 0.5 * h * data.A) @ x0
    linear = np.zeros(N * (n + m))
    linear[:n] = 0.25 * h * data.Q @ x0
    right = np.concatenate([rhs, -np.tile(bound, N)])
    rows = csc_matrix(vstack([equations, -inequalities]))
    cones = [clarabel.ZeroConeT(N * n), clarabel.NonnegativeConeT(N * k)]
    for tolerance in TOLERANCES:
        solution = _solve(weights, linear, rows, right, cones, tolerance)
        if str(solution.status) in SETTLED:
            break
    if str(solution.status) not in SOLVED or not _is_kept(data, size * np.array(solution.x)[: N * n]):
        nothing = csc_matrix(weights.shape)
        ray = np.array(_solve(nothing, 0.0 * linear, rows, right, cones, TOLERANCES[-1]).z)
        masses = np.vstack([np.zeros(k), ray[N * n :].reshape(N, k)])
        raise _failure(data, N, str(solution.status), least_energy(data, masses))
    v, dual = size * np.array(solution.x), size * np.array(solution.z)
    x = np.vstack([data.x0, v[: N * n].reshape(N, n)])
    control = v[N * n :].reshape(N, m)
    means = 0.5 * (x[1:] + x[:-1])
    cost = 0.5 * h * (np.einsum("ji,il,jl->", means, data.Q, means) + float(np.sum(control**2)))
    masses = np.vstack([np.zeros(k), dual[N * n :].reshape(N, k)])
    # The equations stand in the programme as x_(j+1) - ... = 0; the sign is the one of u = B^T lambda.
    costate = dual[: N * n].reshape(N, n)
    return Collocation(np.linspace(0.0, data.horizon, N + 1), x, control, costate, masses, float(cost))


def _programme(data: LQData, N: int, h: float) -> tuple[Any, Any, Any]:
    """Return the Hessian's upper triangle, the equations and the inequalities in (x_1, ..., x_N, u_0, ...)."""
    n, m = data.states, data.B.shape[1]
    before = eye_array(N, k=-1)  # x_j from x_(j+1)
    means = 0.5 * (eye_array(N) + before)
    Q = kron(means.T @ means, h * data.Q)
    hessian = vstack(
        [
            hstack([Q, csc_matrix((N * n, N * m))]),
            hstack([csc_matrix((N * m, N * n)), diags_array(np.full(N * m, h))]),
        ]
    )
    differences = kron(eye_array(N) - before, np.eye(n)) - kron(means, h * data.A)
    equations = hstack([differences, -kron(eye_array(N), h * data.B)])
    inequalities = hstack([kron(eye_array(N), data.C), csc_matrix((N * data.C.shape[0], N * m))])
    return csc_matrix(triu(hessian)), equations, inequalities


def _solve(weights: Any, linear: Vector, rows: Any, right: Vector, cones: list[Any], tolerance: float) -> Any:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
    settings.tol_infeas_abs = settings.tol_infeas_rel = UNREACHED
    settings.max_iter = 100
    return clarabel.DefaultSolver(weights, linear, rows, right, cones, settings).solve()


def _is_kept(data: LQData, states: Vector) -> bool:
    """Tell whether the constraints hold, to a share of the size of the data."""
    slacks = states.reshape(-1, data.states) @ data.C.T - data.bound
    return bool((slacks >= -KEPT * data.slack_sizes).all())


def _failure(data: LQData, N: int, status: str, energy: float) -> NumericalError:
    """Return what to raise, with what the weights of the feasibility problem prove."""
    what = f"C x >= bound up to horizon = {data.horizon:g}"
    if energy == math.inf:
        return InfeasibleError(
            f"no control keeps {what}: proved by a combination of constraints that the control does not reach; "
            "relax bound or shorten horizon"
        )
    if energy > 0.0 and status in INFEASIBLE:
        return NumericalError(
            f"no control constant on {N} intervals keeps {what}, and any control that does has "
            f"int u^T u dt >= {energy:.3g}; relax bound, shorten horizon or take more intervals"
        )
    return NumericalError(
        f"no control that keeps {what} was found on {N} intervals; any that does has int u^T u dt >= {energy:.3g}: the "
        "constraints leave hardly any room, or the data are badly scaled"
    )
