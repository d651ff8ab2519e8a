"""The classic sets of American options, and their true values from the integral equation.

Ju (1999), Andersen, Lake and Offengenden (2016), Wu and Kwok, Forsyth and Vetzal (2002) and others; the strike is 1.
"""

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from benchmarks.problems.integral_equation import put_values, solve_put_boundary
from pricing_core.american import Market, Option
from pricing_core.american.contracts.fields import OptionType
from pricing_core.arrays import Vector

# Distance from the boundary, as a fraction of it, within which gamma is not compared: it jumps there.
NEAR_BOUNDARY = 0.01
BOUNDARY_TIMES = (0.1, 0.25, 0.5, 1.0)  # times to expiry, as fractions of the expiry


@dataclass(frozen=True, slots=True, eq=False)
class Outputs:
    """The outputs that are compared: values at the spots of a problem, and the boundary at its times."""

    price: Vector  # in strikes
    delta: Vector
    gamma: Vector  # times the strike; NaN where it is not compared
    boundary: Vector  # in strikes


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """One contract without its spot, the spots at which it is held, and the true values there."""

    name: str
    option: Option
    market: Market
    spots: Vector  # in strikes
    true: Outputs  # from the integral equation

    @property
    def boundary_times(self) -> Vector:
        """Times to expiry at which the exercise boundary is compared, in years."""
        return self.option.expiry * np.array(BOUNDARY_TIMES)


Row: TypeAlias = tuple[str, float, float, float, float, tuple[float, ...]]
FIVE = (0.8, 0.9, 1.0, 1.1, 1.2)
# name, rate, dividend_yield, volatility, expiry, spots
PUTS: tuple[Row, ...] = (
    ("ALO", 0.05, 0.05, 0.25, 1.0, FIVE),
    ("R", 0.075, 0.05, 0.25, 1.0, (0.95, 1.0)),
    ("A", 0.05, 0.0, 0.2, 1.0, FIVE),
    ("B", 0.1, 0.0, 0.3, 1.0, FIVE),
    ("C", 0.1, 0.0, 0.2, 0.25, (0.9, 0.95, 1.0, 1.05, 1.1)),
    ("D", 0.03, 0.07, 0.2, 3.0, FIVE),
    ("E", 0.04, 0.01, 0.2, 3.0, (0.8, 1.0, 1.2)),
    ("F", 0.04, 0.04, 0.2, 3.0, (0.8, 1.0, 1.2)),
    ("G", 0.05, 0.02, 0.6, 1.0, (0.7, 1.0, 1.3)),
    ("QL", 0.1, 0.03, 0.25, 10.0, (100 / 120,)),
    *(
        (f"Ju {months}m {volatility:g}", 0.0488, 0.0, volatility, months / 12, (40 / 45, 1.0, 40 / 35))
        for volatility in (0.2, 0.3, 0.4)
        for months in (1, 4, 7)
    ),
)
CALLS: tuple[Row, ...] = (
    ("Ju call 1", 0.03, 0.07, 0.2, 3.0, FIVE),
    ("Ju call 2", 0.03, 0.07, 0.4, 3.0, FIVE),
    ("Ju call 3", 0.00001, 0.07, 0.3, 3.0, FIVE),
    ("Ju call 4", 0.07, 0.03, 0.3, 3.0, FIVE),
)


def classic_problems(names: tuple[str, ...] = ()) -> tuple[Problem, ...]:
    """Return the problems with these names, or all of them."""
    puts = [_problem("put", *row) for row in PUTS if not names or row[0] in names]
    calls = [_problem("call", *row) for row in CALLS if not names or row[0] in names]
    return (*puts, *calls)


def _problem(
    option_type: OptionType,
    name: str,
    rate: float,
    dividend_yield: float,
    volatility: float,
    expiry: float,
    spots: tuple[float, ...],
) -> Problem:
    option, market = Option(option_type, 1.0, expiry), Market(1.0, rate, volatility, dividend_yield)
    true_values = _put if option.is_put else _call
    held, true = true_values(market, expiry, np.array(spots))
    return Problem(name, option, market, held, true)


def _put(market: Market, expiry: float, spots: Vector) -> tuple[Vector, Outputs]:
    """Return the spots above the boundary and the true values there."""
    boundary = solve_put_boundary(market, expiry)
    today = boundary.at(np.array([expiry]))
    held = spots[spots > today]
    put = put_values(boundary, held)
    gamma = np.where(held > (1.0 + NEAR_BOUNDARY) * today, put.gamma, np.nan)
    at_times = boundary.at(expiry * np.array(BOUNDARY_TIMES))
    return held, Outputs(put.value, put.delta, gamma, at_times)


def _call(market: Market, expiry: float, spots: Vector) -> tuple[Vector, Outputs]:
    """Return the same for a call, by McDonald and Schroder: call(S, 1, r, q) = S put(1/S, 1, q, r)."""
    mirrored = replace(market, rate=market.dividend_yield, dividend_yield=market.rate)
    reciprocal, put = _put(mirrored, expiry, 1.0 / spots)
    price = put.price / reciprocal
    delta = put.price - reciprocal * put.delta
    return 1.0 / reciprocal, Outputs(price, delta, reciprocal**3 * put.gamma, 1.0 / put.boundary)
