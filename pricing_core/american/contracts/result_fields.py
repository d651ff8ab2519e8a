"""Every output of the option engine, stated once.

Results in Python, the columns of tables and files, JSON answers and printed tables go by these names. What writes or
describes an output takes its unit and words from here, or is compared with this table by a test.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

from pricing_core.american.contracts.fields import GREEKS, GREEKS_UNITS, Greeks
from pricing_core.version import ENGINE_VERSION

Kind: TypeAlias = Literal["number", "count", "flag", "text", "list", "matrix", "flags"]


@dataclass(frozen=True, slots=True, eq=False)
class ResultField:
    """One output, as users read it.

    Parameters
    ----------
    name : str
        The same in Python, tables and JSON.
    kind : {"number", "count", "flag", "text", "list", "matrix", "flags"}
        A list is one of numbers, a matrix one of lists, flags a list of lists of flags.
    unit : str
    meaning : str
        One line without the unit.
    example : object
    given : {"always", "standard", "extended"}
        The least value of `greeks` at which there is such an output.
    per : str
        The input that a list holds a number for each entry or value of; a table without that column has no such list.
    choices : tuple of str
        What a text is one of, where it is.
    of : str
        The Greek that this states in another unit, or whose error it is.
    """

    name: str
    kind: Kind
    unit: str
    meaning: str
    example: Any
    given: Literal["always", "standard", "extended"] = "always"
    per: str = ""
    choices: tuple[str, ...] = ()
    of: str = ""

    @property
    def is_greek(self) -> bool:
        """Whether this is a Greek, and not one in another unit or its error."""
        return self.given != "always" and not self.of

    @property
    def description(self) -> str:
        """One sentence, the unit included."""
        return f"{self.meaning} ({self.unit})." if self.unit else f"{self.meaning}."


PRICE_FIELDS = (
    ResultField("price", "number", "money", "Value now", 6.09),
    ResultField("european_price", "number", "money", "Value without early exercise", 5.57),
    ResultField("early_exercise_premium", "number", "money", "price - european_price", 0.52),
    ResultField("intrinsic_value", "number", "money", "What exercise brings now", 0.0),
    ResultField("delta", "number", "", "dV/dS", -0.41, "standard"),
    ResultField("gamma", "number", "1/money", "d2V/dS2", 0.023, "standard"),
    ResultField("theta", "number", "money/year", "dV/dt in calendar time", -2.3, "standard"),
    ResultField("theta_per_day", "number", "money/day", "theta/365", -0.0063, "standard", of="theta"),
    ResultField("vega", "number", "money per 1.00 of volatility", "dV/d volatility", 37.8, "standard"),
    ResultField(
        "vega_per_point", "number", "money per 0.01 of volatility", "vega/100", 0.378, "standard", of="vega"
    ),
    ResultField("rho", "number", "money per 1.00 of rate", "dV/d rate", -30.3, "standard"),
    ResultField("rho_per_point", "number", "money per 0.01 of rate", "rho/100", -0.303, "standard", of="rho"),
    ResultField(
        "dividend_rho", "number", "money per 1.00 of dividend yield", "dV/d dividend_yield", 24.2, "standard"
    ),
    ResultField(
        "delta_sticky_moneyness",
        "number",
        "",
        "dV/dS where a local volatility moves with the spot, as a function of moneyness; delta holds it fixed",
        -0.45,
        "standard",
    ),
    ResultField("exercise_now", "flag", "", "Whether the holder does best to exercise now", False),
    ResultField(
        "exercise_boundary",
        "number",
        "money",
        "Spot at which to exercise now; of two, the one nearer the strike; none where none is within reach",
        81.0,
    ),
    ResultField("error_estimate", "number", "money", "Estimated absolute error of the price", 2e-5),
    ResultField(
        "status",
        "text",
        "",
        "ok, tolerance_not_met (a price with its honest estimate), invalid_input, out_of_domain or deadline",
        "ok",
        choices=("ok", "tolerance_not_met", "invalid_input", "out_of_domain", "deadline"),
    ),
    ResultField("method", "text", "", "How the price was computed", "premium-march"),
    ResultField("engine_version", "text", "", "Version of the pricing engine", ENGINE_VERSION),
    ResultField(
        "instruction_set",
        "text",
        "",
        "What the processor was asked in, on which the last digits depend: avx512, avx2, portable, or numpy without "
        "the compiled kernel",
        "avx512",
    ),
    ResultField(
        "dividend_sensitivities",
        "list",
        "money per 1.00 of an amount",
        "dV/d amount of each cash dividend, in the order of their times",
        [-0.5],
        "standard",
        per="cash_dividends",
    ),
    ResultField("vanna", "number", "1 per 1.00 of volatility", "d2V/dS d volatility", -0.3, "extended"),
    ResultField(
        "volga", "number", "money per 1.00 of volatility, squared", "d2V/d volatility2", 11.0, "extended"
    ),
    ResultField("charm", "number", "1/year", "d2V/dS dt in calendar time", -0.034, "extended"),
    ResultField(
        "rate_buckets",
        "list",
        "money per 1.00 of a value",
        "dV/d each value of a curve of rates",
        [-12.0, -18.3],
        "extended",
        per="rate",
    ),
    ResultField(
        "dividend_yield_buckets",
        "list",
        "money per 1.00 of a value",
        "dV/d each value of a curve of dividend yields",
        [9.6, 14.6],
        "extended",
        per="dividend_yield",
    ),
    ResultField(
        "volatility_buckets",
        "list",
        "money per 1.00 of a value",
        "dV/d each value of a curve of volatilities",
        [20.0, 17.8],
        "extended",
        per="volatility",
    ),
)


def _error_field(greek: ResultField) -> ResultField:
    """Return the output that states the error of a Greek."""
    is_list = greek.kind == "list"
    return replace(
        greek,
        name=f"{greek.name}_error",
        meaning=f"Estimated absolute error of {'each of ' if is_list else ''}{greek.name}",
        example=[1e-5] * len(greek.example) if is_list else 1e-5,
        of=greek.name,
    )


BOUNDARY_ERROR_FIELD = ResultField(
    "boundary_error",
    "number",
    "money",
    "Estimated absolute error of exercise_boundary",
    0.002,
    of="exercise_boundary",
)
GREEK_ERROR_FIELDS = tuple(_error_field(field) for field in PRICE_FIELDS if field.is_greek)
ERROR_FIELDS = (BOUNDARY_ERROR_FIELD, *GREEK_ERROR_FIELDS)  # beside that of the price

IMPLIED_VOLATILITY_FIELDS = (
    ResultField(
        "volatility", "number", "1/sqrt(year)", "Volatility at which the option is worth its price", 0.2
    ),
    ResultField(
        "status",
        "text",
        "",
        "ok, below_lower_bound, above_upper_bound, not_identifiable (a whole interval of volatilities makes that "
        "price), no_convergence or invalid_input",
        "ok",
        choices=(
            *("ok", "below_lower_bound", "above_upper_bound", "not_identifiable", "no_convergence"),
            "invalid_input",
        ),
    ),
    ResultField("european_price", "number", "money", "Value without early exercise at that volatility", 5.57),
    ResultField("price", "number", "money", "Value at that volatility", 6.09),
    ResultField("bid_volatility", "number", "1/sqrt(year)", "Volatility at which it is worth its bid", 0.198),
    ResultField("ask_volatility", "number", "1/sqrt(year)", "Volatility at which it is worth its ask", 0.202),
    ResultField("error_estimate", "number", "money", "Estimated absolute error of that price", 1e-6),
    ResultField("volatility_error", "number", "1/sqrt(year)", "Estimated absolute error of volatility", 1e-6),
    ResultField("iterations", "count", "", "How many times the option was priced", 4),
    ResultField(
        "method", "text", "", "How the price was computed; none where there is no volatility", "premium-march"
    ),
    ResultField("price_bound", "number", "money", "Price of the option that its own is beyond or at", None),
    ResultField("message", "text", "", "Why there is no volatility, with that bound; else empty", ""),
)

BOUNDARY_FIELDS = (
    ResultField("time", "list", "years", "Calendar times from now", [0.0, 1.0]),
    ResultField("time_to_expiry", "list", "years", "expiry - time", [1.0, 0.0]),
    ResultField(
        "boundary", "list", "money", "Critical spot, null where no spot is exercised at", [81.0, 100.0]
    ),
    ResultField(
        "other_boundary", "list", "money", "The end of the exercise region farther from the strike", None
    ),
    ResultField("error_estimate", "list", "money", "Estimated absolute error of boundary", [0.0004, 0.0]),
    ResultField("method", "text", "", "How the boundary was computed", "premium-march"),
)

SURFACE_FIELDS = (
    ResultField("time", "list", "years", "Times from now", [0.0, 0.5]),
    ResultField("spot", "list", "money", "Spots", [80.0, 100.0]),
    ResultField("value", "matrix", "money", "Values by time and then by spot", [[20.0, 6.09], [20.0, 4.66]]),
    ResultField("delta", "matrix", "", "dV/dS", [[-1.0, -0.41], [-1.0, -0.43]], "standard"),
    ResultField("gamma", "matrix", "1/money", "d2V/dS2", [[0.0, 0.023], [0.0, 0.031]], "standard"),
    ResultField(
        "theta", "matrix", "money/year", "dV/dt in calendar time", [[0.0, -2.3], [0.0, -3.7]], "standard"
    ),
    ResultField(
        "vega",
        "matrix",
        "money per 1.00 of volatility",
        "dV/d volatility",
        [[0.0, 37.8], [0.0, 27.4]],
        "standard",
    ),
    ResultField(
        "multiplier",
        "matrix",
        "money/year",
        "What not exercising costs: r K - q S for a put, q S - r K for a call where exercise is optimal, else 0",
        [[5.0, 0.0], [5.0, 0.0]],
    ),
    ResultField(
        "exercised", "flags", "", "Whether exercise is optimal there", [[True, False], [True, False]]
    ),
    ResultField(
        "error_estimate",
        "matrix",
        "money",
        "Estimated absolute errors of the values",
        [[0.0, 2e-5], [0.0, 2e-5]],
    ),
    ResultField(
        "perpetual_boundary",
        "number",
        "money",
        "Exercise boundary of the option without expiry, where it has one and nothing changes with time",
        71.43,
    ),
    ResultField(
        "status",
        "text",
        "",
        "ok, or tolerance_not_met where a value misses the tolerance",
        "ok",
        choices=("ok", "tolerance_not_met"),
    ),
    ResultField("method", "text", "", "How the values were computed", "premium-march"),
)

ADVICE_FIELDS = (
    ResultField("exercise_now", "flag", "", "Whether the holder does best to exercise now", False),
    ResultField(
        "exercise_boundary",
        "number",
        "money",
        "Spot at which to exercise now; of two, the one nearer the strike",
        80.9,
    ),
    ResultField("probability", "number", "", "Risk-neutral probability of exercise before expiry", 0.4874),
    ResultField("probability_error", "number", "", "Estimated error of each probability", 2e-5),
    ResultField(
        "expected_time", "number", "years", "Expected time of exercise, given that it is before expiry", 0.644
    ),
    ResultField("exercised_at_expiry", "number", "", "Probability of exercise at expiry", 0.0),
    ResultField("expires_worthless", "number", "", "Probability of no exercise at all", 0.5126),
    ResultField("time", "list", "years", "Times from now", [0.5, 1.0]),
    ResultField(
        "cumulative_probability",
        "list",
        "",
        "Probability of exercise before expiry up to each time",
        [0.1637, 0.4874],
    ),
    ResultField(
        "assignment_probability",
        "list",
        "",
        "Probability that the short side has been assigned up to each time, at expiry included",
        [0.1637, 0.4874],
    ),
    ResultField(
        "cost_of_waiting",
        "list",
        "money",
        "What a holder loses who does not exercise before each time; at expiry the early exercise premium",
        [0.0714, 0.5168],
    ),
    ResultField("cost_error", "list", "money", "Estimated error of each cost", [1e-4, 1e-4]),
    ResultField(
        "status",
        "text",
        "",
        "ok, or tolerance_not_met where a price behind the costs misses the tolerance",
        "ok",
        choices=("ok", "tolerance_not_met"),
    ),
    ResultField("method", "text", "", "How boundary and prices were computed", "closed-form, premium-march"),
)
# The columns that a table of prices has on request.
ADVICE_COLUMN_FIELDS = (
    ResultField(
        "exercise_probability", "number", "", "Risk-neutral probability of exercise before expiry", 0.4874
    ),
    ResultField("exercise_probability_error", "number", "", "Estimated error of exercise_probability", 2e-5),
    ResultField(
        "expected_exercise_time",
        "number",
        "years",
        "Expected time of exercise, given that it is before expiry",
        0.644,
    ),
    ResultField(
        "assignment_probability",
        "number",
        "",
        "Risk-neutral probability that the short side is assigned at all, at expiry included",
        0.4874,
    ),
    ResultField(
        "cost_of_waiting",
        "number",
        "money",
        "What a holder loses who does not exercise for a day, 1/365 year",
        0.0,
    ),
)
# What an answer that is not read from a table of prices says besides, so that it can be reproduced.
PROVENANCE_FIELDS = tuple(
    field for field in PRICE_FIELDS if field.name in ("engine_version", "instruction_set")
)
UNITS_FIELD = ResultField(
    "greeks_units",
    "text",
    "",
    "The units of the Greeks, as asked for",
    GREEKS_UNITS.default,
    choices=GREEKS_UNITS.choices,
)


def price_fields(
    greeks: Greeks,
    columns: Container[str] | None = None,
    *,
    greek_errors: bool = False,
    advice: bool = False,
) -> tuple[ResultField, ...]:
    """Return the outputs of a price at a value of `greeks`.

    Parameters
    ----------
    columns : container of str, optional
        Names of the columns of a table of contracts: lists for an input that it does not have are left out.
    greek_errors : bool
        Whether the errors of the exercise boundary and of these Greeks follow.
    advice : bool
        Whether advice on exercise follows.

    Examples
    --------
    >>> [field.name for field in price_fields("none")][:4]
    ['price', 'european_price', 'early_exercise_premium', 'intrinsic_value']
    >>> [field.name for field in price_fields("extended", columns=["rate", "volatility"])][-4:]
    ['volga', 'charm', 'rate_buckets', 'volatility_buckets']
    >>> [field.name for field in price_fields("standard", [], greek_errors=True)][-2:]
    ['dividend_rho_error', 'delta_sticky_moneyness_error']
    """
    given = ("always", *GREEKS.choices[1 : GREEKS.choices.index(greeks) + 1])
    return tuple(
        field
        for field in (
            *PRICE_FIELDS,
            *(ERROR_FIELDS if greek_errors else ()),
            *(ADVICE_COLUMN_FIELDS if advice else ()),
        )
        if field.given in given and (columns is None or not field.per or field.per in columns)
    )
