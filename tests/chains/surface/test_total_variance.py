"""Total variance between expiries: derivatives, monotonicity, and what holds outside."""

import math

import numpy as np
import pytest

from pricing_core.chains.surface.essvi import ESSVI
from pricing_core.chains.surface.smile_basis import SmileBasis
from pricing_core.chains.surface.total_variance import Clock, TotalVariance

EXPIRIES = np.array([0.1, 0.25, 0.4, 1.0, 2.0])
X = np.linspace(-0.6, 0.5, 23)


CLOCKS = [Clock(), Clock((0.06, 0.3, 1.5), (0.05, 0.04, 0.02, 0.0))]
either_clock = pytest.mark.parametrize("clock", CLOCKS, ids=["plain", "dividends"])


def surface(seed, clock=CLOCKS[0]):
    """Return smiles that do not cross, with uneven growth."""
    generator = np.random.default_rng(seed)
    theta = 0.005 * np.cumprod(1.2 + generator.random(EXPIRIES.size))
    basis = SmileBasis.covering(-6.0, 6.0)
    left, right = 0.02 + 0.02 * np.arange(EXPIRIES.size), 0.03 + 0.01 * np.arange(EXPIRIES.size)
    rows = [
        basis.represent(ESSVI(t, a, b).at(basis.places * math.sqrt(t)) / t)
        for t, a, b in zip(theta, left, right, strict=True)
    ]
    return TotalVariance(basis, EXPIRIES, theta, np.array(rows), clock)


@either_clock
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("time", [0.03, 0.1, 0.17, 0.31, 0.7, 1.6, 2.0, 3.0])
def test_the_derivatives_are_those_of_differences(seed, time, clock):
    variance, h = surface(seed, clock), 1e-4
    jet, by_time = variance.at(X, time)
    up, down = variance.at(X + h, time)[0].value, variance.at(X - h, time)[0].value
    assert jet.first == pytest.approx((up - down) / (2 * h), abs=1e-6)
    assert jet.second == pytest.approx((up - 2 * jet.value + down) / h**2, abs=2e-5)
    if time not in EXPIRIES:
        late, early = variance.at(X, time * (1 + 1e-5))[0].value, variance.at(X, time * (1 - 1e-5))[0].value
        assert by_time == pytest.approx((late - early) / (2e-5 * time), rel=1e-5)


@either_clock
@pytest.mark.parametrize("seed", range(8))
def test_it_grows_with_time_and_meets_the_smiles(seed, clock):
    variance = surface(seed, clock)
    times = np.unique(np.concatenate([np.geomspace(0.01, 4.0, 120), EXPIRIES]))
    values = np.array([variance.at(X, time)[0].value for time in times.tolist()])
    assert np.all(np.diff(values, axis=0) > 0.0)
    for i, expiry in enumerate(EXPIRIES.tolist()):
        assert variance.at(X, expiry)[0].value == pytest.approx(variance.smile(i, X).value, rel=1e-13)


def test_it_is_proportional_to_time_before_the_first_expiry():
    variance = surface(0)
    assert variance.at(X, 0.02)[0].value == pytest.approx(0.2 * variance.smile(0, X).value, rel=1e-13)


def test_one_smile_alone_serves_every_time():
    variance = surface(0)
    alone = TotalVariance(variance.basis, EXPIRIES[:1], variance.theta[:1], variance.coefficients[:1])
    assert alone.at(X, 0.1)[0].value == pytest.approx(alone.smile(0, X).value, rel=1e-13)
    assert np.all(alone.at(X, 0.3)[0].value > alone.at(X, 0.1)[0].value)


def test_the_clock_is_the_integral_of_the_square_of_s_over_s_less_d():
    clock, pieces = CLOCKS[1], ((0.06, 0.05), (0.24, 0.04), (0.5, 0.02))  # up to 0.8
    tau, pace = clock.at(X, 0.8)
    expected = sum(length * (1.0 + ratio * np.exp(-X)) ** 2 for length, ratio in pieces)
    assert tau.value == pytest.approx(expected, rel=1e-14)
    assert pace == pytest.approx((1.0 + 0.02 * np.exp(-X)) ** 2, rel=1e-14)


def test_a_spot_of_one_volatility_between_dividends_keeps_it():
    """Between two expiries X has the volatility sigma S/(S - D), so that total variance runs as the clock does."""
    basis, money = SmileBasis.covering(-6.0, 6.0), np.zeros(1)
    taus = np.array([CLOCKS[1].at(money, time)[0].value[0] for time in EXPIRIES.tolist()])
    rows = np.tile(basis.represent(np.ones(basis.size)), (EXPIRIES.size, 1))
    flat = TotalVariance(basis, EXPIRIES, 0.09 * taus, rows, CLOCKS[1])
    for time in (0.05, 0.2, 0.31, 0.8, 1.7):
        jet, by_time = flat.at(money, time)
        tau, pace = CLOCKS[1].at(money, time)
        assert jet.value == pytest.approx(0.09 * tau.value, rel=1e-12)
        assert by_time == pytest.approx(0.09 * pace, rel=1e-12)
