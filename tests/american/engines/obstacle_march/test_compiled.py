"""The compiled march of books, beside the other engines and known values, family by family, also next to boundaries."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.obstacle_march import FAMILIES, random_book
from pricing_core import kernel
from pricing_core.american import CashDividend, Market, Option, PiecewiseConstant, price
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import GREEKS
from pricing_core.american.engines.chapter import Chapter
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march import CompiledMarch
from tests.problems.engines import solved
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel
ENGINE = CompiledMarch()


def marched(contracts, tolerance=1e-5, greeks="none"):
    return solved(ENGINE, *contracts, tolerance=tolerance, greeks=greeks)


def request(book, tolerance, greeks="none"):
    return Request(np.full(book.count, tolerance), greeks)


@pytest.mark.parametrize("family", FAMILIES)
def test_prices_lie_within_the_estimates_of_the_chapters_road(family):
    """The chapter's road knows neither the averaged condition nor the compact scheme."""
    book = random_book(family, 4 if "60" not in family else 1, seed=11)
    own = ENGINE.solve(book, request(book, 1e-5))
    other = Chapter().solve(book, request(book, 1e-4))
    assert own.settled.all()
    assert (own.error <= 1e-5 * book.strike).all()
    assert (np.abs(own.value - other.value) <= own.error + other.error).all()


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
def test_a_row_does_not_depend_on_the_others_by_a_bit(tolerance):
    book = Book.concatenated([random_book(family, 5, seed=3) for family in FAMILIES])
    together = ENGINE.solve(book, request(book, tolerance, "extended"))
    for row in range(0, book.count, 3):
        part = book.take(np.array([row]))
        alone = ENGINE.solve(part, request(part, tolerance, "extended"))
        for name in (
            "value",
            "error",
            "european",
            "boundary",
            *GREEKS,
            *(f"{name}_error" for name in GREEKS),
        ):
            np.testing.assert_array_equal(getattr(alone, name)[0], getattr(together, name)[row], name)
        without = ENGINE.solve(part, request(part, tolerance))
        assert (without.value[0], without.error[0]) == (alone.value[0], alone.error[0])


def test_an_escrowed_call_with_a_large_dividend_after_a_small_one():
    """.8991 by a tree; the option without the first dividend's exercise is worth .06."""
    dividends = [(0.02, 1.0), (0.06, 20.0)]
    market = Market(100.0, 0.03, 0.15, cash_dividends=dividends, dividend_model="escrowed")
    found = marched([(Option("call", 100.0, 0.08), market)], 1e-7)
    assert found.value[0] == pytest.approx(0.8991, abs=1e-4)


@pytest.mark.parametrize(
    ("expiry", "rate", "volatility", "dividends"),
    [
        (198.0, -8e-6, 0.003, [(32.0, 25.6), (61.7, 28.0), (62.0, 52.0), (157.0, 39.0), (192.0, 12.5)]),
        (0.0042, 0.0037, 0.23, [(0.0008, 40.0), (0.0027, 35.0), (0.0039, 34.0), (0.004195, 5.7)]),
        (2.0, 0.05, 0.4, [(0.2, 60.0), (0.9, 130.0), (1.9, 4.0)]),
    ],
)
def test_a_european_put_whose_spot_is_used_up_is_worth_the_discounted_strike(
    expiry, rate, volatility, dividends
):
    """The spot falls to 0 with a probability next to 1."""
    spot = 107.0 if expiry != 2.0 else 40.0
    contract = (
        Option("put", 100.0, expiry, "european"),
        Market(spot, rate, volatility, cash_dividends=dividends),
    )
    found = solved(ENGINE, contract, tolerance=1e-7)
    assert found.value[0] == pytest.approx(
        100.0 * np.exp(-rate * expiry), abs=max(3.0 * found.error[0], 1e-4)
    )
    assert found.error[0] <= 1e-3


def test_small_dividends_of_a_spot_that_is_next_to_nothing_are_felt():
    """With rates below 0 a used-up put is held to expiry; a grid that ends above the dividends is off by 5.9e-3."""
    market = Market(
        0.2525,
        -0.08,
        0.1,
        cash_dividends=[(0.0076, 0.0016), (0.0146, 0.0043)],
        proportional_dividends=[(0.0025, 1.0)],
    )
    found = marched([(Option("put", 100.0, 0.025), market)], tolerance=1e-7)
    assert found.value[0] == pytest.approx(100.0 * np.exp(0.08 * 0.025), abs=1e-5)


