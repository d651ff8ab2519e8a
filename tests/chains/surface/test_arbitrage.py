"""Proofs of the absence of arbitrage on smiles whose state is known."""

import math

import numpy as np
import pytest

from pricing_core.chains.surface.arbitrage import durrleman, prove
from pricing_core.chains.surface.essvi import ESSVI
from pricing_core.chains.surface.smile_basis import SmileBasis
from pricing_core.chains.surface.svi import SVI
from pricing_core.chains.surface.total_variance import TotalVariance


def surface_of(smiles, theta, expiries):
    """Return the splines through smiles, each a function of x."""
    basis, theta = SmileBasis.covering(-8.0, 8.0), np.array(theta)
    rows = [
        basis.represent(smile(basis.places * math.sqrt(own)) / own)
        for smile, own in zip(smiles, theta, strict=True)
    ]
    return TotalVariance(basis, np.array(expiries), theta, np.array(rows))


@pytest.mark.parametrize("seed", range(10))
def test_essvi_within_its_conditions_is_proved_free_of_arbitrage(seed):
    generator = np.random.default_rng(seed)
    left, right = generator.uniform(0.02, 0.1, 2)
    smiles = [ESSVI(0.01 * 2**i, left * 1.3**i, right * 1.3**i) for i in range(4)]
    proof = prove(surface_of([s.at for s in smiles], [s.theta for s in smiles], [0.1, 0.2, 0.4, 0.8]))
    assert proof.holds


def test_the_butterfly_arbitrage_of_vogt_s_smile_is_found_where_the_density_is_negative():
    smile = SVI(-0.0410, 0.1331, 0.3060, 0.3586, 0.4153)
    theta = float(smile.at(np.zeros(1))[0])
    variance = surface_of([smile.at], [theta], [1.0])
    proof = prove(variance)
    assert not proof.butterfly[0]
    found = proof.butterfly_failures[0]
    assert 0.5 < found.max() < 1.2  # Gatheral and Jacquier (2014), figure 2
    assert np.all(durrleman(found, variance.smile(0, found)) < 1e-6)


def test_smiles_that_cross_are_found_where_they_do():
    first, second = ESSVI(0.02, 0.05, 0.12), ESSVI(0.03, 0.07, 0.05)
    proof = prove(surface_of([first.at, second.at], [0.02, 0.03], [0.5, 1.0]))
    assert proof.butterfly == (True, True)
    assert proof.calendar == (True, False)
    places = proof.calendar_failures[1]
    assert places.min() > 0.0
    assert np.all(second.at(places) - first.at(places) < 1e-4)


def test_a_wing_steeper_than_two_is_refused():
    proof = prove(
        surface_of([lambda x: 1.0 + 2.2 * np.maximum(x, 0.0) ** 2 / (1.0 + np.abs(x))], [1.0], [1.0])
    )
    assert not proof.butterfly[0]
    assert proof.butterfly_failures[0].max() > 7.0
