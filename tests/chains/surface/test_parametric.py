"""The two parametric smiles: SVI of an expiry, eSSVI across expiries."""

from itertools import pairwise

import numpy as np
import pytest

from pricing_core.chains.surface.essvi import ESSVI, calibrate_essvi
from pricing_core.chains.surface.svi import SVI, calibrate_svi


@pytest.mark.parametrize("seed", range(6))
def test_svi_is_recovered_from_its_own_total_variances(seed):
    generator = np.random.default_rng(seed)
    smile = SVI(0.02 + 0.02 * generator.random(), 0.1, generator.uniform(-0.7, 0.3), 0.05, 0.15)
    x = np.linspace(-0.6, 0.5, 31)
    found = calibrate_svi(x, smile.at(x), np.full(x.size, 1e-3))
    assert found.at(x) == pytest.approx(smile.at(x), abs=2e-5)
    assert found.b * (1.0 + abs(found.rho)) <= 2.0 + 1e-12


def test_the_gradient_of_essvi_is_that_of_differences():
    x, point, h = np.linspace(-0.5, 0.5, 11), np.array([0.04, 0.1, 0.07]), 1e-7
    gradient = ESSVI(*point).gradient(x)
    for i in range(3):
        step = h * np.eye(3)[i]
        differences = (ESSVI(*(point + step)).at(x) - ESSVI(*(point - step)).at(x)) / (2 * h)
        assert gradient[:, i] == pytest.approx(differences, abs=1e-7)


@pytest.mark.parametrize("seed", range(10))
def test_essvi_keeps_its_conditions_whatever_the_quotes(seed):
    generator = np.random.default_rng(seed)
    smiles, starts = [], []
    for i in range(5):
        x = np.linspace(-0.5, 0.4, 12)
        variance = 0.03 * (i + 1) * np.exp(0.5 * generator.standard_normal(12))
        smiles.append((x, variance, 0.1 * variance))
        starts.append(ESSVI(0.03 * (i + 1), 0.05, 0.05))
    found = calibrate_essvi(smiles, starts)
    for smile in found:
        steep = max(smile.left, smile.right)
        assert steep <= 2.0
        assert smile.psi * steep <= 2.0 * smile.theta * (1 + 1e-9)
    for early, late in pairwise(found):
        assert late.theta > early.theta
        assert late.left >= early.left * (1 - 1e-9)
        assert late.right >= early.right * (1 - 1e-9)
        assert late.psi / late.theta <= early.psi / early.theta * (1 + 1e-9)
