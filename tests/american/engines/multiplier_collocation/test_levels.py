from dataclasses import replace

import numpy as np
import pytest

from pricing_core.american import Market, Option, price
from pricing_core.american.book.book import Book
from pricing_core.american.book.cuts import with_cuts
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.multiplier_collocation.levels import (
    FINEST,
    boundaries_at,
    solve_at_level,
    solve_to_tolerance,
)
from pricing_core.american.engines.multiplier_collocation.served import is_served
from pricing_core.american.engines.obstacle_march import ObstacleMarch
from pricing_core.american.engines.premium_march import PremiumMarch
from tests.problems.engines import solved as solved_by
from tests.problems.event_values import Event, event_values, quadrature_value
from tests.problems.needs_kernel import needs_kernel
from tests.problems.random_events import random_contracts
from tests.problems.schedules import CONTRACTS
from tests.problems.true_values import true_values

pytestmark = needs_kernel
ONE_BOUNDARY = [case for case in event_values() if case.market.rate > 0.0]


def solved(book, tolerance=1e-8):
    """Return value and error of the first contract, money."""
    found = solve_to_tolerance(book, np.full(book.count, tolerance), 1)
    return book.strike[0] * found.value[0], book.strike[0] * found.error[0]


def at_level(book, level):
    """Return V/K of the first contract."""
    found = solve_at_level(book, np.array([level]), 1)
    assert found.settled.all()
    return found.numbers[0, 0]


@pytest.mark.parametrize("case", ONE_BOUNDARY, ids=lambda case: case.name)
def test_calls_with_a_dividend_have_their_exact_values(case):
    value, error = solved(Book.of([(case.option, case.market)]))
    assert value == pytest.approx(case.price, abs=2e-8)
    assert error <= 1e-8 * case.option.strike


@pytest.mark.parametrize("pieces", [1, 2])
@pytest.mark.parametrize("case", true_values(), ids=lambda case: case.name)
def test_without_events_it_is_an_independent_check_of_the_march(case, pieces):
    # The same contract cut in two where nothing happens has two segments, the second of which starts smoothly.
    option, market = case.option, case.market
    if market.rate <= 0.0 or market.dividend_yield < 0.0:
        pytest.skip("exercised nowhere or between two boundaries")
    book = Book.of([(option, market)])
    if pieces == 2:
        book = with_cuts(book, Ragged.of([(0.4 * option.expiry,)]))
    value, error = solved(book)
    marched = solved_by(PremiumMarch(), (option, market), tolerance=1e-8)
    assert marched.settled[0]
    far = option.expiry > 100.0  # the error of so long a life is understated: 1.4e-6 for 8e-7
    assert abs(value - marched.value[0]) <= (8.0 if far else 2.0) * (error + marched.error[0])


@pytest.mark.parametrize("name", CONTRACTS)
def test_the_march_of_obstacle_problems_agrees_within_both_errors(name):
    value, error = solved(Book.of([CONTRACTS[name]]), 1e-7)
    general = solved_by(ObstacleMarch(), CONTRACTS[name], tolerance=1e-5)
    assert abs(value - general.value[0]) <= error + general.error[0]


@pytest.mark.parametrize("option_type", ["put", "call"])
def test_two_dividends_agree_with_nested_quadrature(option_type):
    option = Option(option_type, 100.0, 1.0, "bermudan", (0.25, 0.6))
    dividends = ({"time": 0.25, "amount": 3.0}, {"time": 0.6, "amount": 2.0})
    market = Market(95.0, 0.06, 0.3, 0.01, cash_dividends=dividends)
    events = (Event(0.25, 3.0, exercise=True), Event(0.6, 2.0, exercise=True))
    wanted = quadrature_value(option_type == "put", 100.0, 95.0, 1.0, 0.06, 0.01, 0.3, events)
    value, _ = solved(Book.of([(option, market)]))
    assert value == pytest.approx(wanted, abs=1e-7)


# The gain of each level of the collocation over the one before, at the least, in the median over four levels.
GAINS = [
    ("put, quarterly dividends", 4.0),
    ("put, fractions", 4.0),
    ("put, curves", 3.5),
    ("put, escrowed", 4.0),
    ("put, window", 4.0),
    ("put, dividend at expiry", 4.0),
    ("call, yield above the rate", 6.0),
    ("call, curves", 8.0),
]


