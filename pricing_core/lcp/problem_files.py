"""Complementarity problems in files: those of Siconos, and MatrixMarket."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from scipy.io import mmread, mmwrite

from pricing_core.arrays import Vector, check_choice
from pricing_core.errors import InvalidInputError
from pricing_core.lcp.mixed import MixedLCP
from pricing_core.lcp.problem import LCP, Problem, check_problem
from pricing_core.lcp.siconos_files import (
    read_siconos_lcp,
    read_siconos_mlcp,
    read_siconos_relay,
    siconos_lcp,
    siconos_mlcp,
    siconos_relay,
)
from pricing_core.linalg.coefficients import sparse
from pricing_core.linalg.tridiagonal import Tridiagonal
from pricing_core.replacement import replacement

ProblemFormat: TypeAlias = Literal["siconos-lcp", "siconos-mlcp", "siconos-relay", "matrix-market"]
FORMATS: tuple[str, ...] = get_args(ProblemFormat)
READERS: dict[str, Callable[[str, str], Problem]] = {
    "siconos-lcp": read_siconos_lcp,
    "siconos-mlcp": read_siconos_mlcp,
    "siconos-relay": read_siconos_relay,
}
WRITERS: dict[str, Callable[[Problem], str]] = {
    "siconos-lcp": siconos_lcp,
    "siconos-mlcp": siconos_mlcp,
    "siconos-relay": siconos_relay,
}
VECTORS = ("q", "lower", "upper")
DIGITS = 17  # tell every number apart


def read_problem(path: str | PathLike[str], format: ProblemFormat) -> Problem:  # noqa: A002  # the vocabulary
    """Read an LCP or a mixed LCP from a file.

    Parameters
    ----------
    path : path
    format : {"siconos-lcp", "siconos-mlcp", "siconos-relay", "matrix-market"}
        The first three are the data files of Siconos' numerics: an LCP; a mixed one of equations and complementarity
        conditions; and w = M z + q with -w in the normal cone of the box of z. Dense matrices and sparse block matrices
        are read; what follows the problem in a file is left out. "matrix-market": M in `path`, NAME.mtx, the vectors
        beside it in NAME_q.mtx and, for a mixed problem, NAME_lower.mtx and NAME_upper.mtx.

    Raises
    ------
    InvalidInputError
        The file ends too soon, or does not hold what the format says; the message names where.
    OSError
        It cannot be read.

    Examples
    --------
    >>> import tempfile
    >>> target = Path(tempfile.mkdtemp()) / "problem.dat"
    >>> write_problem(LCP([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0]), target, "siconos-lcp")
    >>> read_problem(target, "siconos-lcp").q
    array([-5., -6.])
    """
    check_choice("format", format, FORMATS)
    path = Path(path)
    if format != "matrix-market":
        return READERS[format](path.read_text(encoding="utf-8", errors="replace"), path.name)
    M = _matrix(path)
    vectors = {name: _beside(path, name) for name in VECTORS}
    q = _vector(vectors["q"])
    if not vectors["lower"].exists() and not vectors["upper"].exists():
        return LCP(M, q)
    return MixedLCP(M, q, _vector(vectors["lower"]), _vector(vectors["upper"]))


def write_problem(problem: Problem, path: str | PathLike[str], format: ProblemFormat) -> None:  # noqa: A002
    """Write an LCP or a mixed LCP to a file, without loss, in one of the formats of `read_problem`.

    "siconos-lcp" takes an `LCP`, "siconos-mlcp" a problem whose unknowns are free or not negative, "siconos-relay" any
    bounds; they hold dense matrices, which they write column by column, as Siconos does. Files that exist are replaced.

    Parameters
    ----------
    problem : LCP or MixedLCP
    path : path-like
        File that is written, or replaced.
    format : str
        One of the formats of `read_problem`.

    Raises
    ------
    InvalidInputError
        The format does not hold such a problem.
    OSError
        A file cannot be written.
    """
    check_problem(problem)
    check_choice("format", format, FORMATS)
    path = Path(path)
    if format != "matrix-market":
        _write(path, WRITERS[format](problem).encode())
        return
    M = sparse(problem.M) if isinstance(problem.M, Tridiagonal) else problem.M
    _write(path, _matrix_market(M))
    for name in VECTORS if isinstance(problem, MixedLCP) else VECTORS[:1]:
        _write(_beside(path, name), _matrix_market(getattr(problem, name)[:, None]))


def _beside(path: Path, name: str) -> Path:
    return path.with_name(f"{path.stem}_{name}{path.suffix}")


def _write(path: Path, content: bytes) -> None:
    with replacement(path) as file:
        file.write(content)


def _matrix_market(A: Any) -> bytes:
    target = BytesIO()
    mmwrite(target, A, precision=DIGITS, symmetry="general")
    return target.getvalue()


def _matrix(path: Path) -> Any:
    try:
        found = mmread(path, spmatrix=False)
    except ValueError as failure:
        raise InvalidInputError("path", path.name, f"a MatrixMarket file: {failure}") from failure
    return found


def _vector(path: Path) -> Vector:
    found: Any = _matrix(path)
    return np.asarray(found.toarray() if hasattr(found, "toarray") else found, dtype=np.float64).reshape(-1)
