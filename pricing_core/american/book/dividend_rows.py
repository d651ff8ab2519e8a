"""The rows of a table whose only events are plain cash dividends, read all at once.

Such a row has flat rates, the spot model and a list of {"time": ..., "amount": ...}, or its JSON text, with nothing
but numbers: times that increase strictly inside the option's life, amounts that make a difference. Any other row,
and every fault, is for `contract_from`.
"""

from collections.abc import Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.book.book import Book, Listed, Rows, Segments
from pricing_core.american.book.ragged import Ragged, starts
from pricing_core.american.contracts.fields import AMOUNT, CASH_DIVIDENDS
from pricing_core.american.contracts.json_text import DECODER
from pricing_core.american.contracts.schedule import NEGLIGIBLE, SAME_TIME
from pricing_core.arrays import BoolVector, Vector


def read_dividend_rows(
    cells: Sequence[object], rows: Rows, arrays: Mapping[str, NDArray[Any]]
) -> tuple[Rows, Book] | None:
    """Return which of the rows could be read, and their contracts; None where none could.

    Parameters
    ----------
    cells : sequence of object
        The table's column of cash dividends.
    rows : int array
        Rows of the table that may have this event alone, and whose numbers are sound.
    arrays : mapping of str to array
        The columns of numbers by name, and is_put and is_american.
    """
    found = [_plain_dividends(cells[row]) for row in rows.tolist()]
    plain = np.array([len(numbers) > 0 for numbers in found], dtype=bool)
    if not plain.any():
        return None
    rows = rows[plain]
    part = {name: column[rows] for name, column in arrays.items()}
    dividends = np.array([len(numbers) // 2 for numbers in found], dtype=np.int64)[plain]
    time, amount = np.fromiter(chain.from_iterable(found), np.float64).reshape(-1, 2).T
    book, sound = _book(part, dividends, time, amount)
    kept = np.flatnonzero(sound)
    return rows[kept], book.take(kept)


def _book(
    part: Mapping[str, NDArray[Any]], dividends: NDArray[np.int64], time: Vector, amount: Vector
) -> tuple[Book, BoolVector]:
    """Return contracts with so many dividends each, and which of them `make_schedule` would make as well."""
    counts = dividends + 1
    first = starts(counts)
    last = first[1:] - 1
    pays = np.ones(first[-1], dtype=bool)
    pays[last] = False
    start, end, due = np.zeros((3, pays.size))
    end[pays], end[last], due[pays] = time, part["expiry"], amount
    start[pays.nonzero()[0] + 1] = time
    names = ("rate", "dividend_yield", "volatility", "expiry", "strike")
    rate, dividend_yield, volatility, expiry, strike = (np.repeat(part[name], counts) for name in names)
    american = np.repeat(part["is_american"], counts)
    nothing = np.zeros(pays.size)
    segments = Segments(start, end, rate, dividend_yield, volatility, american, american, nothing, due)
    none = Ragged.empty(counts.size)
    listed = Listed(Ragged(starts(dividends), time), none, none, none)
    escrowed = np.zeros(counts.size, dtype=bool)
    book = Book(part["is_put"], part["strike"], part["spot"], escrowed, first, segments, listed)
    apart = end - start > SAME_TIME * expiry
    counted = ~pays | ((due > NEGLIGIBLE * strike) & (due <= AMOUNT.most))
    return book, np.logical_and.reduceat(apart & counted, first[:-1])


def _plain_dividends(cell: object) -> list[float]:
    """Return time, amount, time, amount, ...; nothing where the cell is not as plain as that."""
    try:
        entries = DECODER.decode(cell) if type(cell) is str else cell
        if type(entries) is not list or len(entries) > CASH_DIVIDENDS.most_entries:
            return []
        if set(map(type, entries)) != {dict} or set(map(len, entries)) != {2}:
            return []
        numbers = [number for entry in entries for number in (entry["time"], entry["amount"])]
        return [float(number) for number in numbers] if set(map(type, numbers)) <= {float, int} else []
    except (ValueError, RecursionError, KeyError, OverflowError):
        return []
