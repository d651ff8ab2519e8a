"""The value of one option over spots and times."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.american.contract import Option, check_kind
from pricing_core.american.market import Market
from pricing_core.american.price_many import price_many
from pricing_core.american.tolerances import DEFAULT_TOLERANCE
from pricing_core.arrays import Matrix, Vector, as_vector
from pricing_core.errors import InvalidInputError


@dataclass(frozen=True, slots=True, eq=False)
class ValueSurface:
    """The option held to each time and seen from each spot. Money per unit of underlying.

    Parameters
    ----------
    time : Vector, shape (m,)
        Years from now.
    spot : Vector, shape (n,)
    value, delta, gamma : Matrix, shape (m, n)
    exercised : bool array, shape (m, n)
        Whether exercise is optimal there.
    error_estimate : Matrix, shape (m, n)
        Of the value.
    """

    time: Vector
    spot: Vector
    value: Matrix
    delta: Matrix
    gamma: Matrix
    exercised: Matrix
    error_estimate: Matrix


def value_surface(
    option: Option,
    market: Market,
    *,
    spots: ArrayLike,
    times: ArrayLike,
    tolerance: float = DEFAULT_TOLERANCE,
    threads: int | None = None,
) -> ValueSurface:
    """Value the option at every pair of a time and a spot; one solve per time serves all spots.

    Parameters
    ----------
    option : Option
    market : Market
        Its spot is not used.
    spots : array_like, shape (n,)
        Money, 0 to 1e30.
    times : array_like, shape (m,)
        Years from now, 0 to the expiry.
    tolerance : float
        As in `price`.
    threads : int, optional
        As in `price_many`.

    Raises
    ------
    InvalidInputError
        An argument lies outside what is allowed.

    Examples
    --------
    >>> market = Market(spot=100.0, rate=0.05, volatility=0.2)
    >>> surface = value_surface(Option("put", 100.0, 1.0), market, spots=[80.0, 100.0], times=[0.0, 0.5])
    >>> surface.value.round(2).tolist(), surface.exercised.tolist()
    ([[20.0, 6.09], [20.0, 4.66]], [[True, False], [True, False]])
    """
    check_kind("option", option, Option, "an Option")
    check_kind("market", market, Market, "a Market")
    time, spot = as_vector("times", times), as_vector("spots", spots)
    if np.any(time < 0.0) or np.any(time > option.expiry):
        raise InvalidInputError("times", times, "from 0 to the expiry")
    table = price_many(
        {
            "option_type": option.option_type,
            "exercise": option.exercise,
            "strike": option.strike,
            "spot": np.tile(spot, time.size),
            "expiry": np.repeat(option.expiry - time, spot.size),
            "rate": market.rate,
            "dividend_yield": market.dividend_yield,
            "volatility": market.volatility,
        },
        tolerance=tolerance,
        greeks=False,
        threads=threads,
        share_solves=True,
    )
    refused = np.flatnonzero(np.isnan(table["price"]))
    if refused.size:
        row = int(refused[0])
        allowed = str(table["message"][row]).rpartition(": must be ")[
            2
        ]  # the whole message where it says no range
        raise InvalidInputError("spots", float(np.tile(spot, time.size)[row]), allowed)
    shape = (time.size, spot.size)
    names = ("price", "delta", "gamma", "exercise_now", "error_estimate")
    return ValueSurface(time, spot, *(table[name].reshape(shape) for name in names))
