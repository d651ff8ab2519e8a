"""From the flat vocabulary, one value per name as in JSON or a row of a table, to an option and its market."""

from __future__ import annotations

import datetime as dt
from collections.abc import Mapping
from inspect import signature
from typing import Any

import numpy as np

from pricing_core.american.contracts.checks import check_kind
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.fields import CONTRACT_FIELDS, DIVIDEND_YIELD, EXERCISE, EXPIRY
from pricing_core.american.contracts.market import Market
from pricing_core.errors import MissingInputError, UnknownNameError

NAMES = tuple(field.name for field in CONTRACT_FIELDS)
OF_OPTION, OF_MARKET = tuple(signature(Option).parameters), tuple(signature(Market).parameters)
# Fields with a default that a value of None or NaN does not stand for: it may be the trace of a fault.
DEFAULTS = {field.name: field.default for field in (EXERCISE, DIVIDEND_YIELD)}
REQUIRED = tuple(field.name for field in CONTRACT_FIELDS if field.required and field is not EXPIRY)
OPTIONAL = tuple(name for name in NAMES if name not in REQUIRED and name not in DEFAULTS)
DATES = tuple(field.name for field in CONTRACT_FIELDS if field.kind == "date")
LISTS = tuple(field.name for field in CONTRACT_FIELDS if field.kind == "list")


def contract_from(contract: Mapping[str, Any]) -> tuple[Option, Market]:
    """Return the option and the market that one flat mapping describes.

    Parameters
    ----------
    contract : mapping of str to object
        By the names of `Option` and `Market`, which say what each may be; valuation_date is of both. None, NaN and
        blank text stand for an optional value that is not given.

    Raises
    ------
    InvalidInputError
        A value is missing, unknown or outside what is allowed; the message names it, as in
        `cash_dividends[1].amount`.

    Examples
    --------
    >>> option, market = contract_from(
    ...     {
    ...         "option_type": "call",
    ...         "spot": 100.0,
    ...         "strike": 100.0,
    ...         "rate": 0.05,
    ...         "volatility": '{"times": [0.5, 1.0], "values": [0.2, 0.3]}',
    ...         "valuation_date": "2026-01-01",
    ...         "expiration_date": "2027-01-01",
    ...         "cash_dividends": [{"ex_date": "2026-03-15", "amount": 1.0}],
    ...     }
    ... )
    >>> option.expiry, market.cash_dividends, market.volatility.values
    (1.0, (CashDividend(time=0.2, amount=1.0),), (0.2, 0.3))
    """
    check_kind("contract", contract, Mapping, "a mapping of names to values")
    unknown = [str(name) for name in contract if name not in NAMES]
    if unknown:
        raise UnknownNameError("field", unknown, NAMES, "a contract")
    missing = {name: "" for name in REQUIRED if name not in contract}
    if missing:
        raise MissingInputError(missing)
    given = {name: value for name, value in contract.items() if name not in OPTIONAL or not is_missing(value)}
    option = Option(**{name: given[name] for name in OF_OPTION if name in given})
    return option, Market(**{name: given[name] for name in OF_MARKET if name in given})


def is_missing(value: object) -> bool:
    """Tell whether an optional value is not given: None, NaN, a date that is none, or blank text.

    Examples
    --------
    >>> [is_missing(value) for value in (None, float("nan"), " ", 0.0, [], "nan")]
    [True, True, True, False, False, False]
    """
    if isinstance(value, str):
        return not value.strip(" \t")
    if isinstance(value, float | np.generic | dt.date):
        return bool(value != value)  # noqa: PLR0124  # NaN, and NumPy's and pandas' dates that are none
    return value is None