@pytest.mark.parametrize(("name", "gain"), GAINS)
def test_convergence_by_level(name, gain):
    book = Book.of([CONTRACTS[name]])
    exact = solve_to_tolerance(book, np.array([1e-9]), 1).value[0]
    values = [at_level(book, level) for level in range(5)]
    errors = np.abs(np.array(values) - exact)
    assert errors[4] < 3e-8
    assert (errors[0] / errors[4]) ** 0.25 > gain


@pytest.mark.parametrize(
    ("seed", "count"), [(5, 200), pytest.param(6, 3000, marks=pytest.mark.nightly)], ids=["few", "many"]
)
@pytest.mark.parametrize("tolerance", [1e-4, 1e-5, 1e-6, 1e-7])
def test_values_are_within_their_tolerance_and_errors_are_stated_honestly(tolerance, seed, count):
    book = Book.of(random_contracts(seed, count))
    exact = solve_to_tolerance(book, np.full(count, 1e-9), 1)
    found = solve_to_tolerance(book, np.full(count, tolerance), 1)
    assert found.settled.mean() > 0.998
    sure = exact.settled & found.settled & (exact.error <= max(1e-8, 0.02 * tolerance))
    assert sure.mean() > 0.93
    error = np.abs(found.value - exact.value)[sure]
    met = found.error[sure] <= tolerance
    assert met.mean() > 0.99
    assert np.mean(error[met] <= tolerance) > 0.9995
    assert np.mean(error <= found.error[sure] + 1e-8) > 0.998


def test_the_boundary_at_an_ex_time_is_that_just_before_it():
    case = next(
        case for case in ONE_BOUNDARY if case.boundary is not None and case.market.dividend_model == "spot"
    )
    book = Book.of([(case.option, case.market)])
    found, settled = boundaries_at(book, np.array([case.ex_time]), 4)
    assert settled
    assert case.option.strike * np.exp(found[0]) == pytest.approx(case.boundary, abs=1e-5)


def test_what_is_beyond_the_collocation_is_not_served():
    option, market = CONTRACTS["put, curves"]
    certain = Market(100.0, 0.05, 0.0, cash_dividends=[{"time": 0.5, "amount": 1.0}])
    book = Book.of([(option, market), (option, replace(market, spot=0.0)), (option, certain)])
    assert is_served(book).tolist() == [True, False, False]


@pytest.mark.parametrize("volatility", [0.0005, 0.001, 0.002])
def test_where_there_is_next_to_no_chance_the_general_path_serves(volatility):
    option = Option("put", 100.0, 1.0)
    market = Market(100.0, 0.05, volatility, cash_dividends=[{"time": 0.5, "amount": 1.0}])
    assert not is_served(Book.of([(option, market)]))[0]
    found = price(option, market, greeks="none")
    assert found.method != "multiplier-collocation"
    assert found.exercise_boundary <= 100.0


def test_what_a_boundary_violates_counts_as_error():
    # On the last segment but one a spurious boundary, far to the left, solves the equations.
    option = Option("put", 100.0, 0.266958)
    curves = {
        "rate": {"times": [0.011021, 0.205432, 0.266958], "values": [0.061803, 0.057499, 0.012101]},
        "dividend_yield": {"times": [0.011021, 0.205432, 0.266958], "values": [0.018478, 0.028369, 0.043763]},
        "volatility": {"times": [0.011021, 0.205432, 0.266958], "values": [0.433694, 0.573485, 0.599205]},
    }
    book = Book.of([(option, Market(100.0, **curves))])
    exact = solve_to_tolerance(book, np.array([1e-8]), 1)
    for tolerance in (1e-4, 1e-5, 1e-6):
        found = solve_to_tolerance(book, np.array([tolerance]), 1)
        assert found.settled[0]
        assert abs(found.value - exact.value)[0] <= found.error[0] <= tolerance


def test_the_finest_level_is_the_kernels_last():
    with pytest.raises((ValueError, IndexError)):
        at_level(Book.of([CONTRACTS["put, curves"]]), FINEST + 1)


