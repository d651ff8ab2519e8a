"""Tables of contracts: every row is read, or refused in the words of the single contract."""

import math
from fractions import Fraction

import numpy as np
import pytest

from pricing_core.american import Market, Option, price
from pricing_core.american.book import Book, read_book, single_row
from pricing_core.errors import InvalidInputError

ROW = {
    "option_type": "put",
    "exercise": "american",
    "spot": 100.0,
    "strike": 90.0,
    "expiry": 1.0,
    "rate": 0.05,
    "dividend_yield": 0.02,
    "volatility": 0.2,
}
NUMBERS = ("spot", "strike", "expiry", "rate", "dividend_yield", "volatility", "tolerance")


def refused_alone(row: dict[str, object], tolerance: float = 1e-6) -> InvalidInputError:
    """Return what the single price says of a row."""
    with pytest.raises(InvalidInputError) as caught:
        price(
            Option(row["option_type"], row["strike"], row["expiry"], row["exercise"]),
            Market(row["spot"], row["rate"], row["volatility"], row["dividend_yield"]),
            tolerance=tolerance,
        )
    return caught.value


def in_a_column(field: str, cell: object) -> dict[str, object]:
    """Return three rows, the middle one with the cell."""
    column = np.array([ROW[field], None, ROW[field]], dtype=object)
    column[1] = cell
    return {**ROW, field: column}


def assert_only_the_middle_row_is_nan(book: Book) -> None:
    for name in NUMBERS:
        np.testing.assert_array_equal(np.isnan(getattr(book, name)), [False, True, False])


BAD_CELLS = [
    ("option_type", "straddle"),
    ("option_type", "Put"),
    ("option_type", None),
    ("exercise", "bermudan"),
    ("exercise", ""),
    ("strike", 0.0),
    ("strike", -1.0),
    ("strike", 1e-31),
    ("strike", 1e31),
    ("strike", "90"),
    ("strike", None),
    ("strike", True),
    ("spot", -1e-9),
    ("spot", math.inf),
    ("spot", math.nan),
    ("spot", [100.0]),
    ("expiry", -1.0),
    ("expiry", 201.0),
    ("rate", -0.51),
    ("rate", 2.01),
    ("rate", 10**400),
    ("dividend_yield", 3.0),
    ("dividend_yield", 1j),
    ("volatility", -0.2),
    ("volatility", 15.1),
    ("volatility", math.nan),
]


@pytest.mark.parametrize(("field", "cell"), BAD_CELLS, ids=str)
def test_a_bad_cell_is_refused_in_the_words_of_the_single_contract(field, cell):
    book, reasons = read_book(in_a_column(field, cell), 1e-6)
    expected = refused_alone({**ROW, field: cell})
    assert list(reasons) == [1]
    assert str(reasons[1]) == str(expected)
    assert reasons[1].field == expected.field == field
    assert_only_the_middle_row_is_nan(book)


@pytest.mark.parametrize("cell", [-1.0, math.nan, math.inf, 1e31])
def test_a_bad_number_in_a_column_of_floats_is_refused_alike(cell):
    book, reasons = read_book({**ROW, "spot": np.array([100.0, cell, 100.0])}, 1e-6)
    assert str(reasons[1]) == str(refused_alone({**ROW, "spot": cell}))
    assert_only_the_middle_row_is_nan(book)


def test_of_several_faults_the_one_of_the_single_contract_is_told():
    row = {**ROW, "option_type": "straddle", "strike": -1.0, "spot": math.nan, "volatility": -1.0}
    _, reasons = read_book({**row, "tolerance": 5.0}, 1e-6)
    assert str(reasons[0]) == str(refused_alone(row))


@pytest.mark.parametrize("tolerance", [1e-9, 0.02, 0.0, -1.0, math.nan, "1e-4", None])
def test_a_tolerance_out_of_range_is_the_fault_of_its_row(tolerance):
    column = np.array([1e-4, tolerance, 1e-4], dtype=object)
    book, reasons = read_book({**ROW, "tolerance": column}, 1e-6)
    assert str(reasons[1]) == str(refused_alone(ROW, tolerance))
    assert reasons[1].field == "tolerance"
    assert_only_the_middle_row_is_nan(book)


@pytest.mark.parametrize(
    ("spot", "strike"), [(1.0000001e30, 1.0), (1e20, 1e-15), (1e-20, 1e15), (1e-29, 1e30)]
)
def test_spot_and_strike_too_far_apart_are_refused(spot, strike):
    row = {**ROW, "spot": spot, "strike": strike}
    _, reasons = read_book(row, 1e-6)
    assert str(reasons[0]) == str(refused_alone(row))
    assert reasons[0].field == "spot"


@pytest.mark.parametrize(
    ("spot", "strike"), [(1e30, 1.0), (1e15, 1e-15), (1e-15, 1e15), (0.0, 1e30), (0.0, 1e-30)]
)
def test_spot_and_strike_as_far_apart_as_allowed_are_read(spot, strike):
    book, reasons = read_book({**ROW, "spot": spot, "strike": strike}, 1e-6)
    assert not reasons
    assert (book.spot[0], book.strike[0]) == (spot, strike)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("spot", 0.0),
        ("strike", 1e-30),
        ("expiry", 0.0),
        ("expiry", 200.0),
        ("rate", -0.5),
        ("rate", 2.0),
        ("dividend_yield", -0.5),
        ("dividend_yield", 2.0),
        ("volatility", 0.0),
        ("volatility", 15.0),
        ("tolerance", 1e-8),
        ("tolerance", 1e-2),
    ],
)
def test_the_ends_of_every_range_are_allowed(field, value):
    row = {**ROW, "spot": 1e-10, field: value}
    book, reasons = read_book(row, 1e-6)
    assert not reasons
    assert getattr(book, field).tolist() == [value]


