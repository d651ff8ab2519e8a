"""The value of the stock at each expiry that the pairs of a chain imply, and its standard error."""

from __future__ import annotations

import math

import numpy as np

from pricing_core.american.contracts.fields import DIVIDEND_YIELD
from pricing_core.american.implied.carry_pairs import Chain, Pairs
from pricing_core.american.implied.implied_carry import (
    ExpiryCarry,
    discount,
    early_premiums,
    parity_stock,
    stock_value,
)
from pricing_core.arrays import Vector

# Error of call - put in widths if each quote errs by half of its spread: what counts where no pair can be compared.
EXPECTED_ERROR = math.sqrt(0.5)
# Changes of the stock's value, relative, and of the yield, at most, by which the feedback of the premiums is measured.
PROBE, LARGEST_PROBE = 1e-3, 0.05
LEAST_FEEDBACK, MOST_FEEDBACK = -0.5, 0.8  # of the stock's value through the premiums to itself; chosen


def stock_of(chain: Chain, carry: ExpiryCarry) -> float:
    """Return the present value of the stock delivered at an expiry, money."""
    assert carry.pairs is not None
    return carry.forward * discount(chain.market.rate, float(carry.pairs.expiry[0]))


def stock_errors(fitted: list[ExpiryCarry]) -> Vector:
    """Return the standard errors of the stock's values, the feedback left out."""
    misses, count, precision = 0.0, 0, []
    for carry in fitted:
        assert carry.pairs is not None
        width, stock = carry.pairs.width[carry.used], carry.stock[carry.used]
        mean = np.average(stock, weights=width**-2.0)
        misses += float((((stock - mean) / width) ** 2).sum())
        count += width.size - 1
        precision.append(float((width**-2.0).sum()))
    expected = 1.0 / (1.0 + count)  # Number of pairs for which the expected error counts; chosen.
    scale = math.sqrt((misses + expected * EXPECTED_ERROR**2) / (count + expected))
    errors: Vector = scale / np.sqrt(precision)
    return errors


def feedback(chain: Chain, fitted: list[ExpiryCarry], tolerance: float, threads: int | None) -> Vector:
    """Return the factor by which an error of parity is multiplied in the stock's value.

    The stock's value X is parity less premiums, which depend on X: dX = d(parity) / (1 + d(premiums)/dX).
    """
    yields = np.array([carry.dividend_yield for carry in fitted])
    pairs = joined_pairs(fitted)
    lengths = [carry.stock.size for carry in fitted]
    times = np.array([float(carry.pairs.expiry[0]) for carry in fitted if carry.pairs is not None])
    moved = np.clip(
        yields + np.minimum(PROBE / times, LARGEST_PROBE), DIVIDEND_YIELD.least, DIVIDEND_YIELD.most
    )
    by_pair = np.tile(np.repeat(moved, lengths), 2)
    premiums = early_premiums(chain.market, pairs, by_pair, tolerance, threads)
    gains = []
    for place, (carry, part) in enumerate(zip(fitted, parts_of(lengths), strict=True)):
        now = premiums.call_less_put[part]
        parity = parity_of(chain, carry)
        both = carry.used & premiums.identified[part]
        weight = np.where(both, weights_of(carry), 0.0)
        change = stock_value(chain.market, float(moved[place]), times.item(place)) - stock_of(chain, carry)
        total = float(weight.sum())
        slope = 0.0
        if total > 0.0 and change != 0.0:
            slope = (
                -float((weight * np.where(both, now - (parity - carry.stock), 0.0)).sum()) / total / change
            )
        gains.append(1.0 / (1.0 - min(max(slope, LEAST_FEEDBACK), MOST_FEEDBACK)))
    return np.array(gains)


def parity_of(chain: Chain, carry: ExpiryCarry) -> Vector:
    """Return the present value of the stock that each pair implies if call and put are European, shape (m,)."""
    assert carry.pairs is not None
    return parity_stock(carry.pairs, discount(chain.market.rate, float(carry.pairs.expiry[0])))


def weights_of(carry: ExpiryCarry) -> Vector:
    """Return the weight of each pair, shape (m,)."""
    assert carry.pairs is not None
    weights: Vector = np.where(carry.used, carry.pairs.width**-2.0, 0.0)
    return weights


def joined_pairs(fitted: list[ExpiryCarry]) -> Pairs:
    """Return the pairs of several expiries, one after the other."""
    pairs = [carry.pairs for carry in fitted if carry.pairs is not None]
    return Pairs(*(np.concatenate([getattr(part, name) for part in pairs]) for name in Pairs.__slots__))


def parts_of(lengths: list[int]) -> list[slice]:
    """Return where in the joined pairs those of each expiry lie."""
    ends = np.cumsum(lengths).tolist()
    return [slice(end - length, end) for end, length in zip(ends, lengths, strict=True)]
