"""The carry of a chain found: from what the pairs of each expiry tell to one yield curve."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pricing_core.american.contracts.curves import Curve, PiecewiseConstant, integral
from pricing_core.american.implied.carry_pairs import Chain
from pricing_core.american.implied.implied_carry import (
    ExpiryCarry,
    Premiums,
    carry_of_expiry,
    discount,
    early_premiums,
    mean_stock,
    stock_value,
)
from pricing_core.arrays import Matrix, Vector
from pricing_core.chains.carry import Carry
from pricing_core.chains.interruption import check_interrupt
from pricing_core.chains.parity_errors import (
    feedback,
    joined_pairs,
    parity_of,
    parts_of,
    stock_errors,
    stock_of,
    weights_of,
)
from pricing_core.chains.yield_curve import curve_of, joint_yields

# Largest number of times that the premiums are taken at the curve found before, and the change of a stock's value, in
# spots, at which they need no other; chosen.
CURVE_PASSES, SETTLED_STOCK = 3, 1e-5
PIECE_ENDS = (
    0.25,
    0.5,
    0.75,
    0.9,
)  # Where its pieces end for a premium, about, as shares of the expiry; chosen.
FLOOR = 1e-9  # Smallest error of a stock's value that counts, in spots; rounding.


def fit_carry(
    chain: Chain, *, tolerance: float, threads: int | None = None, interrupt: Callable[[], bool] | None = None
) -> Carry:
    """Return the yield curve, piecewise constant between the expiries, that the pairs of all expiries imply.

    Every expiry is fitted by `carry_of_expiry`. Its error is that of the weighted mean of its pairs, scaled by what
    the pairs of the whole chain miss parity by, and by the feedback of the yield through the premiums to itself. The
    yield is a random walk from expiry to expiry; how far it goes in a step is not known, and each of `YIELD_CHANGES`
    counts as the stocks' values make it likely (`joint_yields`). The premiums are then taken at the curve in the place
    of each expiry's own mean yield.

    Raises
    ------
    NumericalError
        The interrupt came.
    """
    found = []
    for group in range(chain.expiries.size):
        check_interrupt(interrupt)
        found.append(carry_of_expiry(chain, group, tolerance, threads))
    known = [place for place, carry in enumerate(found) if carry.status == "ok"]
    if not known:
        return _unknown(chain, found)
    fitted = [found[place] for place in known]
    check_interrupt(interrupt)
    american = chain.exercise == "american"
    gain = feedback(chain, fitted, tolerance, threads) if american else np.ones(len(known))
    values, _ = _joint(chain, fitted, gain)
    for _ in range(CURVE_PASSES if american and len(known) > 1 else 0):
        check_interrupt(interrupt)
        before = [stock_of(chain, carry) for carry in fitted]
        fitted = _at_curve(chain, fitted, curve_of(chain.expiries[known], values), gain, (tolerance, threads))
        values, _ = _joint(chain, fitted, gain)
        changes = [abs(stock_of(chain, carry) - value) for carry, value in zip(fitted, before, strict=True)]
        if max(changes) <= SETTLED_STOCK * chain.market.spot:
            break
    return _result(chain, found, known, fitted, gain)


def refit_carry(chain: Chain, carry: Carry, premiums: Premiums) -> Carry:
    """Return the carry with early exercise premiums of its pairs that were found in another way, at its own curve.

    Parameters
    ----------
    premiums : Premiums
        The early exercise premiums of `carry.pairs`.
    """
    known = [place for place, one in enumerate(carry.told) if one.status == "ok"]
    fitted = _with_premiums(chain, [carry.told[place] for place in known], carry.curve, carry.gain, premiums)
    return _result(chain, list(carry.told), known, fitted, carry.gain)


def _joint(chain: Chain, fitted: list[ExpiryCarry], gain: Vector) -> tuple[Vector, Matrix]:
    times = np.array([float(carry.pairs.expiry[0]) for carry in fitted if carry.pairs is not None])
    stock = np.array([stock_of(chain, carry) for carry in fitted])
    error = np.maximum(stock_errors(fitted) * gain, FLOOR * chain.market.spot)
    return joint_yields(chain.market, times, stock, error)


def _at_curve(
    chain: Chain,
    fitted: list[ExpiryCarry],
    curve: Curve,
    gain: Vector,
    settings: tuple[float, int | None],
) -> list[ExpiryCarry]:
    """Return what the expiries tell with premiums taken at a curve in the place of each one's own mean yield."""
    lengths = [carry.stock.size for carry in fitted]
    curves = [_coarse(curve, float(carry.pairs.expiry[0])) for carry in fitted if carry.pairs is not None]
    of_pairs = [curve for curve, length in zip(curves, lengths, strict=True) for _ in range(length)]
    return _with_premiums(
        chain,
        fitted,
        curve,
        gain,
        early_premiums(chain.market, joined_pairs(fitted), 2 * of_pairs, *settings),
    )


