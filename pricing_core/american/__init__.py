"""American and European options, priced as linear complementarity systems."""

from pricing_core.american.boundary import ExerciseBoundary, exercise_boundary
from pricing_core.american.contract import Option
from pricing_core.american.market import Market
from pricing_core.american.price_many import price_many
from pricing_core.american.resolution import Resolution
from pricing_core.american.results import Diagnostics, Valuation
from pricing_core.american.surface import ValueSurface, value_surface
from pricing_core.american.valuation import price

__all__ = [
    "Diagnostics",
    "ExerciseBoundary",
    "Market",
    "Option",
    "Resolution",
    "Valuation",
    "ValueSurface",
    "exercise_boundary",
    "price",
    "price_many",
    "value_surface",
]
