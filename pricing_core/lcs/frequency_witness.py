"""A complex frequency at which a system delivers energy: the proof that it is not passive."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from flint import fmpq
from numpy.typing import NDArray

from pricing_core.arrays import Matrix
from pricing_core.lcs.rational_system import RationalSystem
from pricing_core.linalg.rational import exact_solution, rational_array, rounded

FREQUENCIES = np.logspace(-4.0, 4.0, 161)  # in units in which the data are of order 1
DAMPINGS = (1.0, 1e-3, 1e-6, 1e-9)
# Negative share of |G| that is more than rounding.
SMALLEST_SHARE = -1e-12
TRIALS = 5


class FrequencyWitness(NamedTuple):
    """Re v^* G(s) v < 0 at an s with Re s > 0, proved in rational arithmetic.

    (11.6) with Q > 0 would make it at least Re s times x^* Q x for x = (sI - A)^-1 B v.

    Parameters
    ----------
    s : complex
        Point in the right half plane.
    v : ndarray of complex, shape (k,)
    value : float
        Re v^* G(s) v, rounded; it is below 0.
    """

    s: complex
    v: NDArray[np.complex128]  # (k,)
    value: float


def frequency_witness(system: RationalSystem, near: Sequence[float] = ()) -> FrequencyWitness | None:
    """Return a witness, or None where none was found; the data should be of order 1.

    Numbers near the poles, along the imaginary axis and near the given frequencies are tried in floating point, the
    best of them proved.

    Cost: about a thousand eigenvalue problems of order k.

    Examples
    --------
    >>> from pricing_core.lcs import LCS
    >>> from pricing_core.lcs.rational_system import rational_system
    >>> frequency_witness(rational_system(LCS([[-1]], [[1]], [[-1]]))).value < 0
    True
    """
    A, B, C, D = (rounded(M) for M in system)
    n = A.shape[0]
    found: list[tuple[float, complex, NDArray[np.complex128]]] = []
    for s in _candidates(A, near):
        try:
            G = C @ np.linalg.solve(s * np.eye(n) - A, B) + D
        except np.linalg.LinAlgError:
            continue
        values, vectors = np.linalg.eigh(G + G.conj().T)
        share = values[0] / max(float(np.max(np.abs(G), initial=0.0)), 1e-300)
        if share < SMALLEST_SHARE:
            found.append((float(share), s, vectors[:, 0]))
    for _, s, v in sorted(found, key=lambda item: item[0])[:TRIALS]:
        value = _supplied(system, s, v)
        if value is not None and value < 0:
            return FrequencyWitness(s, v, float(value))
    return None


def _candidates(A: Matrix, near: Sequence[float]) -> list[complex]:
    poles = np.linalg.eigvals(A)
    heights = np.concatenate([[0.0], near, FREQUENCIES, np.abs(poles.imag)])
    starts = np.concatenate([np.zeros_like(heights), np.maximum(poles.real, 0.0)])
    heights = np.concatenate([heights, np.abs(poles.imag)])
    along = [complex(a + d, b) for a, b in zip(starts, heights, strict=True) for d in DAMPINGS]
    return along + [complex(a, 0.0) for a in FREQUENCIES]


def _supplied(system: RationalSystem, s: complex, v: NDArray[np.complex128]) -> fmpq | None:
    """Return Re v^* G(s) v exactly, from the real and imaginary parts of (sI - A) x = B v; None at a pole."""
    A, B, C, D = system
    n = A.shape[0]
    sigma, omega = rational_array(np.array([s.real, s.imag]))
    identity = rational_array(np.eye(n, dtype=int))
    resolvent = np.block(
        [[sigma * identity - A, -omega * identity], [omega * identity, sigma * identity - A]]
    )
    real, imaginary = rational_array(v.real), rational_array(v.imag)
    right = np.concatenate([B @ real, B @ imaginary])[:, None]
    x = exact_solution(resolvent, right)
    if x is None:
        return None
    first, second = C @ x[:n, 0] + D @ real, C @ x[n:, 0] + D @ imaginary
    return fmpq(real @ first + imaginary @ second)
