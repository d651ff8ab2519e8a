"""The rows of a table whose only events are plain cash dividends, read all at once.

Such a row has flat rates, the spot model and a list of {"time": ..., "amount": ...}, or its JSON text, with nothing
but numbers: times that increase strictly inside the option's life, amounts that make a difference. Any other row,
and every fault, is for `contract_from`.
"""

from collections.abc import Callable, Mapping, Sequence
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pricing_core.american.contracts.contract import LARGEST_MONEY
from pricing_core.american.contracts.dividends import MOST_DIVIDENDS
from pricing_core.american.contracts.json_text import DECODER
from pricing_core.american.contracts.schedule import NEGLIGIBLE, SAME_TIME
from pricing_core.american.events.packed_schedules import PackedSchedules, pack_columns
from pricing_core.american.events.scheduled_book import Contract, ScheduledBook, scheduled_book
from pricing_core.arrays import BoolVector, Vector


def read_dividend_rows(
    cells: Sequence[object],
    rows: NDArray[np.intp],
    arrays: Mapping[str, NDArray[Any]],
    contract: Callable[[int], Contract],
) -> tuple[NDArray[np.intp], ScheduledBook]:
    """Return which of the rows could be read, and those.

    Parameters
    ----------
    cells : sequence of object
        The table's column of cash dividends.
    rows : int array
        Of the table; they may have this event alone, and the numbers of the book are sound there.
    arrays : mapping of str to array
        The columns of the book by name.
    contract : callable
        From a row of the table to its option and market.
    """
    found = [_plain_dividends(cells[row]) for row in rows.tolist()]
    plain = np.array([len(numbers) > 0 for numbers in found], dtype=bool)
    if not plain.any():
        return rows[:0], scheduled_book([])
    rows = rows[plain]
    part = {name: column[rows] for name, column in arrays.items()}
    dividends = np.array([len(numbers) // 2 for numbers in found], dtype=np.int64)[plain]
    time, amount = np.fromiter(chain.from_iterable(found), np.float64).reshape(-1, 2).T
    packed, sound = _schedules(part, dividends, time, amount)
    book = ScheduledBook(part["spot"], dividends, packed, lambda row: contract(int(rows[row])))
    kept = np.flatnonzero(sound)
    return rows[kept], book.take(kept)


def _schedules(
    part: Mapping[str, NDArray[Any]], dividends: NDArray[np.int64], time: Vector, amount: Vector
) -> tuple[PackedSchedules, BoolVector]:
    """Return the schedules of so many dividends each, and which of them `make_schedule` would make as well."""
    counts = dividends + 1
    last = np.cumsum(counts) - 1
    starts = last - dividends
    pays = np.ones(counts.sum(), dtype=bool)
    pays[last] = False
    start, end = np.zeros((2, pays.size))
    end[pays], end[last] = time, part["expiry"]
    start[pays.nonzero()[0] + 1] = time
    names = ("rate", "dividend_yield", "volatility", "is_american", "is_american", "expiry", "strike")
    every = np.repeat(np.array([part[name] for name in names], dtype=np.float64), counts, axis=1)
    stretches = np.zeros((pays.size, 9))
    stretches[:, 0], stretches[:, 1:6], stretches[pays, 7] = end - start, every[:5].T, amount
    apart = stretches[:, 0] > SAME_TIME * every[5]
    counted = ~pays | ((stretches[:, 7] > NEGLIGIBLE * every[6]) & (stretches[:, 7] <= LARGEST_MONEY))
    packed = pack_columns(part["is_put"], part["strike"], part["spot"], counts, stretches)
    return packed, np.logical_and.reduceat(apart & counted, starts)


def _plain_dividends(cell: object) -> list[float]:
    """Return time, amount, time, amount, ...; nothing where the cell is not as plain as that."""
    try:
        entries = DECODER.decode(cell) if type(cell) is str else cell
        if type(entries) is not list or len(entries) > MOST_DIVIDENDS:
            return []
        if set(map(type, entries)) != {dict} or set(map(len, entries)) != {2}:
            return []
        numbers = [number for entry in entries for number in (entry["time"], entry["amount"])]
        return [float(number) for number in numbers] if set(map(type, numbers)) <= {float, int} else []
    except (ValueError, RecursionError, KeyError, OverflowError):
        return []
