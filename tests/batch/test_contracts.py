import datetime as dt
import math

import pyarrow as pa
import pytest

from pricing_core.american import Option
from pricing_core.batch.chunk import Chunk
from pricing_core.batch.contracts import explain, read_contracts
from pricing_core.errors import InvalidInputError

SOUND = {
    "option_type": "put",
    "spot": "100",
    "strike": "100",
    "expiry": "1",
    "rate": "0.05",
    "volatility": "0.2",
}


def chunk(**cells: object) -> Chunk:
    table = pa.RecordBatch.from_pylist([SOUND | cells])
    return Chunk([2], table)


def test_empty_optional_cells_take_their_defaults() -> None:
    contracts = read_contracts(chunk(exercise="", dividend_yield=None, tolerance=" "), 1e-5)
    assert (
        contracts.row(0).items() >= {"exercise": "american", "dividend_yield": 0.0, "tolerance": 1e-5}.items()
    )
    assert contracts.faults == {}


def test_stated_optional_cells_are_read() -> None:
    contracts = read_contracts(chunk(exercise="european", dividend_yield="0.02", tolerance="1e-4"), 1e-6)
    assert (
        contracts.row(0).items()
        >= {"exercise": "european", "dividend_yield": 0.02, "tolerance": 1e-4}.items()
    )


@pytest.mark.parametrize("field", list(SOUND))
def test_an_empty_required_cell_is_a_fault_of_its_field(field: str) -> None:
    fault = read_contracts(chunk(**{field: ""}), 1e-6).faults[0]
    assert (fault.field, fault.value) == (field, "")


def test_nan_in_a_column_of_numbers_is_a_missing_cell() -> None:
    contracts = read_contracts(chunk(dividend_yield=math.nan, exercise_start=math.nan), 1e-6)
    assert contracts.row(0)["dividend_yield"] == 0.0
    assert contracts.faults == {}
    fault = read_contracts(chunk(spot=math.nan), 1e-6).faults[0]
    assert (fault.field, fault.allowed) == ("spot", "given (money)")


@pytest.mark.parametrize("tolerance", ["0", "1e-9", "0.1", "-1e-6"])
def test_a_tolerance_out_of_range_is_a_fault(tolerance: str) -> None:
    assert read_contracts(chunk(tolerance=tolerance), 1e-6).faults[0].field == "tolerance"


@pytest.mark.parametrize("cell", ["", "  ", None, []])
def test_an_empty_cell_of_an_optional_column_is_not_given(cell: object) -> None:
    contracts = read_contracts(chunk(cash_dividends=cell), 1e-6)
    assert contracts.row(0)["cash_dividends"] is None
    assert contracts.faults == {}


@pytest.mark.parametrize(
    ("field", "cell", "read"),
    [
        ("rate", " 0.05 ", 0.05),
        ("rate", ' {"times": [1], "values": [0]} ', '{"times": [1], "values": [0]}'),
        ("volatility", {"times": [1.0], "values": [0.2]}, {"times": [1.0], "values": [0.2]}),
        ("exercise_times", " [0.5] ", "[0.5]"),
        ("cash_dividends", [{"time": 0.5, "amount": 1.0}], [{"time": 0.5, "amount": 1.0}]),
        ("exercise_start", "0.5", 0.5),
        ("dividend_model", " spot ", "spot"),
        ("valuation_date", " 2026-01-01 ", "2026-01-01"),
        ("valuation_date", dt.date(2026, 1, 1), dt.date(2026, 1, 1)),
        ("expiration_date", dt.datetime(2026, 1, 1, 12), dt.datetime(2026, 1, 1, 12)),
    ],
    ids=repr,
)
def test_a_cell_of_an_event_is_passed_on_for_the_contract_to_read(
    field: str, cell: object, read: object
) -> None:
    contracts = read_contracts(chunk(**{field: cell}), 1e-6)
    assert contracts.row(0)[field] == read
    assert contracts.faults == {}


@pytest.mark.parametrize("field", ["rate", "exercise_start"])
@pytest.mark.parametrize("cell", ["1_0", "[0.5]", "x"])
def test_a_cell_that_is_neither_number_nor_curve_is_a_fault(field: str, cell: str) -> None:
    fault = read_contracts(chunk(**{field: cell}), 1e-6).faults[0]
    assert (fault.field, fault.allowed) == (field, "a number such as 0.05 or 5e-2")


def test_an_expiry_may_be_left_empty_where_there_are_dates() -> None:
    contracts = read_contracts(
        chunk(expiry="", valuation_date="2026-01-01", expiration_date="2027-01-01"), 1e-6
    )
    assert contracts.faults == {}
    assert explain(contracts.row(0)) is None
    fault = explain(read_contracts(chunk(expiry="", valuation_date="", expiration_date=""), 1e-6).row(0))
    assert fault is not None
    assert (fault.field, fault.allowed) == ("expiry", "given, or valuation_date and expiration_date")


def test_nanoseconds_of_a_timestamp_are_dropped() -> None:
    moment = pa.array([1_767_225_600_000_000_001], pa.timestamp("ns", "Europe/Berlin"))
    columns = {name: pa.array([cell]) for name, cell in SOUND.items()}
    table = pa.RecordBatch.from_pydict({**columns, "valuation_date": moment})
    row = read_contracts(Chunk([2], table), 1e-6).row(0)
    assert row["valuation_date"] == dt.datetime(2026, 1, 1, tzinfo=dt.UTC)


def test_what_the_contract_refuses_is_explained_by_field() -> None:
    fault = explain(read_contracts(chunk(strike="-5"), 1e-6).row(0))
    with pytest.raises(InvalidInputError) as caught:
        Option("put", -5.0, 1.0)
    assert fault is not None
    assert (fault.field, fault.allowed) == ("strike", caught.value.allowed)
    assert explain(read_contracts(chunk(), 1e-6).row(0)) is None


@pytest.mark.parametrize(
    "dates",
    [
        pa.array([20_454, 10**7], pa.date32()),
        pa.array([1_767_225_600, 10**12], pa.timestamp("s")),
        pa.array([1_767_225_600_000, -(10**17)], pa.timestamp("ms", "Asia/Tokyo")),
    ],
    ids=lambda dates: str(dates.type),
)
def test_a_date_that_python_does_not_have_costs_its_row_alone(dates: pa.Array) -> None:
    columns = {name: pa.array([cell, cell]) for name, cell in SOUND.items() if name != "expiry"}
    table = pa.RecordBatch.from_pydict({**columns, "valuation_date": dates, "expiration_date": dates})
    chunk = Chunk([2, 3], table)
    contracts = read_contracts(chunk, 1e-6)
    assert explain(contracts.row(0)) is None
    fault = explain(contracts.row(1))
    assert fault is not None
    assert fault.field == "valuation_date"
    assert chunk.cell(1, "valuation_date") == str(dates[1].value)
