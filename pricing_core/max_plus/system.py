"""Max-plus linear systems: x(k+1) = A x(k) + B u(k), y(k) = C x(k) + D u(k)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pricing_core.errors import InvalidInputError, NumericalError, Told
from pricing_core.max_plus.algebra import identity, multiply
from pricing_core.max_plus.arcs import arcs_of
from pricing_core.max_plus.circuits import named
from pricing_core.max_plus.divergence import diverging_circuit
from pricing_core.max_plus.matrices import Numbers, all_alike, as_matrix, as_square, dense, epsilon, zero_like
from pricing_core.max_plus.star import star


@dataclass(frozen=True, slots=True, eq=False)
class MaxPlusSystem:
    """x(k+1) = A x(k) + B u(k), y(k) = C x(k) + D u(k), with + the maximum and products sums.

    All four are exact if all that are told are, else floats.

    x_i(k) is the time at which event i happens for the k-th time.

    Parameters
    ----------
    A : array_like, shape (n, n)
    B : array_like, shape (n, m), optional
        Default: no input, a column of epsilon.
    C : array_like, shape (p, n), optional
        Default: the identity, every state is seen.
    D : array_like, shape (p, m), optional
        Default: epsilon.

    Raises
    ------
    InvalidInputError
        Shapes do not fit, an entry is NaN or +inf.

    Examples
    --------
    >>> MaxPlusSystem([[3.0, 7.0], [2.0, 4.0]]).C
    array([[  0., -inf],
           [-inf,   0.]])
    """

    A: Numbers  # (n, n)
    B: Numbers  # (n, m)
    C: Numbers  # (p, n)
    D: Numbers  # (p, m)

    def __init__(self, A: object, B: object = None, C: object = None, D: object = None) -> None:
        own = dense(as_square("A", A, top=False))
        n = len(own)
        inputs = None if B is None else _block("B", B, rows=n)
        outputs = None if C is None else _block("C", C, columns=n)
        shape = n if outputs is None else len(outputs), 1 if inputs is None else inputs.shape[1]
        direct = None if D is None else _block("D", D, *shape)
        own, given = all_alike(own, inputs, outputs, direct)
        defaults = epsilon((n, 1), own), dense(identity(n, like=own)), epsilon(shape, own)
        rest = [default if told is None else told for told, default in zip(given, defaults, strict=True)]
        for name, value in zip("ABCD", (own, *rest), strict=True):
            value.flags.writeable = False
            object.__setattr__(self, name, value)

    @property
    def shape(self) -> tuple[int, int, int]:
        """(n, m, p): the numbers of states, inputs and outputs."""
        return len(self.A), self.B.shape[1], len(self.C)


@dataclass(frozen=True, slots=True, eq=False)
class ImplicitSystem:
    """x(k) = A0 x(k) + A1 x(k-1) + ... + Aq x(k-q) + B u(k-1), y(k) = C x(k).

    Parameters
    ----------
    A : sequence of q + 1 array_like, shape (n, n)
        A0, A1, ..., Aq with q >= 1.
    B, C : array_like, shapes (n, m) and (p, n), optional
        As in `MaxPlusSystem`.
    names : sequence of str, optional
        Names of the states, for messages.

    Raises
    ------
    InvalidInputError
        Shapes do not fit, an entry is NaN or +inf, or there is no A1.
    """

    A: tuple[Numbers, ...]  # q + 1 of (n, n)
    B: Numbers | None  # (n, m)
    C: Numbers | None  # (p, n)
    names: tuple[str, ...]

    def __init__(
        self, A: Sequence[object], B: object = None, C: object = None, names: Sequence[str] = ()
    ) -> None:
        if isinstance(A, str) or not (isinstance(A, Sequence) or np.ndim(A) == 3):
            raise InvalidInputError("A", A, "a list of matrices A0, A1, ...")
        if len(A) < 2:
            raise InvalidInputError("A", Told(f"{len(A)} matrices"), "at least A0 and A1")
        first = dense(as_square("A[0]", A[0], top=False))
        n = len(first)
        later = [_block(f"A[{k}]", A[k], n, n) for k in range(1, len(A))]
        ends = None if B is None else _block("B", B, rows=n), None if C is None else _block("C", C, columns=n)
        first, (inputs, outputs, *rest) = all_alike(first, *ends, *later)
        if isinstance(names, str) or not isinstance(names, Sequence) or len(names) not in (0, n):
            raise InvalidInputError("names", names, f"a list of names, one for each of {n} states")
        object.__setattr__(self, "A", (first, *rest))
        object.__setattr__(self, "B", inputs)
        object.__setattr__(self, "C", outputs)
        object.__setattr__(self, "names", tuple(str(name) for name in names or range(n)))

    def explicit(self) -> MaxPlusSystem:
        """Return the first-order system with the same x and y: shape q n, the state above its past.

        x(k) = A0* (A1 x(k-1) + ... + B u(k-1)) by the star; then (x(k), ..., x(k-q+1)) is the state.

        Raises
        ------
        NumericalError
            A circuit of A0 has a positive weight, so that its events would wait for themselves: it is named.

        Notes
        -----
        Where a circuit of A0 has the weight 0 exactly, this is the least solution of several.
        Source: Baccelli, Cohen, Olsder, Quadrat 1992, section 2.5.3. Cost: O((q n)**3).

        Examples
        --------
        >>> E = -np.inf
        >>> ImplicitSystem(([[E, E], [2.0, E]], [[3.0, 7.0], [E, E]])).explicit().A
        array([[3., 7.],
               [5., 9.]])
        """
        closed = self._star()
        n, order = len(closed), len(self.A) - 1
        steps = [dense(multiply(closed, one)) for one in self.A[1:]]
        A = epsilon((n * order, n * order), closed)
        A[:n] = np.hstack(steps)
        past = np.arange(n * (order - 1))
        A[n + past, past] = zero_like(closed)
        B = None if self.B is None else _below(dense(multiply(closed, self.B)), n * order)
        seen = dense(identity(n, like=closed)) if self.C is None else self.C
        C = _below(seen.T, n * order).T
        return MaxPlusSystem(A, B, C)

    def _star(self) -> Numbers:
        circuit = diverging_circuit(arcs_of(self.A[0]))
        if circuit:
            raise NumericalError(
                f"the circuit {named(circuit, self.names)} of A0 has a positive weight: its events wait for "
                "themselves and never happen; move an arc of it to A1"
            )
        return dense(star(self.A[0]))


def as_system(field: str, value: object) -> MaxPlusSystem:
    """Return a system unchanged, or raise where it is none.

    Raises
    ------
    InvalidInputError
        It is something else.
    """
    if not isinstance(value, MaxPlusSystem):
        raise InvalidInputError(field, value, "a MaxPlusSystem")
    return value


def _below(top: Numbers, rows: int) -> Numbers:
    """Return the matrix with rows of epsilon below, so that there are `rows`."""
    return np.vstack([top, epsilon((rows - len(top), top.shape[1]), top)])


def _block(field: str, M: object, rows: int | None = None, columns: int | None = None) -> Numbers:
    matrix = dense(as_matrix(field, M, top=False))
    for wanted, found, what in ((rows, matrix.shape[0], "rows"), (columns, matrix.shape[1], "columns")):
        if wanted is not None and found != wanted:
            raise InvalidInputError(field, Told(f"shape {matrix.shape}"), f"a matrix with {wanted} {what}")
    return matrix
