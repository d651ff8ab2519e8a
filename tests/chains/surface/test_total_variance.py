"""Total variance between expiries: derivatives, monotonicity, and what holds outside."""

import math

import numpy as np
import pytest

from pricing_core.chains.surface.essvi import ESSVI
from pricing_core.chains.surface.smile_basis import SmileBasis
from pricing_core.chains.surface.total_variance import TotalVariance

EXPIRIES = np.array([0.1, 0.25, 0.4, 1.0, 2.0])
X = np.linspace(-0.6, 0.5, 23)


def surface(seed):
    """Return smiles that do not cross, with uneven growth."""
    generator = np.random.default_rng(seed)
    theta = 0.005 * np.cumprod(1.2 + generator.random(EXPIRIES.size))
    basis = SmileBasis.covering(-6.0, 6.0)
    left, right = 0.02 + 0.02 * np.arange(EXPIRIES.size), 0.03 + 0.01 * np.arange(EXPIRIES.size)
    rows = [
        basis.represent(ESSVI(t, a, b).at(basis.places * math.sqrt(t)) / t)
        for t, a, b in zip(theta, left, right, strict=True)
    ]
    return TotalVariance(basis, EXPIRIES, theta, np.array(rows))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("time", [0.03, 0.1, 0.17, 0.3, 0.7, 1.6, 2.0, 3.0])
def test_the_derivatives_are_those_of_differences(seed, time):
    variance, h = surface(seed), 1e-4
    jet, by_time = variance.at(X, time)
    up, down = variance.at(X + h, time)[0].value, variance.at(X - h, time)[0].value
    assert jet.first == pytest.approx((up - down) / (2 * h), abs=1e-6)
    assert jet.second == pytest.approx((up - 2 * jet.value + down) / h**2, abs=2e-5)
    if time not in EXPIRIES:
        late, early = variance.at(X, time * (1 + 1e-5))[0].value, variance.at(X, time * (1 - 1e-5))[0].value
        assert by_time == pytest.approx((late - early) / (2e-5 * time), rel=1e-5)


@pytest.mark.parametrize("seed", range(8))
def test_it_grows_with_time_and_meets_the_smiles(seed):
    variance = surface(seed)
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
