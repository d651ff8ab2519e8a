"""Every input of the option engine, stated once.

Python arguments, the columns of tables and files, JSON requests and command-line options go by these names. What reads
or describes an input takes its limits, default and words from here, or is compared with this table by a test.
"""

from __future__ import annotations

import math
from typing import Literal, TypeAlias, get_args

from pricing_core.american.contracts.field import Field

OptionType: TypeAlias = Literal["put", "call"]
Exercise: TypeAlias = Literal["american", "european", "bermudan"]
DividendModel: TypeAlias = Literal["spot", "escrowed"]
Underlying: TypeAlias = Literal["spot", "future"]
Greeks: TypeAlias = Literal["none", "standard", "extended"]
GreeksUnits: TypeAlias = Literal["per_year_per_unit", "per_day_per_point"]

MONEY = (0.0, 1e30)  # Limits of an amount of money.
OBSERVED = (0.0, math.inf)  # Limits of a price observed in the market, in money.
YEARS = (0.0, 200.0)  # Limits of a time in the life of an option, in years from now.
# Limits of the time of an event, which may lie behind the expiry, in years from now.
EVENT_YEARS = (0.0, 2000.0)
RATES = (-0.5, 2.0)  # Limits of a rate or a yield, in 1/year.
MOST_LAG = 366.0  # Largest settlement lag, in days.
MOST_ENTRIES = 1000  # Largest length of a list, and largest number of pieces of a curve.

CURVE = (
    Field(
        "times",
        "list",
        "years",
        "Increasing times from now, above 0: values[i] holds up to times[i], the last value for ever",
        EVENT_YEARS,
        most_entries=MOST_ENTRIES,
        example=[0.5, 1.0],
    ),
    Field("values", "list", "", "As many as times", most_entries=MOST_ENTRIES, example=[0.04, 0.05]),
)
KNOT_TIMES, KNOT_VALUES = CURVE
LOCAL_VOLATILITY = (
    Field(
        "times",
        "list",
        "years",
        "Increasing times from now, the first may be 0; the variance is linear in between, and flat outside",
        EVENT_YEARS,
        most_entries=MOST_ENTRIES,
        example=[0.0, 1.0],
    ),
    Field(
        "spots",
        "list",
        "money",
        "Increasing spots: the volatility is a monotone cubic in the logarithm of the spot, and flat outside",
        (1e-30, 1e30),
        most_entries=MOST_ENTRIES,
        example=[80.0, 100.0, 120.0],
    ),
    Field(
        "values",
        "list",
        "1/sqrt(year)",
        "A list for each time of a volatility for each spot",
        (0.0, 15.0),
        most_entries=MOST_ENTRIES,
        example=[[0.25, 0.2, 0.18], [0.24, 0.2, 0.19]],
    ),
)
LOCAL_TIMES, LOCAL_SPOTS, LOCAL_VALUES = LOCAL_VOLATILITY

EX_TIME = Field(
    "time",
    "number",
    "years",
    "Ex-time from now; at 0 the dividend has gone from the spot already, after expiry it is ignored",
    EVENT_YEARS,
    example=0.25,
)
EX_DATE = Field(
    "ex_date",
    "date",
    "ISO date or date-time",
    "In the place of the time, where there is a valuation_date",
    default=None,
    example="2026-03-20",
)
AMOUNT = Field(
    "amount", "number", "money", "What the spot drops by, to zero where it exceeds it", MONEY, example=1.0
)
FRACTION = Field(
    "fraction", "number", "fraction of the spot", "What the spot drops by", (0.0, 1.0), example=0.01
)

