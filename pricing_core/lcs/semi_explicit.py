"""Complementarity systems in semi-explicit form (11.3), and their linearisation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Matrix, Vector, as_pair, as_values, as_whole_number, check_callable

Function: TypeAlias = Callable[[Vector, Vector], ArrayLike]
Jacobian: TypeAlias = Callable[[Vector, Vector], tuple[ArrayLike, ArrayLike]]

MOST_PAIRS = 100_000
DIFFERENCE = 1.5e-8  # square root of the rounding unit: of a variable, or of 1 where that is smaller


class Linearisation(NamedTuple):
    """The functions f and h and their derivatives at a point."""

    f: Vector  # (n,)
    h: Vector  # (k,)
    f_x: Matrix  # (n, n)
    f_u: Matrix  # (n, k)
    h_x: Matrix  # (k, n)
    h_u: Matrix  # (k, k)


@dataclass(frozen=True, slots=True, eq=False)
class SemiExplicitSystem:
    """x' = f(x, u), y = h(x, u), 0 <= y _|_ u >= 0 (11.3).

    Parameters
    ----------
    f : function of (x, u)
        Returns x', shape (n,). A dependence on time is one on a further state with the rate 1.
    h : function of (x, u)
        Returns y, shape (k,).
    pairs : int
        k.
    f_jacobian, h_jacobian : function of (x, u), optional
        Return the derivatives by x and by u: shapes (n, n) and (n, k), (k, n) and (k, k). Without them they are
        taken by differences, for x and u of order 1 or more: k + n more calls for each.

    Examples
    --------
    >>> system = SemiExplicitSystem(lambda x, u: u - x**2, lambda x, u: x, pairs=1)
    >>> system.linearised(np.array([3.0]), np.array([0.0])).f_x.round(6)
    array([[-6.]])
    """

    f: Function
    h: Function
    pairs: int
    f_jacobian: Jacobian | None = None
    h_jacobian: Jacobian | None = None

    def __post_init__(self) -> None:
        check_callable("f", self.f, "(x, u)")
        check_callable("h", self.h, "(x, u)")
        for name in ("f_jacobian", "h_jacobian"):
            if getattr(self, name) is not None:
                check_callable(name, getattr(self, name), "(x, u)")
        object.__setattr__(self, "pairs", as_whole_number("pairs", self.pairs, 1, MOST_PAIRS))

    def rate(self, x: Vector, u: Vector) -> Vector:
        """Return f(x, u), shape (n,)."""
        return as_values("f", self.f(x, u), (x.size,))

    def slack(self, x: Vector, u: Vector) -> Vector:
        """Return h(x, u), shape (k,)."""
        return as_values("h", self.h(x, u), (self.pairs,))

    def linearised(self, x: Vector, u: Vector) -> Linearisation:
        """Return f, h and their derivatives at (x, u)."""
        f, h = self.rate(x, u), self.slack(x, u)
        return Linearisation(
            f,
            h,
            *_derivatives("f_jacobian", self.f_jacobian, self.rate, f, x, u),
            *_derivatives("h_jacobian", self.h_jacobian, self.slack, h, x, u),
        )


def _derivatives(
    field: str,
    jacobian: Jacobian | None,
    function: Callable[[Vector, Vector], Vector],
    value: Vector,
    x: Vector,
    u: Vector,
) -> tuple[Matrix, Matrix]:
    """Return the derivatives of a function by x and by u."""
    if jacobian is not None:
        by_x, by_u = as_pair(field, jacobian(x, u))
        return (
            as_values(f"{field} by x", by_x, (value.size, x.size)),
            as_values(f"{field} by u", by_u, (value.size, u.size)),
        )
    return (
        _differences(lambda moved: function(moved, u), x, value),
        _differences(lambda moved: function(x, moved), u, value),
    )


def _differences(function: Callable[[Vector], Vector], at: Vector, value: Vector) -> Matrix:
    columns = np.empty((value.size, at.size))
    for i in range(at.size):
        moved = at.copy()
        moved[i] += DIFFERENCE * max(1.0, abs(at[i]))
        columns[:, i] = (function(moved) - value) / (moved[i] - at[i])
    return columns
