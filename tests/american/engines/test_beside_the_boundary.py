"""Greeks next to the exercise boundary, where the second derivatives jump, are within what their estimates say.

`next_to_the_boundary.md`, a study of 938 random contracts within 3 % of their boundary, tells where they were not.
"""

import numpy as np
import pytest

from pricing_core.american import Market, Option
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import GREEKS, error_of
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march import CompiledMarch, ObstacleMarch
from pricing_core.american.engines.premium_march import PremiumMarch
from pricing_core.american.engines.solve import solve
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel
PREMIUM, MARCH = PremiumMarch(), CompiledMarch()
GREEKS_THERE = [name for name in GREEKS if name != "delta_sticky_moneyness"]


def asked(book, tolerance):
    return Request(np.full(book.count, tolerance), "extended")


def beside_the_boundary(seed, count, nearest=1e-4, furthest=3e-2, exercised=0.2):
    """Return contracts without events whose spots lie so near to the boundary, a share of them inside the region."""
    rng = np.random.default_rng(seed)
    terms = []
    for _ in range(count):
        expiry, volatility = rng.uniform(0.05, 4.0), rng.uniform(0.08, 0.6)
        rate, dividend_yield = rng.uniform(0.002, 0.12), rng.uniform(0.0, 0.12)
        terms.append((str(rng.choice(["put", "call"])), expiry, rate, volatility, dividend_yield))

    def book_at(spots):
        return Book.of(
            [
                (Option(kind, 100.0, expiry), Market(float(spot), rate, volatility, dividend_yield))
                for (kind, expiry, rate, volatility, dividend_yield), spot in zip(terms, spots, strict=True)
            ]
        )

    at_strike = book_at(np.full(count, 100.0))
    boundary = PREMIUM.solve(at_strike, asked(at_strike, 1e-8)).boundary
    away = np.exp(rng.uniform(np.log(nearest), np.log(furthest), count))
    inside = rng.random(count) < exercised
    book = book_at(boundary * np.exp(at_strike.sign * np.where(inside, -away, away)))
    return book.take(np.flatnonzero(np.isfinite(book.spot)))


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
@pytest.mark.parametrize(
    ("seed", "count"), [(1, 300), pytest.param(2, 4000, marks=pytest.mark.nightly)], ids=["few", "many"]
)
def test_greeks_are_within_their_estimates(seed, count, tolerance):
    """Measured on 4,000: at least 99.0 % of each Greek, 99.5 % of all."""
    book = beside_the_boundary(seed, count)
    found, true = (solve(book, asked(book, each)) for each in (tolerance, 1e-8))
    held = []
    for name in GREEKS_THERE:
        distance = np.abs(getattr(found, name) - getattr(true, name))
        stated = getattr(found, error_of(name)) + getattr(true, error_of(name))
        assert not np.isnan(distance + stated).any(), name
        held.append(distance <= stated)
        assert np.mean(held[-1]) >= 0.975, name
    assert np.mean(held) >= 0.99


def test_a_spot_nearer_to_the_boundary_than_that_is_known_has_errors_of_its_greeks():
    """A spot called exercised may be held, and the other way round: gamma, vanna and volga jump there."""
    book = beside_the_boundary(3, 400, 1e-5, 1e-3, exercised=0.0)
    found, true = (solve(book, asked(book, tolerance)) for tolerance in (1e-3, 1e-8))
    wrong = found.exercised & ~true.exercised
    assert wrong.sum() > 50
    for name in ("gamma", "vanna", "volga", "charm"):
        distance = np.abs(getattr(found, name) - getattr(true, name))
        assert np.mean((distance <= getattr(found, error_of(name)))[wrong]) > 0.95, name


@pytest.mark.parametrize("spot", [80.5, 80.7, 80.9])
def test_a_boundary_that_falls_fast_before_a_dividend_is_resolved(spot):
    """The region closes 0.024 years from now. The steps of a whole segment left the estimate at 2e-4 to 6e-4."""
    market = Market(spot, 0.05, 0.15, 0.01, cash_dividends=[(0.5, 2.0)])
    book = Book.of([(Option("put", 100.0, 0.55), market)])
    found, fine = (MARCH.solve(book, Request(np.array([tolerance]), "none")) for tolerance in (1e-6, 1e-8))
    assert found.error[0] <= 1e-4
    assert abs(found.value[0] - fine.value[0]) <= found.error[0]
    assert found.value[0] >= 100.0 - spot


def test_the_march_in_numpy_finds_volga():
    book = beside_the_boundary(5, 4, nearest=1e-3, furthest=3e-3, exercised=0.0)
    one, other = PREMIUM.solve(book, asked(book, 1e-7)), ObstacleMarch().solve(book, asked(book, 1e-4))
    assert other.volga == pytest.approx(one.volga, rel=0.1)
    assert (np.abs(one.volga - other.volga) <= one.volga_error + other.volga_error).all()


@pytest.mark.parametrize("name", ["gamma", "vanna", "volga"])
def test_both_marches_agree(name):
    """One march moves with the boundary; the other one does not, and compares volatilities around its own."""
    book = beside_the_boundary(4, 150, exercised=0.0)
    one, other = PREMIUM.solve(book, asked(book, 1e-8)), MARCH.solve(book, asked(book, 1e-8))
    held = ~(one.exercised | other.exercised) & one.settled & other.settled
    assert held.sum() > 120
    distance = np.abs(getattr(one, name) - getattr(other, name))[held]
    assert np.median(distance / np.abs(getattr(one, name)[held])) < 1e-3
    stated = (getattr(one, error_of(name)) + getattr(other, error_of(name)))[held]
    assert np.mean(distance <= stated) > 0.95
