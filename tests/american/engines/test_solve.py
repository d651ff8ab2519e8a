"""The driver: which engine answers, which of two answers counts, and when the work ends."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from pricing_core import kernel_name
from pricing_core.american import (
    CashDividend,
    Market,
    Option,
    PiecewiseConstant,
    ProportionalDividend,
    price,
    price_many,
)
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import GREEK_LISTS, GREEKS, error_of, prices
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.engines.chunks import SMALLEST_CHUNK, mapped, solve_in_chunks
from pricing_core.american.engines.engine import Boundaries, Request
from pricing_core.american.engines.price_bounds import lies_high, range_of
from pricing_core.american.engines.solve import BOUNDS_ALONE, ENGINES, FAST_ENGINES, boundary_of, solve
from tests.problems.needs_kernel import needs_kernel
from tests.problems.random_events import random_contracts
from tests.problems.schedules import CONTRACTS

DIVIDENDS = [{"time": 0.5, "amount": 1.0}]
BOOK = Book.of(
    [(Option("put", 100.0, 1.0), Market(90.0 + k, 0.05, 0.2, cash_dividends=DIVIDENDS)) for k in range(4)]
)
TOLERANCE = 1e-4  # 0.01 at a strike of 100


@dataclass
class Stub:
    """An engine that says what it is told to; numbers may be lists, one for each of the four contracts."""

    name: str
    served: list[bool] = field(default_factory=lambda: [True] * 4)
    settled: list[bool] = field(default_factory=lambda: [True] * 4)
    error: list[float] = field(default_factory=lambda: [0.001] * 4)
    complete: list[bool] = field(default_factory=lambda: [True] * 4)
    status: list[str] = field(default_factory=lambda: ["ok"] * 4)
    value: float = 10.0
    vega: float = 1.0
    sensitivity: float = 1.0
    least_error: float = 0.0
    asked: list[list[int]] = field(default_factory=list)

    def of(self, book, column):
        """Return a column for the rows that the book holds, told by their spots."""
        return np.array(column)[(book.spot - 90.0).astype(int)]

    def serves(self, book):
        return self.of(book, self.served)

    def solve(self, book, request):
        rows = (book.spot - 90.0).astype(int)
        self.asked.append(rows.tolist())
        assert request.tolerance.size == book.count
        complete = self.of(book, self.complete)
        listed = book.listed.cash_dividends
        return prices(
            book.count,
            value=self.value + rows,
            european=np.full(book.count, 1.0),
            error=self.of(book, self.error),
            delta=np.full(book.count, self.value),
            vega=np.where(complete, self.vega, math.nan),
            dividend_sensitivities=Ragged(
                listed.first, np.where(complete, self.sensitivity, math.nan)[listed.owner()]
            ),
            settled=self.of(book, self.settled),
            complete=complete,
            status=np.array([self.status[row] for row in rows], dtype=object),
            method=self.name,
        )

    def boundary(self, book, request):
        def at(times):
            self.asked.append([])
            found = np.array(self.settled[: times.size])
            near = np.where(found, self.value, math.nan)
            return Boundaries(near, np.full(times.size, math.nan), near, found)

        return at


def solved(*engines, book=BOOK, **request):
    return solve(book, Request(np.full(book.count, TOLERANCE), **request), engines=engines)


def test_a_contract_goes_to_the_first_engine_that_serves_it():
    first, second = Stub("first", served=[True, False, True, False]), Stub("second", value=20.0)
    found = solved(first, second)
    assert found.method.tolist() == ["first", "second", "first", "second"]
    assert found.value.tolist() == [10.0, 21.0, 12.0, 23.0]
    assert found.status.tolist() == ["ok"] * 4
    assert (first.asked, second.asked) == ([[0, 2]], [[1, 3]])


def test_a_contract_goes_on_where_it_is_not_settled():
    first = Stub("first", settled=[True, False, True, True], error=[0.001, math.nan, 0.001, 0.001])
    second = Stub("second", value=20.0, error=[0.005] * 4)
    found = solved(first, second)
    assert found.method.tolist() == ["first", "second", "first", "first"]
    assert second.asked == [[1]]


def test_a_contract_goes_on_where_its_tolerance_is_missed_and_the_smaller_error_wins():
    first = Stub("first", error=[0.02, 0.02, 0.001, 0.02])
    second = Stub("second", value=20.0, error=[0.015, 0.03, 0.03, 0.005])
    found = solved(first, second)
    assert second.asked == [[0, 1, 3]]
    assert found.method.tolist() == ["second", "first", "first", "second"]
    assert found.error.tolist() == [0.015, 0.02, 0.001, 0.005]
    assert found.status.tolist() == ["tolerance_not_met", "tolerance_not_met", "ok", "ok"]


def test_an_engine_that_is_no_better_is_not_asked():
    first = Stub("first", error=[0.02, 0.2, math.nan, 0.001], settled=[True, True, False, True])
    second = Stub("second", value=20.0, least_error=1e-3)  # 0.1 at a strike of 100
    solved(first, second)
    assert second.asked == [[1, 2]]


def test_greeks_that_are_lacking_are_taken_from_the_next_engine():
    first = Stub("first", complete=[True, False, False, True])
    second = Stub("second", value=20.0, vega=2.0, sensitivity=3.0, error=[0.005, 0.005, 0.0005, 0.0005])
    found = solved(first, second)  # a smaller error does not take the place of one that meets the tolerance
    assert second.asked == [[1, 2]]
    assert found.method.tolist() == ["first"] * 4
    assert found.value.tolist() == [10.0, 11.0, 12.0, 13.0]
    assert found.delta.tolist() == [10.0] * 4
    assert found.vega.tolist() == [1.0, 2.0, 2.0, 1.0]
    assert [found.dividend_sensitivities.row(row) for row in range(4)] == [(1.0,), (3.0,), (3.0,), (1.0,)]
    assert found.complete.all()
    assert found.status.tolist() == ["ok"] * 4


def test_a_better_price_without_greeks_still_goes_on_for_them():
    first = Stub("first", error=[0.02] * 4)
    second = Stub("second", value=20.0, complete=[False] * 4)
    third = Stub("third", value=30.0, vega=3.0)
    found = solved(first, second, third)
    assert third.asked == [[0, 1, 2, 3]]
    assert found.method.tolist() == ["second"] * 4
    assert found.vega.tolist() == [3.0] * 4


def test_what_no_engine_prices_is_out_of_domain():
    nobody = Stub("nobody", served=[False, True, True, True])
    found = solved(nobody)
    assert found.status.tolist() == ["out_of_domain", "ok", "ok", "ok"]
    assert np.isnan(found.value).tolist() == [True, False, False, False]
    assert solved(book=BOOK).status.tolist() == ["out_of_domain"] * 4


def test_a_status_that_an_engine_gives_stands_and_ends_the_row():
    first = Stub("first", status=["ok", "deadline", "ok", "ok"], error=[0.001, 0.02, 0.001, 0.02])
    second = Stub("second", value=20.0)
    found = solved(first, second)
    assert second.asked == [[3]]
    assert found.status.tolist() == ["ok", "deadline", "ok", "ok"]


def test_an_interrupt_ends_with_a_deadline():
    first, second = Stub("first", error=[0.001, 0.02, math.nan, 0.001]), Stub("second")
    assert solved(first, interrupt=lambda: True).status.tolist() == ["deadline"] * 4
    assert first.asked == []
    questions = iter([False, *[True] * 9])
    first.settled = [True, True, False, True]
    found = solved(first, second, interrupt=lambda: next(questions))
    assert second.asked == []
    assert found.status.tolist()[0] == found.status.tolist()[3] == "ok"
    assert found.method.tolist() == ["first", "first", "none", "first"]
    least, most = range_of(BOOK)  # of what has no error: the middle between its bounds
    assert found.error[2] == 0.5 * (most - least)[2] == found.value[2] - least[2]


def test_the_tolerance_is_each_contracts_own():
    first = Stub("first", error=[0.02] * 4)
    found = solve(BOOK, Request(np.array([1e-4, 3e-4, 1e-3, 1e-5])), engines=(first,))
    assert found.status.tolist() == ["tolerance_not_met", "ok", "ok", "tolerance_not_met"]


def test_a_price_stays_within_the_bounds_of_no_arbitrage():
    found = solved(Stub("first", value=99.5, error=[0.02, 0.02, 0.001, 0.02]))
    assert found.value.tolist() == [
        99.5,
        100.0,
        100.0,
        100.0,
    ]  # at most the strike, whether or not the error is small
    assert found.status[2] == "ok"
    below = solved(Stub("first", value=8.0, error=[0.02] * 4))
    assert below.value.tolist() == [10.0, 9.0, 10.0, 11.0]  # spots of 90, 91, 92 and 93


@pytest.mark.parametrize("seed", range(20))
def test_no_value_above_its_bound_is_overlooked(seed):
    rng = np.random.default_rng(seed)
    contracts = []
    for _ in range(50):
        strike, years = float(rng.uniform(50.0, 150.0)), float(rng.uniform(0.1, 5.0))
        option = Option(
            str(rng.choice(["put", "call"])), strike, years, str(rng.choice(["american", "european"]))
        )
        times = np.sort(rng.uniform(0.0, years, 2)).tolist()
        market = Market(
            100.0,
            PiecewiseConstant(times, rng.uniform(-0.1, 0.2, 2)),
            0.2,
            PiecewiseConstant(times, rng.uniform(-0.1, 0.2, 2)),
            cash_dividends=[CashDividend(times[0], 2.0)] if rng.random() < 0.5 else (),
            proportional_dividends=[ProportionalDividend(times[1], 0.1)] if rng.random() < 0.5 else (),
            dividend_model=str(rng.choice(["spot", "escrowed"])),
        )
        contracts.append((option, market))
    book = Book.of(contracts)
    _, most = range_of(book)
    assert lies_high(book, most * (1.0 + 1e-9)).all()


def test_an_error_as_large_as_the_range_without_arbitrage_leaves_the_range():
    found = solved(Stub("first", error=[89.0, 90.0, 92.0, math.inf]))
    assert found.status.tolist() == ["tolerance_not_met"] * 4
    least, most = range_of(BOOK)
    for row in (2, 3):
        assert found.value[row] - found.error[row] == pytest.approx(least[row])
        assert found.value[row] + found.error[row] == pytest.approx(most[row])
    assert np.isnan(found.delta).tolist() == [False, False, True, True]
    assert found.message[2] == found.message[3] == BOUNDS_ALONE


# The boundary.


def test_a_boundary_comes_from_the_first_engine_that_finds_it_at_each_time():
    alone, times = BOOK.part(slice(0, 1)), np.array([0.0, 0.5, 1.0])
    first = Stub("first", settled=[True, False, True, True])
    second, third = Stub("second", value=20.0), Stub("third", value=30.0)
    request = Request(np.array([TOLERANCE]))
    engines = (Stub("nobody", served=[False] * 4), first, second, third)
    found = boundary_of(alone, request, engines)(times)
    assert found.near.tolist() == [10.0, 20.0, 10.0]
    assert found.found.all()
    assert third.asked == []
    nothing = boundary_of(alone, request, (replace(first, settled=[False] * 4),))(times)
    assert not nothing.found.any()
    assert np.isnan(nothing.near).all()


# The engines themselves.

MIXED = [
    *CONTRACTS.values(),
    *random_contracts(4, 60),
    (Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2)),
    (Option("call", 100.0, 1.0), Market(100.0, 0.05, 0.2, 0.06)),
    (Option("put", 100.0, 1.0), Market(80.0, -0.005, 0.2, -0.05)),  # two boundaries
    (Option("put", 100.0, 1.0), Market(0.0, 0.05, 0.2)),
    (Option("put", 100.0, 1.0), Market(90.0, 0.05, 0.0)),
    (Option("put", 100.0, 0.0), Market(90.0, 0.05, 0.2)),
    (Option("call", 100.0, 1.0, "european"), Market(90.0, 0.05, 0.2)),
    (Option("put", 100.0, 2.0), Market(60.9, 0.15515858795, 0.0813951507, 1.5)),  # beyond the march
]
COLUMNS = (
    *(
        "value",
        "european",
        "error",
        "delta",
        "gamma",
        "theta",
        "vega",
        "rho",
        "dividend_rho",
        "vanna",
        "volga",
    ),
    *("boundary", "exercised", "status", "method", "message", "solves", "steps"),
)


def assert_same_rows(found, row, other, place):
    for name in COLUMNS:
        np.testing.assert_array_equal(
            getattr(found, name)[row], getattr(other, name)[place], err_msg=f"{row} {name}"
        )
    for name in ("dividend_sensitivities", "rate_buckets", "dividend_yield_buckets", "volatility_buckets"):
        assert getattr(found, name).row(row) == getattr(other, name).row(place), (row, name)


def request_for(count, **changes):
    return Request(np.full(count, 1e-4), **changes)


@needs_kernel
@pytest.mark.parametrize("greeks", ["none", "standard"])
def test_a_row_depends_neither_on_the_others_nor_on_their_order(greeks):
    book, count = Book.of(MIXED), len(MIXED)
    together = solve(book, request_for(count, greeks=greeks))
    assert set(together.status) == {"ok"}
    assert {"closed-form", "premium-march", "obstacle-march", "expired"} <= set(together.method)
    order = np.random.default_rng(5).permutation(count)
    shuffled = solve(book.take(order), request_for(count, greeks=greeks))
    for place, row in enumerate(order.tolist()):
        assert_same_rows(together, row, shuffled, place)
    for row in range(0, count, 5):
        alone = solve(book.part(slice(row, row + 1)), request_for(1, greeks=greeks))
        assert_same_rows(together, row, alone, 0)


@needs_kernel
def test_extended_greeks_depend_neither_on_the_others_nor_on_their_order():
    chosen = [MIXED[row] for row in (0, 5, 11, 12, 20, -8, -7, -6, -5)]
    book, count = Book.of(chosen), len(chosen)
    together = solve(book, request_for(count, greeks="extended"))
    order = np.arange(count)[::-1]
    backward = solve(book.take(order), request_for(count, greeks="extended"))
    for place, row in enumerate(order.tolist()):
        assert_same_rows(together, row, backward, place)


@needs_kernel
@pytest.mark.parametrize("workers", [1, 2, 5])
def test_threads_and_chunks_change_no_bit(workers):
    contracts = [MIXED[row % 22] for row in range(3 * SMALLEST_CHUNK // 4)]
    book, count = Book.of(contracts), len(contracts)
    assert book.first[-1] > 2 * SMALLEST_CHUNK
    together = solve(book, request_for(count, greeks="none"))
    seen = []

    def keep(rows, part):
        seen.append(rows)
        for place, row in enumerate(range(rows.start, rows.stop)):
            assert_same_rows(together, row, part, place)

    solve_in_chunks(book, request_for(count, greeks="none"), keep, workers=workers)
    assert sorted(row for rows in seen for row in range(rows.start, rows.stop)) == list(range(count))
    assert (len(seen) > 1) == (workers > 1)


@needs_kernel
def test_shared_solves_stay_together_and_keep_their_tolerance():
    contracts = [(Option("put", 100.0, 1.0), Market(80.0 + k, 0.05, 0.2)) for k in range(40)]
    book, parts = Book.of(contracts), []
    solve_in_chunks(
        book, request_for(40, share_solves=True), lambda rows, part: parts.append((rows, part)), workers=4
    )
    assert [rows for rows, _ in parts] == [slice(0, 40)]
    alone = solve(book, request_for(40))
    assert np.all(np.abs(parts[0][1].value - alone.value) <= parts[0][1].error + alone.error)


def test_an_error_in_a_thread_is_raised():
    def fail(task):
        raise ZeroDivisionError(task)

    with pytest.raises(ZeroDivisionError):
        mapped(fail, [1, 2, 3], 2)
    assert mapped(lambda task: task + 1, [1, 2, 3], 2) == [2, 3, 4]


def test_the_engines_are_asked_from_the_fastest_to_the_slowest_and_that_in_numpy_only_without_a_kernel():
    assert [engine.name for engine in ENGINES] == [
        "closed form",
        "premium march",
        "compiled march",
        "hardly diffusing",
        "obstacle march",
    ]
    assert ENGINES[:3] == FAST_ENGINES
    assert np.logical_or.reduce([engine.serves(Book.of(MIXED)) for engine in ENGINES]).all()
    assert ENGINES[-1].serves(Book.of(MIXED)).any() == (kernel_name() == "numpy")


@needs_kernel
def test_a_contract_on_a_spot_of_zero_has_the_boundary_of_the_others():
    option = Option("put", 100.0, 1.0)
    for market in (Market(95.0, 0.05, 0.2), Market(95.0, 0.05, 0.2, cash_dividends=DIVIDENDS)):
        book = Book.of([(option, replace(market, spot=0.0)), (option, market)])
        found = solve(book, request_for(2, greeks="none"))
        assert found.boundary[0] == pytest.approx(found.boundary[1], rel=1e-3)
        assert found.method[0] == "worthless-underlying"


def test_without_the_compiled_engines_everything_is_served_all_the_same(monkeypatch):
    monkeypatch.setattr("pricing_core.kernel.price_options", None)
    monkeypatch.setattr("pricing_core.kernel.march_segments", None)
    contracts = [MIXED[0], MIXED[-8], MIXED[-7], MIXED[-2]]
    found = solve(Book.of(contracts), request_for(4))
    assert found.status.tolist() == ["ok"] * 4
    assert found.method.tolist() == ["obstacle-march", "obstacle-march", "obstacle-march", "closed-form"]


@needs_kernel
@pytest.mark.parametrize(
    ("option", "market"),
    [
        (Option("put", 100.0, 4.1266584), Market(88.7383491, 0.24919364, 0.25661712)),
        (Option("put", 100.0, 200.0), Market(100.0, 2.0, 0.2, 2.0)),
    ],
)
def test_contracts_without_events_that_the_premiums_march_gives_up_go_to_another_engine(option, market):
    found = price(option, market)
    assert found.method == "obstacle-march"
    finer = price(option, market, tolerance=1e-7)
    assert abs(found.price - finer.price) <= found.error_estimate + finer.error_estimate


def test_an_escrowed_dividend_may_be_worth_almost_all_of_the_spot():
    """It is worth the spot less 1e-6: bumped upward it would be worth more."""
    columns = {"option_type": "put", "strike": 100.0, "expiry": 1.0, "rate": 0.0, "volatility": 0.2}
    dividends = [None, [{"time": 0.5, "amount": 1.0}]]
    table = price_many(
        {
            **columns,
            "spot": [100.0, 1.000001],
            "cash_dividends": dividends,
            "dividend_model": ["spot", "escrowed"],
        },
        tolerance=1e-4,
    )
    assert table["status"].tolist() == ["ok", "ok"]
    assert table["price"][1] == pytest.approx(99.999999, abs=1e-2)
    assert table["dividend_sensitivities"][1] == pytest.approx((1.0,), abs=1e-3)


CURVE = {"times": [0.1, 0.2, 0.3], "values": [0.01, 0.02, 0.03]}
ALONE = {
    "European": {"option_type": "call", "exercise": "european", "spot": 86.28, "expiry": 0.274, "rate": 0.03},
    "expired": {"option_type": "put", "exercise": "american", "spot": 90.0, "expiry": 0.0, "rate": 0.05},
    "certain": {"option_type": "put", "exercise": "american", "spot": 95.0, "expiry": 0.5, "rate": 0.05},
}
VOLATILITIES = {"European": 0.298, "expired": 0.2, "certain": 0.0}


@pytest.mark.parametrize("name", ALONE)
def test_a_formula_gives_the_same_bits_next_to_a_contract_with_curves(name):
    row = {**ALONE[name], "strike": 100.0, "volatility": VOLATILITIES[name]}
    other = {**row, "exercise": "european", "expiry": 1.0, "rate": CURVE, "volatility": 0.25}
    alone = price_many({key: [value] for key, value in row.items()})
    together = price_many({key: [row[key], other[key]] for key in row})
    for column, cells in alone.items():
        same = cells[0] == together[column][0] or (cells[0] != cells[0])
        assert same, column


@pytest.mark.parametrize("asked", range(1, 13))
def test_an_interrupt_for_good_is_never_called_ok(asked):
    count = 0

    def interrupt():
        nonlocal count
        count += 1
        return count >= asked

    found = price(
        Option("put", 100.0, 1.0),
        Market(100.0, 0.05, 0.2),
        method="lcs",
        tolerance=1e-4,
        resolution=None,
        interrupt=interrupt,
    )
    assert found.status == "deadline" or (count < asked and found.vega is not None)
    assert found.price is None or abs(found.price - 6.090371) <= 0.1


@pytest.mark.parametrize("exercise", ["american", "european"])
def test_an_interrupt_that_is_true_once_is_remembered(exercise):
    for asked in (1, 2):
        count = 0

        def interrupt(asked=asked):
            nonlocal count
            count += 1
            return count == asked

        found = price(Option("put", 100.0, 1.0, exercise), Market(100.0, 0.05, 0.2), interrupt=interrupt)
        assert (found.status, found.price) == ("deadline", None) or count < asked


EXERCISED = {
    "march": (Option("put", 100.0, 1.0), Market(60.0, 0.05, 0.2)),
    "collocation": (
        Option("put", 100.0, 1.0),
        Market(50.0, 0.08, 0.2, cash_dividends=[CashDividend(0.5, 0.01)]),
    ),
    "curve": (Option("put", 100.0, 1.0), Market(50.0, {"times": [0.5, 1.0], "values": [0.05, 0.06]}, 0.2)),
    "two boundaries": (Option("put", 100.0, 1.0), Market(80.0, -0.01, 0.1, -0.05)),
    "expired": (Option("put", 100.0, 0.0), Market(60.0, 0.05, 0.2, cash_dividends=[CashDividend(0.5, 1.0)])),
    "expired out of the money": (Option("call", 100.0, 0.0), Market(60.0, 0.05, 0.2)),
}


@needs_kernel
@pytest.mark.parametrize("name", EXERCISED)
def test_greeks_of_a_payoff_have_no_error_and_no_charm(name):
    option, market = EXERCISED[name]
    book = Book.of([(option, replace(market, spot=market.spot + by)) for by in (-0.01, 0.0, 0.01)])
    standard, extended = (solve(book, request_for(3, greeks=greeks)) for greeks in ("standard", "extended"))
    assert extended.value == pytest.approx(book.payoff(), abs=1e-14)  # now, and so delta and gamma are known
    assert extended.delta == pytest.approx(np.diff(book.payoff())[0] / 0.01, abs=1e-10)
    for greek in GREEKS:
        if greek == "delta_sticky_moneyness":  # of local volatilities alone
            assert np.isnan(standard.delta_sticky_moneyness).all()
            continue
        with_error = extended if greek in ("vanna", "volga", "charm") else standard
        np.testing.assert_array_equal(getattr(with_error, error_of(greek)), 0.0, err_msg=greek)
        absent = getattr(standard, error_of(greek))[np.isnan(getattr(standard, greek))]
        assert np.isnan(absent).all()
    for greek in GREEK_LISTS:
        values, errors = getattr(extended, greek), getattr(extended, error_of(greek))
        assert errors.first.tolist() == values.first.tolist()
        assert not errors.values.any()
    assert extended.charm.tolist() == [0.0] * 3
    none = solve(book, request_for(3, greeks="none"))
    assert np.isnan(none.vega_error).all()


def test_at_expiry_the_payoff_has_no_delta_at_the_strike():
    book = Book.of([(Option("put", 100.0, 0.0), Market(spot, 0.05, 0.2)) for spot in (99.0, 100.0, 101.0)])
    found = solve(book, request_for(3, greeks="standard"))
    assert np.isnan(found.delta_error).tolist() == [False, True, False]
