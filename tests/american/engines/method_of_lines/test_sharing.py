"""Contracts that share their solves: the prices of each on its own, from fewer solves."""

import numpy as np
import pytest

from pricing_core.american import (
    CashDividend,
    LocalVolatility,
    Market,
    Option,
    PiecewiseConstant,
    value_surface,
)
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import GREEK_LISTS, GREEKS, error_of
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.method_of_lines import MethodOfLines, joint_work
from pricing_core.american.engines.method_of_lines.across_strikes import FEWEST_STRIKES
from pricing_core.american.engines.method_of_lines.joint_work import sweep_together
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel

SURFACE = LocalVolatility.from_function(
    lambda time, spots: (0.22 + 0.04 * time) * (spots / 100.0) ** -0.5,
    np.linspace(0.0, 1.0, 5),
    np.geomspace(30.0, 300.0, 40),
)
CURVE = PiecewiseConstant([0.4, 2.0], [0.06, 0.03])


def market(spot=100.0, rate=0.05, volatility=SURFACE, **others):
    return Market(spot, rate, volatility, **({"dividend_yield": 0.02} | others))


@pytest.fixture
def swept(monkeypatch):
    """Count the sweeps that are done."""
    counted = []

    def counting(requests, interrupt):
        counted.append(len(requests))
        return sweep_together(requests, interrupt)

    monkeypatch.setattr(joint_work, "sweep_together", counting)
    return counted


def solved(contracts, swept, *, tolerance=1e-5, greeks="standard"):
    """Return the prices on their own and shared, and how many sweeps each took."""
    book = Book.of(contracts)
    found, counts = [], []
    for share in (False, True):
        swept.clear()
        request = Request(np.full(book.count, tolerance), greeks, share_solves=share)
        found.append(MethodOfLines().solve(book, request))
        counts.append(sum(swept))
    return book, *found, *counts


def agree(book, alone, shared, tolerance=1e-5):
    """Assert that both say the same within what both claim."""
    assert (shared.status == "ok").all()
    assert (shared.error <= tolerance * book.strike).all()
    assert (np.abs(shared.value - alone.value) <= shared.error + alone.error).all()
    for name in (*GREEKS, *GREEK_LISTS):
        mine, theirs = (getattr(prices, name) for prices in (shared, alone))
        errors = [getattr(prices, error_of(name)) for prices in (shared, alone)]
        if name in GREEK_LISTS:
            mine, theirs, *errors = (column.values for column in (mine, theirs, *errors))
        np.testing.assert_array_equal(np.isnan(mine), np.isnan(theirs))
        edge = np.zeros(mine.shape, dtype=bool)
        if name not in GREEK_LISTS:  # on the boundary it is 0 or not: one may hold what the other exercises
            edge = alone.exercised != shared.exercised
        with np.errstate(invalid="ignore"):
            far = np.abs(mine - theirs) > errors[0] + errors[1] + 1e-9 * np.abs(theirs)
        assert (far & ~edge).sum() <= 0.03 * far.size, name


def test_spots_of_one_strike_share_every_sweep(swept):
    contracts = [(Option("put", 100.0, 1.0), market(spot)) for spot in np.linspace(70.0, 140.0, 30)]
    book, alone, shared, many, few = solved(contracts, swept)
    agree(book, alone, shared)
    assert few < many / 20


@pytest.mark.parametrize("greeks", ["none", "standard", "extended"])
def test_strikes_and_spots_of_a_curve_share_every_sweep(swept, greeks):
    rng = np.random.default_rng(3)
    contracts = [
        (Option("call", rng.uniform(80.0, 120.0), 1.0), market(rng.uniform(80.0, 120.0), CURVE, 0.25))
        for _ in range(20)
    ]
    book, alone, shared, many, few = solved(contracts, swept, greeks=greeks)
    agree(book, alone, shared)
    assert few < many / 10


TWICE = (CashDividend(0.3, 2.0), CashDividend(0.8, 2.0))


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("option_type", "dividends"),
    [
        ("put", ()),
        ("put", TWICE),
        ("call", ()),
        ("call", TWICE),
    ],
)
def test_strikes_of_a_surface_are_interpolated_between_a_few(swept, option_type, dividends):
    strikes = np.linspace(65.0, 150.0, 200)
    contracts = [(Option(option_type, k, 1.0), market(cash_dividends=dividends)) for k in strikes.tolist()]
    book, alone, shared, many, few = solved(contracts, swept)
    agree(book, alone, shared)
    assert few < many / 2.5
    assert (shared.solves == 0).sum() > 100
    np.testing.assert_allclose(shared.european, alone.european, atol=2e-3)


def test_rows_come_back_in_their_order_whatever_shares_with_what(swept):
    rng = np.random.default_rng(5)
    contracts = [
        (Option(rng.choice(["put", "call"]), float(k), 1.0), market(float(rng.choice([95.0, 100.0]))))
        for k in rng.permutation(np.linspace(80.0, 125.0, 2 * FEWEST_STRIKES + 40))
    ]
    contracts += [(Option("put", 100.0, 0.5), market(volatility=0.3)), (Option("put", 90.0, 0.7), market())]
    _, alone, shared, *_ = solved(contracts, swept, greeks="none")
    assert (np.abs(shared.value - alone.value) <= shared.error + alone.error).all()
    assert (shared.status == "ok").all()


def test_contracts_that_differ_in_more_share_nothing(swept):
    contracts = [
        (Option("put", 100.0, 1.0), market()),
        (Option("call", 100.0, 1.0), market()),
        (Option("put", 100.0, 1.1), market()),
        (Option("put", 101.0, 1.0), market()),
        (Option("put", 100.0, 1.0), market(rate=0.04)),
        (Option("put", 100.0, 1.0), market(volatility=SURFACE.shifted(0.01))),
    ]
    _, alone, shared, many, same = solved(contracts, swept)
    assert many == same
    np.testing.assert_array_equal(alone.value, shared.value)


def test_an_interrupt_ends_shared_work(monkeypatch):
    contracts = [(Option("put", k, 1.0), market()) for k in np.linspace(80.0, 120.0, 60).tolist()]
    book = Book.of(contracts)
    asked = []

    def interrupt():
        asked.append(1)
        return len(asked) > 40

    request = Request(np.full(book.count, 1e-6), "none", share_solves=True, interrupt=interrupt)
    found = MethodOfLines().solve(book, request)
    assert "deadline" in set(found.status)
    assert set(found.status) <= {"ok", "deadline"}


def test_a_surface_of_values_with_a_local_volatility_takes_one_solve_for_each_time(swept):
    spots = np.linspace(80.0, 120.0, 15)
    found = value_surface(Option("put", 100.0, 1.0), market(), spots=spots, times=[0.0, 0.5], tolerance=1e-5)
    assert found.status == "ok"
    assert sum(swept) < 40
