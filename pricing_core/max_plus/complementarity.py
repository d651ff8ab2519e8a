"""Max and min as complementarity (11.66)-(11.67): a max-plus step is a linear complementarity problem.

z = max(x, y) says that z = x + a = y + b with 0 <= a _|_ b >= 0. (The text prints b <= 0 in (11.67): then
x <= z <= y, and for x > y there would be no z.) Eliminating z leaves b = a + (x - y), an LCP with M = 1.

The maximum of m numbers takes m - 1 such pairs, one after the other: z = c_1 + a_2 + ... + a_m with
b_k = c_1 + a_2 + ... + a_k - c_k. Then M is lower triangular with ones on its diagonal: a P-matrix, so that the
LCP has exactly one solution, and z is the maximum. The minimum is the same with a taken away. Whatever is put
together from max, min, sums and scaling leads to such an M, since a pair depends only on the pairs inside it.
See `pricing_core.max_plus.vertical` for the other form, one row with m choices.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import Matrix, Vector, as_whole_number
from pricing_core.arrays import as_vector as as_finite_vector
from pricing_core.errors import InvalidInputError, Told
from pricing_core.lcp import LCP, solve
from pricing_core.max_plus.expressions import (
    Constant,
    Expression,
    Largest,
    Least,
    Sum,
    Variable,
    as_expression,
    values_of,
    with_parts,
)
from pricing_core.max_plus.matrices import EPSILON, as_floats, as_matrix, as_vector, dense


@dataclass(frozen=True, slots=True, eq=False)
class ComplementaritySystem:
    """x(k+1) = A v + B a + f, b = C v + D a + g, 0 <= a _|_ b >= 0, with v = (x(k), u(k)).

    Parameters
    ----------
    A, B, C, D : array, shapes (n, n + m), (n, l), (l, n + m), (l, l)
        D is lower triangular with a unit diagonal.
    f, g : array, shapes (n,), (l,)
    """

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    f: Vector
    g: Vector

    def problem(self, v: Vector) -> LCP:
        """Return the problem of one step, 0 <= a _|_ D a + (C v + g) >= 0."""
        return LCP(self.D, self.C @ self._checked(v) + self.g)

    def step(self, v: Vector) -> Vector:
        """Return x(k+1), by the solution of `problem(v)`, shape (n,)."""
        return self.following(v, solve(self.problem(v)).z)

    def following(self, v: Vector, a: Vector) -> Vector:
        """Return x(k+1) for a solution a of the problem, shape (n,)."""
        multipliers = as_finite_vector("a", a, self.B.shape[1])
        return np.asarray(self.A @ self._checked(v) + self.B @ multipliers + self.f)

    def _checked(self, v: Vector) -> Vector:
        return as_finite_vector("v", v, self.A.shape[1])


@dataclass(frozen=True, slots=True, eq=False)
class MaxMinPlusScalingSystem:
    """x_i(k+1) = expression i of (x(k), u(k)), built from max, min, plus and scaling.

    Parameters
    ----------
    expressions : sequence of n Expression or float
        Variables 0 ... n - 1 are the state, n ... n + m - 1 the input.
    inputs : int
        m >= 0.

    Raises
    ------
    InvalidInputError
        There is no expression, or one has a variable beyond n + m.

    Notes
    -----
    Source: De Schutter, van den Boom 2001 (MMPS systems); Heemels, De Schutter, Bemporad 2001 (their equivalence
    to complementarity systems).

    Examples
    --------
    >>> from pricing_core.max_plus.expressions import largest, variables
    >>> x = variables(2)
    >>> system = MaxMinPlusScalingSystem([largest(x[0], x[1] + 2.0) * 0.5, x[0]])
    >>> system.step(np.array([4.0, 6.0])), system.complementarity().step(np.array([4.0, 6.0]))
    (array([4., 4.]), array([4., 4.]))
    """

    expressions: tuple[Expression, ...]
    inputs: int

    def __init__(self, expressions: Sequence[Expression | float], inputs: int = 0) -> None:
        if not isinstance(expressions, Sequence) or isinstance(expressions, str):
            raise InvalidInputError("expressions", expressions, "a list of expressions, one for each state")
        own = tuple(as_expression(one) for one in expressions)
        if not own:
            raise InvalidInputError("expressions", Told("none"), "one for each state")
        object.__setattr__(self, "expressions", own)
        object.__setattr__(self, "inputs", as_whole_number("inputs", inputs, 0))
        size = len(own) + self.inputs
        for one in with_parts(own):
            if isinstance(one, Variable) and not 0 <= one.index < size:
                raise InvalidInputError("expressions", Told(f"variable {one.index}"), f"below {size}")

    def step(self, v: Vector) -> Vector:
        """Return x(k+1) by direct evaluation at v = (x(k), u(k)), shape (n,).

        Raises
        ------
        InvalidInputError
            v has another length than n + m, or is not finite.
        """
        return np.array(
            values_of(self.expressions, as_finite_vector("v", v, len(self.expressions) + self.inputs))
        )

    def complementarity(self) -> ComplementaritySystem:
        """Return the same system with a complementary pair in the place of each binary max and min."""
        pairs = _Pairs(len(self.expressions) + self.inputs, [])
        rows = pairs.forms(self.expressions)
        return _system(rows, pairs)


@dataclass(frozen=True, slots=True, eq=False)
class StepProblem:
    """One step x(k+1) = A x(k) as an LCP, and the way back from its solution.

    Parameters
    ----------
    problem : LCP
        A problem of size (number of entries of A) - n.
    system : ComplementaritySystem
    state : array, shape (n,)
        x(k)
    """

    problem: LCP
    system: ComplementaritySystem
    state: Vector

    def following(self, z: Vector) -> Vector:
        """Return x(k+1) for the solution z of the problem, shape (n,)."""
        return self.system.following(self.state, z)


def as_lcp(A: object, x: object) -> StepProblem:
    """Return the max-plus product A x as a linear complementarity problem (11.66)-(11.67).

    Parameters
    ----------
    A : array_like or scipy.sparse, shape (p, n)
        Finite or epsilon, with an entry in every row.
    x : array_like, shape (n,)
        Finite.

    Returns
    -------
    StepProblem
        `.problem` goes to any solver of `pricing_core.lcp`; `.following(z)` is A x.

    Raises
    ------
    InvalidInputError
        A row is epsilon: its maximum is no number; shapes do not fit, or entries are not finite.

    Notes
    -----
    The matrix is lower triangular with ones on its diagonal: every method for P-matrices solves it.

    Examples
    --------
    >>> from pricing_core.lcp import solve
    >>> step = as_lcp([[3.0, 7.0], [2.0, 4.0]], [1.0, 0.0])
    >>> step.following(solve(step.problem).z)
    array([7., 4.])
    """
    matrix = as_floats(dense(as_matrix("A", A, top=False)))
    empty = np.flatnonzero((matrix == EPSILON).all(axis=1))
    if empty.size:
        raise InvalidInputError(
            "A", Told(f"row {empty[0]} is epsilon"), "a matrix with an entry in every row"
        )
    state = as_floats(as_vector("x", x, matrix.shape[1], top=False))
    if (state == EPSILON).any():
        raise InvalidInputError("x", Told("-inf in it"), "finite: an LCP knows no epsilon")
    pairs = _Pairs(matrix.shape[1], [])
    rows = pairs.forms([_row(row) for row in matrix.tolist()])
    system = _system(rows, pairs)
    return StepProblem(system.problem(state), system, state)


def _row(weights: Sequence[float]) -> Expression:
    """Return the maximum of weight + x_j over the entries of a row."""
    return Largest(tuple(Variable(j) + weight for j, weight in enumerate(weights) if weight != EPSILON))


@dataclass(frozen=True, slots=True, eq=False)
class _Form:
    """The linear form state v + sum of slack[k] a_k + constant."""

    state: Vector
    slack: dict[int, float]
    constant: float

    def plus(self, other: _Form, factor: float) -> _Form:
        keys = self.slack.keys() | other.slack.keys()
        slack = {k: self.slack.get(k, 0.0) + factor * other.slack.get(k, 0.0) for k in keys}
        return _Form(self.state + factor * other.state, slack, self.constant + factor * other.constant)

    def with_pair(self, k: int, sign: float) -> _Form:
        return _Form(self.state, self.slack | {k: sign}, self.constant)


@dataclass(frozen=True, slots=True, eq=False)
class _Pairs:
    """The pairs that have been made so far; `slacks` are their b."""

    size: int
    slacks: list[_Form]

    def forms(self, expressions: Sequence[Expression]) -> list[_Form]:
        """Return expressions as affine functions of v and of pairs that are made here, once for what they share."""
        made: dict[int, _Form] = {}
        for one in with_parts(expressions):
            made[id(one)] = self._form(one, [made[id(part)] for part in one.parts])
        return [made[id(one)] for one in expressions]

    def _form(self, expression: Expression, parts: Sequence[_Form]) -> _Form:
        match expression:
            case Variable(index):
                return _Form(np.eye(self.size)[index], {}, 0.0)
            case Sum(_, factors):
                total = _Form(np.zeros(self.size), {}, 0.0)
                for part, factor in zip(parts, factors, strict=True):
                    total = total.plus(part, factor)
                return total
            case Largest():
                return self._extremum(parts, 1.0)
            case Least():
                return self._extremum(parts, -1.0)
            case Constant(number):
                return _Form(np.zeros(self.size), {}, number)
        raise InvalidInputError(
            "expressions", Told(type(expression).__name__), "of max, min, plus and scaling"
        )

    def _extremum(self, forms: Sequence[_Form], sign: float) -> _Form:
        """Chain the terms: z = x + sign a, b = a + sign (x - y) for the next term y (11.67)."""
        reached = forms[0]
        for following in forms[1:]:
            k = len(self.slacks)
            zero = _Form(np.zeros(self.size), {}, 0.0)
            apart = zero.plus(reached, sign).plus(following, -sign)
            self.slacks.append(apart.with_pair(k, 1.0))
            reached = reached.with_pair(k, sign)
        return reached


def _system(rows: Sequence[_Form], pairs: _Pairs) -> ComplementaritySystem:
    A, B, f = _stacked(rows, pairs.size, len(pairs.slacks))
    C, D, g = _stacked(pairs.slacks, pairs.size, len(pairs.slacks))
    return ComplementaritySystem(A, B, C, D, f, g)


def _stacked(forms: Sequence[_Form], size: int, count: int) -> tuple[Matrix, Matrix, Vector]:
    """Return the matrices of the forms in v and in a, and their constants."""
    in_slacks = np.zeros((len(forms), count))
    for i, form in enumerate(forms):
        for k, factor in form.slack.items():
            in_slacks[i, k] = factor
    in_state = np.array([form.state for form in forms]).reshape(len(forms), size)
    return in_state, in_slacks, np.array([form.constant for form in forms])
