"""The nearest smiles without arbitrage: the conditions made linear, as a quadratic programme, until the proof holds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import clarabel
import numpy as np
from scipy import sparse

from pricing_core.arrays import Matrix, Vector
from pricing_core.chains.interruption import check_interrupt
from pricing_core.chains.surface.arbitrage import NoArbitrage, prove
from pricing_core.chains.surface.conditions import Asked, conditions, variance_of
from pricing_core.chains.surface.essvi import ESSVI
from pricing_core.chains.surface.smoothing import Posterior
from pricing_core.chains.surface.total_variance import TotalVariance, joined

PROGRAMMES = 5  # Largest number of quadratic programmes; chosen.
DAMPED = 0.7  # Share of the way to the solution of each programme but the first; chosen.
FAR = 4.0  # Constraints that hold by more standard deviations than this enter when they are missed; chosen.
ENTRIES, MISSED = 2, 1e-4  # Largest number of times that they do, and what counts as missed; chosen.
GAP = 1e-4  # Tolerance of a programme, in squared standard deviations.
LOOSER = 10.0  # By how much more smiles may vary than they are likely to where only wings are moved; chosen.
PRICE = 1e4  # Cost of a standard deviation by which a row is missed, in standard deviations; chosen.
PLAIN_SLOPES = (0.2, 0.05)  # Slopes of the wings, in sqrt(theta), of admissible smiles; chosen.
SHARES = (0.99, 0.97, 0.9, 0.8, 0.6, 0.4, 0.2, 0.1, 0.0)  # Shares of the way from those that are tried.


@dataclass(frozen=True, slots=True)
class Repaired:
    """Smiles without arbitrage, with what is proved of them.

    Parameters
    ----------
    variance : TotalVariance
    proof : NoArbitrage
    programmes : int
        Number of quadratic programmes solved; 0 where the most probable smiles are proved as they are.
    """

    variance: TotalVariance
    proof: NoArbitrage
    programmes: int


def without_arbitrage(
    posterior: Posterior,
    later: TotalVariance | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> Repaired:
    """Return the most probable smiles if they are proved free of arbitrage, or the nearest ones found that are.

    Distance is that of the posterior: as little probability as possible is given up. Each programme is linear about the
    smiles of the one before, and asks for the conditions where the proof failed as well. Where no programme leads to a
    proof, the smiles returned are those between some of one shape, which are admissible, and the last ones.

    Parameters
    ----------
    posterior : Posterior
    later : TotalVariance, optional
        Smiles on the same splines that stay as they are, and lie above. The proof then has an entry for the first.
    """
    unknowns = posterior.unknowns
    variance = _before(variance_of(posterior, unknowns), later)
    proof, asked = prove(variance), Asked.nothing(variance.expiries.size)
    metric = _metric(posterior, proof)
    for programme in range(PROGRAMMES):
        if proof.holds:
            return Repaired(variance_of(posterior, unknowns), proof, programme)
        check_interrupt(interrupt)
        asked = asked.and_at(proof, variance)
        goal = _programme(posterior, metric, unknowns, variance, asked)
        if not np.isfinite(goal).all():
            break
        unknowns = goal if programme == 0 else unknowns + DAMPED * (goal - unknowns)
        variance = _before(variance_of(posterior, unknowns), later)
        proof = prove(variance)
        metric = _metric(posterior, proof)
    return _from_within(posterior, unknowns, later, interrupt)


def _from_within(
    posterior: Posterior,
    goal: Matrix,
    later: TotalVariance | None,
    interrupt: Callable[[], bool] | None,
) -> Repaired:
    """Return the smiles between admissible ones and a goal that are nearest to it and proved."""
    for slope in PLAIN_SLOPES:
        plain = _of_one_shape(posterior, slope)
        for share in SHARES:
            check_interrupt(interrupt)
            variance = variance_of(posterior, plain + share * (goal - plain))
            proof = prove(_before(variance, later))
            if proof.holds:
                return Repaired(variance, proof, PROGRAMMES)
    return Repaired(variance, proof, PROGRAMMES)


def _before(variance: TotalVariance, later: TotalVariance | None) -> TotalVariance:
    """Return smiles with the first of those that are later and stay as they are."""
    if later is None:
        return variance
    first = TotalVariance(later.basis, later.expiries[:1], later.theta[:1], later.coefficients[:1])
    return joined(variance, first)


def _of_one_shape(posterior: Posterior, slope: float) -> Matrix:
    """Return the unknowns of smiles that are one function of x/sqrt(theta) in units of theta."""
    problem = posterior.problem
    shape = problem.basis.represent(ESSVI(1.0, slope, slope).at(problem.basis.places))
    found = np.zeros((problem.expiries.size, problem.block))
    found[:, : problem.basis.size] = shape - problem.mean
    return found


def _programme(
    posterior: Posterior, metric: sparse.csc_matrix, unknowns: Matrix, variance: TotalVariance, asked: Asked
) -> Matrix:
    """Return the unknowns nearest to the most probable ones under the conditions, linear about the present ones."""
    matrix, bound = conditions(posterior, variance, asked)
    change = _nearest(
        metric, posterior.problem.block, matrix, bound + matrix @ (unknowns - posterior.unknowns).ravel()
    )
    return np.asarray(posterior.unknowns + change.reshape(unknowns.shape))


def _nearest(precision: sparse.csc_matrix, block: int, matrix: Matrix, bound: Vector) -> Matrix:
    """Return the change v of the most probable unknowns of least v' H v with matrix @ v >= bound.

    In units in which the blocks of H on the diagonal are 1; each row is then divided by its length, about the standard
    deviation of what it bounds. Rows that hold by many of them enter only when they are missed.
    """
    units = _units(precision, block)
    rows = sparse.csr_matrix(matrix) @ units
    lengths = np.maximum(np.sqrt(np.asarray(rows.multiply(rows).sum(axis=1)).ravel()), 1e-300)
    distance = bound / lengths
    hessian = units.T @ precision @ units
    scaled = sparse.csr_matrix(sparse.diags(1.0 / lengths) @ rows)
    entered, change = distance > -FAR, np.zeros(matrix.shape[1])
    for _ in range(ENTRIES):
        change = _least(hessian, scaled[np.flatnonzero(entered)], distance[entered])
        missed = (scaled @ change < distance - MISSED) & ~entered
        if not missed.any():
            break
        entered |= missed
    return np.asarray(units @ change)


def _least(hessian: sparse.csc_matrix, rows: sparse.csr_matrix, bound: Vector) -> Vector:
    """Return the v of least v' H v/2 with rows @ v >= bound, each row being missed at a high price."""
    count = bound.size
    both = sparse.block_diag([sparse.triu(hessian), sparse.eye(count)])
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = GAP
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix(both),
        np.zeros(both.shape[0]),
        sparse.csc_matrix(sparse.hstack([-rows, -sparse.eye(count) / PRICE])),
        -bound,
        [clarabel.NonnegativeConeT(count)],
        settings,
    )
    return np.asarray(solver.solve().x)[: hessian.shape[0]]


