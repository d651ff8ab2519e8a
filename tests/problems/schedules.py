"""A zoo of options with events, one of each kind that begins a contact set in its own way."""

from pricing_core.american import Market, Option
from pricing_core.american.book.book import Book

QUARTERS = (0.125, 0.375, 0.625, 0.875)


def cash(amount: float, times: tuple[float, ...] = QUARTERS) -> tuple[dict[str, float], ...]:
    """Return the same amount at every time."""
    return tuple({"time": time, "amount": amount} for time in times)


def proportional(fraction: float, times: tuple[float, ...] = QUARTERS) -> tuple[dict[str, float], ...]:
    """Return the same fraction at every time."""
    return tuple({"time": time, "fraction": fraction} for time in times)


RATES = {"times": [0.3, 0.6, 1.0], "values": [0.02, 0.05, 0.04]}
YIELDS = {"times": [0.3, 0.6, 1.0], "values": [0.0, 0.03, 0.08]}
VOLATILITIES = {"times": [0.3, 0.6, 1.0], "values": [0.15, 0.4, 0.2]}

CONTRACTS: dict[str, tuple[Option, Market]] = {
    "put, quarterly dividends": (
        Option("put", 100.0, 1.0),
        Market(100.0, 0.05, 0.25, cash_dividends=cash(1.0)),
    ),
    "put, small dividends": (Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.25, cash_dividends=cash(0.1))),
    "put, dividends and a yield": (
        Option("put", 100.0, 1.0),
        Market(100.0, 0.05, 0.25, 0.02, cash_dividends=cash(1.0)),
    ),
    "put, yield above the rate": (
        Option("put", 100.0, 1.0),
        Market(100.0, 0.02, 0.25, 0.05, cash_dividends=cash(1.0)),
    ),
    "put, half the spot": (
        Option("put", 100.0, 1.0),
        Market(100.0, 0.05, 0.25, cash_dividends=cash(40.0, (0.5,))),
    ),
    "put, more than the spot": (
        Option("put", 100.0, 1.0),
        Market(100.0, 0.05, 0.25, cash_dividends=cash(140.0, (0.5,))),
    ),
    "put, fractions": (
        Option("put", 100.0, 1.0),
        Market(100.0, 0.05, 0.25, proportional_dividends=proportional(0.01)),
    ),
    "put, small fractions": (
        Option("put", 100.0, 1.0),
        Market(100.0, 0.05, 0.25, proportional_dividends=proportional(0.001)),
    ),
    "put, dividend at expiry": (
        Option("put", 100.0, 1.0),
        Market(100.0, 0.05, 0.25, cash_dividends=cash(3.0, (1.0,))),
    ),
    "put, escrowed": (
        Option("put", 100.0, 1.0),
        Market(100.0, 0.05, 0.25, cash_dividends=cash(1.0), dividend_model="escrowed"),
    ),
    "put, low volatility": (Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.05, cash_dividends=cash(0.5))),
    "put, curves": (Option("put", 100.0, 1.0), Market(100.0, RATES, VOLATILITIES, YIELDS)),
    "put, rate turns positive": (
        Option("put", 100.0, 1.0),
        Market(100.0, {"times": [0.5, 1.0], "values": [0.05, -0.01]}, 0.25),
    ),
    "put, window": (Option("put", 100.0, 1.0, exercise_start=0.5), Market(100.0, 0.05, 0.25)),
    "put, monthly dates": (
        Option("put", 100.0, 1.0, "bermudan", tuple(k / 12.0 for k in range(1, 13))),
        Market(100.0, 0.05, 0.25),
    ),
    "call, quarterly dividends": (
        Option("call", 100.0, 1.0),
        Market(100.0, 0.05, 0.25, cash_dividends=cash(1.0)),
    ),
    "call, dividends and a yield": (
        Option("call", 100.0, 1.0),
        Market(100.0, 0.05, 0.25, 0.02, cash_dividends=cash(1.0)),
    ),
    "call, yield above the rate": (
        Option("call", 100.0, 1.0),
        Market(100.0, 0.02, 0.25, 0.05, cash_dividends=cash(1.0)),
    ),
    "call, fraction and amount on one date": (
        Option("call", 100.0, 1.0),
        Market(
            100.0,
            0.05,
            0.25,
            0.02,
            cash_dividends=cash(3.0, (0.5,)),
            proportional_dividends=proportional(0.02, (0.5,)),
        ),
    ),
    "call, escrowed": (
        Option("call", 100.0, 1.0),
        Market(100.0, 0.05, 0.25, cash_dividends=cash(2.0), dividend_model="escrowed"),
    ),
    "call, curves": (Option("call", 100.0, 1.0), Market(100.0, RATES, VOLATILITIES, YIELDS)),
    "european put, dividends": (
        Option("put", 100.0, 1.0, "european"),
        Market(100.0, 0.05, 0.25, cash_dividends=cash(1.0)),
    ),
}


def terms_of(book: Book, row: int = 0) -> tuple[object, ...]:
    """Return everything that a price of one of the contracts depends on but its reduction."""
    numbers = (column.item(row) for column in (book.is_put, book.strike, book.diffusing()))
    return (*numbers, book.segments_of(row), book.local_terms(row))
