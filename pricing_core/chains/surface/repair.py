"""The nearest smiles without arbitrage: the conditions made linear, as a quadratic programme, until the proof holds."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import clarabel
import numpy as np
from scipy import sparse

from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.chains.interruption import check_interrupt
from pricing_core.chains.surface.arbitrage import NoArbitrage, durrleman, prove
from pricing_core.chains.surface.essvi import ESSVI
from pricing_core.chains.surface.jet import Jet
from pricing_core.chains.surface.smoothing import Posterior
from pricing_core.chains.surface.total_variance import TotalVariance, joined

PROGRAMMES = 5  # Largest number of quadratic programmes; chosen.
DAMPED = 0.7  # Share of the way to the solution of each programme but the first; chosen.
# What the first programme holds g, the relative growth of w, and w/theta above, and what the first two grow by.
LEAST_DENSITY, LEAST_GROWTH, LEAST_VALUE, WIDER = 2e-3, 1e-3, 0.02, 1.15
LEAST_SLOPE, MOST_SLOPE = 1e-3, 1.95  # Of the wings: as shares of sqrt(theta), and in x.
NEAR = 0.5  # Constraints enter where less than this is left of g, or of the growth of w; chosen.
FAR = 4.0  # Constraints that hold by more standard deviations than this enter when they are missed; chosen.
ENTRIES, MISSED = 2, 1e-4  # Largest number of times that they do, and what counts as missed; chosen.
GAP = 1e-4  # Tolerance of a programme, in squared standard deviations.
LOOSER = 10.0  # By how much more smiles may vary than they are likely to where only wings are moved; chosen.
PRICE = 1e4  # Of a standard deviation by which a row is missed, in standard deviations; chosen.
MIDDLE = 4.0  # Up to so many deviations from the money g itself is asked for, quoted or not; chosen.
APART = 0.02  # Least distance of places where a condition is asked for, in deviations; chosen.
PLAIN_SLOPES = (0.2, 0.05)  # Slopes of the wings, in sqrt(theta), of admissible smiles; chosen.
SHARES = (0.99, 0.97, 0.9, 0.8, 0.6, 0.4, 0.2, 0.1, 0.0)  # Of the way from those that are tried.


@dataclass(frozen=True, slots=True)
class Repaired:
    """Smiles, and what is proved of them.

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


@dataclass(frozen=True, slots=True)
class _Asked:
    """Where a programme asks for the conditions besides the knots, and by how much they must hold.

    Parameters
    ----------
    density, growth : list of Vector
        Places x for each expiry.
    margin : float
        Factor of the least density and growth.
    """

    density: list[Vector]
    growth: list[Vector]
    margin: float

    @classmethod
    def nothing(cls, expiries: int) -> _Asked:
        """Return that nothing more is asked for."""
        return cls([np.empty(0)] * expiries, [np.empty(0)] * expiries, 1.0)

    def and_at(self, proof: NoArbitrage, variance: TotalVariance) -> _Asked:
        """Return the same and where a proof failed, with wider margins."""
        width = np.sqrt(variance.theta)
        density = [
            _apart(np.append(*both), h)
            for both, h in zip(zip(self.density, proof.butterfly_failures, strict=True), width, strict=True)
        ]
        growth = [
            _apart(np.append(*both), h)
            for both, h in zip(zip(self.growth, proof.calendar_failures, strict=True), width, strict=True)
        ]
        return _Asked(density, growth, WIDER * self.margin)


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
    proof, asked = prove(variance), _Asked.nothing(variance.expiries.size)
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
        metric = _symmetric(posterior.precision)
        proof = prove(variance)
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


def _apart(places: Vector, width: float) -> Vector:
    """Return places that are further from each other than a small share of a width."""
    return np.unique(np.round(places / (APART * width))) * (APART * width)


def _of_one_shape(posterior: Posterior, slope: float) -> Matrix:
    """Return the unknowns of smiles that are one function of x/sqrt(theta) in units of theta."""
    problem = posterior.problem
    shape = problem.basis.represent(ESSVI(1.0, slope, slope).at(problem.basis.places))
    found = np.zeros((problem.expiries.size, problem.block))
    found[:, : problem.basis.size] = shape - problem.mean
    return found


