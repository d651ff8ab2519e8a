"""Multipliers and slacks that satisfy their own equations, where rounding of the state is felt in them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import NotFoundError, NumericalError
from pricing_core.lcp import LCP, solve
from pricing_core.lcs.system import LCS
from pricing_core.linalg.matrix_classes import is_p_matrix

MISSED = 1e-9  # share of the terms of an equation, the largest of all times, by which it may be missed
ROUNDING = 1e-12  # the same of what the state's terms may have been before they cancelled


def consistent_pairs(
    system: LCS, z: Matrix, u: Matrix, y: Matrix, t: Vector, largest: float
) -> tuple[Matrix, Matrix]:
    """Return u and y with y = C z + D u, 0 <= y _|_ u >= 0 at every time, in the units of the system.

    A flow gives each u_i and y_i as a function of the state. Where a feedthrough of 1e-14 stands beside one of 1e14,
    an input is the state's rounding times 1e14 during the transients that the small one leaves, and its own function
    misses what the other rows need of it. There what is missed is corrected within the mode, or the problem of the
    pairs that miss is solved, the others being as they are.

    Parameters
    ----------
    system : LCS
        Without offsets.
    z : Matrix, shape (m, n)
    u, y : Matrix, shape (m, k)
    t : Vector, shape (m,)
        For messages.
    largest : float
        Largest of the terms that entries of z are sums of.

    Raises
    ------
    NotFoundError
        Pairs miss, and neither helps: the state does not determine their inputs.
    """
    if not u.size:
        return u, y
    A, B, C, D = (np.abs(matrix) for matrix in (system.A, system.B, system.C, system.D))
    inputs = MISSED * np.abs(u).max(axis=0)
    states = MISSED * np.abs(z).max(axis=0) + ROUNDING * largest
    level, rates = C @ states + D @ inputs, (A @ states + B @ inputs)[:, None]
    unfelt = np.divide(rates, B, out=np.full_like(B, np.inf), where=B > 0.0).min(axis=0, initial=np.inf)
    u = np.where((u < 0.0) & (u >= -unfelt), 0.0, u)
    y = np.where((y < 0.0) & (y >= -level), 0.0, y)
    missing = (u < 0.0) | (y < 0.0) | (np.abs(z @ system.C.T + u @ system.D.T - y) > level)
    for i in np.flatnonzero(missing.any(axis=1)).tolist():
        free = system.C @ z[i]
        mended = _corrected(system.D, free, u[i], level, missing[i])
        if mended is None:
            mended = _solved(system.D, free, u[i], level, missing[i])
        if mended is None:
            raise NotFoundError(
                f"at t = {t[i]:.12g} the pairs {np.flatnonzero(missing[i]).tolist()} miss y = Cx + Du + g, "
                "0 <= y _|_ u >= 0 by more than rounding, and no inputs that satisfy them were found: "
                "simulate by time stepping"
            )
        u[i], y[i] = mended
    return u, y


def _corrected(
    D: Matrix, free: Vector, u: Vector, level: Vector, missing: NDArray[np.bool_]
) -> tuple[Vector, Vector] | None:
    """Return u and y = free + D u at one time, the inputs other than zero changed by what the rows miss, or None."""
    held = u > 0.0
    left = np.where(missing, free + D @ u, 0.0)
    try:
        changed = u.copy()
        changed[held] -= np.linalg.solve(D[np.ix_(held, held)], left[held])
    except np.linalg.LinAlgError:
        return None
    slack = free + D @ changed
    y = np.where(held, 0.0, np.maximum(slack, 0.0))
    return (changed, y) if (changed >= 0.0).all() and (np.abs(slack - y) <= level).all() else None


def _solved(
    D: Matrix, free: Vector, u: Vector, level: Vector, missing: NDArray[np.bool_]
) -> tuple[Vector, Vector] | None:
    """Return u and y = free + D u at one time, the pairs that miss solved for, None where these are not unique."""
    while True:
        solved = np.flatnonzero(missing)
        others = np.where(missing, 0.0, u)
        block = D[np.ix_(solved, solved)]
        try:
            if not is_p_matrix(block):
                return None
            others[solved] = solve(LCP(block, (free + D @ others)[solved])).z
        except NumericalError:
            return None
        slack = free + D @ others
        y = np.where(others > 0.0, 0.0, np.maximum(slack, 0.0))
        still = (np.abs(slack - y) > level) | missing
        if np.array_equal(still, missing):
            return others, y
        missing = still