def test_scalars_are_repeated_and_defaults_filled_in():
    columns = {
        "option_type": "call",
        "spot": [90.0, 100.0],
        "strike": 100,
        "expiry": 1,
        "rate": 0.05,
        "volatility": 0.2,
    }
    book, reasons = read_book(columns, 1e-4)
    assert not reasons
    assert book.is_put.tolist() == [False, False]
    assert book.is_american.tolist() == [True, True]
    assert book.dividend_yield.tolist() == [0.0, 0.0]
    assert book.tolerance.tolist() == [1e-4, 1e-4]
    assert book.strike.dtype == np.float64
    assert book.option(1) == Option("call", 100.0, 1.0)
    assert book.market(0) == Market(90.0, 0.05, 0.2)


def test_a_column_of_texts_and_numbers_of_many_types_is_read():
    cells = [np.float32(100.0), 100, np.int64(100), Fraction(100), np.array(100.0)]
    column = np.empty(5, dtype=object)
    column[:] = cells
    types = np.array(["put", "call", "put", "call", "put"], dtype=object)
    book, reasons = read_book({**ROW, "spot": column, "option_type": types}, 1e-6)
    assert not reasons
    assert book.spot.tolist() == [100.0] * 5
    assert book.is_put.tolist() == [True, False, True, False, True]


def test_tables_are_read_without_changing_them():
    spot = np.array([100.0, -1.0])
    types = np.array(["put", "call"], dtype=object)
    book, reasons = read_book({**ROW, "spot": spot, "option_type": types}, 1e-6)
    assert list(reasons) == [1]
    assert spot.tolist() == [100.0, -1.0]
    book.spot[0] = 0.0
    assert spot[0] == 100.0


@pytest.mark.parametrize("name", ["option_type", "spot", "strike", "expiry", "rate", "volatility"])
def test_a_missing_column_is_named(name):
    with pytest.raises(InvalidInputError, match=f"{name} = 'missing': must be given as a column or a scalar"):
        read_book({key: value for key, value in ROW.items() if key != name}, 1e-6)


def test_an_unknown_column_is_named():
    with pytest.raises(InvalidInputError, match="columns = 'vol': must be named option_type, exercise, spot"):
        read_book({**ROW, "vol": 0.2}, 1e-6)


@pytest.mark.parametrize("rate", [[0.05, 0.05], [[0.05, 0.05, 0.05]], []])
def test_columns_of_different_lengths_are_refused(rate):
    with pytest.raises(InvalidInputError, match="must be scalars and vectors of one length") as caught:
        read_book({**ROW, "spot": [90.0, 100.0, 110.0], "rate": rate}, 1e-6)
    assert caught.value.field == "columns"


def test_a_single_contract_makes_a_book_of_one_row():
    option, market = Option("call", 90.0, 0.5, "european"), Market(100.0, 0.05, 0.2, 0.01)
    book = single_row(option, market, 1e-5)
    assert (book.option(0), book.market(0), book.tolerance[0]) == (option, market, 1e-5)


def test_taking_and_slicing_keep_the_rows_together():
    book, _ = read_book({**ROW, "spot": [90.0, 100.0, 110.0], "strike": [1.0, 2.0, 3.0]}, 1e-6)
    taken, sliced = book.take(np.array([2, 0])), book.slice(slice(1, 3))
    assert (taken.spot.tolist(), taken.strike.tolist()) == ([110.0, 90.0], [3.0, 1.0])
    assert (sliced.spot.tolist(), sliced.strike.tolist()) == ([100.0, 110.0], [2.0, 3.0])
    assert np.shares_memory(sliced.spot, book.spot)


class Ungrateful:
    """A cell that raises what it likes."""

    def __float__(self) -> float:
        raise RuntimeError("no")


@pytest.mark.parametrize(
    "cell",
    [Ungrateful(), np.bool_(True), np.timedelta64(100, "ns"), np.datetime64("2026-01-01"), 1j, [], None],
)
def test_a_cell_that_is_no_number_costs_its_row_alone(cell):
    spot = np.array([100.0, None, 90.0], dtype=object)
    spot[1] = cell
    book, reasons = read_book({**ROW, "spot": spot}, 1e-6)
    assert list(reasons) == [1]
    assert reasons[1].field == "spot"
    assert np.isnan(book.spot).tolist() == [False, True, False]


@pytest.mark.parametrize("kind", ["m8[ns]", "m8[D]", "M8[s]", "?"])
def test_a_column_of_durations_dates_or_truth_values_holds_no_numbers(kind):
    book, reasons = read_book({**ROW, "spot": np.array([1, 1]).astype(kind)}, 1e-6)
    assert [reason.field for reason in reasons.values()] == ["spot", "spot"]
    assert np.isnan(book.spot).all()


@pytest.mark.parametrize("columns", [None, [1.0], "spot", 7])
def test_columns_are_a_mapping(columns):
    with pytest.raises(InvalidInputError, match=r"columns = .*: must be a mapping of names to columns"):
        read_book(columns, 1e-6)


@pytest.mark.parametrize("cell", ["a", True, np.bool_(True)])
def test_a_list_of_mixed_cells_costs_the_odd_one_alone(cell):
    book, reasons = read_book({**ROW, "spot": [100.0, cell, 90]}, 1e-6)
    assert list(reasons) == [1]
    assert np.isnan(book.spot).tolist() == [False, True, False]