OPTION_TYPE = Field(
    "option_type",
    "choice",
    "",
    "The right to sell (put) or to buy (call)",
    choices=get_args(OptionType),
    short_forms=(("p", "put"), ("puts", "put"), ("c", "call"), ("calls", "call")),
    example="put",
)
SPOT = Field("spot", "number", "money", "Price of one unit of the underlying now", MONEY, example=100.0)
STRIKE = Field(
    "strike", "number", "money", "Price of one unit at which to sell or buy", (1e-30, 1e30), example=100.0
)
EXPIRY = Field(
    "expiry", "number", "years", "Time to expiry; required unless both dates are given", YEARS, example=1.0
)
RATE = Field(
    "rate",
    "curve",
    "1/year",
    "Risk-free rate, continuously compounded; a number or a curve",
    RATES,
    entries=CURVE,
    example=0.05,
)
VOLATILITY = Field(
    "volatility",
    "curve",
    "1/sqrt(year)",
    "Volatility of ln(spot); a number, a curve, or a local volatility by times and spots",
    (0.0, 15.0),
    entries=CURVE,
    example=0.2,
)
EXERCISE = Field(
    "exercise",
    "choice",
    "",
    "american: at any time up to expiry; european: at expiry; bermudan: also at exercise_times",
    choices=get_args(Exercise),
    short_forms=(("a", "american"), ("e", "european")),
    default="american",
    example="american",
)
EXERCISE_TIMES = Field(
    "exercise_times",
    "list",
    "years or ISO dates",
    "With bermudan alone, and then at least one: times from now, or dates where there is a valuation_date",
    YEARS,
    most_entries=MOST_ENTRIES,
    default=(),
    example=[0.5],
)
EXERCISE_START = Field(
    "exercise_start",
    "time",
    "years or ISO date",
    "With american alone: no exercise before this time from now, or date where there is a valuation_date",
    YEARS,
    default=0.0,
    example=0.0,
)
DIVIDEND_YIELD = Field(
    "dividend_yield",
    "curve",
    "1/year",
    "Continuous yield, to which the borrow_rate adds; a number or a curve",
    RATES,
    entries=CURVE,
    default=0.0,
    example=0.0,
)
CASH_DIVIDENDS = Field(
    "cash_dividends",
    "list",
    "years and money",
    "Amounts that the spot drops by, each at a time from now, or on an ex_date where there is a valuation_date",
    entries=(EX_TIME, EX_DATE, AMOUNT),
    most_entries=MOST_ENTRIES,
    default=(),
    example=[{"time": 0.25, "amount": 1.0}],
)
PROPORTIONAL_DIVIDENDS = Field(
    "proportional_dividends",
    "list",
    "years and fractions of the spot",
    "What the spot loses, each at a time from now, or on an ex_date where there is a valuation_date",
    entries=(EX_TIME, EX_DATE, FRACTION),
    most_entries=MOST_ENTRIES,
    default=(),
    example=[{"time": 0.25, "fraction": 0.01}],
)
DIVIDEND_MODEL = Field(
    "dividend_model",
    "choice",
    "",
    "spot: the spot drops by the cash dividends, lognormal in between; escrowed: the spot without the present value "
    "of those due is lognormal",
    choices=get_args(DividendModel),
    default="spot",
    example="spot",
)
UNDERLYING = Field(
    "underlying",
    "choice",
    "",
    "future: the spot is a futures price, whose yield is the rate: no yield, borrow rate or dividend may be given",
    choices=get_args(Underlying),
    default="spot",
    example="spot",
)
BORROW_RATE = Field(
    "borrow_rate",
    "curve",
    "1/year",
    "Cost of borrowing the underlying, which adds to the yield; a number or a curve",
    RATES,
    entries=CURVE,
    default=0.0,
    example=0.0,
)
FOREIGN_RATE = Field(
    "foreign_rate",
    "curve",
    "1/year",
    "Quanto: the rate of the underlying's currency, where the option pays its numbers in another; the rate less it "
    "adds to the yield; a number or a curve",
    RATES,
    entries=CURVE,
    default=None,
    example=0.03,
)
QUANTO_COVARIANCE = Field(
    "quanto_covariance",
    "number",
    "1/year",
    "Covariance of ln(spot) with the logarithm of the price of the underlying's currency, correlation times both "
    "volatilities, which adds to the yield; Greeks hold it fixed",
    RATES,
    default=0.0,
    example=0.0,
)
SETTLEMENT_LAG = Field(
    "settlement_lag",
    "number",
    "days",
    "Calendar days from exercise or expiry to payment, over which the payoff is discounted",
    (0.0, MOST_LAG),
    default=0.0,
    example=0.0,
)
VALUATION_DATE = Field(
    "valuation_date",
    "date",
    "ISO date or date-time",
    "With expiration_date, in the place of expiry: what counts as now",
    default=None,
    example="2026-01-02",
)
EXPIRATION_DATE = Field(
    "expiration_date",
    "date",
    "ISO date or date-time",
    "With valuation_date, in the place of expiry: the seconds between them / (365 * 86400) are its years",
    default=None,
    example="2027-01-02",
)
TOLERANCE = Field(
    "tolerance",
    "number",
    "fraction of the strike",
    "Absolute error of the price that is allowed",
    (1e-8, 1e-2),
    default=1e-6,
    example=1e-6,
)
GREEKS = Field(
    "greeks",
    "choice",
    "",
    "none: no Greek; standard: derivatives by spot, time, volatility, rate, yield and dividends; extended: also vanna, "
    "volga, charm and those by each value of a curve",
    choices=get_args(Greeks),
    default="standard",
    example="standard",
)
GREEK_ERRORS = Field(
    "greek_errors",
    "flag",
    "",
    "Whether the estimated errors of the exercise boundary and of each Greek come with them, where there are any",
    default=False,
    example=True,
)
ADVICE = Field(
    "advice",
    "flag",
    "",
    "Whether advice on exercise comes with each price of a table: how likely it is and when, and what a day of waiting "
    "costs; 30 ms a contract, with events or a local volatility some tenths of a second",
    default=False,
    example=True,
)
GREEKS_UNITS = Field(
    "greeks_units",
    "choice",
    "",
    "per_year_per_unit: theta and charm per year, derivatives by a volatility, rate or yield per 1.00 of it; "
    "per_day_per_point: per 1/365 year and per 0.01; errors as their Greeks",
    choices=get_args(GreeksUnits),
    default="per_year_per_unit",
    example="per_year_per_unit",
)
OPTION_PRICE = Field(
    "option_price",
    "number",
    "money",
    "Price of the option; required unless bid and ask are given",
    OBSERVED,
    default=None,
    example=6.09,
)
BID = Field("bid", "number", "money", "Price bid for the option", OBSERVED, default=None, example=6.0)
ASK = Field("ask", "number", "money", "Price asked for the option", OBSERVED, default=None, example=6.2)
BOUNDARY_TIMES = Field(
    "times",
    "list",
    "years",
    "Increasing times from now, 0 to expiry; a default set if absent",
    YEARS,
    default=None,
    example=[0.0, 0.5, 1.0],
)
SURFACE_SPOTS = Field("spots", "list", "money", "Spots to value at", MONEY, example=[80.0, 100.0, 120.0])
SURFACE_TIMES = Field("times", "list", "years", "Times from now, 0 to expiry", YEARS, example=[0.0, 0.5])

CONTRACT_FIELDS = (
    *(OPTION_TYPE, SPOT, STRIKE, EXPIRY, RATE, VOLATILITY, EXERCISE, EXERCISE_TIMES, EXERCISE_START),
    *(DIVIDEND_YIELD, CASH_DIVIDENDS, PROPORTIONAL_DIVIDENDS, DIVIDEND_MODEL),
    *(UNDERLYING, BORROW_RATE, FOREIGN_RATE, QUANTO_COVARIANCE, SETTLEMENT_LAG),
    *(VALUATION_DATE, EXPIRATION_DATE),
)
COLUMN_FIELDS = (*CONTRACT_FIELDS, TOLERANCE)
INPUT_FIELDS = (*COLUMN_FIELDS, GREEKS, GREEK_ERRORS, GREEKS_UNITS, OPTION_PRICE, BID, ASK, BOUNDARY_TIMES)
DEFAULT_TOLERANCE: float = TOLERANCE.default


def input_field(name: str) -> Field:
    """Return the input of a name.

    Examples
    --------
    >>> input_field("volatility").limits, input_field("volatility").unit
    ((0.0, 15.0), '1/sqrt(year)')
    """
    return next(field for field in INPUT_FIELDS if field.name == name)