def variance_of(posterior: Posterior, unknowns: Matrix) -> TotalVariance:
    """Return the smiles that unknowns stand for."""
    problem = posterior.problem
    theta = np.array([smile.theta for smile in problem.backbone])
    return TotalVariance(problem.basis, problem.expiries, theta, posterior.coefficients(unknowns))


def _programme(
    posterior: Posterior, metric: sparse.csc_matrix, unknowns: Matrix, variance: TotalVariance, asked: _Asked
) -> Matrix:
    """Return the unknowns nearest to the most probable ones under the conditions, linear about the present ones."""
    rows, bounds = [], []
    fixed = posterior.problem.expiries.size  # the index of a smile that stays as it is
    for i in range(fixed):
        places = _places(variance, i, asked.density[i])
        inside = _inside(posterior, i, places)
        found = [
            _densities(posterior, variance, i, places[inside], asked.margin),
            _outside(posterior, variance, i, places[~inside]),
            _slopes(posterior, variance, i),
        ]
        rows += [row for row, _ in found]
        bounds += [bound for _, bound in found]
    for i in range(1, variance.expiries.size):
        row, bound = _growth(posterior, variance, i, _places(variance, i, asked.growth[i]), asked.margin)
        rows.append(row)
        bounds.append(bound)
    # Each row says: row @ change >= bound, the change being that from the present unknowns.
    matrix, bound = np.concatenate(rows), np.concatenate(bounds)
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


def _places(variance: TotalVariance, i: int, failures: Vector) -> Vector:
    """Return the places x at which the conditions of an expiry are asked for."""
    breaks, root = variance.basis.breaks, math.sqrt(variance.theta[i])
    z = np.concatenate([breaks, 0.5 * (breaks[1:] + breaks[:-1])])
    return np.concatenate([z * root, failures])


def _rows(posterior: Posterior, i: int, x: Vector) -> Jet:
    """Return what the unknowns of an expiry count for in w, w' and w'' at places, each (k, n + 3)."""
    problem = posterior.problem
    theta = problem.backbone[i].theta
    splines = problem.basis.jets(x / math.sqrt(theta))
    own = problem.maps[i]
    return Jet(theta * (splines.value @ own), math.sqrt(theta) * (splines.first @ own), splines.second @ own)


def _densities(
    posterior: Posterior, variance: TotalVariance, i: int, x: Vector, margin: float
) -> tuple[Matrix, Vector]:
    """Return g >= a little, linear about the present smile, and w >= a little."""
    smile, unit = variance.smile(i, x), variance.theta[i]
    w, first = np.maximum(smile.value, 1e-3 * unit), smile.first
    lean = 1.0 - 0.5 * x * first / w
    density = durrleman(x, Jet(w, first, smile.second))
    by_value = lean * x * first / w**2 + 0.25 * (first / w) ** 2
    by_first = -lean * x / w - 0.5 * first * (1.0 / w + 0.25)
    rows = _rows(posterior, i, x)
    linear = by_value[:, None] * rows.value + by_first[:, None] * rows.first + 0.5 * rows.second
    near, slack = density < NEAR, LEAST_VALUE - smile.value / unit
    low = slack > -NEAR
    return (
        _at(posterior, i, np.concatenate([linear[near], rows.value[low] / unit])),
        np.concatenate([margin * LEAST_DENSITY - density[near], slack[low]]),
    )


