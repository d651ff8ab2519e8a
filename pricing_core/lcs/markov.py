"""The Markov parameters of a transfer matrix: D, CB, CAB, ..."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Matrix, as_whole_number, check_type
from pricing_core.lcs.rational_system import EXACT_SIZE, RationalSystem, rational_system
from pricing_core.lcs.system import LCS
from pricing_core.linalg.rational import RationalMatrix, from_flint, rounded, to_flint


class LeadingMarkovParameter(NamedTuple):
    """The first nonzero H_j in G(s) = H_0 + H_1 / s + H_2 / s**2 + ...

    Parameters
    ----------
    power : int
        j.
    matrix : Matrix, shape (k, k)
        H_j.
    """

    power: int  # j
    matrix: Matrix  # (k, k)


def markov_parameters(system: LCS, count: int) -> NDArray[np.float64]:
    """Return D, CB, CAB, ..., the coefficients of G(s) around infinity, shape (count, k, k).

    For n + k <= 24 they are computed in rational arithmetic and rounded once, so that zeros are zeros.

    Parameters
    ----------
    system : LCS
    count : int
        At least 0.

    Raises
    ------
    InvalidInputError
        `count` is negative.

    Notes
    -----
    Cost: count products of an (n, n) by an (n, k) matrix. Source: section 11.6.

    Examples
    --------
    1 / (s + 1) = 1/s - 1/s**2 + ...:

    >>> markov_parameters(LCS([[-1]], [[1]], [[1]]), 3).ravel()
    array([ 0.,  1., -1.])
    """
    check_type("system", system, LCS)
    count = as_whole_number("count", count, 0)
    n, k = system.shape
    if n + k <= EXACT_SIZE:
        exact = exact_markov_parameters(rational_system(system), count)
        return np.array([rounded(H) for H in exact]).reshape(count, k, k)
    parameters, response = [system.D], system.B
    for _ in range(1, count):
        parameters.append(system.C @ response)
        response = system.A @ response
    return np.array(parameters[:count]).reshape(count, k, k)


def exact_markov_parameters(system: RationalSystem, count: int) -> Iterator[RationalMatrix]:
    """Yield `count` Markov parameters as arrays of rationals, each of shape (k, k)."""
    A, response, C = to_flint(system.A), to_flint(system.B), to_flint(system.C)
    for power in range(count):
        if power == 0:
            yield system.D
            continue
        yield from_flint(C * response)
        if power + 1 < count:
            response = A * response


def leading_markov_parameter(system: LCS) -> LeadingMarkovParameter | None:
    """Return the first nonzero Markov parameter and its power j of 1/s, or None where G = 0; exact.

    Cost: up to n + 1 Markov parameters in rational arithmetic; if all of these vanish, so do the others
    (Cayley-Hamilton).

    Parameters
    ----------
    system : LCS

    Examples
    --------
    >>> leading_markov_parameter(LCS([[0, 1], [0, 0]], [[0], [3]], [[1, 0]]))
    LeadingMarkovParameter(power=2, matrix=array([[3.]]))
    """
    check_type("system", system, LCS)
    parameters = exact_markov_parameters(rational_system(system), system.shape[0] + 1)
    for power, H in enumerate(parameters):
        if H.any():
            return LeadingMarkovParameter(power, rounded(H))
    return None
