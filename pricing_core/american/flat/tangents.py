"""Vega, rho and dividend rho on the grid: the implicit stage differentiated, its contact set frozen.

Where the option is held, M dv = dbase + h (de + dL v) has the matrix of the stage. In the exercise region V
does not depend on the parameter, dv = dg, and by smooth pasting that also holds at the exercise boundary
itself, which lies between the nodes: next to it the condition dv - dg = 0 is imposed there, on the line
through the last contact node and the first free one, and not at the contact node (an error of a fraction of a
cell would make these derivatives first order).
"""

import numpy as np

from pricing_core.american.flat.operators import BlackScholesOperator, ThreePointOperator
from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.linalg import solve_tridiagonal


def solve_tangents(
    M: ThreePointOperator, rhs: Matrix, obstacle: Matrix, slack: Vector, contact: BoolVector
) -> Matrix:
    """Return the derivatives of the stage, shape (3, N).

    Parameters
    ----------
    M : ThreePointOperator
        I - hL.
    rhs : Matrix, shape (3, N)
        dbase + h (de + dL v).
    obstacle : Matrix, shape (3, N)
        dg.
    slack : Vector, shape (N,)
        z = v - g, from which the boundary's place between two nodes is read.
    """
    lower, diagonal, upper = M.lower[1:].copy(), M.diagonal.copy(), M.upper[:-1].copy()
    relative = rhs.copy()
    diagonal[contact] = 1.0
    upper[contact[:-1]] = 0.0
    lower[contact[1:]] = 0.0
    relative[:, contact] = obstacle[:, contact]
    for j in np.flatnonzero(contact[:-1] & ~contact[1:]):  # the region ends to the right of node j
        if j + 2 < contact.size:
            upper[j] = _weight(slack[j + 1], slack[j + 2])
            relative[:, j] += upper[j] * obstacle[:, j + 1]
    for j in np.flatnonzero(contact[1:] & ~contact[:-1]) + 1:  # the region ends to the left of node j
        if j >= 2 and not contact[j - 2]:
            lower[j - 1] = _weight(slack[j - 1], slack[j - 2])
            relative[:, j] += lower[j - 1] * obstacle[:, j - 1]
    return solve_tridiagonal(lower, diagonal, upper, relative.T).T


def parameter_source(operators: BlackScholesOperator, everywhere: Vector) -> Matrix:
    """Return dL v for volatility, rate and yield at the unknowns, shape (3, N); v given at all N + 2 nodes."""
    derivatives = (operators.by_volatility, operators.by_rate, operators.by_yield)
    return np.stack([derivative.apply(everywhere) for derivative in derivatives])


def _weight(first: float, second: float) -> float:
    """Return a with f_j + a f_{j+1} = 0 for a line that vanishes at the exercise boundary.

    The parabola through z_j = 0, z_{j+1} = first, z_{j+2} = second has its vertex s cells from node j,
    s = 1/2 - first/(second - 2 first), between -1/2 and 1/2.
    """
    curvature = second - 2.0 * first
    s = 0.5 - first / curvature if curvature > first else -0.5
    return s / (1.0 - s)
