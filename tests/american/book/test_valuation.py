"""A valuation is printed as a user wants to read it."""

from dataclasses import replace

from pricing_core.american import Market, Option, price
from tests.problems.needs_kernel import needs_kernel

PUT, MARKET = Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2)


@needs_kernel
def test_a_printed_valuation_is_a_few_lines_of_what_is_known():
    valuation = price(PUT, MARKET)
    lines = str(valuation).splitlines()
    assert lines[0].startswith(
        f"price {valuation.price:.8g}, error_estimate {valuation.error_estimate:.8g}, status ok,"
    )
    assert lines[0].endswith("method premium-march")
    assert lines[2] == f"exercise_boundary {valuation.exercise_boundary:.8g}, exercise_now False"
    assert [part.split()[0] for part in lines[3].split(", ")] == [
        *("delta", "gamma", "theta", "vega", "rho", "dividend_rho"),
    ]
    assert len(lines) == 4
    assert "None" not in str(valuation)


def test_what_is_missing_is_not_printed_and_long_lists_are_cut():
    known = price(Option("put", 100.0, 1.0, "european"), MARKET, greeks="none")
    assert len(str(known).splitlines()) == 3
    buckets = replace(known, exercise_boundary=None, rate_buckets=(1.0, 2.0, 3.0, 4.0, 5.0))
    assert str(buckets).splitlines()[2:] == ["exercise_now False", "rate_buckets (1, 2, 3, 4, ...)"]
    reason = replace(known.diagnostics, message="beyond the nodes")
    nothing = replace(
        known,
        price=None,
        european_price=None,
        early_exercise_premium=None,
        error_estimate=None,
        status="deadline",
        method="none",
        diagnostics=reason,
    )
    assert str(nothing).splitlines() == [
        "status deadline, method none",
        "intrinsic_value 0",
        "exercise_now False",
        "beyond the nodes",
    ]
