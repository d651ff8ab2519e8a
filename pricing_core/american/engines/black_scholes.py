"""Black, Scholes and Merton's formula for contracts whose spot at expiry is lognormal."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.special import ndtr

from pricing_core.american.book.book import CURVES, Book
from pricing_core.american.book.cuts import with_cuts
from pricing_core.american.book.prices import error_of
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.contracts.fields import Greeks
from pricing_core.american.engines.differences import BUCKETS, DIVIDENDS, of_dividends_not_due
from pricing_core.arrays import Vector

ONE_OVER_SQRT_TWO_PI = 1.0 / math.sqrt(2.0 * math.pi)
# Error of each term of the formula as a share of it, for each unit of its exponent; chosen above their rounding.
ROUNDING = 1e-15
# The same for the Greeks, and for the terms of d1; calibrated against 100 decimal digits.
ROUNDING_OF_GREEKS = 2e-16


def european_columns(book: Book, greeks: Greeks) -> dict[str, Any]:
    """Return the value without early exercise and its derivatives as columns of `Prices`.

    With rates and variance averaged over the segments, and a spot that the proportional dividends and the escrow have
    reduced. The standard deviation of ln S at expiry must be above 0, as must the spot, and the spot model may have no
    cash dividends.

    Parameters
    ----------
    greeks : {"none", "standard", "extended"}
        Delta, gamma and theta come in any case.
    """
    segments, K = book.segments, book.strike
    S = book.spot
    kept: Vector | float = 1.0
    rate, dividend_yield = _sum(book, segments.rate), _sum(book, segments.dividend_yield)
    spread = np.sqrt(_sum(book, segments.volatility**2))
    if segments.fraction.any():
        kept = _per_contract(book, np.multiply, 1.0 - segments.fraction)
    if book.escrowed.any():
        S = S - book.escrow_now()
    sign = -book.sign
    with np.errstate(all="ignore"):
        moneyness = np.log(kept * S / K)
        d1 = (moneyness + (rate - dividend_yield)) / spread + 0.5 * spread
        discount, share = np.exp(-rate), kept * np.exp(-dividend_yield)
        d2 = d1 - spread
        in_stock, in_bond = sign * share * ndtr(sign * d1), sign * discount * ndtr(sign * d2)
        density = share * ONE_OVER_SQRT_TWO_PI * np.exp(-0.5 * d1 * d1)
        value = S * in_stock - K * in_bond
        now = book.now
        by_spread = S * density
        columns: dict[str, Any] = {
            "value": value,
            "delta": in_stock,
            "gamma": density / (S * spread),
            # (11.46); each term of the value accrues at its own rate.
            "theta": now.dividend_yield * S * in_stock
            - now.rate * K * in_bond
            - 0.5 * now.volatility**2 * by_spread / spread
            - _escrow_growth(book, in_stock),
            "error": ROUNDING
            * (S * share * (1.0 + np.abs(dividend_yield)) + K * discount * (1.0 + np.abs(rate))),
        }
        if greeks != "none":
            columns |= _by_parameters(book, in_stock * S, in_bond * K, by_spread, spread)
        if greeks == "extended":
            columns |= _second_order(book, density, by_spread, (d1, d2), spread)
            columns["charm"] = (
                now.dividend_yield * in_stock
                + density
                * (0.5 * (now.volatility / spread) ** 2 * d2 - (now.rate - now.dividend_yield) / spread)
                - _escrow_growth(book, columns["gamma"])
            )
            columns |= _by_pieces(book, in_stock * S, in_bond * K, by_spread / spread)
        if greeks != "none":
            # What the rounding of ln(S/K) and of the integrals does to d1.
            off = (1.0 + np.abs(moneyness) + np.abs(rate) + np.abs(dividend_yield)) / spread
            off = ROUNDING_OF_GREEKS * (off + spread)
            columns |= _errors(book, columns, (S, in_stock, in_bond, density), (d1, d2, spread), off)
    return columns


def _errors(
    book: Book,
    columns: dict[str, Any],
    terms: tuple[Vector, Vector, Vector, Vector],
    arguments: tuple[Vector, Vector, Vector],
    off: Vector,
) -> dict[str, Vector]:
    """Return the rounding errors of the Greeks that are one number, for an error `off` of d1 and d2.

    A term that has the normal density as a factor changes by |d1| times the error of d1 as a share of it.
    """
    (S, in_stock, in_bond, density), (d1, d2, spread) = terms, arguments
    now, expiry, by_spread = book.now, book.expiry, S * density
    # Relative errors of a term without the density (a few roundings and the exponents), and of one with it.
    plain = ROUNDING_OF_GREEKS * (
        1.0 + _sum(book, np.abs(book.segments.rate) + np.abs(book.segments.dividend_yield))
    )
    dense = 4.0 * plain + np.abs(d1) * off
    of_delta = plain * np.abs(in_stock) + density * off
    of_bond = plain * book.strike * np.abs(in_bond) + by_spread * off
    decay = 0.5 * (now.volatility / spread) ** 2
    errors = {
        "delta": of_delta,
        "gamma": dense * columns["gamma"],
        "theta": np.abs(now.dividend_yield) * S * of_delta
        + np.abs(now.rate) * of_bond
        + dense * decay * by_spread * spread
        + np.abs(_escrow_growth(book, of_delta)),
        "vega": dense * np.abs(columns["vega"]),
        "rho": expiry * of_bond + plain * np.abs(columns["rho"]),
        "dividend_rho": expiry * S * of_delta,
    }
    if "vanna" in columns:
        first = _sum(book, book.segments.volatility) / spread
        errors["vanna"] = dense * np.abs(columns["vanna"]) + density * first / spread * off
        # Both terms of s'' are about T/s, whose difference loses digits.
        errors["volga"] = dense * np.abs(columns["volga"]) + by_spread / spread * (
            first**2 * (np.abs(d1) + np.abs(d2)) * off + 4.0 * plain * expiry
        )
        drift = (np.abs(now.rate) + np.abs(now.dividend_yield)) / spread
        errors["charm"] = (
            np.abs(now.dividend_yield) * of_delta
            + density * (dense * (decay * np.abs(d2) + drift) + decay * off)
            + np.abs(_escrow_growth(book, dense * columns["gamma"]))
        )
    return {error_of(name): error for name, error in errors.items()}


def _sum(book: Book, column: Vector) -> Vector:
    """Return the integrals of a parameter over the lives of the contracts, shape (n,)."""
    return _per_contract(book, np.add, column * book.segments.duration)


def _per_contract(book: Book, operation: np.ufunc, column: Vector) -> Vector:
    result: Vector = column if book.is_simple else operation.reduceat(column, book.first[:-1])
    return result


def _escrow_growth(book: Book, in_stock: Vector) -> Vector | float:
    """Return what the escrow's interest takes from theta: the spot less the escrow falls by it at a given spot."""
    return book.now.rate * book.escrow_now() * in_stock if book.escrowed.any() else 0.0


