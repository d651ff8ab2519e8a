"""The rows of a book that can be valued all at once: American options by the march, European ones in closed form."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from pricing_core.american.flat.closed_form import ONE_OVER_SQRT_TWO_PI
from pricing_core.american.flat.premium import Puts, PutValues, solve_puts
from pricing_core.american.priced_rows import PricedRows
from pricing_core.american.tables.book import Book
from pricing_core.arrays import BoolVector, Matrix, Vector

MARCHED, CLOSED, LEFT = 1, 2, 0  # how a row is valued; what is left takes the path of single options
GREEKS_SHARE = 10.0  # tolerances that the Greeks may be off by
ROUNDING = 1e-14  # of a marched value, in strikes of its put
CLOSED_ERROR = 1e-15  # of spot and strike
SMALLEST_SPREAD = 1e-9  # sigma sqrt(T) of a European option that is not treated as certain
LARGEST_LOG = 600.0  # of spot and strike: beyond, the closed formula overflows


@dataclass(frozen=True, slots=True, eq=False)
class BookValues(PricedRows):
    """The rows of a book, NaN in those that are left.

    Parameters
    ----------
    path : int array
        MARCHED, CLOSED or LEFT.
    steps : int array
        Time steps of the finest march; 0 in closed form.
    """

    path: NDArray[np.int8]
    steps: NDArray[np.int64]


def value_book(book: Book, *, greeks: bool, threads: int, shared: bool) -> BookValues:
    """Value what the kernel and the closed formula can.

    Parameters
    ----------
    book : Book
        Rows with NaN are left.
    greeks : bool
        Whether vega, rho and dividend rho are wanted; they are NaN otherwise.
    threads : int
    shared : bool
        Whether rows that differ in spot and strike alone share a march.
    """
    count = book.spot.size
    numbers = dict(zip(PricedRows.__slots__[:10], np.full((10, count), np.nan), strict=True))
    out = BookValues(
        **numbers,
        exercised=np.zeros(count, dtype=bool),
        path=np.full(count, LEFT, dtype=np.int8),
        steps=np.zeros(count, dtype=np.int64),
    )
    with np.errstate(all="ignore"):
        spread = book.volatility * np.sqrt(book.expiry)
        ready = (spread >= SMALLEST_SPREAD) & (np.abs(np.log(book.spot / book.strike)) < LARGEST_LOG)
        closed = ready & (~book.is_american | _never_exercised(book))
        rows = np.flatnonzero(closed)
        if rows.size:
            _store(out, rows, _closed_values(book.take(rows), greeks))
        rows = np.flatnonzero(ready & ~closed)
        if rows.size:
            _march_rows(book, rows, greeks, threads, shared, out)
    return out


def _march_rows(
    book: Book, rows: NDArray[np.intp], greeks: bool, threads: int, shared: bool, out: BookValues
) -> None:
    part = book if rows.size == book.spot.size else book.take(rows)
    puts = _as_puts(part)
    scale = np.where(part.is_put, part.strike, part.spot)
    # A spot that even the option without expiry would be exercised at needs the boundary alone.
    certain = puts.x <= -np.log1p(puts.spread / puts.decay())
    tolerance = part.tolerance * np.where(part.is_put | certain, 1.0, part.strike / scale)
    limits = _limits(part, scale) if greeks else None
    solved = solve_puts(puts, tolerance, limits=limits, threads=threads, shared=shared)
    found = _marched_values(part, scale, solved, greeks)
    settled = solved.settled
    if not settled.all():
        rows, found = rows[settled], {name: column[settled] for name, column in found.items()}
    _store(out, rows, found)


def _limits(book: Book, scale: Vector) -> Matrix:
    """Return what the dimensionless values may be off by for Greeks to ten tolerances.

    Delta, and theta, vega and the rhos over the strike; strike times gamma to a thousand tolerances.
    """
    allowed = GREEKS_SHARE * book.tolerance * book.strike / scale
    by_spot = allowed * book.spot / book.strike  # delta = K/S v_x or v - v_x; its scale is 1, not the strike
    curvature = np.minimum(
        2.0 * allowed / book.volatility**2, 100.0 * allowed * (book.spot / book.strike) ** 2
    )
    limits = np.full((scale.size, 7), np.inf)
    limits[:, 1], limits[:, 2] = by_spot, curvature
    limits[:, 4] = limits[:, 5] = allowed / book.expiry
    limits[:, 6] = allowed / np.sqrt(book.expiry)
    return limits


def _store(out: BookValues, rows: NDArray[np.intp], found: dict[str, NDArray[Any]]) -> None:
    where = slice(None) if rows.size == out.path.size else rows  # copying is faster than scattering
    for name, column in found.items():
        getattr(out, name)[where] = column


def _marched_values(book: Book, scale: Vector, solved: PutValues, greeks: bool) -> dict[str, NDArray[Any]]:
    """Return money for the puts' dimensionless values; a call is S times the put with spot and strike exchanged."""
    is_put, S, K, T = book.is_put, book.spot, book.strike, book.expiry
    v, v_x, v_xx, european, *_ = solved.values
    payoff = np.maximum(np.where(is_put, K - S, S - K), 0.0)
    held = ~solved.exercised
    european = scale * european
    error = scale * (solved.error + np.where(held, ROUNDING, 0.0))
    # What a value lacks of a bound that it cannot be under counts as error.
    least = np.maximum(payoff, european)
    value = np.where(held, scale * v, payoff)
    error = np.maximum(error, np.where(held, least - value, 0.0))
    value = np.where(held, np.maximum(value, least), payoff)
    delta = np.where(held, np.where(is_put, K / S * v_x, v - v_x), np.where(is_put, -1.0, 1.0))
    gamma = np.where(held, scale / S * (v_xx - v_x) / S, 0.0)
    drift = book.rate - book.dividend_yield
    theta = book.rate * value - drift * S * delta - 0.5 * (book.volatility * S) ** 2 * gamma
    found: dict[str, NDArray[Any]] = {
        "value": value,
        "european": european,
        "delta": delta,
        "gamma": gamma,
        "theta": np.where(held, theta, 0.0),
        "boundary": K * np.exp(np.where(is_put, solved.boundary, -solved.boundary)),
        "error": error,
        "exercised": solved.exercised & (payoff > 0.0),
        "path": np.full(S.size, MARCHED, dtype=np.int8),
        "steps": solved.steps,
    }
    if greeks:
        by_rate, by_dividend, by_spread = solved.values[4:]
        found["vega"] = np.where(held, scale * np.sqrt(T) * by_spread, 0.0)
        found["rho"] = np.where(held, scale * T * np.where(is_put, by_rate, by_dividend), 0.0)
        found["dividend_rho"] = np.where(held, scale * T * np.where(is_put, by_dividend, by_rate), 0.0)
    return found


