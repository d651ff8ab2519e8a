"""Limiting cases have their exact answers, and puts with two boundaries meet the default tolerance."""

import pytest

from pricing_core.american import Market, Option, price
from tests.problems.event_values import event_values
from tests.problems.needs_kernel import needs_kernel
from tests.problems.true_values import rows_of

TWO_BOUNDARIES = [case for case in event_values() if case.market.rate < 0.0]


# The grid's errors are a part of the spot, those of the compiled engines of the price.
ROWS = [
    pytest.param(row, id="-".join(row.values()), marks=[needs_kernel] * (row["strike"] == "1e-8"))
    for row in rows_of("american_edge_cases.csv")
]


@pytest.mark.parametrize("row", ROWS)
def test_limiting_cases_have_their_exact_answers(row):
    numbers = {name: float(text) for name, text in row.items() if name != "option_type"}
    option = Option(row["option_type"], numbers["strike"], numbers["days"] / 365.0)
    market = Market(numbers["spot"], numbers["rate"], numbers["volatility"], numbers["dividend_yield"])
    assert price(option, market).price == pytest.approx(
        numbers["expected"], rel=0.0, abs=numbers["tolerance"]
    )


@pytest.mark.parametrize("case", TWO_BOUNDARIES, ids=lambda case: case.name)
def test_puts_with_two_boundaries_meet_the_default_tolerance(case):
    found = price(case.option, case.market, greeks="none")
    assert found.status == "ok"
    assert found.price == pytest.approx(case.price, abs=2e-6 * case.option.strike)
