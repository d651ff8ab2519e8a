"""The contract in a request: an option and a market in the flat vocabulary, as the table of fields states it."""

from collections.abc import Callable, Mapping
from math import isfinite
from types import MappingProxyType
from typing import Annotated, Any, TypeAlias

import pydantic
from pydantic import BaseModel, BeforeValidator, ConfigDict, Discriminator, Tag

from pricing_core.american import Market, Option
from pricing_core.american.contracts import fields
from pricing_core.american.contracts.dates import is_date
from pricing_core.american.contracts.dividends import is_pair
from pricing_core.american.contracts.field import Field
from pricing_core.american.contracts.vocabulary import NAMES, contract_from

# Largest lengths of lists in a request, smaller than the library's: the deadline is not asked while one solve, or its
# derivatives, are under way.
MOST_DIVIDENDS = 366
MOST_PIECES = 100
MOST_SPOTS = 100  # of a local volatility
LONGEST_DATE = 40  # Largest length of a date, in characters.
# What a rate, a volatility or a time may be; no field has such a name.
NUMBER, CURVE, DATE, LOCAL = "number", "curve", "date", "local volatility"
DATE_IN_WORDS = "with valuation_date an ISO date"
# Keys of the objects inside a field, by its name.
KEYS = {
    field.name: tuple(entry.name for entry in field.entries)
    for field in fields.CONTRACT_FIELDS
    if field.entries
}
CONTRACT_NAMES = set(NAMES)
KEYS["volatility"] = tuple(field.name for field in fields.LOCAL_VOLATILITY)


class Strict(BaseModel):
    """Numbers are finite numbers, not strings or booleans; unknown keys are refused; nothing is coerced."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


def limits(field: Field) -> Any:
    """Return the limits of a number as arguments of pydantic's `Field`."""
    return pydantic.Field(**_limits(field))


def _limits(field: Field) -> dict[str, Any]:
    return {name: limit for name, limit in (("ge", field.least), ("le", field.most)) if isfinite(limit)}


def stated(field: Field, **changes: Any) -> Any:
    """Return the default, description, example and limits of an input as pydantic's `Field`.

    Parameters
    ----------
    changes : object
        Arguments of `pydantic.Field` that take the place of the table's.
    """
    told: dict[str, Any] = {"description": field.description, "examples": [field.example]}
    if field.kind == "number":
        told |= _limits(field)
    if not field.required:
        told["default"] = list(field.default) if isinstance(field.default, tuple) else field.default
    return pydantic.Field(**(told | changes))


Date = Annotated[str, pydantic.Field(max_length=LONGEST_DATE)]
Pieces = pydantic.Field(min_length=1, max_length=MOST_PIECES)
KnotTimes = Annotated[list[Annotated[float, limits(fields.KNOT_TIMES)]], Pieces]
Rate = Annotated[float, limits(fields.RATE)]
Volatility = Annotated[float, limits(fields.VOLATILITY)]


class RateCurve(Strict):
    """Piecewise constant: values[i] up to times[i], the last value for ever."""

    times: KnotTimes
    values: Annotated[list[Rate], Pieces]


class VolatilityCurve(Strict):
    """Piecewise constant: values[i] up to times[i], the last value for ever."""

    times: KnotTimes
    values: Annotated[list[Volatility], Pieces]


class VolatilitySurface(Strict):
    """Local volatility: a list of values for each time, one for each spot."""

    times: Annotated[list[Annotated[float, limits(fields.LOCAL_TIMES)]], Pieces]
    spots: Annotated[
        list[Annotated[float, limits(fields.LOCAL_SPOTS)]],
        pydantic.Field(min_length=1, max_length=MOST_SPOTS),
    ]
    values: Annotated[
        list[Annotated[list[Volatility], pydantic.Field(min_length=1, max_length=MOST_SPOTS)]], Pieces
    ]


def as_mapping(size: Field) -> Callable[[object], object]:
    """Return what makes of a dividend given as its time, or its ex-date, and its size one with these names."""

    def named(entry: object) -> object:
        if not is_pair(entry):
            return entry
        when, what = entry
        return {fields.EX_DATE.name if is_date(when) else fields.EX_TIME.name: when, size.name: what}

    return named


def word(field: Field) -> Any:
    """Return a validator that understands the words of a choice in any case, and their short forms."""
    return BeforeValidator(lambda value: field.word(value) or value)


class CashAmount(Strict):
    """An amount of money that the spot drops by at its ex-time."""

    time: float | None = stated(fields.EX_TIME, default=None)
    ex_date: Date | None = stated(fields.EX_DATE)
    amount: float = stated(fields.AMOUNT)


