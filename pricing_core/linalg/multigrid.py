"""Algebraic multigrid of sparse matrices: coarser matrices, and an approximate inverse by one cycle over them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.linalg import LinearOperator, cg, gmres, splu

from pricing_core.arrays import Matrix, Vector
from pricing_core.errors import NumericalError

FEW = 1500  # order up to which a matrix is factored instead
COARSEST = 200
POSITIVE_SHARE = (
    0.1  # of the entries off the diagonal, by size, up to which interpolation goes by the entries
)
NEARLY = 0.05  # share of the diagonal's part in x'Mx that x'Mx itself is, where M nearly takes x to zero
RELAXED, RELAXATIONS, GOLDEN = 6, 40, 0.6180339887498949
RESTART = 30


@dataclass(frozen=True, slots=True, eq=False)
class Transfer:
    """From a matrix to the next coarser one, P' M P.

    Parameters
    ----------
    prolongation : csr_array, shape (n, m)
        P.
    points : integer array, shape (m,)
        The row of the finer matrix whose unknown each of the coarser one takes over.
    """

    prolongation: csr_array
    points: NDArray[np.integer]


@dataclass(frozen=True, slots=True, eq=False)
class Multigrid:
    """Matrices M_0 = M, M_1, ... of falling order, and what lies between them.

    `transfers` is empty where the coarser unknowns are no values at points.
    """

    matrices: tuple[csr_array, ...]
    transfers: tuple[Transfer, ...]
    inverse: LinearOperator  # one V-cycle, symmetric for a symmetric M; of a small matrix M^-1

    @classmethod
    def of(cls, M: csr_array, near_null: Matrix | None) -> Multigrid:
        """Make the hierarchy of a square matrix with a positive diagonal.

        Without `near_null` classical interpolation (Ruge and Stueben 1987), with it smoothed aggregation (Vanek, Mandel
        and Brezina 1996), for a symmetric M; both by PyAMG. Cost: O(nnz).

        Parameters
        ----------
        M : csr_array, shape (n, n)
        near_null : array, shape (n, k), optional
            Vectors that M nearly takes to zero, as of `near_null_vectors`.

        Raises
        ------
        NumericalError
            No hierarchy can be made: M is singular, or not of this kind.
        """
        n = M.shape[0]
        if n <= FEW:
            return cls((M,), (), LinearOperator((n, n), matvec=_factored(M), dtype=np.float64))
        try:
            solver = _classical(M) if near_null is None else _aggregated(M, near_null)
        except (ValueError, IndexError, ZeroDivisionError, RuntimeError, np.linalg.LinAlgError) as failure:
            raise NumericalError(
                f"no coarser matrices could be made of one of order {n}: {failure}"
            ) from failure
        matrices = tuple(_sorted(level.A) for level in solver.levels)
        fine = solver.levels[:-1] if near_null is None else ()
        transfers = tuple(Transfer(csr_array(level.P), _points(csr_array(level.P))) for level in fine)
        return cls(matrices, transfers, solver.aspreconditioner(cycle="V"))


def near_null_vectors(M: csr_array) -> Matrix | None:
    """Return vectors by which to coarsen a symmetric M, shape (n, k), None where its own entries tell enough.

    Where nearly all entries off the diagonal are negative they do. Elsewhere M may belong to displacements, whose one,
    two or three components stand in turn: the translations are nearly taken to zero then. Where they are not, a few
    vectors that Gauss-Seidel sweeps leave are taken.
    """
    if _is_nearly_z(M):
        return None
    n, diagonal = M.shape[0], M.diagonal()
    for components in (3, 2, 1):
        places = np.arange(n) % components
        translations = (places[:, None] == np.arange(components)).astype(np.float64)
        energy = np.einsum("ij,ij->j", translations, M @ translations)
        if n % components == 0 and (energy <= NEARLY * (diagonal @ translations)).all():
            return np.asarray(translations)
    return _relaxed(M)


def _relaxed(M: csr_array) -> Matrix:
    from pyamg.relaxation.relaxation import gauss_seidel  # noqa: PLC0415  # slow to import

    irregular = np.modf(GOLDEN * np.arange(1.0, M.shape[0] * RELAXED + 1.0))[0] - 0.5
    vectors = np.ascontiguousarray(irregular.reshape(RELAXED, -1))
    for vector in vectors:
        gauss_seidel(M, vector, np.zeros(M.shape[0]), iterations=RELAXATIONS, sweep="symmetric")
    return np.asarray(np.linalg.qr(vectors.T)[0])


def solve_preconditioned(
    A: LinearOperator | csr_array,
    b: Vector,
    inverse: LinearOperator,
    *,
    symmetric: bool,
    tolerance: float,
    limit: int,
) -> tuple[Vector, bool]:
    """Return x with |A x - b| <= tolerance |b|, and whether it is reached within so many products with A.

    Conjugate gradients for a symmetric A, which must then be positive definite, else GMRES.
    """
    with np.errstate(all="ignore"):  # a breakdown is told by the flag, or by numbers that are not finite
        if symmetric:
            x, flag = cg(A, b, rtol=tolerance, maxiter=limit, M=inverse)
        else:
            cycles = max(1, limit // RESTART)
            x, flag = gmres(A, b, rtol=tolerance, restart=min(RESTART, limit), maxiter=cycles, M=inverse)
    return np.asarray(x), flag == 0


def _factored(M: csr_array) -> partial[Vector]:
    try:
        return partial(splu(M.tocsc()).solve)
    except RuntimeError as failure:
        raise NumericalError(f"a matrix of order {M.shape[0]} is singular: {failure}") from failure


def _classical(M: csr_array):  # type: ignore[no-untyped-def]
    import pyamg  # noqa: PLC0415  # slow to import

    return pyamg.ruge_stuben_solver(M, max_coarse=COARSEST)


def _aggregated(M: csr_array, near_null: Matrix):  # type: ignore[no-untyped-def]
    import pyamg  # noqa: PLC0415  # slow to import

    # With local weights no spectral radius is estimated from random vectors: equal problems have equal answers.
    smooth = ("jacobi", {"omega": 4.0 / 3.0, "weighting": "local"})
    return pyamg.smoothed_aggregation_solver(
        M, B=near_null, symmetry="symmetric", smooth=smooth, max_coarse=COARSEST
    )


def _is_nearly_z(M: csr_array) -> bool:
    off = M.data[np.repeat(np.arange(M.shape[0]), np.diff(M.indptr)) != M.indices]
    return bool(off[off > 0.0].sum() <= POSITIVE_SHARE * np.abs(off).sum())


def _sorted(M: Any) -> csr_array:
    A: csr_array = csr_array(M)
    A.sort_indices()
    return A


def _points(P: csr_array) -> NDArray[np.integer]:
    """Return for each column the first row that has the single entry 1 there."""
    single = np.flatnonzero(np.diff(P.indptr) == 1)
    single = single[P.data[P.indptr[single]] == 1.0]
    points = np.zeros(P.shape[1], dtype=np.int64)
    points[P.indices[P.indptr[single]][::-1]] = single[::-1]
    return points