def _with_premiums(
    chain: Chain, fitted: list[ExpiryCarry], curve: Curve, gain: Vector, premiums: Premiums
) -> list[ExpiryCarry]:
    """Return what the expiries tell with premiums that were taken at a curve."""
    lengths, there = [carry.stock.size for carry in fitted], []
    for carry, part, factor in zip(fitted, parts_of(lengths), gain.tolist(), strict=True):
        assert carry.pairs is not None
        time = float(carry.pairs.expiry[0])
        used = carry.used & premiums.identified[part]
        if not used.any():
            there.append(carry)
            continue
        value = stock_value(chain.market, curve, time)
        stock = parity_of(chain, carry) - premiums.call_less_put[part]
        told = float(np.average(stock[used], weights=weights_of(carry)[used]))
        # The premiums are those of the curve's value, and change with it: Newton's step, the same for every pair.
        stock += (factor - 1.0) * (told - value)
        there.append(mean_stock(chain.market, carry.pairs, stock, used, time))
    return there


def _coarse(curve: Curve, expiry: float) -> Curve:
    """Return a curve of few pieces with the same integral over each of them, the last one up to the expiry.

    What a premium depends on is mostly how much is paid by then; with many pieces it takes much longer.
    """
    if not isinstance(curve, PiecewiseConstant):
        return curve
    before = [time for time in curve.times if time < expiry]
    ends = {max((time for time in before if time <= share * expiry), default=expiry) for share in PIECE_ENDS}
    times = sorted({*ends, expiry})
    values = [
        curve.integral(start, end) / (end - start) for start, end in zip([0.0, *times], times, strict=False)
    ]
    return PiecewiseConstant(tuple(times), tuple(values))


def _result(
    chain: Chain, found: list[ExpiryCarry], known: list[int], fitted: list[ExpiryCarry], gain: Vector
) -> Carry:
    """Return the carry of all expiries, given what the `known` ones tell."""
    found = list(found)
    for place, one in zip(known, fitted, strict=True):
        found[place] = one
    times = chain.expiries[known]
    values, covariance = _joint(chain, fitted, gain)
    curve = curve_of(times, values)
    lengths = np.diff(times, prepend=0.0)
    error = np.full(chain.expiries.size, math.nan)
    for row, place in enumerate(known):
        share = np.where(np.arange(times.size) <= row, lengths, 0.0) / times[row]
        error[place] = math.sqrt(float(share @ covariance @ share))
    own, own_error = (np.full(chain.expiries.size, math.nan) for _ in range(2))
    own[known] = [stock_of(chain, carry) for carry in fitted]
    own_error[known] = np.maximum(stock_errors(fitted) * gain, FLOOR * chain.market.spot)
    expiries = chain.expiries.tolist()
    stock = [stock_value(chain.market, curve, time) for time in expiries]
    residuals = [carry.stock - stock[place] for carry, place in zip(fitted, known, strict=True)]
    return Carry(
        expiry=chain.expiries,
        forward=np.array(
            [x / discount(chain.market.rate, time) for x, time in zip(stock, expiries, strict=True)]
        ),
        dividend_yield=np.array([integral(curve, time) / time for time in expiries]),
        standard_error=error,
        residual=np.array([carry.residual for carry in found]),
        pairs_used=np.array([carry.pairs_used for carry in found], dtype=np.int64),
        status=np.array([carry.status for carry in found], dtype=object),
        curve=curve,
        pairs=joined_pairs(fitted),
        pair_residual=np.concatenate(residuals),
        pair_used=np.concatenate([carry.used for carry in fitted]),
        stock=own,
        stock_error=own_error,
        told=tuple(found),
        gain=gain,
    )


def _unknown(chain: Chain, found: list[ExpiryCarry]) -> Carry:
    """Return the carry of the given dividends alone."""
    count, nothing = chain.expiries.size, np.empty(0)
    stock = [stock_value(chain.market, 0.0, time) for time in chain.expiries.tolist()]
    return Carry(
        expiry=chain.expiries,
        forward=np.array(
            [x / discount(chain.market.rate, t) for x, t in zip(stock, chain.expiries.tolist(), strict=True)]
        ),
        dividend_yield=np.zeros(count),
        standard_error=np.full(count, math.nan),
        residual=np.full(count, math.nan),
        pairs_used=np.zeros(count, dtype=np.int64),
        status=np.array([carry.status for carry in found], dtype=object),
        curve=0.0,
        pairs=None,
        pair_residual=nothing,
        pair_used=nothing.astype(bool),
        stock=np.full(count, math.nan),
        stock_error=np.full(count, math.nan),
        told=tuple(found),
        gain=nothing,
    )
