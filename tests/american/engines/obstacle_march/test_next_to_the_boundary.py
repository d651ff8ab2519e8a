"""Prices and Greeks within 3 % of the exercise boundary, where something is to happen yet.

Prices at the tolerance 1e-8 are held to be true, and so are the Greeks with them; theta is held beside differences of
such prices in time as well, which know nothing of the march's own rate. Measured over three seeds and all families:
99.7 % of the prices' estimates hold, 99.3 % of those of Greeks, the worst are missed by a factor of 5 to 7.
"""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.obstacle_march import random_book
from pricing_core.american import Market, Option, PiecewiseConstant
from pricing_core.american.book.book import Book
from pricing_core.american.book.segments import Segments
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march import CompiledMarch
from tests.problems.needs_kernel import needs_kernel
from tests.problems.nightly import nightly

pytestmark = needs_kernel

ENGINE = CompiledMarch()
BEYOND = np.array([1e-4, 1e-3, 5e-3, 0.01, 0.03])  # the boundary, as shares of it
CONTRACTS = 6
GREEKS = ("delta", "gamma", "theta", "vega", "rho", "dividend_rho")
LATER = 2e-4  # years


def with_curves(count, seed):
    """Return puts and calls with curves of rates and volatilities."""
    rng = np.random.default_rng(seed)
    contracts = []
    for k in range(count):
        rates, volatilities = rng.uniform(0.02, 0.1, 3).tolist(), rng.uniform(0.15, 0.4, 2).tolist()
        curves = (
            PiecewiseConstant([0.3, 0.6, 1.0], rates),
            PiecewiseConstant([0.5, 1.0], volatilities),
            float(rng.uniform(0.0, 0.08)),
        )
        contracts.append((Option("put" if k % 4 < 3 else "call", 100.0, 1.0), Market(100.0, *curves)))
    return Book.of(contracts)


FAMILIES = {
    "put": lambda count, seed: random_book("put", count, seed),
    "put, two boundaries": lambda count, seed: random_book("put, two boundaries", count, seed),
    "put, 4 dividends": lambda count, seed: random_book("put, 4 dividends", count, seed),
    "call, 4 dividends": lambda count, seed: random_book("call, 4 dividends", count, seed),
    "call, 4 escrowed dividends": lambda count, seed: random_book("call, 4 escrowed dividends", count, seed),
    "put, 3 proportional dividends": lambda count, seed: random_book(
        "put, 3 proportional dividends", count, seed
    ),
    "curves": with_curves,
}

BY_DAY = ("put", "call, 4 dividends")  # the families that are not left to the nightly run


def asked(book, tolerance, greeks="standard"):
    return ENGINE.solve(book, Request(np.full(book.count, tolerance), greeks))


def seen_later(book, by):
    """Return the contracts as they are so many years from now, before anything has happened."""
    segments = {name: getattr(book.segments, name).copy() for name in Segments.__slots__}
    segments["end"] = segments["end"] - by
    segments["start"] = np.maximum(segments["start"] - by, 0.0)
    return replace(book, segments=Segments(**segments))


def next_to_the_boundary(family, seed):
    """Return contracts on spots just beyond their boundaries, on the side where they are held."""
    book = FAMILIES[family](CONTRACTS, seed)
    at_strike = replace(book, spot=book.strike + book.escrow_now())
    boundary = asked(at_strike, 1e-7, "none").boundary
    rows = np.flatnonzero(np.isfinite(boundary) & book.now.exercisable)
    near = book.take(np.repeat(rows, BEYOND.size))
    spots = np.repeat(boundary[rows], BEYOND.size) * (1.0 + near.sign * np.tile(BEYOND, rows.size))
    return replace(near, spot=spots)


@pytest.mark.parametrize("tolerance", [1e-6, *nightly([1e-4])])
@pytest.mark.parametrize("seed", [1, *nightly(range(2, 12))])
def test_prices_and_greeks_lie_within_their_estimates(tolerance, seed):
    """Families are taken together: in some of them few contracts are exercised now."""
    missed = {name: [] for name in ("value", *GREEKS)}
    for family in FAMILIES:
        book = next_to_the_boundary(family, seed)
        if book.count == 0:
            continue
        found, true = asked(book, tolerance), asked(book, 1e-8)
        held = ~(found.exercised | true.exercised) & true.complete
        assert held.sum() >= 0.3 * book.count
        for name, ratios in missed.items():
            error = "error" if name == "value" else f"{name}_error"
            claimed = getattr(found, error) + getattr(true, error) + 1e-9
            ratios.extend((np.abs(getattr(found, name) - getattr(true, name)) / claimed)[held].tolist())
    together = np.concatenate([*missed.values()])
    assert together.size > 700
    assert (np.array(missed["value"]) <= 1.0).mean() >= 0.99
    assert (together <= 1.0).mean() >= 0.99
    assert together.max() <= 7.0, {name: max(own) for name, own in missed.items()}


@pytest.mark.parametrize("family", [*BY_DAY, *nightly(name for name in FAMILIES if name not in BY_DAY)])
def test_theta_is_the_difference_of_prices_in_time(family):
    book = next_to_the_boundary(family, 1)
    if book.count == 0:
        pytest.skip("none of these is exercised now")
    found = asked(book, 1e-7)
    now, later, still_later = (asked(seen_later(book, by), 1e-10, "none") for by in (0.0, LATER, 2.0 * LATER))
    theta = (-3.0 * now.value + 4.0 * later.value - still_later.value) / (2.0 * LATER)
    noise = 4.0 * (now.error + later.error + still_later.error) / LATER
    held = ~(found.exercised | now.exercised | still_later.exercised)
    missed = np.abs(found.theta - theta)[held]
    assert (missed <= (found.theta_error + noise)[held] + 2e-3).mean() >= 0.97