def _by_parameters(
    book: Book, stock: Vector, bond: Vector, by_spread: Vector, spread: Vector
) -> dict[str, Any]:
    """Return vega, rho and dividend rho; of escrowed dividends with what the rate does to their present value."""
    expiry = book.expiry
    by_volatility = _sum(book, book.segments.volatility) / spread
    rho = expiry * bond
    columns: dict[str, Any] = {"vega": by_spread * by_volatility, "dividend_rho": -expiry * stock}
    columns[DIVIDENDS] = of_dividends_not_due(book)
    escrowed = np.flatnonzero(book.escrowed)
    if escrowed.size:
        by_dividend, by_rate = _escrow_derivatives(book.take(escrowed), stock[escrowed])
        columns[DIVIDENDS] = columns[DIVIDENDS].replaced(escrowed, by_dividend)
        rho[escrowed] += by_rate
    return columns | {"rho": rho}


def _escrow_derivatives(book: Book, stock: Vector) -> tuple[Ragged, Vector]:
    """Return the derivatives by the dividends, and by the rate through the dividends' present value.

    All contracts are escrowed. They are delta times d(S - A)/d amount = -e^{-int r}, and delta times d(S - A)/dr, the
    sum of time x amount x e^{-int r}.
    """
    listed, segments = book.listed.cash_dividends, book.segments
    delta = stock / book.diffusing()
    integral, so_far = np.zeros(segments.end.size), np.zeros(book.count)
    for rows, at in book.by_place():
        so_far[rows] += (segments.rate * segments.duration)[at]
        integral[at] = so_far[rows]
    present = segments.due * np.exp(-integral)
    by_rate = _per_contract(book, np.add, segments.end * present) * delta
    owner, time = listed.owner(), listed.values
    found = np.zeros(time.size)
    for entry in np.flatnonzero((time > 0.0) & (time <= book.expiry[owner])).tolist():
        row = int(owner[entry])
        inside = slice(int(book.first[row]), int(book.first[row + 1]))
        length = np.clip(time[entry] - segments.start[inside], 0.0, segments.duration[inside])
        found[entry] = -math.exp(-float(np.dot(segments.rate[inside], length))) * delta[row]
    return Ragged(listed.first, found), by_rate


def _second_order(
    book: Book, density: Vector, by_spread: Vector, d: tuple[Vector, Vector], spread: Vector
) -> dict[str, Any]:
    """Return vanna and volga: with s the spread, s' = int sigma / s and s'' = (T - s'**2)/s for a parallel shift."""
    first = _sum(book, book.segments.volatility) / spread
    second = (book.expiry - first**2) / spread
    return {
        "vanna": -density * d[1] / spread * first,
        "volga": by_spread * (d[0] * d[1] / spread * first**2 + second),
    }


def _by_pieces(book: Book, stock: Vector, bond: Vector, by_variance: Vector) -> dict[str, Any]:
    """Return the buckets: each piece of a curve acts through the time for which it holds before expiry.

    A piece of the rate also acts on the present value of the escrowed dividends behind it.
    """
    columns = {}
    by_integral = {"rate": bond, "dividend_yield": -stock, "volatility": by_variance}
    delta = stock / book.diffusing()
    for name in CURVES:
        times = getattr(book.listed, name)
        found = np.zeros(times.values.size)
        for row in np.flatnonzero(times.counts()).tolist():
            ends = np.array(times.row(row))
            part = with_cuts(book.take(np.array([row])), Ragged.of([ends.tolist()]))
            segments, duration = part.segments, part.segments.duration
            amounts = duration * by_integral[name][row]
            if name == "volatility":
                amounts *= segments.volatility
            if name == "rate" and book.escrowed[row]:
                present = segments.due * np.exp(-np.cumsum(segments.rate * duration))
                amounts += duration * np.cumsum(present[::-1])[::-1] * delta[row]
            piece = np.minimum(np.searchsorted(ends, 0.5 * (segments.start + segments.end)), ends.size - 1)
            found[times.first[row] : times.first[row + 1]] = np.bincount(piece, amounts, ends.size)
        columns[BUCKETS[name]] = Ragged(times.first, found)
    return columns
