"""Tables of contracts: every row is read, or refused in the words of the single contract."""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from pricing_core.american import CashDividend, Market, Option, PiecewiseConstant, price
from pricing_core.american.book.book import Book
from pricing_core.american.book.reading import ReadBook, read_book
from pricing_core.errors import InvalidInputError
from tests.problems.schedules import terms_of

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


def numbers(read: ReadBook, name: str) -> np.ndarray:
    """Return a column of what was read, in the order of the table's rows."""
    order, book = np.argsort(read.rows), read.book
    if name == "tolerance":
        return read.tolerance[order]
    owner = book if name in ("is_put", "spot", "strike", "expiry", "escrowed") else book.now
    return np.asarray(getattr(owner, name))[order]


def assert_only_the_middle_row_is_missing(read: ReadBook) -> None:
    assert (read.count, read.book.count) == (3, 2)
    assert sorted(read.rows.tolist()) == [0, 2]
    for name in NUMBERS:
        assert np.isfinite(numbers(read, name)).all()


def contracts_of(read: ReadBook) -> dict[int, object]:
    """Return the contracts that were read, by row of the table."""
    return {row: terms_of(read.book, place) for place, row in enumerate(read.rows.tolist())}


def expected_of(contracts: dict[int, tuple[Option, Market]]) -> dict[int, object]:
    """Return the same of contracts that were made one by one."""
    return {row: terms_of(Book.of([contract])) for row, contract in contracts.items()}


