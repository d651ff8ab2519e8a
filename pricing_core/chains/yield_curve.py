"""The yield between expiries, given what the stock to be had at each of them is worth now."""

from __future__ import annotations

import math

import numpy as np

from pricing_core.american.contracts.curves import Curve, PiecewiseConstant
from pricing_core.american.contracts.fields import DIVIDEND_YIELD
from pricing_core.american.contracts.market import Market
from pricing_core.american.implied.implied_carry import stock_value
from pricing_core.arrays import Matrix, Vector

# Standard deviations of what the yield changes by from one expiry to the next, 1/year, among which the quotes choose.
YIELD_CHANGES = np.geomspace(1e-4, 0.3, 16)
MOST_STEPS = 10  # of Gauss and Newton; the problem is nearly linear
SETTLED = 1e-9  # Largest change of a yield in the last of them, 1/year.
STEP = 1e-6  # of the differences by which the stock's value is derived, 1/year


def joint_yields(market: Market, times: Vector, stock: Vector, error: Vector) -> tuple[Vector, Matrix]:
    """Return the mean and the covariance of the yields between the expiries, given the stock's values at these.

    The stock's value is nearly linear in the yields. Each change of the yield gives a mean, a covariance and an
    evidence of its own; the result is that of their mixture.

    Parameters
    ----------
    times : Vector, shape (n,)
        Expiries, years, increasing.
    stock, error : Vector, shape (n,)
        What the stock to be had then is worth now, and the standard errors of that, money.
    """
    values = np.zeros(times.size)
    for _ in range(MOST_STEPS):
        now, jacobian = _derived(market, times, values)
        jacobian, goal = jacobian / error[:, None], (stock - now) / error
        goal += jacobian @ values
        mean, covariance = random_walk(jacobian, goal)
        found = np.clip(mean, DIVIDEND_YIELD.least, DIVIDEND_YIELD.most)
        step, values = float(np.abs(found - values).max()), found
        if step <= SETTLED:
            break
    return values, covariance


def random_walk(jacobian: Matrix, goal: Vector) -> tuple[Vector, Matrix]:
    """Return mean and covariance of a random walk x of which jacobian @ x is goal, with errors of size 1.

    How far it goes in a step is one of `YIELD_CHANGES`, each of which counts as the goal makes it likely.
    """
    fits = [_fit_at(jacobian, goal, change) for change in YIELD_CHANGES.tolist()]
    # All changes are alike before, not their logarithms.
    evidence = np.array([fit[2] for fit in fits]) + np.log(YIELD_CHANGES)
    weight = np.exp(evidence - evidence.max())
    weight /= weight.sum()
    means = np.array([fit[0] for fit in fits])
    mean: Vector = weight @ means
    spread = means - mean
    covariance = np.einsum("k,kij->ij", weight, np.array([fit[1] for fit in fits]))
    return mean, covariance + (spread.T * weight) @ spread


def _fit_at(jacobian: Matrix, goal: Vector, change: float) -> tuple[Vector, Matrix, float]:
    """Return mean, covariance and the logarithm of the evidence if the walk changes so much in a step."""
    count = jacobian.shape[1]
    smooth = np.diff(np.eye(count), axis=0) / change
    matrix = np.vstack([jacobian, smooth])
    right = np.concatenate([goal, np.zeros(count - 1)])
    q, r = np.linalg.qr(matrix)
    inverse = np.linalg.inv(r)
    mean: Vector = inverse @ (q.T @ right)
    misses = float(((right - matrix @ mean) ** 2).sum())
    determinant = float(np.log(np.abs(np.diag(r))).sum())
    return mean, inverse @ inverse.T, -0.5 * misses - determinant - (count - 1) * math.log(change)


def _derived(market: Market, times: Vector, values: Vector) -> tuple[Vector, Matrix]:
    """Return the stock's values at a curve, and their derivatives by its values."""
    now = _stocks(market, times, values)
    columns = []
    for bump in STEP * np.eye(times.size):
        columns.append((_stocks(market, times, values + bump) - now) / STEP)
    return now, np.array(columns).T


def _stocks(market: Market, times: Vector, values: Vector) -> Vector:
    curve = curve_of(times, values)
    return np.array([stock_value(market, curve, time) for time in times.tolist()])


def curve_of(times: Vector, values: Vector) -> Curve:
    """Return the yield between the expiries as a curve; a number for a single one."""
    if times.size == 1:
        return float(values[0])
    return PiecewiseConstant(tuple(times.tolist()), tuple(values.tolist()))
