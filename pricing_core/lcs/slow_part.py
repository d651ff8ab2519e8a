"""Stiff modes: what is left of the flow once its fast part has died out."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from flint import arb_mat, ctx, fmpq
from numpy.typing import NDArray
from scipy.linalg import schur
from scipy.linalg.lapack import dtrsyl

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcs.mode_dynamics import ModeDynamics, longest_step
from pricing_core.lcs.mode_maps import ExactMaps, ModeMaps, coordinate_rows, without_rounding
from pricing_core.linalg.rational import RationalMatrix, rounded, to_flint

GAP = 4.0  # between the sizes of fast and slow eigenvalues
DAMPED = 1e-6  # damping of the fast ones, at the least
PRECISE = 1e3  # of fast to slow rates, from which on rounding of the fast ones is felt in the slow ones
DIGITS = 400  # binary, of the slow part of a stiff mode
ITERATIONS = 12
SHIFT = 1e-3  # of the threshold between fast and slow
LEAST_SHIFT = 1e-20  # of the fastest rate
DEAD = 1e-15  # share of the coordinates
KEPT_UP = 10.0  # times the error of the slow subspace's invariance
NOTHING = 1e-140  # in the form's units: a state so small has died out, and squares of it would underflow


@dataclass(frozen=True, slots=True, eq=False)
class SlowPart:
    """The invariant subspace of the eigenvalues that are not fast, and the dynamics on it.

    Parameters
    ----------
    dynamics : ModeDynamics
        The dynamics of the slow coordinates.
    take : Matrix, shape (d_slow, d)
        Coordinates to slow coordinates, along the fast subspace.
    back : Matrix, shape (d, d_slow)
    dead : float
        Share of the coordinates below which the fast part is no more than what rounding keeps up.
    """

    dynamics: ModeDynamics
    take: Matrix
    back: Matrix
    dead: float

    def is_all_of(self, c: Vector) -> bool:
        """Tell whether the fast part of these coordinates is no more than rounding."""
        fast = c - self.back @ (self.take @ c)
        return math.sqrt(fast @ fast) <= max(self.dead * math.sqrt(c @ c), NOTHING)


def slow_part(dynamics: ModeDynamics) -> SlowPart | None:
    """Split off the largest eigenvalues, in the left half plane, beyond the first gap of at least a factor 4.

    Where there is no such gap, but all are in the left half plane, nothing is left. Elsewhere None is returned: all
    eigenvalues set the step. Cost: one Schur form.

    Examples
    --------
    A fast and a slow decay, of which the slow one is left:

    >>> W, none = np.eye(2), np.zeros((0, 0, 2))
    >>> both = ModeDynamics((), np.eye(2), W, np.diag([-1e6, -1.0]), np.zeros((0, 2)), none, 2e-6)
    >>> slow_part(both).dynamics.rate, slow_part(both).dynamics.step
    (array([[-1.]]), 2.0)
    """
    threshold = _threshold(np.linalg.eigvals(dynamics.rate).astype(np.complex128))
    if threshold is None:
        return None
    triangular, Q, fast = schur(
        dynamics.rate, output="real", sort=lambda re, im: np.hypot(re, im) > threshold
    )
    slow_block = triangular[fast:, fast:]
    # Q [I, X; 0, I] takes the rate to diag(fast, slow).
    X = _coupling(triangular[:fast, :fast], slow_block, triangular[:fast, fast:])
    back = Q @ np.vstack([X, np.eye(slow_block.shape[0])])
    rows = coordinate_rows(back)
    scale = np.linalg.inv(back[rows])
    basis, take = back @ scale, np.linalg.solve(scale, Q[:, fast:].T)
    whole = (
        dynamics.basis @ basis,
        without_rounding(take @ dynamics.rate @ basis, np.abs(take) @ np.abs(dynamics.rate) @ np.abs(basis)),
        without_rounding(dynamics.outputs @ basis, dynamics.output_sizes @ np.abs(basis)),
    )
    exact, precise = None if dynamics.maps is None else dynamics.maps.exact, None
    largest = float(np.abs(dynamics.rate).max(initial=0.0))
    slowest = float(np.abs(np.linalg.eigvals(slow_block)).min(initial=math.inf))
    if exact is not None and largest > PRECISE * slowest:
        take, basis, precise = _refined(exact, take, basis, rows, threshold, largest)
        whole = rounded(precise.basis), rounded(precise.rate), rounded(precise.outputs)
    maps = ModeMaps(whole[0], take @ dynamics.coordinates, whole[1], whole[2], dynamics.impulses, precise)
    slow = replace(
        dynamics,
        basis=maps.basis,
        coordinates=maps.coordinates,
        rate=maps.rate,
        outputs=maps.outputs,
        step=longest_step(maps.rate),
        maps=maps,
    )
    left = float(np.linalg.norm(dynamics.rate @ basis - basis @ whole[1]))
    least = float(np.abs(np.linalg.eigvals(triangular[:fast, :fast])).min())
    return SlowPart(slow, take, basis, max(DEAD, KEPT_UP * left / least))


def _coupling(fast: Matrix, slow: Matrix, between: Matrix) -> Matrix:
    """Return X with fast X - X slow = -between, both triangular but for blocks of two."""
    if not slow.size:
        return np.zeros((fast.shape[0], 0))
    X, scale, _ = dtrsyl(fast, slow, -between, isgn=-1)
    return np.asarray(X / scale)


def _refined(
    exact: ExactMaps, rough: Matrix, back: Matrix, rows: list[int], threshold: float, largest: float
) -> tuple[Matrix, Matrix, ExactMaps]:
    """Return the maps of the slow subspace by inverse iteration with many digits, far more than a float has.

    In floating point the slow eigenvalues carry the rounding of the fast ones: also where what is fast consists of
    several groups, that are split off one after the other.
    """
    with ctx.workprec(DIGITS):
        rate, basis, outputs = (arb_mat(to_flint(part)) for part in exact)
        d = rate.nrows()
        shift = max(SHIFT * threshold, LEAST_SHIFT * largest)
        shifted = rate - arb_mat(np.diag(np.full(d, shift)).tolist())
        right, left = arb_mat(back.tolist()), arb_mat(rough.T.tolist())
        for _ in range(ITERATIONS):
            right = shifted.solve(right).mid()
            right = (right * _part(right, rows).inv()).mid()
            left = shifted.transpose().solve(left).mid()
            left = (left * (right.transpose() * left).inv()).mid()
        take = left.transpose()
        parts = (_rationals(part) for part in (take * rate * right, basis * right, outputs * right))
        return rounded(_rationals(take)), rounded(_rationals(right)), ExactMaps(*parts)


def _part(M: arb_mat, rows: list[int]) -> arb_mat:
    return arb_mat([[M[i, j] for j in range(M.ncols())] for i in rows])


def _rationals(M: arb_mat) -> RationalMatrix:
    """Return the middles of the entries."""
    found = np.empty((M.nrows(), M.ncols()), dtype=object)
    for place, entry in enumerate(M.entries()):
        mantissa, exponent = entry.mid().man_exp()
        found.flat[place] = fmpq(mantissa) * fmpq(2) ** int(exponent)
    return found


def _threshold(eigenvalues: NDArray[np.complex128]) -> float | None:
    """Return a size between the fast eigenvalues and the others, at the first gap from above; None without one."""
    order = np.argsort(-np.abs(eigenvalues))
    sizes = np.maximum(np.abs(eigenvalues[order]), np.finfo(float).tiny)
    for i in range(1, sizes.size + 1):
        following = sizes[i] if i < sizes.size else 0.0
        if sizes[i - 1] > GAP * following:
            fast = eigenvalues[order[:i]]
            decays = np.all(fast.real < -DAMPED * np.abs(fast))
            return float(np.sqrt(sizes[i - 1]) * np.sqrt(following)) if decays else None
    return None
