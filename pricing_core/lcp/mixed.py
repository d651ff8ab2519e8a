"""The mixed linear complementarity problem: bounds on some unknowns, none on others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Matrix, Vector, as_array, as_vector
from pricing_core.errors import InvalidInputError
from pricing_core.linalg.coefficients import Coefficients, as_coefficients_or_operator, dense


@dataclass(frozen=True, slots=True, eq=False)
class MixedLCP:
    """Find z in [lower, upper] such that w = M z + q is >= 0 where z = lower, <= 0 where z = upper, and 0 between.

    It is the affine variational inequality on a box: with a symmetric M >= 0 the problem of least z'Mz/2 + q'z there.

    Parameters
    ----------
    M : array_like (n, n), scipy.sparse matrix or array (n, n), Tridiagonal, or scipy.sparse.linalg.LinearOperator
    q : array_like, shape (n,)
    lower, upper : float or array_like of shape (n,)
        lower <= upper; they may be infinite. An unknown between -inf and inf is free, and has the equation w = 0.

    Raises
    ------
    InvalidInputError
        Shapes that do not fit, entries of M or q that are not finite, or bounds that hold no number between them.

    Examples
    --------
    >>> problem = MixedLCP([[2.0, 1.0], [1.0, 2.0]], [-5.0, 1.0], [0.0, -np.inf], [1.0, np.inf])
    >>> problem.slack(np.array([1.0, -1.0]))
    array([-4.,  0.])
    """

    M: Coefficients  # (n, n)
    q: Vector  # (n,)
    lower: Vector  # (n,)
    upper: Vector  # (n,)

    def __init__(self, M: object, q: ArrayLike, lower: ArrayLike, upper: ArrayLike) -> None:
        object.__setattr__(self, "M", as_coefficients_or_operator("M", M))
        n = self.M.shape[0]
        object.__setattr__(self, "q", as_vector("q", q, n))
        object.__setattr__(self, "lower", _bounds("lower", lower, n, np.inf))
        object.__setattr__(self, "upper", _bounds("upper", upper, n, -np.inf))
        if (wrong := np.flatnonzero(self.lower > self.upper)).size:
            i = int(wrong[0])
            raise InvalidInputError(
                f"lower[{i}]", float(self.lower[i]), f"at most upper[{i}] = {self.upper[i]}"
            )

    @property
    def size(self) -> int:
        """The number of unknowns n."""
        return self.q.size

    def slack(self, z: Vector) -> Vector:
        """Return w = M z + q, shape (n,)."""
        if np.shape(z) != self.q.shape or np.asarray(z).dtype.kind not in "fiu":
            raise InvalidInputError("z", z, f"a vector of {self.q.size} numbers")
        return np.asarray(self.M @ z + self.q)

    def dense(self) -> Matrix:
        """Return M as an array, shape (n, n)."""
        return dense(self.M)


def _bounds(field: str, value: ArrayLike, n: int, excluded: float) -> Vector:
    raw = as_array(field, value)
    if raw.dtype.kind not in "fiu" or raw.shape not in {(), (n,)}:
        raise InvalidInputError(field, value, f"a number or a vector of {n} numbers")
    bounds = np.array(np.broadcast_to(raw, (n,)), dtype=np.float64)
    if np.isnan(bounds).any() or (bounds == excluded).any():
        raise InvalidInputError(field, value, f"numbers or {-excluded}")
    bounds.flags.writeable = False
    return bounds