BAD_CELLS = [
    ("option_type", "straddle"),
    ("option_type", "Putt"),
    ("option_type", None),
    ("exercise", "bermudan"),  # without exercise times
    ("exercise", "sometimes"),
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
    read = read_book(in_a_column(field, cell), 1e-6)
    expected = refused_alone({**ROW, field: cell})
    assert list(read.faults) == [1]
    assert str(read.faults[1]) == str(expected)
    assert read.faults[1].field == expected.field
    assert_only_the_middle_row_is_missing(read)


@pytest.mark.parametrize("cell", [-1.0, math.nan, math.inf, 1e31])
def test_a_bad_number_in_a_column_of_floats_is_refused_alike(cell):
    read = read_book({**ROW, "spot": np.array([100.0, cell, 100.0])}, 1e-6)
    assert str(read.faults[1]) == str(refused_alone({**ROW, "spot": cell}))
    assert_only_the_middle_row_is_missing(read)


def test_of_several_faults_the_one_of_the_single_contract_is_told():
    row = {**ROW, "option_type": "straddle", "strike": -1.0, "spot": math.nan, "volatility": -1.0}
    read = read_book({**row, "tolerance": 5.0}, 1e-6)
    assert str(read.faults[0]) == str(refused_alone(row))


@pytest.mark.parametrize("tolerance", [1e-9, 0.02, 0.0, -1.0, math.nan, "1e-4", None])
def test_a_tolerance_out_of_range_is_the_fault_of_its_row(tolerance):
    column = np.array([1e-4, tolerance, 1e-4], dtype=object)
    read = read_book({**ROW, "tolerance": column}, 1e-6)
    assert str(read.faults[1]) == str(refused_alone(ROW, tolerance))
    assert read.faults[1].field == "tolerance"
    assert_only_the_middle_row_is_missing(read)


@pytest.mark.parametrize(
    ("spot", "strike"), [(1.0000001e30, 1.0), (1e20, 1e-15), (1e-20, 1e15), (1e-29, 1e30)]
)
def test_spot_and_strike_too_far_apart_are_refused(spot, strike):
    row = {**ROW, "spot": spot, "strike": strike}
    read = read_book(row, 1e-6)
    assert str(read.faults[0]) == str(refused_alone(row))
    assert read.faults[0].field == "spot"


@pytest.mark.parametrize(
    ("spot", "strike"), [(1e30, 1.0), (1e15, 1e-15), (1e-15, 1e15), (0.0, 1e30), (0.0, 1e-30)]
)
def test_spot_and_strike_as_far_apart_as_allowed_are_read(spot, strike):
    read = read_book({**ROW, "spot": spot, "strike": strike}, 1e-6)
    assert not read.faults
    assert (read.book.spot[0], read.book.strike[0]) == (spot, strike)


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
    read = read_book(row, 1e-6)
    assert not read.faults
    assert numbers(read, field).tolist() == [value]


def test_scalars_are_repeated_and_defaults_filled_in():
    columns = {
        "option_type": "call",
        "spot": [90.0, 100.0],
        "strike": 100,
        "expiry": 1,
        "rate": 0.05,
        "volatility": 0.2,
    }
    read = read_book(columns, 1e-4)
    assert not read.faults
    assert read.book.strike.dtype == np.float64
    assert numbers(read, "dividend_yield").tolist() == [0.0, 0.0]
    assert read.tolerance.tolist() == [1e-4, 1e-4]
    option = Option("call", 100.0, 1.0)
    contracts = {row: (option, Market(spot, 0.05, 0.2)) for row, spot in enumerate((90.0, 100.0))}
    assert contracts_of(read) == expected_of(contracts)


def test_a_column_of_texts_and_numbers_of_many_types_is_read():
    cells = [np.float32(100.0), 100, np.int64(100), Fraction(100), np.array(100.0)]
    column = np.empty(5, dtype=object)
    column[:] = cells
    types = np.array(["put", "call", "put", "call", "put"], dtype=object)
    read = read_book({**ROW, "spot": column, "option_type": types}, 1e-6)
    assert not read.faults
    assert read.book.spot.tolist() == [100.0] * 5
    assert read.book.is_put.tolist() == [True, False, True, False, True]


def test_tables_are_read_without_changing_them():
    spot = np.array([100.0, -1.0])
    types = np.array(["put", "call"], dtype=object)
    read = read_book({**ROW, "spot": spot, "option_type": types}, 1e-6)
    assert list(read.faults) == [1]
    assert spot.tolist() == [100.0, -1.0]
    assert read.book.spot.tolist() == [100.0]
    assert not np.shares_memory(read.book.spot, spot)
    clean = np.array([100.0, 90.0])
    assert not np.shares_memory(read_book({**ROW, "spot": clean}, 1e-6).book.spot, clean)


@pytest.mark.parametrize("name", ["option_type", "spot", "strike", "expiry", "rate", "volatility"])
def test_a_missing_column_is_named(name):
    with pytest.raises(InvalidInputError, match=rf"^{name} \(.*\) is missing"):
        read_book({key: value for key, value in ROW.items() if key != name}, 1e-6)


def test_an_unknown_column_is_named():
    with pytest.raises(InvalidInputError, match=r"there is no column 'vol': did you mean volatility\?"):
        read_book({**ROW, "vol": 0.2}, 1e-6)


@pytest.mark.parametrize("rate", [[0.05, 0.05], [[0.05, 0.05, 0.05]], []])
def test_columns_of_different_lengths_are_refused(rate):
    with pytest.raises(InvalidInputError, match="must be scalars and vectors of one length") as caught:
        read_book({**ROW, "spot": [90.0, 100.0, 110.0], "rate": rate}, 1e-6)
    assert caught.value.field == "columns"


def test_the_columns_unlike_the_others_are_named_the_shortest_first():
    columns = {**ROW, "spot": [90.0, 100.0, 110.0], "strike": [1.0, 2.0, 3.0], "rate": [0.0] * 4}
    with pytest.raises(InvalidInputError) as caught:
        read_book({**columns, "volatility": [0.2, 0.3], "expiry": [[1.0, 2.0]]}, 1e-6)
    assert str(caught.value) == (
        "columns = lengths 2, 3, 4: must be scalars and vectors of one length: 3 as most have, "
        "not expiry, shape (1, 2), of 2, volatility 2, rate 4"
    )


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
    read = read_book({**ROW, "spot": spot}, 1e-6)
    assert list(read.faults) == [1]
    assert read.faults[1].field == "spot"
    assert sorted(read.rows.tolist()) == [0, 2]


@pytest.mark.parametrize("kind", ["m8[ns]", "m8[D]", "M8[s]", "?"])
def test_a_column_of_durations_dates_or_truth_values_holds_no_numbers(kind):
    read = read_book({**ROW, "spot": np.array([1, 1]).astype(kind)}, 1e-6)
    assert [reason.field for reason in read.faults.values()] == ["spot", "spot"]
    assert read.book.count == 0


@pytest.mark.parametrize("columns", [None, [1.0], "spot", 7])
def test_columns_are_a_mapping(columns):
    with pytest.raises(InvalidInputError, match=r"columns = .*: must be a mapping of names to columns"):
        read_book(columns, 1e-6)


@pytest.mark.parametrize("cell", ["a", True, np.bool_(True)])
def test_a_list_of_mixed_cells_costs_the_odd_one_alone(cell):
    read = read_book({**ROW, "spot": [100.0, cell, 90]}, 1e-6)
    assert list(read.faults) == [1]
    assert sorted(read.rows.tolist()) == [0, 2]


CURVE = {"times": [0.5, 1.0], "values": [0.1, 0.2]}
DIVIDEND = {"time": 0.5, "amount": 1.0}
THREE = {**ROW, "spot": [90.0, 100.0, 110.0]}


def assert_same_contracts(read: ReadBook, other: ReadBook) -> None:
    assert contracts_of(read) == contracts_of(other)
    np.testing.assert_array_equal(numbers(read, "tolerance"), numbers(other, "tolerance"))


@pytest.mark.parametrize(
    "columns",
    [
        {"cash_dividends": []},
        {"cash_dividends": [None, [], "[]"]},
        {"cash_dividends": [math.nan, (), ""], "dividend_model": ["spot", None, "escrowed"]},
        {"cash_dividends": [{"time": 0.0, "amount": 1.0}, {"time": 1.5, "amount": 1.0}]},
        {
            "cash_dividends": [{"time": 0.5, "amount": 0.0}],
            "proportional_dividends": [{"time": 0.5, "fraction": 0}],
        },
        {"exercise_times": [None, [], np.array([])], "exercise_start": [0.0, None, math.nan]},
        {"exercise_start": np.zeros(3)},
        {"rate": {"times": [0.5, 2.0], "values": [0.05, 0.05]}},
        {
            "rate": [
                0.05,
                {"times": [1.0, 2.0], "values": [0.05, 0.1]},
                '{"times": [1, 2], "values": [0.05, 0]}',
            ]
        },
        {"valuation_date": None, "expiration_date": [None, "", math.nan]},
        {"expiry": None, "valuation_date": "2026-01-01", "expiration_date": "2027-01-01"},
        {
            "expiry": [1.0, None, math.nan],
            "valuation_date": [None, "2026-01-01", "2025-01-01T12:00"],
            "expiration_date": [None, "2027-01-01", "2026-01-01T12:00"],
        },
    ],
    ids=str,
)
def test_columns_of_events_without_events_leave_the_plain_numbers(columns):
    read = read_book({**THREE, **columns}, 1e-6)
    assert not read.faults
    assert read.book.is_plain
    assert_same_contracts(read, read_book(THREE, 1e-6))


def test_dates_may_take_the_place_of_the_column_of_expiries():
    dates = {
        "valuation_date": np.datetime64("2026-01-01"),
        "expiration_date": np.array(["2027-01-01"] * 3, "M8[ns]"),
    }
    read = read_book({name: THREE[name] for name in THREE if name != "expiry"} | dates, 1e-6)
    assert not read.faults
    assert_same_contracts(read, read_book(THREE, 1e-6))


def test_an_option_exercised_at_expiry_only_is_a_plain_european_one():
    times = {"exercise": ["bermudan", "american", "european"], "exercise_times": [[1.0], None, None]}
    read = read_book({**THREE, **times, "exercise_start": [0.0, 1.0, 0.0]}, 1e-6)
    assert not read.faults
    assert read.book.is_simple
    wanted = read_book({**THREE, "exercise": "european"}, 1e-6)
    for name in (*NUMBERS, "is_put", "exercisable"):
        np.testing.assert_array_equal(numbers(read, name), numbers(wanted, name))


def test_rows_with_and_without_events_stand_in_one_book():
    columns = {
        "exercise": ["bermudan", "american", "american", "american", "american"],
        "exercise_times": [[0.5, 1.0], None, None, None, None],
        "exercise_start": [0.0, 0.5, 0.0, 0.0, 0.0],
        "rate": [0.05, 0.05, CURVE, 0.05, 0.05],
        "cash_dividends": [None, None, None, [DIVIDEND], None],
        "tolerance": [1e-3, 1e-3, 1e-4, 1e-3, 1e-5],
    }
    read = read_book({**ROW, **columns}, 1e-6)
    assert not read.faults
    market = Market(100.0, 0.05, 0.2, 0.02)
    contracts = {
        0: (Option("put", 90.0, 1.0, "bermudan", (0.5, 1.0)), market),
        1: (Option("put", 90.0, 1.0, exercise_start=0.5), market),
        2: (Option("put", 90.0, 1.0), Market(100.0, PiecewiseConstant(**CURVE), 0.2, 0.02)),
        3: (Option("put", 90.0, 1.0), Market(100.0, 0.05, 0.2, 0.02, (CashDividend(0.5, 1.0),))),
        4: (Option("put", 90.0, 1.0), market),
    }
    assert contracts_of(read) == expected_of(contracts)
    assert numbers(read, "tolerance").tolist() == [1e-3, 1e-3, 1e-4, 1e-3, 1e-5]
    listed = Book.of([contracts[row] for row in read.rows.tolist()]).listed
    for name in ("cash_dividends", "rate", "dividend_yield", "volatility"):
        found, wanted = getattr(read.book.listed, name), getattr(listed, name)
        assert [found.row(place) for place in range(5)] == [wanted.row(place) for place in range(5)], name


@pytest.mark.parametrize(
    "dividends", [[DIVIDEND], (CashDividend(0.5, 1.0),), '[{"time": 0.5, "amount": 1.0}]']
)
def test_one_list_of_dividends_serves_all_rows(dividends):
    read = read_book({**THREE, "cash_dividends": dividends}, 1e-6)
    market = Market(100.0, 0.05, 0.2, 0.02, (CashDividend(0.5, 1.0),))
    option = Option("put", 90.0, 1.0)
    contracts = {row: (option, replace(market, spot=spot)) for row, spot in enumerate(THREE["spot"])}
    assert contracts_of(read) == expected_of(contracts)


@pytest.mark.parametrize("times", [[0.5, 0.25, 1.0], (0.25, 0.5, 1.0), np.array([0.25, 0.5, 1.0])])
def test_one_list_of_times_serves_all_rows_whatever_its_length(times):
    read = read_book({**THREE, "exercise": "bermudan", "exercise_times": times}, 1e-6)
    assert read.book.segments.end.tolist() == [0.25, 0.5, 1.0] * 3
    assert read.book.segments.exercise_at_end.all()


@pytest.mark.parametrize("times", [[[0.5, 0.6]] * 3, np.array([[0.5, 0.6]] * 3), ["[0.5, 0.6]"] * 3])
def test_a_column_of_lists_of_one_length_is_no_matrix(times):
    read = read_book({**THREE, "exercise": "bermudan", "exercise_times": times}, 1e-6)
    assert read.book.segments.end.tolist() == [0.5, 0.6, 1.0] * 3


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        (
            {"cash_dividends": [DIVIDEND, {"time": 0.5, "amount": -1.0}]},
            "cash_dividends[1].amount = -1.0: must be a number from 0 to 1e+30",
        ),
        ({"cash_dividends": "[{]"}, "cash_dividends = '[{]': must be a list of"),
        ({"cash_dividends": [[[0.5, 1.0, 2.0]]]}, "cash_dividends[0] = [[0.5, 1.0, 2.0]]: must be"),
        (
            {"cash_dividends": [{"time": 0.5, "amount": 200.0}], "dividend_model": "escrowed"},
            "must be worth less today than the spot in the escrowed model",
        ),
        ({"dividend_model": "other"}, "dividend_model = 'other': must be"),
        ({"rate": {"times": [1.0]}}, "rate = {'times': [1.0]}: must be a number or"),
        (
            {"volatility": {"times": [1.0], "values": [-1.0]}},
            "volatility.values = -1.0: must be a number from 0",
        ),
        ({"exercise_times": [0.5]}, 'exercise_times = [0.5]: must be empty unless exercise is "bermudan"'),
        ({"exercise_start": True}, "exercise_start = True: must be a number from 0 to 200"),
        ({"exercise_start": 2.0}, "exercise_start = 2.0: must be at most the expiry, 1"),
        ({"valuation_date": "2026-01-01"}, "expiry = 1.0: must be left out where dates are given"),
        (
            {"expiry": None, "valuation_date": "2026-01-01"},
            "expiration_date is missing: valuation_date needs it",
        ),
        (
            {"expiry": None, "valuation_date": "x", "expiration_date": "y"},
            "valuation_date = 'x': must be an ISO",
        ),
        (
            {"expiry": None, "valuation_date": ["x"], "expiration_date": "y"},
            "valuation_date = ['x']: must be an ISO",
        ),
        (
            {"expiry": None, "valuation_date": {1}, "expiration_date": "y"},
            "valuation_date = {1}: must be an ISO",
        ),
        ({"expiry": None}, "expiry is missing: give it, or valuation_date and expiration_date"),
        ({"rate": 1j}, "rate = 1j: must be a number from -0.5 to 2"),
        ({"spot": [100.0]}, "spot = [100.0]: must be a number from 0 to 1e+30"),
        (
            {"exercise": np.array([])},
            'exercise = array([], dtype=float64): must be "american", "european" or "bermudan"',
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_bad_cell_of_an_event_costs_its_row_alone(cells, message):
    columns = {name: [cell, ROW.get(name)] for name, cell in cells.items()}
    read = read_book({**ROW, **columns}, 1e-6)
    assert list(read.faults) == [0]
    assert message in str(read.faults[0])
    assert read.rows.tolist() == [1]
    assert read.book.is_plain


def test_what_is_kept_of_a_fault_is_small():
    """A table of a million rows at fault would keep as many texts, and the calls that led to each."""
    fault = read_book({**ROW, "option_type": "x" * 16_000}, 1e-6).faults[0]
    assert len(fault.value) == 200
    assert fault.__traceback__ is None
    assert fault.__context__ is None
