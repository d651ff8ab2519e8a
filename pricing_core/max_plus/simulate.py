"""The orbit of a max-plus linear system."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import as_whole_number
from pricing_core.errors import InvalidInputError, Told
from pricing_core.max_plus.algebra import product
from pricing_core.max_plus.matrices import Numbers, all_alike, as_matrix, as_square, as_vector, dense

LARGEST_STEPS = 10_000_000


@dataclass(frozen=True, slots=True, eq=False)
class MaxPlusTrajectory:
    """The states x(0), ..., x(K) and, where there is a C, y(0), ..., y(K).

    Parameters
    ----------
    x : array, shape (K + 1, n)
    y : array, shape (K + 1, p), or None
    """

    x: Numbers
    y: Numbers | None


def simulate(
    A: object, x0: object, steps: int, B: object = None, u: object = None, C: object = None
) -> MaxPlusTrajectory:
    """Run x(k+1) = A x(k) + B u(k), y(k) = C x(k), for k = 0 ... steps - 1.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, n)
    x0 : array_like, shape (n,)
        Times of the events with number 0; epsilon for an event that nothing has to wait for.
    steps : int
    B : array_like or scipy.sparse, shape (n, m), optional
        Only together with u.
    u : array_like, shape (steps, m), optional
        u[k] acts on x[k + 1].
    C : array_like or scipy.sparse, shape (p, n), optional

    Returns
    -------
    MaxPlusTrajectory

    Raises
    ------
    InvalidInputError
        Shapes do not fit, an entry is NaN or +inf, `steps` is no whole number >= 0, or B comes without u.
    NumericalError
        A time is beyond 1e150 in size.

    Notes
    -----
    Cost: one product of A and a vector per step. The times are exact if all data are, else floats.

    Examples
    --------
    >>> simulate([[3.0, 7.0], [2.0, 4.0]], [1.0, 0.0], 3).x
    array([[ 1.,  0.],
           [ 7.,  4.],
           [11.,  9.],
           [16., 13.]])
    """
    matrix = as_square("A", A, top=False)
    n = matrix.shape[0]
    steps = as_whole_number("steps", steps, 0, LARGEST_STEPS)
    if (B is None) != (u is None):
        raise InvalidInputError("u", Told("u alone" if B is None else "none"), "given together with B")
    pushed = None if B is None else _pushes(B, u, n, steps)
    matrix, (first, pushed) = all_alike(matrix, as_vector("x0", x0, n, top=False), pushed)
    states = [np.asarray(first)]
    for k in range(steps):
        following = np.asarray(product(matrix, states[-1]))
        states.append(following if pushed is None else np.maximum(following, pushed[k]))
    x = np.array(states)
    return MaxPlusTrajectory(x, None if C is None else _outputs(C, x))


def _pushes(B: object, u: object, n: int, steps: int) -> Numbers | None:
    """Return B u(k) for every k, shape (steps, n); None where there is no step."""
    matrix = as_matrix("B", B, top=False)
    if matrix.shape[0] != n:
        raise InvalidInputError("B", Told(f"shape {matrix.shape}"), f"a matrix with {n} rows")
    shape = (steps, matrix.shape[1])
    if not steps:
        return None
    inputs = dense(as_matrix("u", u, top=False))
    if inputs.shape != shape:
        raise InvalidInputError("u", Told(f"shape {inputs.shape}"), f"of shape {shape}: a row for each step")
    return dense(product(matrix, inputs.T)).T


def _outputs(C: object, x: Numbers) -> Numbers:
    matrix = as_matrix("C", C, top=False)
    if matrix.shape[1] != x.shape[1]:
        raise InvalidInputError("C", Told(f"shape {matrix.shape}"), f"a matrix with {x.shape[1]} columns")
    return dense(product(matrix, x.T)).T