class ProportionalAmount(Strict):
    """A fraction that the spot loses at its ex-time."""

    time: float | None = stated(fields.EX_TIME, default=None)
    ex_date: Date | None = stated(fields.EX_DATE)
    fraction: float = stated(fields.FRACTION)


def _kind(value: object) -> str:
    return CURVE if isinstance(value, dict | Strict) else NUMBER


def _kind_of_volatility(value: object) -> str:
    is_local = isinstance(value, VolatilitySurface) or (isinstance(value, dict) and "spots" in value)
    return LOCAL if is_local else _kind(value)


RateOrCurve: TypeAlias = Annotated[
    Annotated[Rate, Tag(NUMBER)] | Annotated[RateCurve, Tag(CURVE)], Discriminator(_kind)
]
VolatilityOrCurve: TypeAlias = Annotated[
    Annotated[Volatility, Tag(NUMBER)]
    | Annotated[VolatilityCurve, Tag(CURVE)]
    | Annotated[VolatilitySurface, Tag(LOCAL)],
    Discriminator(_kind_of_volatility),
]


def _kind_of_time(value: object) -> str:
    return DATE if isinstance(value, str) else NUMBER


TimeOrDate: TypeAlias = Annotated[
    Annotated[float, limits(fields.EXERCISE_START), Tag(NUMBER)] | Annotated[Date, Tag(DATE)],
    Discriminator(_kind_of_time),
]


ExTime: TypeAlias = Annotated[float, limits(fields.EX_TIME)] | Date
CashDividend: TypeAlias = Annotated[
    CashAmount,
    BeforeValidator(
        as_mapping(fields.AMOUNT),
        json_schema_input_type=CashAmount | tuple[ExTime, Annotated[float, limits(fields.AMOUNT)]],
    ),
]
ProportionalDividend: TypeAlias = Annotated[
    ProportionalAmount,
    BeforeValidator(
        as_mapping(fields.FRACTION),
        json_schema_input_type=ProportionalAmount | tuple[ExTime, Annotated[float, limits(fields.FRACTION)]],
    ),
]
OptionType: TypeAlias = Annotated[fields.OptionType, word(fields.OPTION_TYPE)]
Exercise: TypeAlias = Annotated[fields.Exercise, word(fields.EXERCISE)]
DividendModel: TypeAlias = Annotated[fields.DividendModel, word(fields.DIVIDEND_MODEL)]
Underlying: TypeAlias = Annotated[fields.Underlying, word(fields.UNDERLYING)]
Greeks: TypeAlias = Annotated[fields.Greeks, word(fields.GREEKS)]
GreeksUnits: TypeAlias = Annotated[fields.GreeksUnits, word(fields.GREEKS_UNITS)]


class Contract(Strict):
    """The part that all questions share: the option, and the market without spot and volatility."""

    option_type: OptionType = stated(fields.OPTION_TYPE)
    strike: float = stated(fields.STRIKE)
    expiry: float | None = stated(fields.EXPIRY, default=None)
    valuation_date: Date | None = stated(fields.VALUATION_DATE)
    expiration_date: Date | None = stated(fields.EXPIRATION_DATE)
    rate: RateOrCurve = stated(fields.RATE)
    dividend_yield: RateOrCurve = stated(fields.DIVIDEND_YIELD)
    cash_dividends: list[CashDividend] = stated(fields.CASH_DIVIDENDS, max_length=MOST_DIVIDENDS)
    proportional_dividends: list[ProportionalDividend] = stated(
        fields.PROPORTIONAL_DIVIDENDS, max_length=MOST_DIVIDENDS
    )
    dividend_model: DividendModel = stated(fields.DIVIDEND_MODEL)
    underlying: Underlying = stated(fields.UNDERLYING)
    borrow_rate: RateOrCurve = stated(fields.BORROW_RATE)
    foreign_rate: RateOrCurve | None = stated(fields.FOREIGN_RATE)
    quanto_covariance: float = stated(fields.QUANTO_COVARIANCE)
    settlement_lag: float = stated(fields.SETTLEMENT_LAG)
    exercise: Exercise = stated(fields.EXERCISE)
    exercise_times: list[TimeOrDate] = stated(
        fields.EXERCISE_TIMES, max_length=fields.EXERCISE_TIMES.most_entries
    )
    exercise_start: TimeOrDate = stated(fields.EXERCISE_START)
    tolerance: float = stated(fields.TOLERANCE)

    def contract(self, standing_in: Mapping[str, float] = MappingProxyType({})) -> tuple[Option, Market]:
        """Return the option and the market; `standing_in` holds values for what the question does not give.

        Raises
        ------
        InvalidInputError
            Fields that are sound one by one do not go together.
        """
        given = self.model_dump(include=CONTRACT_NAMES, exclude_none=True, exclude_unset=True)
        return contract_from({**standing_in, **given})
