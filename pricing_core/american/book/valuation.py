"""What `price` returns: one row of prices, with everything that follows from it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import GREEK_LISTS, GREEKS, Prices, Status, error_of
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.book.resolution import Resolution
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.dates import DAYS_PER_YEAR
from pricing_core.american.contracts.market import Market
from pricing_core.arrays import Vector
from pricing_core.kernel import instruction_set
from pricing_core.version import ENGINE_VERSION

# Greeks and the columns of their errors.
NUMBER_ERRORS = tuple((name, error_of(name)) for name in GREEKS)
LIST_ERRORS = tuple((name, error_of(name)) for name in GREEK_LISTS)

MOST_SHOWN = 4  # values of a list that are printed


@dataclass(frozen=True, slots=True)
class Diagnostics:
    """How a price was found.

    Parameters
    ----------
    solves : int
        How often the contract was solved; on grids at doubling resolutions, extrapolated from the last two.
    steps_taken : int
        Time steps of the finest solve.
    resolution : Resolution or None
        The finest grid and steps; with lcp_residual and fitted, of the chapter's road alone.
    lcp_residual : float
        Largest natural residual of the finest solve's complementarity problems, as a fraction of the strike.
    fitted : bool
        Exponential fitting was needed (the drift dominates the diffusion on the finest grid): first order only.
    message : str
        Why there is no price, or what of the contract lies outside the nodes of a local volatility.
    """

    solves: int = 0
    steps_taken: int = 0
    resolution: Resolution | None = None
    lcp_residual: float = 0.0
    fitted: bool = False
    message: str = ""


@dataclass(frozen=True, slots=True)
class Valuation:
    """The result of `price`. Money per unit of underlying; None where a number is missing.

    `print` shows in a few lines what is known.

    Parameters
    ----------
    price, european_price, early_exercise_premium, intrinsic_value : float
    delta, gamma : float
        dV/dS, d2V/dS2; a local volatility held fixed as a function of time and spot.
    delta_sticky_moneyness : float or None
        dV/dS where the local volatility moves with the spot, as a function of moneyness; None where there is none.
    theta, theta_per_day : float
        dV/dt in calendar time, per year and per 1/365 year.
    vega, vega_per_point, rho, rho_per_point, dividend_rho : float
        Per 1.00 of volatility, rate and yield, a curve or a local volatility shifted as a whole; per point: per 0.01.
    dividend_sensitivities : tuple of float or None
        dV/d amount of each of the market's cash dividends, in their order (that of time).
    vanna, volga : float or None
        d delta/d volatility and d vega/d volatility; with extended Greeks only, as the next four.
    charm : float or None
        d delta/dt in calendar time, per year.
    rate_buckets, dividend_yield_buckets, volatility_buckets : tuple of float or None
        dV by each of the values of the curve; None where the parameter is a number.
    exercise_now : bool
        The intrinsic value is positive and the spot lies in the closed exercise region.
    exercise_boundary : float or None
        S* now, where there are two the one nearer the strike (see `exercise_boundary` for both); None where
        exercise is not optimal now, or only at spots more than 4.5 standard deviations of ln S away.
    boundary_error : float or None
        Estimated absolute error of the exercise boundary, money; None where there is none, or no estimate.
    error_estimate : float
        Estimated absolute error of the price, money.
    greek_errors : mapping of str to float or tuple of float
        Estimated absolute errors of the Greeks by their names, in their units, of those that have an estimate;
        that of theta_per_day is theta's over 365, and so for vega_per_point and rho_per_point.
    status : str
        "ok", "tolerance_not_met" or "deadline".
    method : str
        "premium-march"; "obstacle-march" with two boundaries or events; "lcs" and "crank-nicolson" where they are
        asked for; or what took their place: "closed-form",
        "zero-volatility", "worthless-underlying", "expired", "none".
    engine_version : str
    instruction_set : str
        "avx512", "avx2" or "portable", or "numpy" without the compiled kernel: the last digits depend on it.
    diagnostics : Diagnostics
    """

    price: float | None
    european_price: float | None
    early_exercise_premium: float | None
    intrinsic_value: float
    delta: float | None
    gamma: float | None
    theta: float | None
    theta_per_day: float | None
    vega: float | None
    vega_per_point: float | None
    rho: float | None
    rho_per_point: float | None
    dividend_rho: float | None
    delta_sticky_moneyness: float | None
    dividend_sensitivities: tuple[float, ...] | None
    vanna: float | None
    volga: float | None
    charm: float | None
    rate_buckets: tuple[float, ...] | None
    dividend_yield_buckets: tuple[float, ...] | None
    volatility_buckets: tuple[float, ...] | None
    exercise_now: bool
    exercise_boundary: float | None
    boundary_error: float | None
    error_estimate: float | None
    greek_errors: Mapping[str, float | tuple[float, ...]] = field(hash=False)
    status: Status
    method: str
    engine_version: str
    instruction_set: str
    diagnostics: Diagnostics

    def __str__(self) -> str:
        """Return in some lines what is known: the price with its error, what exercise adds to it, and the Greeks."""
        lines = (
            [*self._known("price", "error_estimate"), f"status {self.status}", f"method {self.method}"],
            self._known("european_price", "early_exercise_premium", "intrinsic_value"),
            [*self._known("exercise_boundary"), f"exercise_now {self.exercise_now}"],
            self._known(*GREEKS),
            self._known(*GREEK_LISTS),
            [self.diagnostics.message] if self.diagnostics.message else [],
        )
        return "\n".join(", ".join(line) for line in lines if line)

    def _known(self, *names: str) -> list[str]:
        """Return "name value" of each that there is, of a list its first values."""
        return [f"{name} {_in_brief(value)}" for name in names if (value := getattr(self, name)) is not None]


def valuation(
    contract: tuple[Option, Market], book: Book, prices: Prices, *, greeks: bool, row: int = 0
) -> Valuation:
    """Return the valuation of one contract of a book; NaN becomes None.

    Parameters
    ----------
    contract : (Option, Market)
    greeks : bool
        Whether Greeks are wanted at all.
    row : int
        Which of the contracts it is.
    """
    value, european = prices.value.item(row), prices.european.item(row)
    option, market = contract
    discount = 1.0 if book.reduction is None else book.reduction.discount.item(row)

    def greek(column: Vector, share: float = 1.0) -> float | None:
        return _present(column.item(row) / share) if greeks else None

    def greek_list(column: Ragged) -> tuple[float, ...] | None:
        return (column.known_row(row) or None) if greeks and column.values.size else None

    return Valuation(
        price=_present(value),
        european_price=_present(european),
        early_exercise_premium=_present(value - european),
        intrinsic_value=discount * option.payoff(market.spot),
        delta=greek(prices.delta),
        gamma=greek(prices.gamma),
        theta=greek(prices.theta),
        theta_per_day=greek(prices.theta, DAYS_PER_YEAR),
        vega=greek(prices.vega),
        vega_per_point=greek(prices.vega, 100.0),
        rho=greek(prices.rho),
        rho_per_point=greek(prices.rho, 100.0),
        dividend_rho=greek(prices.dividend_rho),
        delta_sticky_moneyness=greek(prices.delta_sticky_moneyness),
        dividend_sensitivities=greek_list(prices.dividend_sensitivities),
        vanna=greek(prices.vanna),
        volga=greek(prices.volga),
        charm=greek(prices.charm),
        rate_buckets=greek_list(prices.rate_buckets),
        dividend_yield_buckets=greek_list(prices.dividend_yield_buckets),
        volatility_buckets=greek_list(prices.volatility_buckets),
        exercise_now=bool(prices.exercised[row]),
        exercise_boundary=_present(prices.boundary.item(row)),
        boundary_error=_present(prices.boundary_error.item(row)),
        error_estimate=_present(prices.error.item(row)),
        greek_errors=_greek_errors(prices, row) if greeks else {},
        status=prices.status[row],
        method=prices.method[row] or "none",
        engine_version=ENGINE_VERSION,
        instruction_set=instruction_set(),
        diagnostics=Diagnostics(
            solves=prices.solves.item(row),
            steps_taken=prices.steps.item(row),
            resolution=prices.resolution[row],
            lcp_residual=prices.residual.item(row),
            fitted=bool(prices.fitted[row]),
            message=prices.message[row],
        ),
    )


def _greek_errors(prices: Prices, row: int) -> dict[str, float | tuple[float, ...]]:
    """Return the errors that there is an estimate of, by Greek."""
    found: dict[str, float | tuple[float, ...]] = {}
    for name, column in NUMBER_ERRORS:
        error = getattr(prices, column).item(row)
        if not math.isnan(error):
            found[name] = error
    for name, column in LIST_ERRORS:
        errors: Ragged = getattr(prices, column)
        if errors.values.size and (known := errors.known_row(row)):
            found[name] = known
    return found


def _in_brief(value: float | tuple[float, ...]) -> str:
    if isinstance(value, float):
        return f"{value:.8g}"
    more = ", ..." if len(value) > MOST_SHOWN else ""
    return f"({', '.join(f'{entry:.8g}' for entry in value[:MOST_SHOWN])}{more})"


def _present(number: float) -> float | None:
    return None if math.isnan(number) else number + 0.0  # no -0.0
