"""The semidiscrete option of one segment, on the range of spots that the method of lines would choose."""

import numpy as np

from pricing_core.american import Market, Option
from pricing_core.american.contracts.schedule import make_schedule
from pricing_core.american.engines.method_of_lines.grid import reach
from pricing_core.american.engines.method_of_lines.segment_form import SegmentForm
from pricing_core.arrays import Vector

Contract = tuple[Option, Market]
ESCROWED = {"cash_dividends": [{"time": 1.0, "amount": 8.0}], "dividend_model": "escrowed"}
CONTRACTS: dict[str, Contract] = {
    "put": (Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2)),
    "put with r < q": (Option("put", 100.0, 1.0), Market(100.0, 0.03, 0.3, 0.07)),
    "call": (Option("call", 100.0, 1.0), Market(100.0, 0.03, 0.3, 0.07)),
    "put with two boundaries": (Option("put", 100.0, 1.0), Market(100.0, -0.005, 0.2, -0.05)),
    "call with two boundaries": (Option("call", 100.0, 1.0), Market(100.0, -0.05, 0.2, -0.005)),
    "escrowed put": (Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2, **ESCROWED)),
    "escrowed call": (Option("call", 100.0, 1.0), Market(100.0, 0.03, 0.3, 0.07, **ESCROWED)),
}


def segment_form(
    contract: Contract, intervals: int, *, stretching: float = 0.0, truncation: float = 1e-8
) -> tuple[SegmentForm, Vector]:
    """Return the form of the contract's last segment, and what exercise brings at its end at all nodes."""
    schedule = make_schedule(*contract)
    segment, sign = schedule.segments[-1], 1.0 if schedule.is_put else -1.0
    grid = reach(schedule, truncation).range_of(1.0, 1.0).grid(intervals, stretching)
    values = np.maximum(sign * (1.0 - segment.escrow / schedule.strike - grid.nodes), 0.0)
    form = SegmentForm.discretise(
        segment, grid, sign=sign, strike=schedule.strike, values=values, watched=(1.0,)
    )
    return form, values