# This was once wrong by a tenth of the strike with the status "ok".
@pytest.mark.parametrize(
    ("option", "market", "right"),
    [
        (
            Option("call", 100.0, 30.0, "european"),
            Market(50.0, 0.05, 1.8, {"times": [23.8, 24.8, 30.0], "values": [0.05, -0.05, 0.1]}),
            9.5069,
        ),
    ],
    ids=["cancellation"],
)
def test_what_the_collocation_would_get_wrong_is_left_to_the_general_path(option, market, right):
    assert not is_served(Book.of([(option, market)]))[0]
    assert price(option, market, tolerance=1e-5, greeks="none").price == pytest.approx(right, rel=1e-4)


@pytest.mark.parametrize(
    ("option", "market", "right"),
    [
        (
            Option("put", 100.0, 5.0),
            Market(90.0, 0.08, 2.0, cash_dividends=[{"time": 3.75, "amount": 1.0}]),
            83.9471,
        ),
        (
            Option("put", 100.0, 1.0, "bermudan", (0.5, 1.0)),
            Market(90.0, 0.1, 0.3, cash_dividends=[{"time": 0.25, "amount": 72.0}]),
            75.10430,
        ),
        (
            Option("put", 100.0, 5.0),
            Market(
                100.0, 0.03, 0.4, cash_dividends=[{"time": (i + 0.5) / 4.0, "amount": 1.0} for i in range(20)]
            ),
            34.69891,
        ),
        (
            Option("put", 100.0, 0.25, "european"),
            Market(
                100.0, 0.0, 0.25, cash_dividends=[{"time": 0.1 + i / 365, "amount": 4.35} for i in range(20)]
            ),
            86.826873,
        ),
    ],
    ids=["spread", "spot gone", "many dividends", "clustered dividends"],
)
def test_dividends_may_take_the_spot_of_a_put_to_zero(option, market, right):
    book = Book.of([(option, market)])
    assert is_served(book)[0]
    value, error = solved(book, 1e-6)
    assert value == pytest.approx(right, abs=1e-4)
    assert error <= 1e-6 * option.strike


def emptied_puts(seed, count):
    """Return puts whose dividends take the spot to zero with a probability of some per cent at least."""
    rng = np.random.default_rng(seed)
    contracts = []
    while len(contracts) < count:
        expiry = float(np.exp(rng.uniform(np.log(0.3), np.log(20.0))))
        number = int(rng.integers(1, 9))
        volatility = float(np.exp(rng.uniform(np.log(0.15), np.log(1.2))))
        times = (np.arange(number) + rng.uniform(0.1, 0.9, number)) / number * expiry
        paid = rng.uniform(0.2, 0.8) * rng.dirichlet(np.ones(number))
        spot = 100.0 * float(np.exp(rng.normal(0.0, 0.3)))
        dividends = [{"time": t, "amount": spot * a} for t, a in zip(times, paid, strict=True)]
        if float(np.sum(paid)) < np.exp(-2.0 * volatility * np.sqrt(expiry)):
            continue
        rate, dividend_yield = rng.uniform(0.005, 0.08), float(rng.choice([0.0, rng.uniform(0.0, 0.08)]))
        market = Market(spot, rate, volatility, dividend_yield, cash_dividends=dividends)
        contracts.append((Option("put", 100.0, expiry), market))
    return contracts


@pytest.mark.parametrize("seed", [1, 2])
def test_puts_whose_spot_may_be_paid_out_agree_with_the_march_of_obstacle_problems(seed):
    book = Book.of(emptied_puts(seed, 20))
    assert is_served(book).all()
    found = solve_to_tolerance(book, np.full(book.count, 1e-6), 1)
    assert found.settled.all()
    assert np.mean(found.error <= 1e-6) >= 0.95
    lines = ObstacleMarch().solve(book, Request(np.full(book.count, 1e-5), "none"))
    apart = np.abs(book.strike * found.value - lines.value)
    assert np.mean(apart <= book.strike * found.error + 2.0 * lines.error) >= 0.95
    assert np.all(apart <= 1e-4 * book.strike + 2.0 * lines.error)


