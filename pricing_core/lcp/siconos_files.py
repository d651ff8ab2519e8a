"""The data files of Siconos' numerics: numbers separated by white space, matrices column by column."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import InvalidInputError
from pricing_core.lcp.mixed import MixedLCP
from pricing_core.lcp.problem import LCP, Problem

DENSE, BLOCKS = 0, 1  # how a file says that a matrix is stored


def read_siconos_lcp(text: str, name: str) -> LCP:
    """Return the problem of a file with the order, M and q.

    Examples
    --------
    >>> read_siconos_lcp("2 0 2 2 2 2  1 3 2 4  5 6", "a.dat").M
    array([[1., 2.],
           [3., 4.]])
    """
    words = _Words(text, name)
    n = words.count("the order")
    return LCP(words.matrix(n), words.vector("q", n))


def read_siconos_relay(text: str, name: str) -> MixedLCP:
    """Return the problem of a file with the order, M, q and the bounds."""
    words = _Words(text, name)
    n = words.count("the order")
    M = words.matrix(n)
    q, lower, upper = (words.vector(part, n) for part in ("q", "the lower bounds", "the upper bounds"))
    return MixedLCP(M, q, lower, upper)


def read_siconos_mlcp(text: str, name: str) -> MixedLCP:
    """Return the problem of a file with equations and complementarity conditions, as one matrix or as four.

    The four are A u + C v + a = 0 and w = D u + B v + b, by rows. Where both are there, the one matrix counts.
    """
    words = _Words(text, name)
    whole, parts = words.count("the mark of one matrix"), words.count("the mark of four matrices")
    n, m = words.count("the number of equations"), words.count("the number of complementarity conditions")
    if whole:
        starts = [words.count("the first row of a run")]
        while starts[-1] < n + m:
            starts.append(words.count("the first row of a run"))
        is_pair = [words.count("the kind of a run") for _ in starts[1:]]
        M = words.matrix(n + m)
        q = words.vector("q", n + m)
        free = np.repeat(np.array(is_pair) == 0, np.diff(starts))
    elif parts:
        shapes = (("A", n, n), ("B", m, m), ("C", n, m), ("D", m, n))
        A, B, C, D = (words.vector(part, r * c).reshape(r, c) for part, r, c in shapes)
        M, q = np.block([[A, C], [D, B]]), np.append(words.vector("a", n), words.vector("b", m))
        free = np.arange(n + m) < n
    else:
        raise words.wrong("one of the two marks at its beginning set: it holds no matrix")
    if np.count_nonzero(free) != n:
        raise words.wrong(f"{n} equations: it marks {np.count_nonzero(free)}")
    return MixedLCP(M, q, np.where(free, -np.inf, 0.0), np.inf)


def siconos_lcp(problem: Problem) -> str:
    """Return the file of an LCP."""
    if not isinstance(problem, LCP):
        raise InvalidInputError("problem", problem, "an LCP for this format; for bounds use 'siconos-relay'")
    return "\n".join([str(problem.size), *_matrix_lines(problem.dense()), _line(problem.q), ""])


def siconos_relay(problem: Problem) -> str:
    """Return the file of a problem with bounds."""
    vectors = problem.q, problem.lower, problem.upper
    return "\n".join([str(problem.size), *_matrix_lines(problem.dense()), *(_line(v) for v in vectors), ""])


def siconos_mlcp(problem: Problem) -> str:
    """Return the file, with one matrix, of a problem with equations and complementarity conditions."""
    free = np.isinf(problem.lower)
    if not ((problem.lower == 0.0) | free).all() or not np.isinf(problem.upper).all():
        raise InvalidInputError(
            "problem", problem, "one whose unknowns are free or not negative, for this format"
        )
    starts = [0, *(np.flatnonzero(np.diff(free)) + 1).tolist(), problem.size]
    kinds = [str(int(not free[start])) for start in starts[:-1]] if problem.size else []
    free_count = int(np.count_nonzero(free))
    head = ["1", "0", str(free_count), str(problem.size - free_count)]
    runs = [" ".join(map(str, starts if problem.size else [0])), " ".join(kinds)]
    return "\n".join([*head, *runs, *_matrix_lines(problem.dense()), _line(problem.q), ""])


def _matrix_lines(M: Matrix) -> list[str]:
    n = str(len(M))
    return [str(DENSE), n, n, f"{n}\t{n}", *(_line(column) for column in M.T)]


def _line(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


class _Words:
    """The words of a file, one after the other."""

    def __init__(self, text: str, name: str) -> None:
        self.words, self.name, self.at = text.split(), name, 0

    def wrong(self, allowed: str) -> InvalidInputError:
        return InvalidInputError("path", self.name, f"a file with {allowed}")

    def count(self, what: str) -> int:
        number = self.vector(what, 1)[0]
        if not number >= 0.0 or number != int(number):
            raise self.wrong(f"a whole number >= 0 for {what}: word {self.at} is {self.words[self.at - 1]}")
        return int(number)

    def vector(self, what: str, size: int) -> Vector:
        words = self.words[self.at : self.at + size]
        if len(words) < size:
            raise self.wrong(f"{size} numbers for {what}: it ends after {len(words)} of them")
        self.at += size
        try:
            return np.array([float(word) for word in words])
        except ValueError as failure:
            raise self.wrong(f"numbers alone for {what}: {failure}") from failure

    def matrix(self, order: int) -> Matrix:
        storage = self.count("the storage of M")
        rows, columns = self.count("the rows of M"), self.count("the columns of M")
        if storage not in {DENSE, BLOCKS}:
            raise self.wrong(f"a dense matrix (0) or sparse blocks (1): its storage is {storage}")
        if (rows, columns) != (order, order):
            raise self.wrong(f"a square M of order {order}: it is {rows} by {columns}")
        if storage == BLOCKS:
            return self._blocks(order)
        again = self.count("the rows of M"), self.count("the columns of M")
        if again != (rows, columns):
            raise self.wrong(f"one size of M: it has {rows} by {columns} and {again[0]} by {again[1]}")
        return self.vector("M", rows * columns).reshape(columns, rows).T

    def _blocks(self, order: int) -> Matrix:
        """Read rows of blocks; each block says at which place in the list of blocks it stands, and is full."""
        count = self.count("the number of blocks")
        down, across = self.count("the rows of blocks"), self.count("the columns of blocks")
        ends = [[0, *(self.count("the end of a block") for _ in range(blocks))] for blocks in (down, across)]
        filled, stored = self.count("the number of block rows, and 1"), self.count("the number of blocks")
        first = [self.count("the first block of a row") for _ in range(filled)]
        column_of = [self.count("the column of a block") for _ in range(stored)]
        if ends[0][-1] != order or ends[1][-1] != order or stored != count or first[-1:] != [count]:
            raise self.wrong(
                f"blocks that fill a matrix of order {order}: their sizes or their number do not"
            )
        M, seen = np.zeros((order, order)), set()
        row_of = np.repeat(np.arange(len(first) - 1), np.diff(first))
        for _ in range(count):
            place = self.count("the number of a block")
            if place >= count or place in seen or row_of[place] >= down or column_of[place] >= across:
                raise self.wrong(
                    f"each block once, under a number below {count}: {place} is none, or comes again"
                )
            seen.add(place)
            top, bottom = ends[0][row_of[place]], ends[0][row_of[place] + 1]
            left, right = ends[1][column_of[place]], ends[1][column_of[place] + 1]
            entries = self.vector("a block", (bottom - top) * (right - left))
            M[top:bottom, left:right] = entries.reshape(right - left, bottom - top).T
        return M
