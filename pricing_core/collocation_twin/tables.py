"""The nodes of the collocation and of its integrals, and the interpolation between them."""

import functools
from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import leggauss

from pricing_core.arrays import Matrix, Vector


class Table(NamedTuple):
    """For polynomials in eta = sqrt(s/h), 0 <= eta <= 1.

    Parameters
    ----------
    eta : Vector, shape (m + 1,)
        The Chebyshev points, 0 and 1 among them.
    cosine, sine, weight : Vector, shape (n,)
        Age s_k cosine**2 and time s_k sine**2 of the integrals' nodes, and their weights of s_k. Both ends, the start
        and the boundary's own place, have root singularities: the substitution removes them.
    at_nodes : array, shape (m, n, m + 1)
        Values at eta_k * sine, k = 1, ..., m, from those at eta.
    at_end : Matrix, shape (n, m + 1)
        Those of k = m.
    """

    eta: Vector
    cosine: Vector
    sine: Vector
    weight: Vector
    at_nodes: Matrix
    at_end: Matrix


@functools.cache
def table(m: int, n: int) -> Table:
    """Return the table of degree m and n nodes in every integral."""
    eta = 0.5 * (1.0 - np.cos(np.pi * np.arange(m + 1) / m))
    points, weights = leggauss(n)
    angle = 0.25 * np.pi * (points + 1.0)
    cosine, sine = np.cos(angle), np.sin(angle)
    at_nodes = interpolation(eta, eta[1:, None] * sine)
    return Table(eta, cosine, sine, 0.5 * np.pi * weights * sine * cosine, at_nodes, at_nodes[-1])


def interpolation(eta: Vector, wanted: Matrix) -> Matrix:
    """Return the matrix that takes values at the Chebyshev points to those at `wanted`, shape (..., m + 1)."""
    m = eta.size - 1
    barycentric = (-1.0) ** np.arange(m + 1)
    barycentric[[0, -1]] *= 0.5
    distance = wanted[..., None] - eta
    hit = np.abs(distance) < 1e-14
    terms = barycentric / np.where(hit, 1.0, distance)
    return np.where(hit.any(-1, keepdims=True), hit, terms / terms.sum(-1, keepdims=True))
