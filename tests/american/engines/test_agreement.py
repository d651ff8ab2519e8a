"""Three engines that share no discretisation, asked the same questions: they agree within their error estimates.

The march of the premium is compiled and has no twin in Python; this is its check, besides closed forms and published
values. What is allowed beyond the estimates is stated with what was measured.
"""

import numpy as np
import pytest

from pricing_core.american import Market, Option
from pricing_core.american.book.book import Book
from pricing_core.american.engines.closed_form import ClosedForm
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march import CompiledMarch, ObstacleMarch
from pricing_core.american.engines.premium_march import PremiumMarch
from tests.problems.engines import solved
from tests.problems.needs_kernel import needs_kernel
from tests.problems.random_events import random_contracts
from tests.problems.true_values import true_values

pytestmark = needs_kernel
PREMIUM, MARCH, GENERAL = PremiumMarch(), CompiledMarch(), ObstacleMarch()
nightly = pytest.mark.nightly


def random_flat_contracts(seed, count):
    """Return American puts and calls of 5 days to 10 years, 5 % to 100 % volatility, rates of -2 % to 15 %."""
    rng = np.random.default_rng(seed)
    contracts = []
    for _ in range(count):
        expiry = float(np.exp(rng.uniform(np.log(5 / 365), np.log(10.0))))
        volatility = float(np.exp(rng.uniform(np.log(0.05), np.log(1.0))))
        rate, dividend_yield = rng.uniform(-0.02, 0.15, 2).tolist()
        spot = 100.0 * float(np.exp(rng.normal() * min(volatility * np.sqrt(expiry), 0.7)))
        option = Option(str(rng.choice(["put", "call"])), 100.0, expiry)
        contracts.append((option, Market(spot, rate, volatility, dividend_yield)))
    return contracts


def asked(book, tolerance):
    return Request(np.full(book.count, tolerance), "none")


def served_by(book, *engines):
    """Return the contracts that all of the engines serve."""
    return book.take(np.flatnonzero(np.logical_and.reduce([engine.serves(book) for engine in engines])))


def ratios(one, other, settled):
    """Return the distance of two prices over the sum of their error estimates."""
    distance, stated = np.abs(one.value - other.value)[settled], (one.error + other.error)[settled]
    return np.where(distance == 0.0, 0.0, distance / np.maximum(stated, 1e-300))


@pytest.mark.parametrize(
    ("seed", "count"), [(1, 200), pytest.param(2, 3000, marks=nightly)], ids=["few", "many"]
)
def test_both_marches_agree_without_events(seed, count):
    """Measured on 3,000: apart by more than both estimates in 0.6 %."""
    book = served_by(Book.of(random_flat_contracts(seed, count)), PREMIUM, MARCH)
    premium, march = PREMIUM.solve(book, asked(book, 1e-7)), MARCH.solve(book, asked(book, 1e-5))
    settled = premium.settled & march.settled
    assert np.count_nonzero(settled) > 0.8 * count
    assert np.mean(march.error[settled] <= 1e-5 * 100.0) > 0.98
    apart = ratios(premium, march, settled)
    assert np.mean(apart > 1.0) <= 0.015
    assert apart.max() <= 10.0
    size = np.maximum(book.spot, book.strike)[settled]
    assert np.max(np.abs(premium.value - march.value)[settled] / size) <= 2e-5
    np.testing.assert_array_equal(premium.exercised[settled], march.exercised[settled])
    np.testing.assert_allclose(premium.european[settled], march.european[settled], rtol=0.0, atol=1e-5)


@pytest.mark.parametrize(
    ("seed", "count"), [(5, 25), pytest.param(6, 400, marks=nightly)], ids=["few", "many"]
)
@pytest.mark.parametrize("engine", [PREMIUM, MARCH], ids=lambda engine: engine.name)
def test_the_general_march_agrees_without_events(engine, seed, count):
    """Measured on 120: never apart by more than both estimates."""
    book = served_by(Book.of(random_flat_contracts(seed, count)), engine)
    fast, lines = engine.solve(book, asked(book, 1e-8)), GENERAL.solve(book, asked(book, 1e-6))
    settled = fast.settled
    assert np.count_nonzero(settled) > 0.6 * count
    assert np.mean(lines.error <= 1e-6 * 100.0) > 0.95
    apart = ratios(fast, lines, settled)
    assert np.mean(apart > 1.0) <= 0.01
    assert apart.max() <= 2.0
    np.testing.assert_array_equal(fast.exercised[settled], lines.exercised[settled])
    assert np.max(np.abs(fast.delta - lines.delta)[settled]) <= 1e-4
    known = settled & np.isfinite(fast.boundary)
    if engine is PREMIUM:  # the other one knows none that lies beyond its grid
        np.testing.assert_array_equal(np.isnan(fast.boundary)[settled], np.isnan(lines.boundary)[settled])
    distance = np.abs(lines.boundary / fast.boundary - 1.0)[
        known
    ]  # the march of obstacle problems states no error of it
    assert np.quantile(distance, 0.98) <= 2e-3
    assert distance.max() <= 1e-2


