"""The kernel's march with local volatilities, against constant ones, closed forms, differences and itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ncx2

from pricing_core.american import LocalVolatility, Market, Option
from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import GREEKS, error_of
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march import CompiledMarch
from tests.problems.engines import solved
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel

DIVIDENDS = ((0.3, 2.0), (0.7, 1.5))
SKEW = LocalVolatility(
    [0.0, 0.35, 0.8],
    [70.0, 85.0, 100.0, 115.0, 130.0],
    [
        [0.36, 0.29, 0.23, 0.2, 0.21],
        [0.34, 0.27, 0.22, 0.21, 0.22],
        [0.3, 0.26, 0.24, 0.23, 0.23],
    ],
)


def marched(option, market, tolerance, greeks="none"):
    """Return what the march says of one contract, all of it; the tolerance is in strikes."""
    found = solved(CompiledMarch(), (option, market), tolerance=tolerance, greeks=greeks)
    assert found.settled.all()
    assert found.complete.all()
    return found


@pytest.mark.parametrize("kind", ["put", "call"])
def test_a_flat_surface_is_a_constant_volatility(kind: str) -> None:
    """Rows that are told node by node are those of constants; so are the derivatives that they make."""
    option = Option(kind, 100.0, 1.0)
    times, spots = [0.2, 0.5, 0.9], [60.0, 100.0, 140.0]
    flat = LocalVolatility(times[:1], spots, [[0.25] * 3])
    constant, local = (
        marched(option, Market(97.0, 0.05, volatility, 0.02, cash_dividends=DIVIDENDS), 1e-6, "extended")
        for volatility in (0.25, flat)
    )
    assert local.value == pytest.approx(constant.value, abs=(local.error + constant.error).item(0))
    assert local.boundary == pytest.approx(constant.boundary, abs=1e-3, nan_ok=True)
    assert local.delta_sticky_moneyness == pytest.approx(constant.delta, abs=1e-5)
    for name in set(GREEKS) - {"delta_sticky_moneyness"}:
        errors = sum(getattr(one, error_of(name)).item(0) for one in (local, constant))
        assert getattr(local, name) == pytest.approx(getattr(constant, name), abs=errors), name


def test_constant_elasticity_has_its_closed_form() -> None:
    """A European call with sigma(S) = a (S/100)^(-1/2) (Cox 1975; Schroder 1989), without drift."""
    scale, strike, expiry = 0.3, 100.0, 0.8
    spots = np.geomspace(2.0, 1500.0, 300)
    surface = LocalVolatility([0.0], spots, [scale * (spots / 100.0) ** -0.5])
    variance = (scale * 10.0) ** 2 * expiry  # of dS = 3 sqrt(S) dW
    x, y = 4.0 * 105.0 / variance, 4.0 * strike / variance
    exact = 105.0 * (1.0 - ncx2.cdf(y, 4.0, x)) - strike * ncx2.cdf(x, 2.0, y)
    option = Option("call", strike, expiry, exercise="european")
    found = marched(option, Market(105.0, 0.0, surface), 1e-7)
    assert found.value.item(0) == pytest.approx(exact, abs=3e-5)


@pytest.mark.parametrize("kind", ["put", "call"])
@pytest.mark.parametrize("dividends", [(), DIVIDENDS])
def test_greeks_are_differences_of_prices(kind: str, dividends: tuple[tuple[float, float], ...]) -> None:
    """By the rate, the yield and all volatilities, with a surface that depends on the spot and the time."""
    option = Option(kind, 100.0, 1.0)
    market = Market(97.0, 0.05, SKEW, 0.03, cash_dividends=dividends)
    found = marched(option, market, 1e-6, "standard")
    step = 5e-4

    def difference(*sides: Market) -> float:
        up, down = (marched(option, side, 1e-8).value.item(0) for side in sides)
        return (up - down) / (2.0 * step)

    shifted = [replace(market, volatility=SKEW.shifted(by)) for by in (step, -step)]
    rates = [replace(market, rate=market.rate + by) for by in (step, -step)]
    moved = [replace(market, spot=97.0 * (1.0 + by), volatility=SKEW.moved(1.0 + by)) for by in (step, -step)]
    yields = [replace(market, dividend_yield=market.dividend_yield + by) for by in (step, -step)]
    for name, sides in (("vega", shifted), ("rho", rates), ("dividend_rho", yields)):
        error = getattr(found, error_of(name)).item(0)
        assert getattr(found, name).item(0) == pytest.approx(difference(*sides), abs=error + 3e-3), name
        assert error < 0.1
    sticky = found.delta_sticky_moneyness.item(0)
    assert sticky == pytest.approx(difference(*moved) / 97.0, abs=1e-4)
    assert abs(sticky - found.delta.item(0)) > 1e-2


def random_contracts(rng: np.random.Generator, count: int) -> Book:
    """Return contracts under surfaces of up to twelve times and thirty spots, with up to three dividends."""
    contracts = []
    for number in range(count):
        expiry = rng.uniform(0.1, 2.0)
        times = np.unique(np.round(rng.uniform(0.0, 2.0, rng.integers(1, 13)), 3))
        spots = np.geomspace(rng.uniform(35.0, 80.0), rng.uniform(125.0, 280.0), rng.integers(3, 31))
        skew = -rng.uniform(0.0, 0.25) * np.log(spots / 100.0)
        curve = rng.uniform(0.0, 0.3) * np.log(spots / 100.0) ** 2
        wave = 1.0 + 0.3 * np.sin(3.0 * times + rng.uniform(0.0, 6.0))
        values = np.clip((rng.uniform(0.12, 0.45) + skew + curve) * wave[:, None], 0.06, 1.2)
        moments = np.sort(rng.uniform(0.02, 0.98, number % 4)) * expiry
        market = Market(
            float(100.0 * np.exp(rng.normal(0.0, 0.15))),
            rng.uniform(0.0, 0.08),
            LocalVolatility(times, spots, values),
            rng.uniform(0.0, 0.06),
            cash_dividends=[(t, rng.uniform(0.3, 2.5)) for t in moments.tolist()],
        )
        contracts.append((Option(("put", "call")[number % 2], 100.0, expiry), market))
    return Book.of(contracts)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-5])
def test_estimates_hold(tolerance: float) -> None:
    """The estimate is at least what the price moves by to much finer grids, in all but two of a hundred."""
    book = random_contracts(np.random.default_rng(7), 50)
    march = CompiledMarch()
    found, finer = (
        march.solve(book, Request(np.full(book.count, tol), "none")) for tol in (tolerance, tolerance / 100.0)
    )
    holds = np.abs(found.value - finer.value) <= found.error + finer.error
    assert holds.mean() >= 0.98
    assert (found.error <= 100.0 * tolerance).mean() >= 0.98


def test_a_contract_does_not_depend_on_the_others() -> None:
    """Beside others, whose surfaces have other times and which take more steps, it is the same to the last bit."""
    book = random_contracts(np.random.default_rng(3), 20)
    request = Request(np.full(book.count, 1e-4), "none")
    together = CompiledMarch().solve(book, request)
    for row in (0, 7, 19):
        alone = CompiledMarch().solve(book.part(slice(row, row + 1)), request.take(np.array([0])))
        assert alone.value.item(0) == together.value.item(row)
