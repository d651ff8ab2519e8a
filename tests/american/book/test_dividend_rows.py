import json

import numpy as np
import pytest

from pricing_core.american import contract_from
from pricing_core.american.book import reading
from pricing_core.american.book.array_column import ArrayColumn
from pricing_core.american.book.book import Book
from pricing_core.american.book.columns import as_objects
from pricing_core.american.book.dividend_rows import read_dividend_rows
from pricing_core.american.book.reading import checked_contract, read_book
from pricing_core.american.book.segments import Segments
from pricing_core.american.contracts.fields import CASH_DIVIDENDS

ROW = {"option_type": "put", "spot": 95.0, "strike": 100.0, "expiry": 1.0, "rate": 0.05, "volatility": 0.25}
ARRAYS = {
    name: np.array([number])
    for name, number in {**ROW, "dividend_yield": 0.0, "is_put": True, "is_american": True}.items()
}
PLAIN = [
    [{"time": 0.5, "amount": 1.0}],
    [{"amount": 1, "time": 0.5}, {"time": 0.75, "amount": 2}],
    ' [{"time": 0.5, "amount": 1e0}]\n',
    [(0.5, 1.0)],
    [[0.5, 1.0], (0.75, 2)],
    "[[0.5, 1]]",
]
NOT_PLAIN = [
    None,
    [],
    "[]",
    "[",
    ({"time": 0.5, "amount": 1.0},),
    [{"time": 0.5, "amount": True}],
    [{"time": 0.5, "amount": "1"}],
    [{"time": 0.5, "amount": np.float64(1.0)}],
    [{"time": 0.5, "amount": 10**400}],
    [{"time": 0.5, "amount": 2e30}],
    [{"time": 0.5, "amount": 0.0}],
    [{"time": 0.5, "amount": 1e-9}],  # makes no difference
    [{"time": 0.5, "amount": float("nan")}],
    [{"time": float("nan"), "amount": 1.0}],
    [{"time": 0.5, "amount": 1.0, "ex_date": None}],
    [(0.5, 1.0, 2.0)],
    [("2026-03-15", 1.0)],
    [(0.5, True)],
    [(0.5, 1.0), {"time": 0.75, "amount": 1.0}],
    [{"ex_date": "2026-03-15", "amount": 1.0}],
    [{"time": 0.0, "amount": 1.0}],
    [{"time": 1.0, "amount": 1.0}],
    [{"time": 1.0 - 1e-13, "amount": 1.0}],
    [{"time": 2.0, "amount": 1.0}],
    [{"time": 0.5, "amount": 1.0}, {"time": 0.5, "amount": 1.0}],
    [{"time": 0.5, "amount": 1.0}, {"time": 0.25, "amount": 1.0}],
    [{"time": k / 2000.0, "amount": 0.01} for k in range(1, 1002)],
    '[{"time": 0.5, "time": 0.5, "amount": 1.0}]',
    '[{"time": 0.5, "amount": Infinity}]',
]


def rows_read(cells):
    arrays = {name: np.repeat(column, len(cells)) for name, column in ARRAYS.items()}
    found = read_dividend_rows(ArrayColumn(CASH_DIVIDENDS, as_objects(cells)), np.arange(len(cells)), arrays)
    if found is None:
        return []
    rows, book = found
    assert book.count == rows.size
    return rows.tolist()


@pytest.mark.parametrize("cell", PLAIN, ids=repr)
def test_plain_dividends_are_read(cell):
    assert rows_read([cell]) == [0]


@pytest.mark.parametrize("cell", NOT_PLAIN, ids=lambda cell: repr(cell)[:40])
def test_what_is_not_plain_is_left_and_costs_its_row_alone(cell):
    assert rows_read([cell]) == []
    assert rows_read([cell, PLAIN[0], cell, PLAIN[1]]) == [1, 3]


def test_the_book_is_that_of_the_contracts_bit_for_bit(monkeypatch):
    singly = []

    def checked(cells):
        singly.append(cells)
        return checked_contract(cells)

    monkeypatch.setattr(reading, "checked_contract", checked)
    random = np.random.default_rng(1)
    count = 50
    lists = [
        [
            {"time": time, "amount": amount}
            for time, amount in random.uniform(0.0, 2.0, (random.integers(1, 9), 2)).tolist()
        ]
        for _ in range(count)
    ]
    for cell in lists:
        cell.sort(key=lambda dividend: dividend["time"])
    columns = {
        "option_type": random.choice(["put", "call"], count),
        "exercise": random.choice(["american", "european"], count),
        "spot": random.uniform(50.0, 150.0, count),
        "strike": random.uniform(50.0, 150.0, count),
        "expiry": random.uniform(1.0, 2.5, count),
        "rate": random.uniform(-0.01, 0.1, count),
        "dividend_yield": random.choice([0.0, 1e-40, 0.03], count),
        "volatility": random.uniform(0.0, 0.6, count),
        "cash_dividends": [json.dumps(cell) if row % 2 else cell for row, cell in enumerate(lists)],
    }
    read = read_book(columns, 1e-6)
    assert not read.faults
    rows = [{name: column[row] for name, column in columns.items()} for row in read.rows.tolist()]
    rows = [
        {name: cell.item() if hasattr(cell, "item") else cell for name, cell in row.items()} for row in rows
    ]
    wanted, book = Book.of([contract_from(row) for row in rows]), read.book
    assert 0 < len(singly) < 0.5 * count  # those some of whose dividends come after expiry
    for name in ("is_put", "strike", "spot", "escrowed", "first"):
        np.testing.assert_array_equal(getattr(book, name), getattr(wanted, name), err_msg=name)
    for name in Segments.__slots__:
        np.testing.assert_array_equal(
            getattr(book.segments, name), getattr(wanted.segments, name), err_msg=name
        )
    for name in ("first", "values"):
        found, listed = book.listed.cash_dividends, wanted.listed.cash_dividends
        np.testing.assert_array_equal(getattr(found, name), getattr(listed, name))
