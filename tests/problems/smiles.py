"""Total variances and local volatilities of models whose smiles are known, and chains of quotes made from them."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import ncx2, norm

from pricing_core.american import Market
from pricing_core.american.implied.black_spread import black_spread
from pricing_core.chains.surface.smile_quotes import SmileQuotes

EXPIRIES = (0.04, 0.1, 0.25, 0.5, 1.0, 2.0)


@dataclass(frozen=True)
class Truth:
    """A model of the martingale X: total variance and local volatility at x = ln X and at a time."""

    name: str
    total_variance: Callable
    local_volatility: Callable


def ssvi(x, time, rho=-0.5, eta=1.0, power=0.4, volatility=0.25):
    """Gatheral and Jacquier's (2014) SSVI, phi = eta theta^-power, theta proportional to time."""
    theta = volatility**2 * time
    phi = eta / theta**power
    return 0.5 * theta * (1.0 + rho * phi * x + np.sqrt((phi * x + rho) ** 2 + 1.0 - rho**2))


def ssvi_local(x, time):
    """Dupire's formula on SSVI by central differences."""
    h, w = 1e-3, ssvi(x, time)
    first, second = (
        (ssvi(x + h, time) - ssvi(x - h, time)) / (2 * h),
        (ssvi(x + h, time) - 2 * w + ssvi(x - h, time)) / h**2,
    )
    by_time = (ssvi(x, 1.0005 * time) - ssvi(x, 0.9995 * time)) / (0.001 * time)
    density = (1 - 0.5 * x * first / w) ** 2 - 0.25 * first**2 * (1 / w + 0.25) + 0.5 * second
    return np.sqrt(by_time / density)


def displaced(x, time, shift, scale):
    """dX = scale (X + shift) dW: Black's formula at (1 + shift, K + shift)."""
    strike = np.exp(x)
    forward, moved, spread = 1.0 + shift, strike + shift, scale * math.sqrt(time)
    d = np.log(forward / moved) / spread + 0.5 * spread
    call = forward * norm.cdf(d) - moved * norm.cdf(d - spread)
    put = moved * norm.cdf(spread - d) - forward * norm.cdf(-d)
    return black_spread(np.abs(x), np.where(x > 0.0, call, put) / np.minimum(1.0, strike)) ** 2


def elastic(x, time, scale=0.25, beta=1.0):
    """dX = scale X^(beta/2) dW, beta < 2: noncentral chi-square (Schroder 1989)."""
    strike, power = np.exp(x), 2.0 - beta
    unit = 4.0 / (scale**2 * power**2 * time)
    far, degrees = unit * strike**power, 2.0 / power
    call = ncx2.sf(far, degrees + 2.0, unit) - strike * ncx2.cdf(unit, degrees, far)
    put = strike * ncx2.sf(unit, degrees, far) - ncx2.cdf(far, degrees + 2.0, unit)
    return black_spread(np.abs(x), np.where(x > 0.0, call, put) / np.minimum(1.0, strike)) ** 2


TRUTHS = (
    Truth("ssvi", ssvi, ssvi_local),
    Truth(
        "displaced up",
        lambda x, time: displaced(x, time, 0.5, 0.18),
        lambda x, _: 0.18 * (np.exp(x) + 0.5) / np.exp(x),
    ),
    Truth(
        "displaced down",
        lambda x, time: displaced(x, time, -0.15, 0.25),
        lambda x, _: 0.25 * (np.exp(x) - 0.15) / np.exp(x),
    ),
    Truth("constant elasticity", elastic, lambda x, _: 0.25 * np.exp(-0.5 * x)),
)


def spread_at(truth: Truth, time: float) -> float:
    """Return the standard deviation of ln X at the money."""
    return math.sqrt(float(truth.total_variance(np.zeros(1), time)[0]))


def smile_quotes(
    truth: Truth, market: Market, noise: float = 0.0, seed: int = 0, expiries: Sequence[float] = EXPIRIES
) -> list[SmileQuotes]:
    """Return the volatilities of a chain without cash dividends, with so many deviations of noise."""
    generator, found = np.random.default_rng(seed), []
    for expiry in expiries:
        forward = market.spot * math.exp((market.rate - market.dividend_yield) * expiry)
        z = np.linspace(-2.5, 2.0, 37)
        x = z * spread_at(truth, expiry)
        deviation = 0.003 * (1.0 + z**2) * (0.1 / max(expiry, 0.1)) ** 0.25
        volatility = np.sqrt(truth.total_variance(x, expiry) / expiry)
        volatility = volatility + noise * deviation * generator.standard_normal(z.size)
        found.append(SmileQuotes(expiry, forward, x, forward * np.exp(x), volatility, deviation))
    return found