def _closed_values(book: Book, greeks: bool) -> dict[str, NDArray[Any]]:
    """Return Black, Scholes and Merton's formula in money."""
    sign = np.where(book.is_put, -1.0, 1.0)
    S, K, T, rate, dividend_yield = book.spot, book.strike, book.expiry, book.rate, book.dividend_yield
    spread = book.volatility * np.sqrt(T)
    d1 = (np.log(S / K) + (rate - dividend_yield) * T) / spread + 0.5 * spread
    discount, share = np.exp(-rate * T), np.exp(-dividend_yield * T)
    in_stock, in_bond = sign * share * ndtr(sign * d1), sign * discount * ndtr(sign * (d1 - spread))
    density = share * ONE_OVER_SQRT_TWO_PI * np.exp(-0.5 * d1 * d1)
    value = S * in_stock - K * in_bond
    found: dict[str, NDArray[Any]] = {
        "value": value,
        "european": value,
        "delta": in_stock,
        "gamma": density / (S * spread),
        "theta": dividend_yield * S * in_stock - rate * K * in_bond - 0.5 * S * density * spread / T,
        "error": CLOSED_ERROR * (S + K),
        "path": np.full(S.size, CLOSED, dtype=np.int8),
    }
    if greeks:
        found["vega"] = S * density * np.sqrt(T)
        found["rho"], found["dividend_rho"] = T * K * in_bond, -T * S * in_stock
    return found


def _never_exercised(book: Book) -> BoolVector:
    """Tell puts with r <= 0 and r <= q, and calls with q <= 0 and q <= r."""
    earned = np.where(book.is_put, book.rate, book.dividend_yield)
    paid = np.where(book.is_put, book.dividend_yield, book.rate)
    return (earned <= 0.0) & (earned <= paid)


def _as_puts(book: Book) -> Puts:
    """Return the puts: a call is one with spot and strike, and rate and yield, exchanged."""
    x = np.log(book.spot / book.strike)
    return Puts(
        np.where(book.is_put, x, -x),
        np.where(book.is_put, book.rate, book.dividend_yield) * book.expiry,
        np.where(book.is_put, book.dividend_yield, book.rate) * book.expiry,
        book.volatility * np.sqrt(book.expiry),
    )
