"""Eigenvectors and, for a reducible matrix, the generalised eigenmode."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import BoolVector, as_extended_number
from pricing_core.errors import InvalidInputError, NumericalError, Told
from pricing_core.max_plus.arcs import Arcs, IntVector, arcs_of, first_of_runs
from pricing_core.max_plus.class_order import largest_upstream
from pricing_core.max_plus.critical import critical_arcs, critical_components
from pricing_core.max_plus.howard import HowardSolution
from pricing_core.max_plus.matrices import EPSILON, TOP, Numbers, Scalar, as_square, zero_like
from pricing_core.max_plus.normal_form import longest_paths_at
from pricing_core.max_plus.scalars import as_number
from pricing_core.max_plus.spectrum import mean_of_circuits, plain, spectral_nodes


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
    return next(_vectors(A, None))


def eigenvectors(A: object, value: Scalar | None = None) -> Numbers:
    """Return vectors whose max-plus combinations are all eigenvectors of one eigenvalue: shape (n, k).

    One for each component of the critical graphs of the classes with that mean, largest entry 0; epsilon at the
    nodes to which no path leads from the component.

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
    vectors = list(_vectors(A, value))
    return np.column_stack(vectors)


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
    iteration, a longest-path problem, and a sweep over the cycle times.
    Source: Heidergott, Olsder, van der Woude 2006, section 3.3 (generalised eigenmode).

    Examples
    --------
    >>> mode = eigenmode([[3.0, -np.inf], [2.0, 4.0]])
    >>> mode.cycle_time, mode.offset
    (array([3., 4.]), array([0., 0.]))
    """
    matrix = as_square("A", A, top=False)
    graph = arcs_of(matrix)
    entryless = np.setdiff1d(np.arange(graph.size), graph.head)
    if entryless.size:
        raise InvalidInputError(
            "A", Told(f"row {entryless[0]} is epsilon"), "a matrix with an entry in every row"
        )
    solution = mean_of_circuits(graph)
    rates = largest_upstream(graph, solution.label, solution.ratio)
    alike = np.asarray(rates[graph.head] == rates[graph.tail])
    pacing = np.zeros(graph.size, dtype=np.bool_)
    pacing[critical_arcs(graph, solution, np.asarray(solution.ratio == rates)).head] = True
    levels = _Levels(*np.unique(rates, return_inverse=True))
    offset = levels.from_zero(longest_paths_at(graph, solution, rates, alike, pacing))
    return Eigenmode(rates, levels.put_late(graph.only(~alike), offset))


def _vectors(A: object, value: Scalar | None) -> Iterator[Numbers]:
    """Yield the eigenvectors of `eigenvectors` one by one."""
    graph = arcs_of(as_square("A", A, top=False))
    solution = mean_of_circuits(graph)
    own = _nodes_of(graph, solution, value)
    rate = solution.ratio[own].max()
    for component in critical_components(critical_arcs(graph, solution, own)):
        start = np.arange(graph.size) == component[0]
        reached = graph.reached_from(start)
        kept = np.asarray(reached[graph.head] & reached[graph.tail])
        yield longest_paths_at(graph, solution, np.full(graph.size, rate), kept, start)


def _nodes_of(graph: Arcs, solution: HowardSolution, value: Scalar | None) -> BoolVector:
    """Return the nodes of the classes whose mean is this eigenvalue."""
    spectral = spectral_nodes(graph, solution)
    if not spectral.any():
        raise NumericalError("A has no circuit, and no eigenvector but those of -inf")
    if value is None:
        largest = (solution.ratio - solution.error).max()
        return np.asarray(spectral & (solution.ratio + solution.error >= largest))
    if as_extended_number("value", value) == EPSILON:
        raise InvalidInputError("value", value, "finite: only columns of epsilon have eigenvectors of -inf")
    ratio = np.where(spectral, solution.ratio, TOP)
    wanted = as_number("value", value)
    own = np.asarray(spectral & (np.abs(ratio - wanted) <= solution.error))
    if not own.any():
        known = ", ".join(str(plain(one)) for one in np.unique(solution.ratio[spectral])[::-1])
        raise InvalidInputError("value", value, f"an eigenvalue of A; with circuits these are {known}")
    return own


@dataclass(frozen=True, slots=True, eq=False)
class _Levels:
    """The nodes by their rates."""

    rate: Numbers  # increasing
    level: IntVector  # (n,): the place of each node's rate in it

    def from_zero(self, offset: Numbers) -> Numbers:
        """Return the offsets with the largest of each level moved to 0."""
        top = np.full(self.rate.size, EPSILON, dtype=offset.dtype)
        np.maximum.at(top, self.level, offset)
        return np.asarray(offset - top[self.level])

    def put_late(self, arcs: Arcs, offset: Numbers) -> Numbers:
        """Return the offsets with each level so late that no node of a slower one makes it wait.

        Parameters
        ----------
        arcs : Arcs
            The arcs from lower levels to higher ones.
        """
        late = np.full(self.rate.size, zero_like(offset))
        order = np.argsort(self.level[arcs.head], kind="stable")
        wait = (arcs.weight + offset[arcs.tail] - self.rate[self.level[arcs.head]] - offset[arcs.head])[order]
        to, of = self.level[arcs.head][order], self.level[arcs.tail][order]
        first = first_of_runs(to)
        for begin, end in zip(first, np.append(first, to.size)[1:], strict=True):
            late[to[begin]] = max((wait[begin:end] + late[of[begin:end]]).max(), late[to[begin]])
        return np.asarray(offset + late[self.level])