def test_a_put_beyond_a_boundary_that_two_engines_put_elsewhere():
    """73.42028 by differences on 2,048 nodes: not exercised."""
    market = Market(26.58404959, 0.0237627188, 0.0813081456, 0.0866609149)
    found = marched([(Option("put", 100.0, 3.6466938629), market)], 1e-7)
    assert found.value[0] == pytest.approx(73.42028, abs=1e-5)
    assert not found.exercised[0]


def test_a_dividend_larger_than_the_spot_is_waited_for():
    """The spot drops to 0: to wait is worth the discounted strike at the least."""
    rate, time = 0.053223223, 0.1981747164
    market = Market(1.0603778471, rate, 0.1109076699, 0.0386771411, cash_dividends=[(time, 42.3857777787)])
    found = ENGINE.solve(book := Book.of([(Option("put", 100.0, 0.3625585944), market)]), request(book, 1e-7))
    assert found.value[0] >= 100.0 * np.exp(-rate * time) - found.error[0]
    assert not found.exercised[0]


def test_theta_and_gamma_right_next_to_the_boundary_with_a_dividend_to_come():
    """Theta -.0083 by the boundary's speed and by prices of finite differences over time, gamma .0444."""
    market = Market(82.2, 0.06, 0.2, cash_dividends=[(0.5, 0.2)])
    found = marched([(Option("put", 100.0, 1.0), market)], 1e-7, "standard")
    assert not found.exercised[0]
    assert found.theta[0] == pytest.approx(-0.0083, abs=2e-4)
    assert found.gamma[0] == pytest.approx(0.0444, abs=2e-4)


@pytest.mark.parametrize("family", [family for family in FAMILIES if "60" not in family])
def test_greeks_are_derivatives_of_prices(family):
    """Central differences of prices at 1e-8 of contracts that differ in one number."""
    book = random_book(family, 4, seed=8)
    found = ENGINE.solve(book, request(book, 1e-6, "standard"))

    def moved(name, by):
        if name == "spot":
            return replace(book, spot=book.spot + by)
        column = getattr(book.segments, name) + by
        return replace(book, segments=replace(book.segments, **{name: column}))

    for greek, name, step in (
        *(("delta", "spot", 2e-4), ("vega", "volatility", 2e-4)),
        *(("rho", "rate", 2e-4), ("dividend_rho", "dividend_yield", 2e-4)),
    ):
        up, down = (ENGINE.solve(moved(name, by), request(book, 1e-8)) for by in (step, -step))
        difference = (up.value - down.value) / (2.0 * step)
        held = ~(found.exercised | up.exercised | down.exercised)
        allowed = getattr(found, f"{greek}_error") + (up.error + down.error) / (2.0 * step) + 5e-4
        assert (np.abs(getattr(found, greek) - difference) <= allowed)[held].all(), greek


def test_buckets_add_up_to_the_parallel_derivatives_and_dividends_not_due_have_none():
    curve = PiecewiseConstant((0.3, 0.7, 1.0), (0.02, 0.05, 0.08))
    dividends = [(0.5, 1.0), (1.5, 1.0)]
    market = Market(100.0, curve, 0.25, 0.01, cash_dividends=dividends)
    found = marched([(Option("put", 100.0, 1.0), market)], 1e-6, "extended")
    assert found.rate_buckets.values.sum() == pytest.approx(found.rho[0], abs=1e-10)
    assert found.dividend_sensitivities.values[1] == 0.0
    assert found.dividend_sensitivities.values[0] > 0.1


def test_vanna_volga_and_charm_of_a_european_option_are_the_formulas():
    option = Option("call", 100.0, 1.0, exercise="european")
    book = Book.of([(option, Market(95.0, 0.03, 0.3, 0.01))])
    found = ENGINE.solve(book, request(book, 1e-7, "extended"))
    from pricing_core.american.engines.closed_form import ClosedForm  # noqa: PLC0415

    exact = ClosedForm().solve(book, request(book, 1e-7, "extended"))
    for name in GREEKS[:9]:
        distance = abs(getattr(found, name)[0] - getattr(exact, name)[0])
        assert distance <= getattr(found, f"{name}_error")[0] + 1e-9, name
        assert distance <= 1e-4 * max(1.0, abs(getattr(exact, name)[0])), name