@pytest.mark.parametrize(
    ("seed", "count"), [(8, 5), pytest.param(9, 400, marks=nightly)], ids=["few", "many"]
)
def test_the_marches_agree_whatever_the_events(seed, count):
    """Measured on 120: apart by more than both estimates in one, by 1.3 times them."""
    book = served_by(Book.of(random_contracts(seed, count)), MARCH)
    fast, lines = MARCH.solve(book, asked(book, 1e-7)), GENERAL.solve(book, asked(book, 1e-6))
    settled = fast.settled
    assert np.count_nonzero(settled) > 0.9 * count
    assert np.mean(lines.error <= 1e-6 * 100.0) > 0.95
    apart = ratios(fast, lines, settled)
    assert np.mean(apart > 1.0) <= 0.05  # what the march of obstacle problems claims of its estimate
    assert apart.max() <= 4.0
    assert np.max(np.abs(fast.delta - lines.delta)[settled]) <= 2e-5
    assert np.max(np.abs(fast.gamma - lines.gamma)[settled]) * 100.0 <= 1e-3  # what both are accurate to
    close = np.abs(fast.european - lines.european)[settled]
    assert np.max(close) <= 1e-4


# Closed forms.


@pytest.mark.parametrize("count", [300, pytest.param(5000, marks=nightly)], ids=["few", "many"])
@pytest.mark.parametrize("engine", [PREMIUM, MARCH], ids=lambda engine: engine.name)
def test_the_value_without_exercise_is_the_formulas(engine, count):
    book = served_by(Book.of(random_flat_contracts(10, count)), engine)
    found = engine.solve(book, asked(book, 1e-8))
    exact = ClosedForm().solve(book.european(), asked(book, 1e-8)).value
    size = np.maximum(book.spot, book.strike)
    settled = found.settled if engine is PREMIUM else slice(None)
    assert np.max((np.abs(found.european - exact) / size)[settled]) <= 1e-9


def test_the_march_prices_european_contracts_with_curves_and_fractions_as_the_formula_does():
    book = Book.of(random_contracts(11, 400)).european()
    book = served_by(book, MARCH, ClosedForm())
    assert book.count > 150
    found, exact = (engine.solve(book, asked(book, 1e-8)) for engine in (MARCH, ClosedForm()))
    assert found.settled.all()
    assert np.max(np.abs(found.value - exact.value)) <= 1e-8 * 100.0
    assert np.max(np.abs(found.delta - exact.delta)) <= 1e-6
    assert np.max(np.abs(found.gamma - exact.gamma)) * 100.0 <= 1e-4
    assert not found.exercised.any()


NEVER = [
    (Option("put", 100.0, 1.0), Market(95.0, -0.02, 0.3, 0.01)),
    (Option("put", 100.0, 2.0), Market(120.0, -0.03, 0.2, -0.01)),
    (Option("call", 100.0, 1.0), Market(95.0, 0.04, 0.3, -0.01)),
    (Option("call", 100.0, 3.0), Market(130.0, -0.01, 0.25, -0.02)),
]


@pytest.mark.parametrize("engine", [MARCH, GENERAL], ids=lambda engine: engine.name)
@pytest.mark.parametrize("contract", NEVER)
def test_what_is_never_exercised_is_worth_the_formula_to_every_engine(engine, contract):
    exact, found = solved(ClosedForm(), contract), solved(engine, contract, tolerance=1e-6)
    if not found.settled[0]:
        pytest.skip("given up")
    assert abs(found.value[0] - exact.value[0]) <= found.error[0] + exact.error[0]
    assert np.isnan(found.boundary[0])
    assert not found.exercised[0]


@pytest.mark.parametrize("engine", [PREMIUM, MARCH, GENERAL], ids=lambda engine: engine.name)
def test_calls_are_puts_with_spot_and_strike_and_rate_and_yield_exchanged(engine):
    """McDonald and Schroder 1998: call(S, K, r, q) = put(K, S, q, r); S*_call S*_put = K S."""
    contracts = random_flat_contracts(12, 12 if engine is GENERAL else 400)
    mirrored = [
        (
            Option("call" if option.option_type == "put" else "put", market.spot, option.expiry),
            Market(option.strike, market.dividend_yield, market.volatility, market.rate),
        )
        for option, market in contracts
    ]
    book, other_book = Book.of(contracts), Book.of(mirrored)
    both = np.flatnonzero(engine.serves(book) & engine.serves(other_book))
    book, other_book = book.take(both), other_book.take(both)
    one, other = engine.solve(book, asked(book, 1e-6)), engine.solve(other_book, asked(book, 1e-6))
    settled = one.settled & other.settled
    assert np.count_nonzero(settled) > 0.7 * len(contracts)
    apart = ratios(one, other, settled)
    assert np.mean(apart > 1.0) <= 0.01
    assert apart.max() <= 4.0
    product = one.boundary * other.boundary / (book.spot * book.strike)
    known = settled & np.isfinite(product)
    assert np.quantile(np.abs(product[known] - 1.0), 0.9) <= 1e-3


@pytest.mark.parametrize("engine", [PREMIUM, MARCH, GENERAL], ids=lambda engine: engine.name)
def test_published_values_are_met_by_every_engine_alone(engine):
    cases = [case for case in true_values() if case.market.rate > 0.0 and case.market.dividend_yield >= 0.0]
    book = served_by(Book.of([(case.option, case.market) for case in cases]), engine)
    assert book.count == len(cases)
    found = engine.solve(book, asked(book, 1e-6))
    assert found.settled.all()
    error = np.abs(found.value - [case.price for case in cases]) / book.strike
    known = np.array([case.reference_error for case in cases])
    assert np.all(error <= np.maximum(1e-6, 2.0 * found.error / book.strike) + known)
    assert np.mean(error <= found.error / book.strike + known) >= 0.95
    assert np.mean(found.error <= 1e-6 * book.strike) >= 0.9
