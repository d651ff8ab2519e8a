"""What a question is expected to cost, which decides where it is answered, from what the engine says of a price."""

from pricing_core.american import Market, Option
from pricing_core.american.book.book import Book
from pricing_core.american.contracts.fields import Greeks
from pricing_core.american.engines.solve import COMPILED_MARCH
from pricing_core.american.expected_cost import expected_seconds, first_engine

CHEAP_SECONDS = 2e-3  # below which a question is answered at once; chosen
# Cost of a surface with events at one time, in prices, where the kernel marches it; measured, typical.
SURFACE_PRICES = 4.0
BOUNDARY_PRICES = 3.0  # cost of a boundary in prices without Greeks; measured, typical
# Cost of an advice: seconds for each segment, and boundaries; measured, typical.
ADVICE_SECONDS, ADVICE_BOUNDARIES = 0.06, 5.0
# Cost of an implied volatility: seconds, and prices without Greeks; measured, typical.
SEARCH_SECONDS, SEARCH_PRICES = 1.2e-3, 3.0


def seconds_of_surface(
    option: Option, market: Market, tolerance: float, greeks: Greeks, points: tuple[int, int]
) -> float:
    """Return what a surface at so many times and spots is expected to cost.

    The spots at one time share a solve, or a few where they are far apart.
    """
    times, spots = points
    book = Book.at_strike(option, market)
    solves = float(times)
    if not book.is_plain:
        solves *= min(SURFACE_PRICES, spots) if first_engine(book) == COMPILED_MARCH.name else spots
    return solves * expected_seconds(book, tolerance, greeks)


def seconds_of_boundary(option: Option, market: Market, tolerance: float) -> float:
    """Return what an exercise boundary is expected to cost."""
    return BOUNDARY_PRICES * expected_seconds(Book.at_strike(option, market), tolerance, "none")


def seconds_of_advice(option: Option, market: Market, tolerance: float, times: int) -> float:
    """Return what advice on exercise is expected to cost: a price for each time, and boundaries for each segment."""
    book = Book.at_strike(option, market)
    prices = times + ADVICE_BOUNDARIES * BOUNDARY_PRICES
    return ADVICE_SECONDS * book.segments.end.size + prices * expected_seconds(book, tolerance, "none")


def seconds_of_search(option: Option, market: Market, tolerance: float) -> float:
    """Return what an implied volatility is expected to cost."""
    return SEARCH_SECONDS + SEARCH_PRICES * expected_seconds(
        Book.at_strike(option, market), tolerance, "none"
    )
