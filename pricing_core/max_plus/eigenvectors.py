"""Eigenvectors and, for a reducible matrix, the generalised eigenmode."""

from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import BoolVector
from pricing_core.errors import InvalidInputError, NumericalError, Told
from pricing_core.max_plus.arcs import Arcs, arcs_of
from pricing_core.max_plus.critical import critical_arcs, critical_components
from pricing_core.max_plus.howard import HowardSolution
from pricing_core.max_plus.longest_paths import longest_paths
from pricing_core.max_plus.matrices import EPSILON, Numbers, Scalar, as_square, zero_like
from pricing_core.max_plus.spectrum import loudest, mean_of_circuits, plain, spectral_nodes


@dataclass(frozen=True, slots=True, eq=False)
class Eigenmode:
    """A solution x(k) = k cycle_time + offset of x(k+1) = A x(k), for all k >= 0.

    Parameters
    ----------
    cycle_time, offset : array, shape (n,)
    """

    cycle_time: Numbers
    offset: Numbers


def eigenvector(A: object) -> Numbers:
    """Return a solution of A v = lambda + v for the largest circuit mean lambda, its largest entry 0: shape (n,).

    It is the first column of `eigenvectors(A)`; all entries are finite if A is irreducible.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, n)
        Entries are finite or epsilon.

    Raises
    ------
    InvalidInputError
        A is not square, is empty, or an entry is NaN or +inf.
    NumericalError
        A has no circuit.

    Examples
    --------
    >>> eigenvector([[3.0, 7.0], [2.0, 4.0]])
    array([ 0. , -2.5])
    """
    found: Numbers = eigenvectors(A)[:, 0]
    return found


def eigenvectors(A: object, value: Scalar | None = None) -> Numbers:
    """Return vectors whose max-plus combinations are all eigenvectors of one eigenvalue: shape (n, k).

    One for each component of the critical graphs of the classes with that mean, largest entry 0; epsilon at the
    nodes that do not hear of the component.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, n)
        Entries are finite or epsilon.
    value : float or Fraction, optional
        A finite one of `eigenvalues(A)`. Default: the largest.

    Raises
    ------
    InvalidInputError
        `value` is no eigenvalue; or as for `eigenvector`.
    NumericalError
        A has no circuit.

    Notes
    -----
    They are columns of (A - lambda)*. Cost: Howard's iteration and k longest-path problems.
    Source: Baccelli, Cohen, Olsder, Quadrat 1992, Theorem 3.101; Butkovič 2010, section 4.6.

    Examples
    --------
    >>> eigenvectors([[5.0, -np.inf], [0.0, 3.0]], 3.0)
    array([[-inf],
           [  0.]])
    >>> eigenvectors([[2.0, 0.0], [1.0, 2.0]])
    array([[ 0., -2.],
           [-1.,  0.]])
    """
    matrix = as_square("A", A, top=False)
    graph = arcs_of(matrix)
    solution = mean_of_circuits(graph)
    spectral = spectral_nodes(graph, solution)
    if not spectral.any():
        raise NumericalError("A has no circuit, and no eigenvector but those of -inf")
    wanted = solution.ratio.max() if value is None else value
    own = spectral & (np.abs(_finite(solution.ratio) - wanted) <= 2 * solution.tolerance)
    if not own.any():
        known = ", ".join(str(plain(one)) for one in np.unique(solution.ratio[spectral])[::-1])
        raise InvalidInputError("value", wanted, f"an eigenvalue of A; with circuits these are {known}")
    rate = solution.ratio[own].max()
    return _columns(graph, solution, own, rate)


def eigenmode(A: object) -> Eigenmode:
    """Return x(k) = k eta + v with x(k+1) = A x(k) for all k >= 0: eta is the cycle-time vector.

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (n, n)
        Every row has an entry; entries are finite or epsilon. A may be reducible.

    Raises
    ------
    InvalidInputError
        A row is epsilon; A is not square, is empty, or an entry is NaN or +inf.

    Notes
    -----
    Nodes of one cycle time are solved together and then put late enough for all slower ones. Cost: Howard's
    iteration and a longest-path problem for each cycle time.
    Source: Heidergott, Olsder, van der Woude 2006, section 3.3 (generalised eigenmode).

    Examples
    --------
    >>> mode = eigenmode([[3.0, -np.inf], [2.0, 4.0]])
    >>> mode.cycle_time, mode.offset
    (array([3., 4.]), array([0., 0.]))
    """
    matrix = as_square("A", A, top=False)
    graph = arcs_of(matrix)
    unheard = np.setdiff1d(np.arange(graph.size), graph.head)
    if unheard.size:
        raise InvalidInputError(
            "A", Told(f"row {unheard[0]} is epsilon"), "a matrix with an entry in every row"
        )
    solution = mean_of_circuits(graph)
    rates = loudest(graph, solution.ratio)
    offset = np.full(graph.size, zero_like(matrix))
    placed = np.zeros(graph.size, dtype=np.bool_)
    for rate in np.unique(rates):
        level = np.asarray(rates == rate)
        offset[level] = _mode_of_level(graph, solution, level, rate)[level]
        late = _wait_for(graph, level, placed, offset, rate)
        offset[level] += late
        placed |= level
    return Eigenmode(rates, offset)


def _columns(graph: Arcs, solution: HowardSolution, own: BoolVector, rate: Scalar) -> Numbers:
    components = critical_components(critical_arcs(graph.among(own), solution))
    columns = []
    for component in components:
        start = np.full(graph.size, EPSILON, dtype=graph.weight.dtype)
        start[component[0]] = zero_like(graph.weight)
        heard = graph.reached_from(np.asarray(start != EPSILON))
        found = _paths(graph.among(heard), start, rate, solution)
        columns.append(found - found.max())
    return np.column_stack(columns)


def _paths(graph: Arcs, start: Numbers, rate: Scalar, solution: HowardSolution) -> Numbers:
    tolerance = 2 * graph.size * solution.tolerance
    return longest_paths(graph.weighing(graph.weight - rate), start, tolerance)


def _mode_of_level(graph: Arcs, solution: HowardSolution, level: BoolVector, rate: Scalar) -> Numbers:
    inside = graph.among(level)
    own = np.asarray(level & (solution.ratio == rate))
    critical = np.unique(critical_arcs(inside.among(own), solution).head)
    start = np.full(graph.size, EPSILON, dtype=graph.weight.dtype)
    start[critical] = zero_like(graph.weight)
    found = _paths(inside, start, rate, solution)
    return np.asarray(found - np.max(found[level]))


def _wait_for(graph: Arcs, level: BoolVector, placed: BoolVector, offset: Numbers, rate: Scalar) -> Scalar:
    """Return by how much the nodes of a level must be later, so that no slower node makes them wait."""
    arcs = graph.only(level[graph.head] & placed[graph.tail])
    late = arcs.weight + offset[arcs.tail] - rate - offset[arcs.head]
    found: Scalar = max(late.max(), zero_like(offset)) if late.size else zero_like(offset)
    return found


def _finite(ratio: Numbers) -> Numbers:
    """Return the ratios with inf in the place of -inf, which is a distance from every number."""
    return np.where(ratio == EPSILON, np.inf, ratio)
