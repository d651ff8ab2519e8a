"""Differences of bumped contracts, priced by a formula whose derivatives are known."""

import numpy as np
import pytest

from pricing_core.american import Market, Option
from pricing_core.american.book.book import Book
from pricing_core.american.engines.black_scholes import european_columns
from pricing_core.american.engines.differences import BUCKETS, plan_differences, stored, unchanged
from tests.problems.schedules import RATES, VOLATILITIES, YIELDS, cash

PUT, CALL = (Option(option_type, 100.0, 1.0, "european") for option_type in ("put", "call"))
CURVES = Market(95.0, RATES, VOLATILITIES, YIELDS)
ESCROWED = {"cash_dividends": cash(2.0, (0.0, 0.25, 0.5, 1.0, 1.5)), "dividend_model": "escrowed"}
CONTRACTS = [
    (PUT, Market(95.0, 0.05, 0.25, 0.03)),
    (CALL, Market(95.0, 0.0, 0.25, 0.0)),  # bumped upward only
    (CALL, Market(95.0, -0.03, 0.25, -0.01)),
    (Option("put", 100.0, 5.0, "european"), Market(95.0, 0.05, 0.25, 0.03)),
    (PUT, CURVES),
    (CALL, Market(110.0, RATES, VOLATILITIES, YIELDS, **ESCROWED)),
    (PUT, Market(95.0, {"times": [0.5, 1.0], "values": [0.0, 0.05]}, 0.3, 0.01)),
    (PUT, Market(95.0, 0.05, {"times": [0.5, 3.0, 4.0], "values": [0.2, 0.3, 0.4]}, 0.01)),
]
NUMBERS = ("vega", "rho", "dividend_rho", "vanna", "volga")
LISTS = ("dividend_sensitivities", *BUCKETS.values())


def differences(contracts, *, extended=True, share=1.0):
    """Return the derivatives by differences of the formula."""
    plan = plan_differences(Book.of(contracts), extended=extended, share=share)
    found = european_columns(plan.book, "none")
    return plan.columns(found["value"], found["delta"])


@pytest.mark.parametrize("row", range(len(CONTRACTS)))
def test_they_are_the_derivatives(row):
    contract = CONTRACTS[row]
    found = differences([contract])
    exact = european_columns(Book.of([contract]), "extended")
    # One-sided differences of second order have four times the error of central ones, and further from zero.
    for name in NUMBERS:
        assert found[name] == pytest.approx(exact[name], rel=2e-4, abs=2e-3), name
    for name in LISTS:
        if name == "rate_buckets" and contract[1].dividend_model == "escrowed":
            continue  # the sum is tested below
        wanted = exact.get(name)
        if wanted is None:
            assert found[name].values.size == 0
        else:
            assert found[name].row(0) == pytest.approx(wanted.row(0), rel=2e-4, abs=2e-3), name


@pytest.mark.parametrize("row", range(len(CONTRACTS)))
def test_the_buckets_of_a_curve_sum_to_the_parallel_derivative(row):
    found = differences([CONTRACTS[row]])
    for name, whole in (("rate", "rho"), ("dividend_yield", "dividend_rho"), ("volatility", "vega")):
        if found[BUCKETS[name]].values.size:
            assert sum(found[BUCKETS[name]].row(0)) == pytest.approx(found[whole][0], rel=1e-3, abs=2e-3), (
                name
            )


def test_the_error_falls_with_the_square_of_the_step():
    exact = european_columns(Book.of(CONTRACTS), "extended")
    errors = []
    for share in (8.0, 4.0, 2.0):
        found = differences(CONTRACTS, share=share)
        errors.append([np.abs(found[name] - exact[name]).max() for name in ("vega", "rho", "dividend_rho")])
    ratios = np.array(errors[:-1]) / np.array(errors[1:])
    assert ratios == pytest.approx(4.0, rel=0.1)


