"""Is the tolerance kept, and do the error estimates hold, on random contracts of a wide range?"""

from functools import partial
from typing import NamedTuple

import numpy as np

from benchmarks.measuring.timing import Task, least_seconds
from benchmarks.problems.portfolios import Portfolio
from benchmarks.quantlib.american_engines import Reference
from pricing_core.american import price_many

TOLERANCES = (1e-5, 1e-6, 1e-7)
# Smallest error, as a fraction of the strike, that an estimate is compared with.
LEAST_ERROR = 1e-9


class ToleranceKept(NamedTuple):
    """Shares of the rows; errors are fractions of the strike, less the possible error of the reference.

    `within`: error <= tolerance. `ok`: status. `ok_within_five`: of the ok rows, error <= 5 tolerances;
    `largest_ok` the largest error of an ok row, in tolerances. `honest`: estimate >= error/2, or an error
    below 1e-9, where the reference says nothing. `overestimate`: median of estimate/error over the other rows.
    """

    tolerance: float
    rows: int
    left_out: int
    within: float
    ok: float
    ok_within_five: float
    largest_ok: float
    honest: float
    overestimate: float
    microseconds: float


def tolerance_kept(portfolio: Portfolio, reference: Reference, tolerance: float) -> ToleranceKept:
    """Compare prices and estimates with a reference on the rows where it agrees with itself."""
    rows = np.flatnonzero(reference.agreed)
    contracts = portfolio.take(rows)
    solve = partial(price_many, contracts.columns(), tolerance=tolerance, greeks="none", threads=1)
    (seconds,) = least_seconds([Task((solve,))])
    table = solve()
    distance = np.abs(table["price"] / contracts.strike - reference.price[rows])
    error = np.where(np.isfinite(distance), np.maximum(distance - reference.disagreement[rows], 0.0), np.inf)
    estimate = table["error_estimate"] / contracts.strike
    ok = table["status"] == "ok"
    counted = (error > LEAST_ERROR) & np.isfinite(error)
    return ToleranceKept(
        tolerance=tolerance,
        rows=len(rows),
        left_out=len(portfolio) - len(rows),
        within=float(np.mean(error <= tolerance)),
        ok=float(np.mean(ok)),
        ok_within_five=float(np.mean(error[ok] <= 5.0 * tolerance)) if ok.any() else np.nan,
        largest_ok=float(np.max(error[ok] / tolerance, initial=0.0)),
        honest=float(np.mean((estimate >= error / 2.0) | (error <= LEAST_ERROR))),
        overestimate=float(np.median(estimate[counted] / error[counted])) if counted.any() else np.nan,
        microseconds=1e6 * seconds / len(rows),
    )