def test_an_interrupt_ends_the_march():
    book = random_book("put, 4 dividends", 4, seed=1)
    found = ENGINE.solve(book, replace(request(book, 1e-6), interrupt=lambda: True))
    assert np.isnan(found.error).all()
    assert (found.status == "deadline").all()


def test_a_table_that_does_not_fit_is_refused():
    one = np.ones(1)
    columns = dict.fromkeys(
        ("sign", "x", "duration", "rate", "dividend_yield", "volatility", "fraction", "amount", "escrow"), one
    )
    first, owner = np.array([0, 1]), np.array([0])
    flags = dict.fromkeys(("european", "exercisable", "exercise_at_end"), np.ones(1, dtype=bool))
    kernel.SegmentTable(**columns, first=first, owner=owner, **flags)
    for name, value, told in (
        ("volatility", np.zeros(1), "volatility and duration must be above 0"),
        ("x", np.array([np.inf]), "x must be finite"),
        ("rate", np.ones(2), "the columns differ in length"),
        ("first", np.array([0, 2]), "first must have 2 entries"),
        ("owner", np.array([1]), "there is no such owner"),
    ):
        given = columns | {"first": first, "owner": owner} | {name: value}
        with pytest.raises(ValueError, match=told):
            kernel.SegmentTable(**given, **flags)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-5])
@pytest.mark.parametrize("longest", [60.0, 3_600.0, 86_400.0])
def test_a_dividend_within_a_day_of_expiry_lies_within_its_estimate(longest, tolerance):
    """The kink of the payoff is not smoothed over a cell by then, and the drop carries it between the nodes."""
    rng = np.random.default_rng(5)
    missed = 0
    for _ in range(50):
        expiry = np.exp(rng.uniform(np.log(0.02), np.log(3.0)))
        years = longest * np.exp(rng.uniform(-3.0, 0.0)) / (365.25 * 86_400.0)
        dividend = CashDividend(expiry - years, rng.uniform(0.05, 4.0))
        volatility = rng.uniform(0.08, 0.8)
        spot = 100.0 * np.exp(rng.uniform(-0.75, 0.75) * volatility * np.sqrt(expiry))
        market = Market(
            spot, rng.uniform(-0.01, 0.1), volatility, rng.uniform(-0.01, 0.05), cash_dividends=(dividend,)
        )
        option = Option(str(rng.choice(["put", "call"])), 100.0, expiry)
        found, true = (price(option, market, tolerance=accuracy) for accuracy in (tolerance, 1e-8))
        missed += abs(found.price - true.price) > found.error_estimate + true.error_estimate
    assert missed <= 1


@pytest.mark.nightly
@pytest.mark.parametrize("tolerance", [1e-4, 1e-5, 1e-6])
def test_prices_with_many_dividends_lie_within_their_estimates(tolerance):
    """The first steps after each leave an error of either sign, by where in its cell the boundary lies."""
    rng = np.random.default_rng(1)
    contracts = []
    for number in range(600):
        count = (2, 4, 12)[number % 3]
        times = np.sort(rng.uniform(0.02, 0.98, count)).tolist()
        amounts = (rng.uniform(0.2, 2.0, count) * min(1.0, 8.0 / count)).tolist()
        volatility = rng.uniform(0.1, 0.6)
        market = Market(
            100.0 * np.exp(rng.uniform(-0.5, 0.5) * volatility),
            rng.uniform(0.01, 0.08),
            volatility,
            rng.uniform(0.0, 0.04),
            cash_dividends=tuple(map(CashDividend, times, amounts)),
        )
        contracts.append((Option("call" if number % 5 == 0 else "put", 100.0, 1.0), market))
    found, true = (marched(contracts, accuracy) for accuracy in (tolerance, 1e-8))
    errors = np.maximum(np.abs(found.value - true.value) - true.error, 0.0)
    assert np.mean(errors <= found.error) >= 0.99
    assert np.median(found.error / np.maximum(errors, 1e-9)) <= 60.0
    assert (errors <= 3.0 * found.error).all()
