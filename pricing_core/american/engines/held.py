"""Prices from what an engine finds of contracts as if they were held: bounds, the exercise region and theta."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices, prices
from pricing_core.arrays import BoolVector, Vector

ROUNDING = 4e-16  # Smallest error of a value, as a share of it; two units in the last place.
# Error of theta over what the errors of delta and gamma are worth in its equation, where they partly cancel; calibrated
# on random contracts.
THETA_SHARE = 0.55
BY_PARAMETERS = ("vega", "rho", "dividend_rho", "vanna", "volga", "charm")


def priced(
    book: Book,
    *,
    value: Vector,
    european: Vector,
    error: Vector,
    delta: Vector,
    gamma: Vector,
    boundary: Vector,
    exercised: BoolVector,
    theta: Vector | None = None,
    **others: Any,
) -> Prices:
    """Return the prices; in the exercise region they and their derivatives are the payoff's.

    Their message says what lies outside the nodes of a local volatility.

    What a held value lacks of a bound that it cannot be below counts as error.

    Parameters
    ----------
    value, european, error, delta, gamma, boundary : Vector, shape (n,)
        Money; in the exercise region value, delta and gamma are not read.
    exercised : bool array, shape (n,)
        Whether the spot lies in the closed exercise region.
    theta : Vector, shape (n,), optional
        Where it is not given it follows from the others.
    others
        Further columns of `Prices` by name. Derivatives by the parameters are not read in the exercise region; theta's
        error follows from those of the price, delta and gamma where they are given.
    """
    payoff, now = book.payoff(), book.now.exercisable
    least = np.maximum(np.where(now, payoff, 0.0), european)
    value, missing = np.maximum(value, least), least - value
    exercised = exercised & ~(
        european - payoff > np.fmax(error, ROUNDING * payoff)
    )  # holding it is worth more
    by_value, by_delta, by_gamma = _theta_weights(book)
    columns = {
        "value": value,
        "error": np.maximum(error, missing),
        "delta": delta,
        "gamma": gamma,
        "theta": by_value * value + by_delta * delta + by_gamma * gamma if theta is None else theta,
    }
    if "gamma_error" in others and theta is None:
        by_others = THETA_SHARE * np.maximum(
            np.abs(by_delta) * others["delta_error"], np.abs(by_gamma) * others["gamma_error"]
        )
        with np.errstate(invalid="ignore"):  # without a rate nothing is known from an infinite error
            others["theta_error"] = np.maximum(np.abs(by_value) * columns["error"], by_others)
    if exercised.any():
        columns |= {name: others.pop(name) for name in BY_PARAMETERS if name in others}
        paid = {"value": payoff, "error": error, "delta": -book.sign}
        columns = {name: np.where(exercised, paid.get(name, 0.0), column) for name, column in columns.items()}
    columns["error"] = np.maximum(columns["error"], ROUNDING * columns["value"])
    return prices(
        book.count,
        european=european,
        boundary=boundary,
        exercised=exercised & (payoff > 0.0),
        message=_outside_surface(book),
        **columns,
        **others,
    )


def held_theta(book: Book, value: Vector, delta: Vector, gamma: Vector) -> Vector:
    """Return dV/dt where the contract is held, from (11.46), money per year, shape (n,).

    In the escrowed model the present value A of the dividends due grows like a bond while the spot less A diffuses:
    r V - ((r - q) (S - A) + r A) V_S - sigma**2/2 (S - A)**2 V_SS.
    """
    by_value, by_delta, by_gamma = _theta_weights(book)
    theta: Vector = by_value * value + by_delta * delta + by_gamma * gamma
    return theta


def _theta_weights(book: Book) -> tuple[Vector, Vector, Vector]:
    """Return what theta is linear in value, delta and gamma with, each of shape (n,)."""
    spot, drift = _diffusing(book)
    volatility, _ = book.volatility_now()
    return book.now.rate, -drift, -0.5 * (volatility * spot) ** 2


def charm_weights(book: Book) -> tuple[Vector, Vector, Vector]:
    """Return what d delta/dt is linear in delta, gamma and V_SSS with where the contract is held, each of shape (n,).

    It is the derivative of theta's equation, (11.46), by the spot.
    """
    (spot, drift), now = _diffusing(book), book.now
    volatility, by_spot = book.volatility_now()
    variance = volatility**2
    by_gamma = -(drift + variance * spot + 0.5 * by_spot * spot**2)
    return now.dividend_yield, by_gamma, -0.5 * variance * spot**2


def _diffusing(book: Book) -> tuple[Vector, Vector]:
    """Return the spot that diffuses and the drift of the quoted one, money and money per year, each of shape (n,)."""
    now, spot = book.now, book.spot
    grown: Vector | float = 0.0
    if book.escrowed.any():
        escrow = book.escrow_now()
        spot, grown = spot - escrow, now.rate * escrow
    return spot, (now.rate - now.dividend_yield) * spot + grown


def _outside_surface(book: Book) -> str | NDArray[np.object_]:
    """Return what lies outside the nodes of each contract's local volatility, a sentence or nothing, shape (n,)."""
    if book.local is None:
        return ""
    found = np.full(book.count, "", dtype=object)
    for row in np.flatnonzero(book.is_local()).tolist():
        surface = book.local[row].volatility
        found[row] = surface.extrapolated(book.spot.item(row), book.strike.item(row), book.expiry.item(row))
    return found
