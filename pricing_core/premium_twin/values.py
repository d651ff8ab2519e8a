"""From the premium at the labels to the option at a spot."""

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Matrix, Vector
from pricing_core.premium_twin.cell import ONE_OVER_SQRT_TWO_PI, mills_ratio
from pricing_core.premium_twin.march import Profiles, premium_march

STENCIL = 6
VALUES = 7


def premium_values(
    steps: int,
    width: float,
    x: Vector,
    rate: Vector,
    dividend: Vector,
    spread: Vector,
    nodes: NDArray[np.int64],
    halvings: NDArray[np.int64],
    tangents: bool,
    threads: int,
) -> tuple[Matrix, Vector, NDArray[np.bool_]]:
    """March every row and read it at x = ln(S/K).

    Parameters
    ----------
    x : Vector, shape (rows,)
        The others are those of `premium_march`.

    Returns
    -------
    values : Matrix, shape (rows, 7)
        v = V/K, v_x, v_xx, the European v, dv/drate, dv/ddividend, dv/dspread at fixed x; the last three are 0 without
        `tangents`. At and below the boundary those of the payoff.
    boundary : Vector, shape (rows,)
        ln(S*/K).
    settled : bool array, shape (rows,)
    """
    profiles, frame, boundary, settled = premium_march(
        steps, width, rate, dividend, spread, nodes, halvings, tangents, threads
    )
    row = np.arange(rate.size)
    values = profile_values(width, rate, dividend, spread, nodes, halvings, profiles, frame, boundary, row, x)
    return values, boundary, settled


def profile_values(
    width: float,
    rate: Vector,
    dividend: Vector,
    spread: Vector,
    nodes: NDArray[np.int64],
    halvings: NDArray[np.int64],
    profiles: Profiles,
    frame: Vector,
    boundary: Vector,
    row: NDArray[np.int64],
    x: Vector,
) -> Matrix:
    """Read marched profiles at any number of spots: `row` says which, x = ln(S/K) where.

    Returns
    -------
    values : Matrix, shape (x.size, 7)
        As in `premium_values`.
    """
    rate, dividend, spread = rate[row], dividend[row], spread[row]
    xi = (x + rate - dividend) / spread - 0.5 * spread
    dx = width / 2.0 ** halvings[row]
    u, slope, curvature = _interpolate(profiles[row], nodes[row], (xi - frame[row]) / dx)
    slope, curvature = slope / dx, curvature / (dx * dx)
    bond, stock = np.exp(-rate), np.exp(x - dividend)
    density = bond * ONE_OVER_SQRT_TWO_PI * np.exp(-0.5 * (xi * xi))
    in_bond = _weighted_normal(-xi, density, bond)
    in_stock = _weighted_normal(-(xi + spread), density, stock)
    moved = bond * slope / spread
    values = np.zeros((x.size, VALUES))
    values[:, 0] = in_bond - in_stock + bond * u[:, 0]
    values[:, 1] = moved - in_stock
    values[:, 2] = (bond * curvature / spread + density) / spread - in_stock
    values[:, 3] = in_bond - in_stock
    if u.shape[1] > 1:
        values[:, 4] = moved + bond * (u[:, 1] - u[:, 0]) - in_bond
        values[:, 5] = bond * u[:, 2] - moved + in_stock
        values[:, 6] = bond * (u[:, 3] - slope * (xi / spread + 1.0)) + density
    exercised = x <= boundary[row]
    at_once = np.zeros_like(values)
    at_once[:, 0], at_once[:, 1], at_once[:, 2] = -np.expm1(x), -np.exp(x), -np.exp(x)
    at_once[:, 3] = values[:, 3]
    return np.where(exercised[:, None], at_once, values)


def _weighted_normal(d: Vector, density: Vector, whole: Vector) -> Vector:
    tail = density * mills_ratio(np.abs(d))
    return np.where(d < 0.0, tail, whole - tail)


def _interpolate(profiles: Profiles, nodes: NDArray[np.int64], y: Vector) -> tuple[Matrix, Vector, Vector]:
    """Return the profile at y cells from label 0, and its first two derivatives; zero beyond the labels."""
    last = nodes + 1 - STENCIL
    first = np.clip(np.where(y >= 2.0, np.minimum(y, 1e9), 2.0).astype(np.int64) - 2, 0, last)
    z = y - first
    inside = z < STENCIL - 3
    z = np.where(inside, z, 0.0)
    rows = np.arange(y.size)
    labels = [profiles[rows, :, first + k] for k in range(STENCIL)]
    for order in range(1, STENCIL):  # Newton's forward differences
        for k in range(STENCIL - 1, order - 1, -1):
            labels[k] = labels[k] - labels[k - 1]
    binomial, once, twice = np.ones_like(z), np.zeros_like(z), np.zeros_like(z)
    value, slope, curvature = labels[0], np.zeros_like(z), np.zeros_like(z)
    for k in range(1, STENCIL):
        step = z - (k - 1)
        twice = (twice * step + 2.0 * once) / k
        once = (once * step + binomial) / k
        binomial = binomial * step / k
        value = value + binomial[:, None] * labels[k]
        slope = slope + once * labels[k][:, 0]
        curvature = curvature + twice * labels[k][:, 0]
    return (
        np.where(inside[:, None], value, 0.0),
        np.where(inside, slope, 0.0),
        np.where(inside, curvature, 0.0),
    )
