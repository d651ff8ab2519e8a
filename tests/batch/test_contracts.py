import math

import pyarrow as pa
import pytest

from pricing_core.american import Option
from pricing_core.batch.chunk import Chunk
from pricing_core.batch.contracts import explain, read_contracts
from pricing_core.batch.schema import UNSUPPORTED_COLUMNS
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


@pytest.mark.parametrize("field", UNSUPPORTED_COLUMNS)
def test_a_word_of_the_vocabulary_that_is_not_supported_is_never_ignored(field: str) -> None:
    fault = read_contracts(chunk(**{field: "0.5"}), 1e-6).faults[0]
    assert (fault.field, fault.allowed) == (field, "empty: this version does not support it")


@pytest.mark.parametrize("cell", ["", "  ", None, []])
def test_an_empty_cell_of_such_a_column_is_harmless(cell: object) -> None:
    assert read_contracts(chunk(cash_dividends=cell), 1e-6).faults == {}


def test_what_the_contract_refuses_is_explained_by_field() -> None:
    fault = explain(read_contracts(chunk(strike="-5"), 1e-6).row(0))
    with pytest.raises(InvalidInputError) as caught:
        Option("put", -5.0, 1.0)
    assert fault is not None
    assert (fault.field, fault.allowed) == ("strike", caught.value.allowed)
    assert explain(read_contracts(chunk(), 1e-6).row(0)) is None
