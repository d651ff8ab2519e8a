"""The conditions under which smiles admit no arbitrage, linear about smiles nearby: rows of a quadratic programme."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.chains.surface.arbitrage import NoArbitrage, durrleman
from pricing_core.chains.surface.jet import Jet
from pricing_core.chains.surface.smoothing import Posterior
from pricing_core.chains.surface.total_variance import TotalVariance

# What the first programme holds g, the relative growth of w, and w/theta above, and what the first two grow by.
LEAST_DENSITY, LEAST_GROWTH, LEAST_VALUE, WIDER = 2e-3, 1e-3, 0.02, 1.15
LEAST_SLOPE, MOST_SLOPE = 1e-3, 1.95  # Slopes of the wings: as shares of sqrt(theta), and in x.
NEAR = 0.5  # Constraints enter where less than this is left of g, or of the growth of w; chosen.
MIDDLE = 4.0  # Up to so many deviations from the money g itself is asked for, quoted or not; chosen.
APART = 0.02  # Least distance of places where a condition is asked for, in deviations; chosen.


@dataclass(frozen=True, slots=True)
class Asked:
    """The places, besides the knots, at which a programme imposes the conditions, and with which margins.

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
    def nothing(cls, expiries: int) -> Asked:
        """Return that no conditions besides those at the knots are imposed."""
        return cls([np.empty(0)] * expiries, [np.empty(0)] * expiries, 1.0)

    def and_at(self, proof: NoArbitrage, variance: TotalVariance) -> Asked:
        """Return these places and those at which a proof failed, with wider margins."""
        width = np.sqrt(variance.theta)
        density = [
            _apart(np.append(*both), h)
            for both, h in zip(zip(self.density, proof.butterfly_failures, strict=True), width, strict=True)
        ]
        growth = [
            _apart(np.append(*both), h)
            for both, h in zip(zip(self.growth, proof.calendar_failures, strict=True), width, strict=True)
        ]
        return Asked(density, growth, WIDER * self.margin)


def _apart(places: Vector, width: float) -> Vector:
    """Return places that are further from each other than a small share of a width."""
    return np.unique(np.round(places / (APART * width))) * (APART * width)


def variance_of(posterior: Posterior, unknowns: Matrix) -> TotalVariance:
    """Return the smiles that unknowns stand for."""
    problem = posterior.problem
    theta = np.array([smile.theta for smile in problem.backbone])
    return TotalVariance(problem.basis, problem.expiries, theta, posterior.coefficients(unknowns))


def conditions(posterior: Posterior, variance: TotalVariance, asked: Asked) -> tuple[Matrix, Vector]:
    """Return rows and bounds: row @ change >= bound, the change being that from the present unknowns.

    Parameters
    ----------
    variance : TotalVariance
        The present smiles; one more than the posterior has stays as it is.
    """
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
    return np.concatenate(rows), np.concatenate(bounds)


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
