"""Newton's law of impact, for event-driven runs of mechanical systems."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pricing_core.arrays import IndexSet, Matrix, Vector
from pricing_core.lcp import LCP, least_norm_solution, solve


@dataclass(frozen=True, slots=True, eq=False)
class NewtonsLaw:
    """F v+ >= -e F v- where there is contact, with equality where there is an impulse.

    Parameters
    ----------
    normals : Matrix, shape (k, n)
        F.
    response : Matrix, shape (n, k)
        M^-1 F^T.
    restitution : float
        e.
    """

    normals: Matrix
    response: Matrix
    restitution: float
    _known: dict[IndexSet, tuple[Matrix, bool]] = field(default_factory=dict, init=False, repr=False)

    def __call__(self, before: Vector, after: Vector, contacts: IndexSet) -> tuple[Vector, Vector]:
        """Return the state after an impact, and the impulse: of least norm where that is open."""
        k, n = self.normals.shape
        index, v = list(contacts), before[n:]
        normals, response = self.normals[index], self.response[:, index]
        if contacts not in self._known:
            delassus = normals @ response
            is_open = len(index) > 1 and bool(np.linalg.matrix_rank(delassus) < len(index))
            self._known[contacts] = delassus, is_open
        delassus, is_open = self._known[contacts]
        q = (1.0 + self.restitution) * (normals @ v)
        if len(index) == 1 and delassus[0, 0] > 0.0:
            held = np.maximum(-q / delassus[0], 0.0)
        else:
            problem = LCP(delassus, q)
            held = solve(problem).z
            if is_open:
                held = least_norm_solution(problem, held)
        impulse = np.zeros(k)
        impulse[index] = held
        return np.concatenate([after[:n], v + response @ held]), impulse
