import pyarrow as pa
import pytest

from pricing_core.american.arrow.schema import check_names, check_results, check_types, result_schema
from pricing_core.american.contracts.fields import COLUMN_FIELDS
from pricing_core.errors import InvalidInputError

REQUIRED = [column.name for column in COLUMN_FIELDS if column.required]


def test_the_required_columns_are_enough_and_others_may_stand_between() -> None:
    check_names(REQUIRED)
    check_names(["id", *reversed(REQUIRED), "desk", ""])


@pytest.mark.parametrize("missing", REQUIRED)
def test_a_missing_column_is_named_with_its_unit(missing: str) -> None:
    with pytest.raises(InvalidInputError, match=rf"^{missing} \(.*\) is missing"):
        check_names([name for name in REQUIRED if name != missing])


def test_every_missing_column_is_named_in_one_message() -> None:
    with pytest.raises(InvalidInputError) as caught:
        check_names(["option_type", "spot", "rate"])
    assert str(caught.value) == (
        "strike (money), expiry (years; or valuation_date and expiration_date in its place) and "
        "volatility (1/sqrt(year)) are missing"
    )


def test_a_name_that_appears_twice_is_refused() -> None:
    with pytest.raises(InvalidInputError, match="column spot"):
        check_names([*REQUIRED, "spot"])


RESULTS = result_schema(REQUIRED).names


@pytest.mark.parametrize("name", RESULTS)
def test_an_input_column_may_not_have_the_name_of_a_result(name: str) -> None:
    with pytest.raises(InvalidInputError, match=f"column {name} has the name of a result"):
        check_results([*REQUIRED, name], RESULTS)


def test_the_name_of_a_result_is_free_where_there_is_no_such_result() -> None:
    names = [*REQUIRED, "delta", "dividend_sensitivities", "vanna"]
    check_results(names[:-3], RESULTS)
    check_results(names, result_schema(names, "none").names)
    for taken in (result_schema(names).names, result_schema([*names, "cash_dividends"], "extended").names):
        with pytest.raises(InvalidInputError, match=r"column delta has the name of a result"):
            check_results(names, taken)


def test_the_expiry_may_be_missing_where_both_dates_are_there() -> None:
    undated = [name for name in REQUIRED if name != "expiry"]
    check_names([*undated, "valuation_date", "expiration_date"])
    for date in ("valuation_date", "expiration_date"):
        with pytest.raises(InvalidInputError, match=r"^expiry \(years; or .* is missing"):
            check_names([*undated, date])


STRUCTURE = pa.struct([("times", pa.list_(pa.float64())), ("values", pa.list_(pa.float64()))])
DIVIDENDS = pa.list_(pa.struct([("time", pa.float64()), ("amount", pa.float64())]))


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("rate", pa.string()),
        ("volatility", STRUCTURE),
        ("dividend_yield", pa.float32()),
        ("cash_dividends", DIVIDENDS),
        ("cash_dividends", pa.string()),
        ("exercise_times", pa.large_list(pa.float64())),
        ("exercise_start", pa.int8()),
        ("valuation_date", pa.date32()),
        ("valuation_date", pa.timestamp("ns", "UTC")),
        ("expiration_date", pa.string()),
        ("proportional_dividends", pa.null()),
    ],
    ids=str,
)
def test_curves_lists_and_dates_may_be_stored_in_every_way(name: str, found: pa.DataType) -> None:
    check_types(pa.schema([(name, found)]))


@pytest.mark.parametrize(
    ("name", "found", "allowed"),
    [
        ("rate", pa.bool_(), "a column of numbers (double), or of text or structures for curves"),
        ("cash_dividends", pa.float64(), "a column of lists, or of text (string)"),
        ("exercise_times", STRUCTURE, "a column of lists, or of text (string)"),
        ("valuation_date", pa.int64(), "a column of dates, timestamps or text (string)"),
        (
            "exercise_start",
            pa.bool_(),
            "a column of numbers (double), or of dates, timestamps or text (string)",
        ),
    ],
    ids=str,
)
def test_what_cannot_hold_a_curve_a_list_or_a_date_is_refused(
    name: str, found: pa.DataType, allowed: str
) -> None:
    with pytest.raises(InvalidInputError, match=f"column {name}") as caught:
        check_types(pa.schema([(name, found)]))
    assert caught.value.allowed == allowed


@pytest.mark.parametrize("found", [pa.int32(), pa.float32(), pa.decimal128(10, 2), pa.null()])
def test_every_numeric_type_holds_a_number(found: pa.DataType) -> None:
    check_types(pa.schema([("spot", found)]))


@pytest.mark.parametrize("found", [pa.string(), pa.bool_(), pa.date32(), pa.list_(pa.float64())])
def test_a_column_of_another_type_is_named_with_its_type(found: pa.DataType) -> None:
    with pytest.raises(InvalidInputError, match=r"column spot = .*: must be a column of numbers"):
        check_types(pa.schema([("id", pa.string()), ("spot", found)]))


@pytest.mark.parametrize("found", [pa.string(), pa.large_string(), pa.dictionary(pa.int8(), pa.string())])
def test_text_may_be_stored_in_every_way(found: pa.DataType) -> None:
    check_types(pa.schema([("option_type", found)]))


def test_text_may_not_be_a_number() -> None:
    with pytest.raises(InvalidInputError, match=r"column option_type = 'int64': must be a column of text"):
        check_types(pa.schema([("option_type", pa.int64())]))


@pytest.mark.parametrize(
    ("name", "right"),
    [
        ("Dividend_Yield", "dividend_yield"),
        ("dividend yield", "dividend_yield"),
        ("dividend-yield", "dividend_yield"),
        ("dividendYield", "dividend_yield"),
        (" tolerance", "tolerance"),
        ("EXERCISE", "exercise"),
        ("Cash Dividends", "cash_dividends"),
        ("Spot", "spot"),
    ],
)
def test_another_spelling_of_a_column_is_refused_with_the_right_one(name: str, right: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        check_names([*REQUIRED, name])
    assert str(caught.value) == f"there is no column {name!r}: did you mean {right}?"


@pytest.mark.parametrize(
    ("misspelt", "right"),
    [("divdend_yield", "dividend_yield"), ("excercise", "exercise"), ("cash_dividend", "cash_dividends")],
)
def test_a_misspelt_optional_column_is_refused_with_the_right_word(misspelt, right):
    with pytest.raises(InvalidInputError, match=f"did you mean {right}"):
        check_names([*REQUIRED, misspelt])


def test_a_column_that_only_resembles_one_that_is_there_passes_through():
    check_names([*REQUIRED, "strikes", "dividend_yield", "dividend_yield_source"])
