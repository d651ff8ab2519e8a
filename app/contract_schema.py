"""The contract in a request: an option and a market in the flat vocabulary; the ranges are the library's own."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, TypeAlias

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag

from pricing_core.american import Market, Option
from pricing_core.american.contracts.contract import (
    LARGEST_EXPIRY,
    LARGEST_MONEY,
    MOST_EXERCISE_TIMES,
    SMALLEST_MONEY,
    Exercise,
    OptionType,
)
from pricing_core.american.contracts.dividends import LATEST
from pricing_core.american.contracts.market import (
    LARGEST_RATE,
    LARGEST_VOLATILITY,
    SMALLEST_RATE,
    DividendModel,
)
from pricing_core.american.contracts.tolerances import (
    DEFAULT_TOLERANCE,
    LARGEST_TOLERANCE,
    SMALLEST_TOLERANCE,
)
from pricing_core.american.contracts.vocabulary import NAMES, contract_from

# Fewer than the library takes: the deadline is not asked while one solve, or its derivatives, are under way.
MOST_DIVIDENDS = 366  # of one kind, of one request
MOST_PIECES = 100  # of one curve
LONGEST_DATE = 40  # characters
NUMBER, CURVE, DATE = "number", "curve", "date"  # what a rate or a time may be; no field has such a name
DATE_IN_WORDS = "with valuation_date an ISO date"
CURVE_IN_WORDS = '{"times": [...], "values": [...]}'


class Strict(BaseModel):
    """Numbers are finite numbers, not strings or booleans; unknown keys are refused; nothing is coerced."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


Money = Annotated[float, Field(ge=0.0, le=LARGEST_MONEY)]
Rate = Annotated[float, Field(ge=SMALLEST_RATE, le=LARGEST_RATE)]
Volatility = Annotated[float, Field(ge=0.0, le=LARGEST_VOLATILITY)]
Time = Annotated[float, Field(ge=0.0, le=LARGEST_EXPIRY)]
LateTime = Annotated[float, Field(ge=0.0, le=LATEST)]
Date = Annotated[str, Field(max_length=LONGEST_DATE)]
KnotTimes = Annotated[list[LateTime], Field(min_length=1, max_length=MOST_PIECES)]


class RateCurve(Strict):
    """Piecewise constant: values[i] up to times[i], the last value for ever."""

    times: KnotTimes
    values: list[Rate] = Field(min_length=1, max_length=MOST_PIECES)


class VolatilityCurve(Strict):
    """Piecewise constant: values[i] up to times[i], the last value for ever."""

    times: KnotTimes
    values: list[Volatility] = Field(min_length=1, max_length=MOST_PIECES)


class CashAmount(Strict):
    """An amount of money that the spot drops by at its ex-time."""

    time: LateTime | None = None
    ex_date: Date | None = None
    amount: Money


class ProportionalAmount(Strict):
    """A fraction that the spot loses at its ex-time."""

    time: LateTime | None = None
    ex_date: Date | None = None
    fraction: float = Field(ge=0.0, le=1.0)


def _kind(value: object) -> str:
    return CURVE if isinstance(value, dict | Strict) else NUMBER


RateOrCurve: TypeAlias = Annotated[
    Annotated[Rate, Tag(NUMBER)] | Annotated[RateCurve, Tag(CURVE)], Discriminator(_kind)
]
VolatilityOrCurve: TypeAlias = Annotated[
    Annotated[Volatility, Tag(NUMBER)] | Annotated[VolatilityCurve, Tag(CURVE)], Discriminator(_kind)
]


def _kind_of_time(value: object) -> str:
    return DATE if isinstance(value, str) else NUMBER


TimeOrDate: TypeAlias = Annotated[
    Annotated[Time, Tag(NUMBER)] | Annotated[Date, Tag(DATE)], Discriminator(_kind_of_time)
]
KEYS: dict[str, tuple[str, ...]] = {  # of the objects inside a field
    **dict.fromkeys(("rate", "dividend_yield", "volatility"), tuple(RateCurve.model_fields)),
    "cash_dividends": tuple(CashAmount.model_fields),
    "proportional_dividends": tuple(ProportionalAmount.model_fields),
}


def _events(most: int, description: str, example: object) -> Any:
    return Field(default_factory=list, max_length=most, description=description, examples=[[example]])


class Contract(Strict):
    """What every question holds: the option, and the market without spot and volatility."""

    option_type: OptionType = Field(description="The right to sell (put) or to buy (call).", examples=["put"])
    strike: float = Field(
        ge=SMALLEST_MONEY,
        le=LARGEST_MONEY,
        description="Money per unit of the underlying.",
        examples=[100.0],
    )
    expiry: Time | None = Field(
        None, description="Time to expiry in years; given unless both dates are.", examples=[1.0]
    )
    valuation_date: Date | None = Field(
        None,
        description="ISO date or date-time; with expiration_date, in the place of expiry.",
        examples=["2026-01-02"],
    )
    expiration_date: Date | None = Field(
        None,
        description="ISO date or date-time; the years between the dates are seconds / (365 * 86400).",
        examples=["2027-01-02"],
    )
    rate: RateOrCurve = Field(
        description="Risk-free rate per year, continuously compounded; or a curve, times in years from now.",
        examples=[0.05],
    )
    dividend_yield: RateOrCurve = Field(
        0.0,
        description="Continuous yield per year; the cost of borrowing adds to it; or a curve.",
        examples=[0.0],
    )
    cash_dividends: list[CashAmount] = _events(
        MOST_DIVIDENDS,
        "Amounts of money with a time in years from now each, or with dates an ex_date.",
        {"time": 0.25, "amount": 1.0},
    )
    proportional_dividends: list[ProportionalAmount] = _events(
        MOST_DIVIDENDS,
        "Fractions of the spot, 0 to 1, with a time in years from now each, or with dates an ex_date.",
        {"time": 0.25, "fraction": 0.01},
    )
    dividend_model: DividendModel = Field(
        "spot",
        description="spot: the spot drops by the cash dividends, lognormal in between; escrowed: the spot without "
        "the present value of those due is lognormal.",
        examples=["spot"],
    )
    exercise: Exercise = Field(
        "american",
        description="american: at any time up to expiry; european: at expiry; bermudan: also at exercise_times.",
        examples=["american"],
    )
    exercise_times: list[TimeOrDate] = _events(
        MOST_EXERCISE_TIMES,
        "With bermudan alone, and then at least one: years from now, or with valuation_date ISO dates.",
        0.5,
    )
    exercise_start: TimeOrDate = Field(
        0.0,
        description="With american alone: no exercise before it, years from now, or with valuation_date an ISO date.",
        examples=[0.0],
    )
    tolerance: float = Field(
        DEFAULT_TOLERANCE,
        ge=SMALLEST_TOLERANCE,
        le=LARGEST_TOLERANCE,
        description="Absolute error of the price allowed, as a fraction of the strike.",
        examples=[1e-6],
    )

    def contract(self, standing_in: Mapping[str, float] = MappingProxyType({})) -> tuple[Option, Market]:
        """Return the option and the market; `standing_in` holds values for what the question does not give.

        Raises
        ------
        InvalidInputError
            Fields that are sound one by one do not go together.
        """
        given = self.model_dump(include=set(NAMES), exclude_none=True)
        return contract_from({**standing_in, **given})
