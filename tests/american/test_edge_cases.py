import pytest

from pricing_core.american import Market, Option, price
from tests.problems.event_values import event_values
from tests.problems.true_values import _rows

TWO_BOUNDARIES = [case for case in event_values() if case.market.rate < 0.0]


@pytest.mark.parametrize("row", _rows("american_edge_cases.csv"), ids=lambda row: "-".join(row.values()))
def test_limiting_cases_have_their_exact_answers(row):
    numbers = {name: float(text) for name, text in row.items() if name != "option_type"}
    option = Option(row["option_type"], numbers["strike"], numbers["days"] / 365.0)
    market = Market(numbers["spot"], numbers["rate"], numbers["volatility"], numbers["dividend_yield"])
    assert price(option, market).price == pytest.approx(
        numbers["expected"], rel=0.0, abs=numbers["tolerance"]
    )


@pytest.mark.parametrize("case", TWO_BOUNDARIES, ids=lambda case: case.name)
def test_puts_with_two_boundaries_meet_the_default_tolerance(case):
    found = price(case.option, case.market, greeks=False)
    assert found.status == "ok"
    assert found.price == pytest.approx(case.price, abs=2e-6 * case.option.strike)
