"""The chapter's road: prices within their estimates, every scheme, mesh and solver, Greeks, boundaries, interrupts."""

import numpy as np
import pytest

from pricing_core.american import Market, Option, Resolution
from pricing_core.american.book.book import Book
from pricing_core.american.engines.chapter import Chapter
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march import ObstacleMarch
from tests.problems.engines import solved
from tests.problems.nightly import nightly
from tests.problems.schedules import CONTRACTS

BY_DAY = ["put, half the spot", "call, curves", "put, escrowed"]
PUT = (Option("put", 100.0, 1.0), Market(95.0, 0.06, 0.3, 0.03))


@pytest.mark.parametrize("scheme", ["sdirk2", "crank-nicolson", "implicit-euler"])
@pytest.mark.parametrize("name", [*BY_DAY, *nightly(name for name in CONTRACTS if name not in BY_DAY)])
def test_prices_lie_within_their_estimates(name, scheme):
    other = solved(ObstacleMarch(), CONTRACTS[name], tolerance=1e-5)
    found = solved(Chapter(scheme, resolution=Resolution(200, 50)), CONTRACTS[name])
    assert found.status[0] == "ok"
    assert found.method[0] == ("crank-nicolson" if scheme == "crank-nicolson" else "lcs")
    assert abs(found.value[0] - other.value[0]) <= found.error[0] + other.error[0]
    assert found.european[0] == pytest.approx(other.european[0], abs=0.05)


@pytest.mark.parametrize(
    "choices",
    [{"time_mesh": "adaptive"}, {"time_mesh": "cube-root"}, {"time_mesh": "uniform"}, {"stretching": 2.0}],
)
def test_meshes_and_stretchings_change_the_price_by_less_than_its_error(choices):
    other = solved(ObstacleMarch(), PUT, tolerance=1e-6)
    found = solved(Chapter(resolution=Resolution(200, 50, **choices)), PUT)
    assert abs(found.value[0] - other.value[0]) <= max(found.error[0], 5e-3)
    assert found.resolution[0].time_mesh == choices.get("time_mesh", "square-root")


def test_without_a_resolution_both_are_doubled_to_the_tolerance():
    found = solved(Chapter(), PUT, tolerance=1e-4)
    assert found.error[0] <= 1e-2
    assert found.solves[0] >= 3
    again = solved(Chapter(resolution=found.resolution[0]), PUT)
    assert again.value[0] == found.value[0]


def test_greeks_are_those_of_the_march():
    other = solved(ObstacleMarch(), PUT, greeks="standard")
    found = solved(Chapter(resolution=Resolution(400, 100)), PUT, greeks="standard")
    for greek in ("delta", "gamma", "theta", "vega", "rho", "dividend_rho"):
        assert getattr(found, greek)[0] == pytest.approx(getattr(other, greek)[0], rel=2e-3, abs=2e-3), greek


@pytest.mark.parametrize("market", [PUT[1], Market(80.0, -0.005, 0.2, -0.05)])
def test_boundaries_are_those_of_the_march(market):
    book, times = Book.of([(PUT[0], market)]), np.array([0.0, 0.5, 0.9, 1.0])
    request = Request(np.array([1e-6]))
    found, other = (engine.boundary(book, request)(times) for engine in (Chapter(), ObstacleMarch()))
    assert found.near == pytest.approx(other.near, rel=2e-3)
    assert found.far[-1] == pytest.approx(other.far[-1], nan_ok=True)  # the others lie beyond its grid


def test_an_interrupt_ends_the_work():
    asked = []
    request = Request(np.array([1e-6]), interrupt=lambda: len(asked) > 20 or bool(asked.append(0)))
    found = Chapter(resolution=Resolution(400, 100)).solve(Book.of([PUT]), request)
    assert found.status[0] == "deadline"
    assert np.isnan(found.value[0])
