"""The carry of a chain: a yield curve that call and put of every expiry agree on, with standard errors."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.curves import Curve, PiecewiseConstant, integral
from pricing_core.american.contracts.fields import DIVIDEND_YIELD
from pricing_core.american.implied.carry_pairs import Chain, Pairs
from pricing_core.american.implied.implied_carry import (
    ExpiryCarry,
    Premiums,
    carry_of_expiry,
    discount,
    early_premiums,
    mean_stock,
    parity_stock,
    stock_value,
)
from pricing_core.arrays import Matrix, Vector
from pricing_core.chains.interruption import check_interrupt
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
# Error of call - put in widths if each quote errs by half of its spread: what counts where no pair can be compared.
EXPECTED_ERROR = math.sqrt(0.5)
# Changes of the stock's value, relative, and of the yield, at most, by which the feedback of the premiums is measured.
PROBE, LARGEST_PROBE = 1e-3, 0.05
LEAST_FEEDBACK, MOST_FEEDBACK = -0.5, 0.8  # of the stock's value through the premiums to itself; chosen
FLOOR = 1e-9  # Smallest error of a stock's value that counts, in spots; rounding.


@dataclass(frozen=True, slots=True, eq=False)
class Carry:
    """What a chain says of its carry; arrays of shape (n,) have one entry per expiry, in order.

    Parameters
    ----------
    expiry : Vector
        Years.
    forward : Vector
        Expected spot at expiry, money per unit of underlying.
    dividend_yield : Vector
        1/year, continuous: the mean up to the expiry of what comes on top of the dividends that are given.
    standard_error : Vector
        Of dividend_yield, 1/year; NaN for an expiry without pairs.
    residual : Vector
        Root of the weighted mean square of what the pairs used miss parity by, money; NaN without pairs.
    pairs_used : int array
    status : object array of str
        "ok"; "no_pairs" or "no_convergence", where the yield is that of the other expiries.
    curve : float or PiecewiseConstant
        The yield from expiry to expiry.
    pairs : Pairs, pair_residual : Vector, pair_used : bool array, each of shape (m,)
        The pairs that were looked at, what each misses parity by, money, and which count.
    stock, stock_error : Vector
        What the stock to be had at each expiry is worth now by its own pairs, and the standard error of that, money;
        NaN where the status is not "ok".
    told : tuple of ExpiryCarry
        What the pairs of each expiry tell on their own.
    gain : Vector
        By what an error of parity is multiplied on its way to the stock's value, for each expiry that is "ok".
    """

    expiry: Vector
    forward: Vector
    dividend_yield: Vector
    standard_error: Vector
    residual: Vector
    pairs_used: NDArray[np.int64]
    status: NDArray[np.object_]
    curve: Curve
    pairs: Pairs | None
    pair_residual: Vector
    pair_used: NDArray[np.bool_]
    stock: Vector
    stock_error: Vector
    told: tuple[ExpiryCarry, ...]
    gain: Vector

    @property
    def is_known(self) -> bool:
        """Whether any expiry has told it."""
        return bool((self.status == "ok").any())


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
    gain = _feedback(chain, fitted, tolerance, threads) if american else np.ones(len(known))
    values, _ = _joint(chain, fitted, gain)
    for _ in range(CURVE_PASSES if american and len(known) > 1 else 0):
        check_interrupt(interrupt)
        before = [_stock(chain, carry) for carry in fitted]
        fitted = _at_curve(chain, fitted, curve_of(chain.expiries[known], values), gain, (tolerance, threads))
        values, _ = _joint(chain, fitted, gain)
        changes = [abs(_stock(chain, carry) - value) for carry, value in zip(fitted, before, strict=True)]
        if max(changes) <= SETTLED_STOCK * chain.market.spot:
            break
    return _result(chain, found, known, fitted, gain)


def refit_carry(chain: Chain, carry: Carry, premiums: Premiums) -> Carry:
    """Return the carry with early exercise premiums of its pairs that were found in another way, at its own curve.

    Parameters
    ----------
    premiums : Premiums
        Of `carry.pairs`.
    """
    known = [place for place, one in enumerate(carry.told) if one.status == "ok"]
    fitted = _with_premiums(chain, [carry.told[place] for place in known], carry.curve, carry.gain, premiums)
    return _result(chain, list(carry.told), known, fitted, carry.gain)


def _joint(chain: Chain, fitted: list[ExpiryCarry], gain: Vector) -> tuple[Vector, Matrix]:
    times = np.array([float(carry.pairs.expiry[0]) for carry in fitted if carry.pairs is not None])
    stock = np.array([_stock(chain, carry) for carry in fitted])
    error = np.maximum(_errors(fitted) * gain, FLOOR * chain.market.spot)
    return joint_yields(chain.market, times, stock, error)


def _stock(chain: Chain, carry: ExpiryCarry) -> float:
    assert carry.pairs is not None
    return carry.forward * discount(chain.market.rate, float(carry.pairs.expiry[0]))


def _errors(fitted: list[ExpiryCarry]) -> Vector:
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


def _feedback(chain: Chain, fitted: list[ExpiryCarry], tolerance: float, threads: int | None) -> Vector:
    """Return by what an error of parity is multiplied on its way to the stock's value.

    The stock's value X is parity less premiums, which depend on X: dX = d(parity) / (1 + d(premiums)/dX).
    """
    yields = np.array([carry.dividend_yield for carry in fitted])
    pairs = _joined(fitted)
    lengths = [carry.stock.size for carry in fitted]
    times = np.array([float(carry.pairs.expiry[0]) for carry in fitted if carry.pairs is not None])
    moved = np.clip(
        yields + np.minimum(PROBE / times, LARGEST_PROBE), DIVIDEND_YIELD.least, DIVIDEND_YIELD.most
    )
    by_pair = np.tile(np.repeat(moved, lengths), 2)
    premiums = early_premiums(chain.market, pairs, by_pair, tolerance, threads)
    gains = []
    for place, (carry, part) in enumerate(zip(fitted, _parts(lengths), strict=True)):
        now = premiums.call_less_put[part]
        parity = _parity(chain, carry)
        both = carry.used & premiums.identified[part]
        weight = np.where(both, _weights(carry), 0.0)
        change = stock_value(chain.market, float(moved[place]), times.item(place)) - _stock(chain, carry)
        total = float(weight.sum())
        slope = 0.0
        if total > 0.0 and change != 0.0:
            slope = (
                -float((weight * np.where(both, now - (parity - carry.stock), 0.0)).sum()) / total / change
            )
        gains.append(1.0 / (1.0 - min(max(slope, LEAST_FEEDBACK), MOST_FEEDBACK)))
    return np.array(gains)


def _parity(chain: Chain, carry: ExpiryCarry) -> Vector:
    assert carry.pairs is not None
    return parity_stock(carry.pairs, discount(chain.market.rate, float(carry.pairs.expiry[0])))


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
        chain, fitted, curve, gain, early_premiums(chain.market, _joined(fitted), 2 * of_pairs, *settings)
    )


def _with_premiums(
    chain: Chain, fitted: list[ExpiryCarry], curve: Curve, gain: Vector, premiums: Premiums
) -> list[ExpiryCarry]:
    """Return what the expiries tell with premiums that were taken at a curve."""
    lengths, there = [carry.stock.size for carry in fitted], []
    for carry, part, factor in zip(fitted, _parts(lengths), gain.tolist(), strict=True):
        assert carry.pairs is not None
        time = float(carry.pairs.expiry[0])
        used = carry.used & premiums.identified[part]
        if not used.any():
            there.append(carry)
            continue
        value = stock_value(chain.market, curve, time)
        stock = _parity(chain, carry) - premiums.call_less_put[part]
        told = float(np.average(stock[used], weights=_weights(carry)[used]))
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
    own[known] = [_stock(chain, carry) for carry in fitted]
    own_error[known] = np.maximum(_errors(fitted) * gain, FLOOR * chain.market.spot)
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
        pairs=_joined(fitted),
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


def _weights(carry: ExpiryCarry) -> Vector:
    assert carry.pairs is not None
    weights: Vector = np.where(carry.used, carry.pairs.width**-2.0, 0.0)
    return weights


def _joined(fitted: list[ExpiryCarry]) -> Pairs:
    pairs = [carry.pairs for carry in fitted if carry.pairs is not None]
    return Pairs(*(np.concatenate([getattr(part, name) for part in pairs]) for name in Pairs.__slots__))


def _parts(lengths: list[int]) -> list[slice]:
    ends = np.cumsum(lengths).tolist()
    return [slice(end - length, end) for end, length in zip(ends, lengths, strict=True)]
