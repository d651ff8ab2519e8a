"""A local volatility in the cells of a grid: what it exceeds the number that stands for it by, in each step.

The variance is averaged over the cell around a node and over a step, so that kinks of the surface leave the error
regular: with an operator that is the mean of L over a step the march keeps second order (Magnus 1954).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pricing_core.american.book.segments import LocalTerms, Segment
from pricing_core.american.contracts.local_volatility import mean_weights
from pricing_core.arrays import Matrix, Vector


@dataclass(frozen=True, slots=True, eq=False)
class CellVolatility:
    """A local volatility at the N interior nodes of a grid.

    Parameters
    ----------
    times : Vector, shape (m,)
        Years from now.
    variance : Matrix, shape (m, N)
        sigma**2 at these times, averaged over cells.
    reference : float
        As in `LocalTerms`.
    """

    times: Vector
    variance: Matrix
    reference: float

    @classmethod
    def of(cls, local: LocalTerms, nodes: Vector) -> CellVolatility:
        """Interpolate a surface once, by Simpson's rule in every cell between N + 2 nodes, money."""
        middles = 0.5 * (nodes[1:] + nodes[:-1])
        size, surface = nodes.size - 2, local.volatility
        at = surface.at_nodes_of_time(np.concatenate([middles[:-1], nodes[1:-1], middles[1:]])) ** 2
        variance = (at[:, :size] + 4.0 * at[:, size : 2 * size] + at[:, 2 * size :]) / 6.0
        if surface.is_steady:
            return cls(surface.times[:1], variance[:1], local.reference)
        return cls(surface.times, variance, local.reference)

    def excess(self, weights: Vector) -> Vector:
        """Return that excess for a weighted mean of the variances at the times of the surface, shape (N,)."""
        excess: Vector = np.sqrt(weights @ self.variance) - self.reference
        return excess

    def weights_of_steps(self, segment: Segment, mesh: Vector) -> Matrix:
        """Return the weights of the times in the steps of a segment, shape (k, m); k = 1 where all steps are alike.

        Parameters
        ----------
        mesh : Vector
            Years before the segment's end, increasing.
        """
        weights = mean_weights(self.times, segment.end - mesh[1:], segment.end - mesh[:-1])
        return weights[:1] if (weights == weights[0]).all() else weights
