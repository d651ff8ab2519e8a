"""Chains whose truth is known, through the whole fit: without noise, and with noise of half a spread."""

import math

import numpy as np
import pytest

from pricing_core.chains import fit_chain
from pricing_core.chains.chain_fit import ChainFit
from pricing_core.chains.surface.dupire import local_volatility_error
from tests.problems.chains import CLASSES, EXPIRIES, RATE, SPOT, YIELD, KnownChain, known_chain

BASIS_POINT = 1e-4
NOISY = list(zip(CLASSES, (False, True, True, False), strict=True))
TIMES = np.sort(np.concatenate([EXPIRIES, np.sqrt(EXPIRIES[1:] * EXPIRIES[:-1])]))
SEEDS, CHAINS = 20_261_125, 12


def fitted(known: KnownChain, mid: np.ndarray) -> ChainFit:
    dividends = [{"time": each.time, "amount": each.amount} for each in known.market.cash_dividends]
    return fit_chain(known.table(mid), RATE, cash_dividends=dividends)


def column(fit: ChainFit, name: str) -> np.ndarray:
    return np.array(fit.quotes[name].to_numpy(zero_copy_only=False), dtype=float)


def spots_of(known: KnownChain, time: float, count: int) -> np.ndarray:
    """Return spots within two deviations of the forward."""
    forward = np.interp(time, EXPIRIES, known.forward[:: known.forward.size // EXPIRIES.size])
    return forward * np.exp(np.linspace(-2.0, 2.0, count) * known.deviation(np.array(time)))


def check_without_noise(name: str, dividends: bool) -> None:
    known = known_chain(name, dividends=dividends)
    fit = fitted(known, known.price)
    np.testing.assert_allclose(fit.carry["dividend_yield"].to_numpy(), YIELD, rtol=0.0, atol=BASIS_POINT)
    for expiry in EXPIRIES.tolist():
        rows = (known.expiry == expiry) & known.near & known.out_of_the_money
        found = fit.surface.volatility(known.strike[rows], expiry)
        np.testing.assert_allclose(found, known.volatility[rows], rtol=0.0, atol=4e-4)
    for time in TIMES.tolist():
        spots = spots_of(known, time, 41)
        truth = known.local_volatility.at(time, spots)
        np.testing.assert_allclose(fit.local_volatility.at(time, spots), truth, rtol=0.01)
    miss = np.abs(column(fit, "model_price") - known.price)[known.near] / SPOT
    # SSVI's local volatility before the first expiry, which no quote tells, moves the boundaries of exercise a little.
    assert np.mean(miss < 1e-5) > (0.95 if name == "ssvi" else 0.999)
    assert miss.max() < (4e-5 if name == "ssvi" else 1e-5)
    assert fit.unfitted == {}


@pytest.mark.nightly
@pytest.mark.parametrize("name", CLASSES)
@pytest.mark.parametrize("dividends", [False, True])
def test_without_noise_everything_is_recovered(name: str, dividends: bool) -> None:
    check_without_noise(name, dividends)


def ratios(known: KnownChain, seed: int) -> dict[str, np.ndarray]:
    """Return errors over the standard errors that the fit of a noisy chain reports."""
    rng = np.random.default_rng(seed)
    fit = fitted(known, known.price + known.half_spread * rng.standard_normal(known.price.size))
    carry = (fit.carry["dividend_yield"].to_numpy() - YIELD) / fit.carry["standard_error"].to_numpy()
    local = []
    for time in TIMES.tolist():
        spots = spots_of(known, time, 9)
        off = fit.local_volatility.at(time, spots) - known.local_volatility.at(time, spots)
        local.append(off / local_volatility_error(fit.surface, fit.market, spots, time))
    model, error = column(fit, "model_price"), column(fit, "model_price_error")
    rows = (
        known.near & np.isfinite(model) & (error > 1e-6 * SPOT)
    )  # others are exercised, or worth what they pay
    told = known.near & known.out_of_the_money & np.isfinite(model)
    volatility = (column(fit, "model_volatility") - known.volatility)[told]
    return {
        "carry": carry,
        "volatility": volatility / column(fit, "model_volatility_error")[told],
        "local_volatility": np.concatenate(local),
        "price": (model - known.price)[rows] / error[rows],
    }


@pytest.mark.nightly
@pytest.mark.parametrize(("name", "dividends"), NOISY)
def test_with_noise_errors_lie_within_two_standard_errors_in_95_of_100_cases(
    name: str, dividends: bool
) -> None:
    """The share within two deviations of a normal error is 0.954, and its mean square 1.

    What twelve chains say of both scatters by the standard error of their mean; the bounds are three of these, and a
    little, on both sides.

    """
    known = known_chain(name, dividends=dividends)
    first = SEEDS + CHAINS * CLASSES.index(name)
    found = [ratios(known, first + seed) for seed in range(CHAINS)]
    for quantity in found[0]:
        within = [float(np.mean(np.abs(each[quantity]) <= 2.0)) for each in found]
        square = [float(np.mean(each[quantity] ** 2)) for each in found]
        for said, values, expected, besides in (("share", within, 0.954, 0.01), ("square", square, 1.0, 0.1)):
            scatter = float(np.std(values, ddof=1)) / math.sqrt(CHAINS)
            print(f"{name}, {quantity}: {said} {np.mean(values):.3f} +- {scatter:.3f}")
            assert abs(np.mean(values) - expected) < 3.0 * scatter + besides, (quantity, said)
            assert scatter < (0.03 if said == "share" else 0.3), (quantity, said)
