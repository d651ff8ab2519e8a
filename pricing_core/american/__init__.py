"""American and European options, priced as linear complementarity systems."""

from __future__ import annotations

from pricing_core.american.advice.exercise_advice import ExerciseAdvice, exercise_advice
from pricing_core.american.book.resolution import Resolution
from pricing_core.american.book.valuation import Diagnostics, Valuation
from pricing_core.american.boundary import ExerciseBoundary, exercise_boundary
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.curves import PiecewiseConstant
from pricing_core.american.contracts.dividends import CashDividend, ProportionalDividend
from pricing_core.american.contracts.exchange import exchange_option
from pricing_core.american.contracts.fields import Greeks
from pricing_core.american.contracts.local_volatility import LocalVolatility
from pricing_core.american.contracts.market import Market
from pricing_core.american.contracts.vocabulary import contract_from
from pricing_core.american.implied.implied_carry import ImpliedCarry, implied_carry
from pricing_core.american.implied.implied_volatility import ImpliedVolatility, implied_volatility
from pricing_core.american.implied.implied_volatility_many import implied_volatility_many
from pricing_core.american.price import price
from pricing_core.american.price_many import price_many
from pricing_core.american.surface import ValueSurface, value_surface

__all__ = [  # noqa: RUF022 - the order of the reference, which begins with what most readers look for
    "price",
    "Option",
    "Market",
    "Valuation",
    "Diagnostics",
    "Resolution",
    "Greeks",
    "price_many",
    "exercise_boundary",
    "ExerciseBoundary",
    "exercise_advice",
    "ExerciseAdvice",
    "implied_volatility",
    "ImpliedVolatility",
    "implied_volatility_many",
    "implied_carry",
    "ImpliedCarry",
    "value_surface",
    "ValueSurface",
    "CashDividend",
    "ProportionalDividend",
    "PiecewiseConstant",
    "LocalVolatility",
    "contract_from",
    "exchange_option",
]