def test_a_rate_next_to_zero_is_bumped_upward_only_and_one_below_both_ways():
    for row, least in ((1, 0.0), (2, -0.032)):
        plan = plan_differences(Book.of([CONTRACTS[row]]), extended=False)
        assert plan.book.segments.rate.min() >= least
        assert plan.book.segments.dividend_yield.min() >= least
    assert plan.book.segments.rate.min() < -0.03


def test_every_entry_is_a_dividend_or_a_piece_of_the_market():
    found = differences([CONTRACTS[5], CONTRACTS[7], CONTRACTS[0]])
    dividends = found["dividend_sensitivities"]
    assert dividends.counts().tolist() == [5, 0, 0]
    assert [number == 0.0 for number in dividends.row(0)] == [True, False, False, False, True]
    volatility = found["volatility_buckets"]
    assert volatility.counts().tolist() == [3, 3, 0]
    assert volatility.row(1)[2] == 0.0  # holds after expiry alone
    assert min(volatility.row(1)[:2]) > 1.0


def test_a_dividend_of_nothing_has_its_sensitivity_too():
    def put(amount):
        dividends = [{"time": 0.5, "amount": amount}]
        return PUT, Market(95.0, 0.05, 0.25, cash_dividends=dividends, dividend_model="escrowed")

    nothing, something = (differences([put(amount)], extended=False) for amount in (0.0, 1e-2))
    expected = something["dividend_sensitivities"].row(0)
    assert nothing["dividend_sensitivities"].row(0) == pytest.approx(expected, rel=1e-3)


def test_without_extended_greeks_fewer_contracts_are_priced():
    standard, extended = (plan_differences(Book.of(CONTRACTS), extended=e) for e in (False, True))
    assert standard.book.count < extended.book.count
    assert set(standard.row.tolist()) == set(range(len(CONTRACTS)))
    found = differences(CONTRACTS, extended=False)
    assert not {"vanna", "volga", *BUCKETS.values()} & found.keys()
    whole = differences(CONTRACTS)
    for name in ("vega", "rho", "dividend_rho"):
        np.testing.assert_array_equal(found[name], whole[name])


def test_a_row_does_not_depend_on_the_others():
    together = differences(CONTRACTS)
    for row, contract in enumerate(CONTRACTS):
        alone = differences([contract])
        for name in NUMBERS:
            assert together[name][row] == alone[name][0], name
        for name in LISTS:
            assert together[name].row(row) == alone[name].row(0), name


def test_a_price_that_is_missing_leaves_what_needs_it_missing():
    plan = plan_differences(Book.of(CONTRACTS), extended=True)
    found = european_columns(plan.book, "none")
    value = np.where(plan.row == 5, np.nan, found["value"])
    columns = plan.columns(value, found["delta"])
    assert np.flatnonzero(np.isnan(columns["vega"])).tolist() == [5]
    for name in LISTS:
        missing = np.unique(columns[name].owner()[np.isnan(columns[name].values)])
        assert missing.tolist() == [5]


def test_what_nothing_changes_has_derivatives_of_zero_of_the_right_shape():
    book = Book.of(CONTRACTS)
    columns, found = unchanged(book, extended=True), differences(CONTRACTS)
    assert columns.keys() == found.keys()
    for name in NUMBERS:
        assert columns[name].tolist() == [0.0] * len(CONTRACTS)
    for name in LISTS:
        assert columns[name].counts().tolist() == found[name].counts().tolist()
        assert not columns[name].values.any()
    assert not {"vanna", *BUCKETS.values()} & unchanged(book, extended=False).keys()


def test_columns_found_elsewhere_are_put_in():
    rows = np.array([5, 4, 0])
    columns = unchanged(Book.of(CONTRACTS), extended=True)
    found = differences([CONTRACTS[row] for row in rows])
    put = stored(columns, rows, found)
    whole = differences(CONTRACTS)
    for name in NUMBERS:
        assert put[name][rows].tolist() == whole[name][rows].tolist()
        assert np.count_nonzero(put[name]) <= 3
        assert not columns[name].any()
    for name in LISTS:
        assert [put[name].row(row) for row in rows] == [whole[name].row(row) for row in rows]