def _metric(posterior: Posterior, proof: NoArbitrage) -> sparse.csc_matrix:
    """Return the metric of the distance: the precision, or one that is looser if only wings beyond the quotes fail.

    The most probable smiles are stiff: what must bend a wing would move the quotes beside it, which say nothing of it.
    """
    problem, scales = posterior.problem, posterior.scales
    for quotes, *failures in zip(
        problem.smiles, proof.butterfly_failures, proof.calendar_failures, strict=False
    ):
        places = np.concatenate(failures)
        if np.any((places >= quotes[0][0]) & (places <= quotes[0][-1])):
            return _symmetric(posterior.precision)
    prior = problem.precision(replace(scales, amplitude=LOOSER * scales.amplitude))
    return _symmetric(problem.band / scales.noise**2 + prior)


def _units(precision: sparse.csc_matrix, block: int) -> sparse.csc_matrix:
    """Return the inverse transposed Cholesky factors of the blocks of the precision on the diagonal."""
    found = []
    for start in range(0, precision.shape[0], block):
        own = precision[start : start + block, start : start + block].toarray()
        found.append(np.linalg.inv(np.linalg.cholesky(own)).T)
    return sparse.csc_matrix(sparse.block_diag(found))


def _symmetric(band: Matrix) -> sparse.csc_matrix:
    """Return the matrix of which the lower band is given."""
    size = band.shape[1]
    lower = sparse.dia_matrix((band, -np.arange(band.shape[0])), shape=(size, size))
    return sparse.csc_matrix(lower + sparse.tril(lower, -1).T)
