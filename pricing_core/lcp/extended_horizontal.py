"""The extended horizontal linear complementarity problem, which every piecewise linear characteristic leads to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import Matrix, Vector, as_matrix, as_square_matrix, as_vector, check_list, check_type
from pricing_core.errors import InvalidInputError
from pricing_core.lcp.horizontal import HorizontalLCP, solve_horizontal


@dataclass(frozen=True, slots=True, eq=False)
class ExtendedHorizontalLCP:
    """Find x^0, ..., x^m >= 0 with C_0 x^0 = q + C_1 x^1 + ... + C_m x^m and, in each component, in turn.

    x^0 _|_ x^1, and x^j <= d_j with d_j - x^j _|_ x^(j+1) for j = 1, ..., m - 1: x^(j+1) starts where x^j is full.

    Parameters
    ----------
    blocks : sequence of array_like, m + 1 >= 2 of shape (n, n)
        C_0, ..., C_m.
    q : array_like, shape (n,)
    bounds : sequence of array_like, m - 1 of shape (n,)
        d_1, ..., d_(m-1) > 0.

    Raises
    ------
    InvalidInputError
        Shapes or numbers that do not fit, bounds that are not positive.
    """

    blocks: tuple[Matrix, ...]
    q: Vector  # (n,)
    bounds: tuple[Vector, ...]

    def __init__(self, blocks: Sequence[ArrayLike], q: ArrayLike, bounds: Sequence[ArrayLike] = ()) -> None:
        check_list("blocks", blocks)
        check_list("bounds", bounds)
        if len(blocks) < 2:
            raise InvalidInputError("blocks", f"{len(blocks)} matrices", "two matrices or more")
        first = as_square_matrix("blocks[0]", blocks[0])
        rest = (as_matrix(f"blocks[{j}]", block, first.shape) for j, block in enumerate(blocks[1:], 1))
        object.__setattr__(self, "blocks", (first, *rest))
        object.__setattr__(self, "q", as_vector("q", q, len(first)))
        if len(bounds) != len(blocks) - 2:
            raise InvalidInputError("bounds", f"{len(bounds)} vectors", f"{len(blocks) - 2} vectors")
        limits = tuple(as_vector(f"bounds[{j}]", bound, len(first)) for j, bound in enumerate(bounds))
        for j, limit in enumerate(limits):
            if not (limit > 0.0).all():
                raise InvalidInputError(f"bounds[{j}]", limit, "positive in every component")
        object.__setattr__(self, "bounds", limits)

    def to_horizontal(self) -> HorizontalLCP:
        """Return the horizontal LCP in w = (x^0, d_1 - x^1, ...) and z = (x^1, ..., x^m), of order m n."""
        n, m = self.q.size, len(self.blocks) - 1
        M, N = np.eye(m * n), np.zeros((m * n, m * n))
        M[:n, :n] = self.blocks[0]
        N[:n] = np.hstack(self.blocks[1:])
        N[n:, : (m - 1) * n] = -np.eye((m - 1) * n)
        return HorizontalLCP(M, N, np.concatenate([self.q, *self.bounds]))


class ExtendedHorizontalSolution(NamedTuple):
    """The vectors x^0, ..., x^m, the residual of the horizontal LCP, and the method that solved it."""

    x: tuple[Vector, ...]
    residual: float
    method: str


def solve_extended_horizontal(problem: ExtendedHorizontalLCP) -> ExtendedHorizontalSolution:
    """Solve an extended horizontal LCP; where the blocks have the column W-property it has one solution.

    Parameters
    ----------
    problem : ExtendedHorizontalLCP

    Raises
    ------
    NumericalError, InfeasibleError, RayTerminationError
        As `solve_horizontal`.

    Notes
    -----
    Source: Kaneko and Pang 1980; Sznajder and Gowda 1995.

    Examples
    --------
    The saturation u = -1 + x^1 <= 1 of y = -1 - x^0 + x^1 + x^2, met by the line y = 6 - 2 u:

    >>> problem = ExtendedHorizontalLCP([[[-1]], [[-3]], [[-1]]], [9], [[2]])
    >>> solve_extended_horizontal(problem).x
    (array([0.]), array([2.]), array([3.]))
    """
    check_type("problem", problem, ExtendedHorizontalLCP)
    n, m = problem.q.size, len(problem.blocks) - 1
    found = solve_horizontal(problem.to_horizontal())
    parts = tuple(found.z.reshape(m, n))
    return ExtendedHorizontalSolution((found.w[:n], *parts), found.residual, found.method)