def _outside(posterior: Posterior, variance: TotalVariance, i: int, x: Vector) -> tuple[Matrix, Vector]:
    """Return conditions that are linear and imply g > 0 beyond the quotes: w'' >= 0 and x w' <= w.

    Then g >= 1/4 - w'^2 (1/w + 1/4)/4, and w'^2/w <= w/x^2 is small where the quotes end; where x w' < 0, g is larger.
    Where w'' >= 0 the second holds everywhere if it does farthest from the money. w'' is free where g is far from 0
    in the present smile and in the most probable one.
    """
    smile, rows, unit = variance.smile(i, x), _rows(posterior, i, x), variance.theta[i]
    sides = [side for side in (np.flatnonzero(x < 0.0), np.flatnonzero(x > 0.0)) if side.size]
    outer = [side[np.argmax(np.abs(x[side]))] for side in sides]
    best = variance_of(posterior, posterior.unknowns).smile(i, x)
    bent = np.zeros(x.size, dtype=np.bool_)
    for each in (smile, best):
        positive = each.value > 2.0 * LEAST_VALUE * unit
        density = durrleman(x, Jet(np.where(positive, each.value, unit), each.first, each.second))
        bent |= ~positive | (density < NEAR)
    matrix = [rows.second[bent], ((rows.value - x[:, None] * rows.first) / unit)[outer]]
    bound = [-smile.second[bent], ((x * smile.first - smile.value) / unit)[outer]]
    return _at(posterior, i, np.concatenate(matrix)), np.concatenate(bound)


def _inside(posterior: Posterior, i: int, x: Vector) -> BoolVector:
    """Return which places lie among the quotes of an expiry, or near the money."""
    quoted, root = posterior.problem.smiles[i][0], math.sqrt(posterior.problem.backbone[i].theta)
    least = min(float(quoted[0]), -MIDDLE * root) - 0.5 * root
    most = max(float(quoted[-1]), MIDDLE * root) + 0.5 * root
    found: BoolVector = (x >= least) & (x <= most)
    return found


def _slopes(posterior: Posterior, variance: TotalVariance, i: int) -> tuple[Matrix, Vector]:
    """Return that both wings rise, but not too steeply."""
    root = math.sqrt(variance.theta[i])
    ends = variance.basis.breaks[[0, -1]] * root
    rows = _rows(posterior, i, ends).first * np.array([[-1.0], [1.0]])
    present = variance.smile(i, ends).first * np.array([-1.0, 1.0])
    linear = np.concatenate([rows, -rows]) / root
    bound = np.concatenate([LEAST_SLOPE * root - present, present - MOST_SLOPE]) / root
    return _at(posterior, i, linear), bound


def _growth(
    posterior: Posterior, variance: TotalVariance, i: int, x: Vector, margin: float
) -> tuple[Matrix, Vector]:
    """Return that the smile lies above the one before, and its wings are steeper."""
    after, before = variance.smile(i, x), variance.smile(i - 1, x)
    growth = after.value - (1.0 + margin * LEAST_GROWTH) * before.value
    near = growth < NEAR * np.abs(before.value)
    unit = 1.0 / variance.theta[i]
    ends = np.array([-1.0, 1.0]) * 1e3 * math.sqrt(variance.theta[i]) * np.abs(variance.basis.breaks[[0, -1]])
    signs = np.array([[-1.0], [1.0]]) / math.sqrt(variance.theta[i])
    steeper = (variance.smile(i, ends).first - variance.smile(i - 1, ends).first) * signs[:, 0]
    other = [
        -(1.0 + margin * LEAST_GROWTH) * _rows(posterior, i - 1, x[near]).value * unit,
        -_rows(posterior, i - 1, ends).first * signs,
    ]
    both = _at(posterior, i - 1, np.concatenate(other))
    if i < posterior.problem.expiries.size:  # else the smile stays as it is
        own = [_rows(posterior, i, x[near]).value * unit, _rows(posterior, i, ends).first * signs]
        both += _at(posterior, i, np.concatenate(own))
    return both, np.concatenate([-growth[near] * unit, margin * LEAST_SLOPE - steeper])


def _at(posterior: Posterior, i: int, rows: Matrix) -> Matrix:
    """Return rows over the unknowns of one expiry as rows over all."""
    block = posterior.problem.block
    found = np.zeros((rows.shape[0], posterior.problem.unknowns))
    found[:, i * block : (i + 1) * block] = rows
    return found


def _symmetric(band: Matrix) -> sparse.csc_matrix:
    """Return the matrix of which the lower band is given."""
    size = band.shape[1]
    lower = sparse.dia_matrix((band, -np.arange(band.shape[0])), shape=(size, size))
    return sparse.csc_matrix(lower + sparse.tril(lower, -1).T)
