"""QuantLib's finite differences with cash dividends (extra [bench]): explicit projection at each time step.

The spot drops by the amount at the ex-date (its cash dividend model Spot), as in this library's model "spot".
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.problems.portfolios import Portfolio
from benchmarks.quantlib.american_engines import AVAILABLE, Instruments, ql
from pricing_core.arrays import Matrix, Vector

__all__ = ["AVAILABLE", "GRIDS", "options_with_dividends", "prices"]

GRIDS = ((100, 200), (200, 400), (400, 800), (800, 1600))  # time steps, space nodes


def options_with_dividends(
    portfolio: Portfolio, days: NDArray[np.int64], amounts: Matrix, steps: int, nodes: int
) -> list[Any]:
    """Return QuantLib's options, ready to be priced.

    Parameters
    ----------
    portfolio : Portfolio
    days, amounts : shape (n, m)
        Ex-dates of each contract's dividends in days from now, and their amounts in money.
    steps, nodes : int
        Size of the grid.
    """
    instruments = Instruments.of(portfolio)
    today = ql.Settings.instance().evaluationDate
    make, scheme = ql.FdBlackScholesVanillaEngine, ql.FdmSchemeDesc.Douglas()
    rows = zip(instruments.options, instruments.processes, days.tolist(), amounts.tolist(), strict=True)
    for option, process, when, paid in rows:
        dividends = ql.DividendVector([today + day for day in when], paid)
        option.setPricingEngine(
            make(process, dividends, steps, nodes, 0, scheme, False, 0.0, make.Spot)  # 0 damping steps
        )
    return list(instruments.options)


def prices(options: Iterable[Any]) -> Vector:
    """Price options in money, NaN where QuantLib raises an error."""
    return np.array([_price(option) for option in options])


def _price(option: Any) -> float:
    try:
        return float(option.NPV())
    except RuntimeError:
        return float("nan")