QUARTERLY = [0.1 + 0.25 * k for k in range(4)]
JUMPS = {
    "cash": {"cash_dividends": [{"time": time, "amount": 0.6} for time in QUARTERLY]},
    "escrowed": {
        "cash_dividends": [{"time": time, "amount": 0.6} for time in QUARTERLY],
        "dividend_model": "escrowed",
    },
    "proportional": {"proportional_dividends": [{"time": time, "fraction": 0.006} for time in QUARTERLY]},
    "small proportional": {
        "proportional_dividends": [{"time": time, "fraction": 0.001} for time in QUARTERLY]
    },
}


@pytest.mark.parametrize(
    ("name", "dividend_yield"),
    [("cash", -7e-5), ("escrowed", -7e-5), ("proportional", -0.03), ("small proportional", -0.03)],
)
def test_a_put_with_dividends_and_a_negative_yield_has_the_value_of_the_march_of_obstacle_problems(
    name, dividend_yield
):
    contract = Option("put", 100.0, 1.0), Market(100.0, 0.03, 0.25, dividend_yield, **JUMPS[name])
    book = Book.of([contract])
    assert is_served(book)[0]
    found = solve_to_tolerance(book, np.array([1e-6]), 1)
    lines = solved_by(ObstacleMarch(), contract, tolerance=1e-7)
    assert found.settled[0]
    assert abs(100.0 * found.value[0] - lines.value[0]) <= 100.0 * found.error[0] + lines.error[0]
    assert found.error[0] <= 1e-6


def test_finer_levels_are_not_tried_where_they_bring_nothing():
    contract = Option("put", 100.0, 1.0), Market(100.0, 0.03, 0.25, -4e-4, **JUMPS["cash"])
    found = solve_to_tolerance(Book.of([contract]), np.array([1e-7]), 1)
    assert found.settled[0]
    assert found.error[0] > 1e-7
    assert found.level[0] < FINEST - 1


@pytest.mark.parametrize(
    ("name", "step"),
    [("cash", 7e-5), ("escrowed", 7e-5), ("proportional", 1e-3), ("small proportional", 1e-3)],
)
def test_value_and_slope_go_smoothly_through_a_yield_of_zero(name, step):
    option = Option("put", 100.0, 1.0)
    markets = [Market(100.0, 0.03, 0.25, by * step, **JUMPS[name]) for by in (-1.0, 0.0, 1.0)]
    found = solve_to_tolerance(Book.of([(option, market) for market in markets]), np.full(3, 1e-6), 1)
    assert found.settled.all()
    # The second difference is that of a smooth function, some 1 per square of the yield, but for the errors.
    assert abs(np.diff(found.value, 2)[0]) <= step**2 + found.error @ [1.0, 2.0, 1.0]
    assert abs(np.diff(found.slope, 2)[0]) <= 4.0 * step**2 + 1e-5


@pytest.mark.parametrize(
    ("option", "market"),
    [
        # Exercised before a dividend, after which the strike is too far away to be met.
        (
            Option("call", 100.0, 0.05),
            Market(
                96.0,
                0.14,
                0.076,
                cash_dividends=[{"time": t, "amount": a} for t, a in ((0.012, 2.9), (0.03, 1.7))],
            ),
        ),
        # Out of the money by five standard deviations.
        (
            Option("call", 100.0, 0.47),
            Market(69.0, 0.07, 0.115, 0.03, cash_dividends=[{"time": 0.25, "amount": 0.8}]),
        ),
        # Below the boundary the spot waits through small dividends: a line for many standard deviations.
        (
            Option("put", 100.0, 9.4),
            Market(
                106.0,
                0.07,
                0.15,
                cash_dividends=[{"time": 0.2 + 0.25 * k, "amount": 1.06} for k in range(37)],
            ),
        ),
        # In the money for every spot that matters.
        (
            Option("call", 100.0, 3.0),
            Market(390.0, 0.126, 0.04, 0.016, cash_dividends=[{"time": 1.4, "amount": 0.5}]),
        ),
    ],
)
def test_what_lies_beyond_the_interval_and_on_lines_does_not_matter(option, market):
    book = Book.of([(option, market)])
    exact, _ = solved(book, 1e-9)
    for tolerance in (1e-4, 1e-5, 1e-6, 1e-7):
        value, error = solved(book, tolerance)
        assert abs(value - exact) <= error + 1e-9 * option.strike
