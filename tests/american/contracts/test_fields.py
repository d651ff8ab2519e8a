"""Everything that states an input or an output states what the tables of fields state."""

import dataclasses
import inspect
import itertools
import math
from typing import get_args, get_type_hints

import pyarrow as pa
import pytest
import typer

from app import cli
from app.service import schemas
from app.service.contract_schema import MOST_DIVIDENDS, MOST_PIECES
from app.service.json_schema import inline_schema
from pricing_core.american import (
    CashDividend,
    ExerciseBoundary,
    ImpliedVolatility,
    Market,
    Option,
    PiecewiseConstant,
    ProportionalDividend,
    Valuation,
    contract_from,
    exercise_boundary,
    implied_carry,
    implied_volatility,
    implied_volatility_many,
    price,
    price_many,
    value_surface,
)
from pricing_core.american.arrow.schema import ARROW_TYPES, TYPES, check_names, result_schema
from pricing_core.american.book.prices import GREEK_LISTS, GREEKS, error_of
from pricing_core.american.contracts import fields
from pricing_core.american.contracts.fields import CONTRACT_FIELDS, INPUT_FIELDS, input_field
from pricing_core.american.contracts.result_fields import (
    ADVICE_FIELDS,
    BOUNDARY_ERROR_FIELD,
    BOUNDARY_FIELDS,
    GREEK_ERROR_FIELDS,
    IMPLIED_VOLATILITY_FIELDS,
    PRICE_FIELDS,
    PROVENANCE_FIELDS,
    SURFACE_FIELDS,
    UNITS_FIELD,
    price_fields,
)
from pricing_core.batch import run_batch
from pricing_core.errors import InvalidInputError, UnknownNameError

CONTRACT = {field.name: field.example for field in CONTRACT_FIELDS if field.required}
ENTRIES = {  # by the constructor that takes them
    CashDividend: (fields.EX_TIME, fields.AMOUNT),
    ProportionalDividend: (fields.EX_TIME, fields.FRACTION),
}
CONSTRUCTORS = {
    Option: [input_field(f.name) for f in dataclasses.fields(Option)],
    Market: [input_field(f.name) for f in dataclasses.fields(Market)],
    **ENTRIES,
}
LIMITED = [
    (kind, field)
    for kind, of_kind in CONSTRUCTORS.items()
    for field in of_kind
    if field.kind != "list" and any(map(math.isfinite, field.limits))
]
MODELS = (schemas.PriceRequest, schemas.BoundaryRequest, schemas.ImpliedVolatilityRequest)
FUNCTIONS = (price, price_many, exercise_boundary, implied_volatility, implied_volatility_many)


def by_name(values):
    return [value.name for value in values]


@pytest.mark.parametrize("field", INPUT_FIELDS, ids=lambda field: field.name)
def test_an_example_and_a_default_are_what_the_field_allows(field):
    for value in (field.example, field.default):
        if field.kind == "choice":
            assert value in field.choices or (value is field.default and field.required)
        if isinstance(value, float):
            assert field.check(value) == value


def test_every_name_is_there_once():
    prices = (*PRICE_FIELDS, BOUNDARY_ERROR_FIELD, *GREEK_ERROR_FIELDS)
    for table in (INPUT_FIELDS, prices, IMPLIED_VOLATILITY_FIELDS, BOUNDARY_FIELDS):
        assert len(set(by_name(table))) == len(table)


def test_every_greek_has_an_error_in_its_own_unit():
    greeks = [field for field in PRICE_FIELDS if field.is_greek]
    assert sorted(by_name(greeks)) == sorted((*GREEKS, *GREEK_LISTS))
    for greek, error in zip(greeks, GREEK_ERROR_FIELDS, strict=True):
        assert (error.name, error.of) == (error_of(greek.name), greek.name)
        assert (error.kind, error.unit, error.given, error.per) == (
            greek.kind,
            greek.unit,
            greek.given,
            greek.per,
        )
        assert error.meaning.startswith("Estimated absolute error of ")
        assert not error.is_greek


# Python


def test_options_and_markets_have_the_fields_of_the_table():
    names = [f.name for kind in (Option, Market) for f in dataclasses.fields(kind)]
    assert sorted(names) == sorted(field.name for field in CONTRACT_FIELDS if field.kind != "date")
    for kind, of_kind in CONSTRUCTORS.items():
        for own, field in zip(dataclasses.fields(kind), of_kind, strict=True):
            assert own.name == field.name
            if field is not fields.EXPIRY:  # dates may stand in its place
                assert (own.default is dataclasses.MISSING) == field.required
                assert field.required or own.default == field.default
    assert by_name(dataclasses.fields(PiecewiseConstant)) == by_name(fields.CURVE)


@pytest.mark.parametrize(("kind", "field"), LIMITED, ids=lambda value: getattr(value, "name", "of"))
def test_what_a_constructor_takes_ends_at_the_limits_which_its_documentation_states(kind, field):
    def made(number):
        given = {f.name: f.example for f in CONSTRUCTORS[kind] if f.required}
        if field is fields.EXERCISE_START:
            given |= {"expiry": fields.EXPIRY.most}
        if field is fields.FOREIGN_RATE:  # and the yield is to be 0
            given |= {"rate": min(max(number, fields.RATE.least), fields.RATE.most)}
        return getattr(kind(**given | {field.name: number}), field.name)

    for limit, beyond in ((field.least, -math.inf), (field.most, math.inf)):
        assert made(limit) == limit
        with pytest.raises(InvalidInputError) as caught:
            made(math.nextafter(limit, beyond))
        assert caught.value.field == field.name
    if field.kind in ("number", "curve") and kind in (Option, Market):
        stated = "{:g} to {:g}".format(*field.limits).replace("e+", "e")
        assert stated in inspect.getdoc(kind)


@pytest.mark.parametrize("kind", [Option, Market], ids=str)
def test_a_choice_is_one_of_those_of_the_table(kind):
    given = {f.name: f.example for f in CONSTRUCTORS[kind] if f.required}
    hints = get_type_hints(kind)
    for field in CONSTRUCTORS[kind]:
        if field.kind == "choice":
            assert get_args(hints[field.name]) == field.choices
            with pytest.raises(InvalidInputError, match=field.name) as caught:
                kind(**given | {field.name: "other"})
            assert caught.value.allowed == field.allowed


def test_lists_and_curves_are_as_long_as_the_table_allows():
    for field, entry in ((fields.CASH_DIVIDENDS, "amount"), (fields.PROPORTIONAL_DIVIDENDS, "fraction")):
        longest = [{"time": 0.5, entry: 0.5}] * field.most_entries
        assert len(getattr(contract_from(CONTRACT | {field.name: longest})[1], field.name)) == len(longest)
        with pytest.raises(InvalidInputError, match=f"at most {field.most_entries} dividends"):
            contract_from(CONTRACT | {field.name: [*longest, longest[0]]})
    times = [float(k + 1) for k in range(fields.KNOT_TIMES.most_entries)]
    assert PiecewiseConstant(times, times).times == tuple(times)
    with pytest.raises(InvalidInputError, match="times = 1001 entries: must be 1 to 1000 numbers"):
        PiecewiseConstant([*times, 1999.0], times)


def test_the_functions_have_the_defaults_of_the_table():
    for function in (*FUNCTIONS, implied_carry, value_surface, run_batch):
        assert inspect.signature(function).parameters["tolerance"].default == fields.TOLERANCE.default
    for function in (price, price_many, run_batch):
        assert inspect.signature(function).parameters["greeks"].default == fields.GREEKS.default
    for function in (price_many, run_batch):
        assert inspect.signature(function).parameters["greek_errors"].default is fields.GREEK_ERRORS.default
    for name in ("option_price", "bid", "ask"):
        assert inspect.signature(implied_volatility).parameters[name].default is input_field(name).default


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.__name__)
@pytest.mark.parametrize("beyond", [(0, -math.inf), (1, math.inf)], ids=["least", "most"])
def test_tolerances_end_at_the_limits(function, beyond):
    end, away = beyond
    contract = [CONTRACT] if function in (price_many, implied_volatility_many) else [*contract_from(CONTRACT)]
    price_too = {"option_price": 6.0} if function in (implied_volatility, implied_volatility_many) else {}
    with pytest.raises(InvalidInputError, match=r"^tolerance = .*: must be a number from 1e-08 to 0\.01$"):
        function(*contract, tolerance=math.nextafter(fields.TOLERANCE.limits[end], away), **price_too)


@pytest.mark.parametrize("greeks", [True, False, None, "all", ["none"]], ids=repr)
def test_greeks_are_one_of_three_words(greeks):
    for function, arguments in ((price, contract_from(CONTRACT)), (price_many, [CONTRACT])):
        with pytest.raises(InvalidInputError, match='must be "none", "standard" or "extended"'):
            function(*arguments, greeks=greeks)


def test_the_results_have_the_fields_of_the_table():
    for kind, table in (
        (Valuation, (*PRICE_FIELDS, BOUNDARY_ERROR_FIELD)),
        (ImpliedVolatility, IMPLIED_VOLATILITY_FIELDS),
        (ExerciseBoundary, BOUNDARY_FIELDS),
    ):
        others = {"diagnostics", "greek_errors"}
        assert {f.name for f in dataclasses.fields(kind)} - others == set(by_name(table))
        for field in table:
            assert not field.choices or get_args(get_type_hints(kind)[field.name]) == field.choices


# Tables and files


def test_tables_take_the_columns_of_the_table():
    with pytest.raises(UnknownNameError) as caught:
        price_many(CONTRACT | {"vol": 0.2})
    assert caught.value.known == by_name(fields.COLUMN_FIELDS)
    for name in CONTRACT:
        with pytest.raises(InvalidInputError, match=rf"^{name} \(.*\) is missing"):
            price_many({other: value for other, value in CONTRACT.items() if other != name})
    beyond = [f for f in fields.COLUMN_FIELDS if f.kind in ("number", "curve")]
    rows = [CONTRACT | {f.name: math.nextafter(f.most, math.inf)} for f in beyond]
    names = {name for row in rows for name in row}
    table = price_many(
        {n: [row.get(n, input_field(n).default) for row in rows] for n in names}, greeks="none"
    )
    for field, message in zip(beyond, table["message"], strict=True):
        assert message.startswith(f"{field.name} = ")
        assert message.endswith(": must be a number from {:g} to {:g}".format(*field.limits))


@pytest.mark.parametrize("greeks", fields.GREEKS.choices)
def test_tables_and_files_have_the_columns_of_the_results(greeks):
    columns = CONTRACT | {"cash_dividends": [{"time": 0.5, "amount": 1.0}]}
    for given, errors in itertools.product((CONTRACT, columns), (False, True)):
        expected = price_fields(greeks, given, greek_errors=errors)
        table = price_many(given, greeks=greeks, greek_errors=errors, tolerance=1e-3)
        assert set(table) == {*by_name(expected), "message"}
        kinds = {"number": "f", "flag": "b", "text": "O", "list": "O"}
        assert all(table[field.name].dtype.kind == kinds[field.kind] for field in expected)
        assert result_schema(list(given), greeks, greek_errors=errors).names == by_name(expected)


def test_files_take_every_kind_of_column():
    check_names(by_name(fields.COLUMN_FIELDS))
    assert set(TYPES) == {field.kind for field in fields.COLUMN_FIELDS}
    assert {field.kind for field in PRICE_FIELDS} <= set(ARROW_TYPES)
    assert ARROW_TYPES["number"] == pa.float64()


# The service


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.__name__)
def test_a_request_is_described_as_the_table_states_it(model):
    schema = inline_schema(model)
    assert set(schema["properties"]) <= set(by_name(INPUT_FIELDS))
    assert set(by_name(CONTRACT_FIELDS)) <= set(schema["properties"])
    for name, described in schema["properties"].items():
        field = input_field(name)
        assert described["examples"] == [field.example]
        stands_in = not field.required and name not in schema.get("required", [])
        default = list(field.default) if isinstance(field.default, tuple) else field.default
        assert not stands_in or described["default"] == default
        if name not in ("spot", "volatility"):  # some requests do without them
            assert described["description"] == field.description
        if field.kind == "choice":
            assert described["enum"] == list(field.choices)
        surface = {("spots", *fields.LOCAL_SPOTS.limits)} if name == "volatility" else set()
        assert found_limits(described) == table_limits(field) | surface, name


def found_limits(schema):
    """Return the places of numbers in a schema with their limits."""
    if schema.get("type") == "number":
        return {("", schema.get("minimum"), schema.get("maximum"))}
    inside = [("", choice) for choice in [*schema.get("anyOf", []), *schema.get("oneOf", [])]]
    inside += [("", schema["items"])] if "items" in schema else []
    inside += list(schema.get("properties", {}).items())
    return {(f"{name}{place}", *limits) for name, part in inside for place, *limits in found_limits(part)}


def table_limits(field):
    """Return the same from the table."""
    entries = {(entry.name, *entry.limits) for entry in field.entries if entry.kind == "number"}
    if field.kind == "curve":
        entries = {("times", *fields.KNOT_TIMES.limits), ("values", *field.limits)}
    own = {("", *field.limits)} if any(map(math.isfinite, field.limits)) else set()
    return {tuple(None if v in (math.inf, -math.inf) else v for v in limits) for limits in own | entries}


def test_the_limits_of_the_service_are_narrower():
    assert fields.CASH_DIVIDENDS.most_entries >= MOST_DIVIDENDS
    assert fields.KNOT_TIMES.most_entries >= MOST_PIECES


@pytest.mark.parametrize(
    ("model", "table"),
    [
        (schemas.PriceResponse, (*PRICE_FIELDS, UNITS_FIELD, BOUNDARY_ERROR_FIELD, *GREEK_ERROR_FIELDS)),
        (schemas.ImpliedVolatilityResponse, (*IMPLIED_VOLATILITY_FIELDS, *PROVENANCE_FIELDS)),
        (schemas.BoundaryResponse, (*BOUNDARY_FIELDS, *PROVENANCE_FIELDS)),
        (schemas.AdviceResponse, (*ADVICE_FIELDS, *PROVENANCE_FIELDS)),
        (schemas.SurfaceResponse, (*SURFACE_FIELDS, UNITS_FIELD, *PROVENANCE_FIELDS)),
    ],
    ids=["price", "implied volatility", "boundary", "advice", "surface"],
)
def test_an_answer_is_described_as_the_table_states_it(model, table):
    properties = inline_schema(model)["properties"]
    assert list(properties) == by_name(table)
    for field in table:
        assert properties[field.name]["description"].startswith(field.description)
    model.model_validate({field.name: field.example for field in table})


# The command line


OPTIONS = {
    "cash_dividend": "cash_dividends",
    "proportional_dividend": "proportional_dividends",
    "exercise_time": "exercise_times",
    "time": "times",
}
COMMANDS = typer.main.get_command(cli.app).commands


@pytest.mark.parametrize("command", ["price", "boundary", "implied-volatility", "batch"])
def test_an_option_is_described_as_the_table_states_it(command):
    given = {option.name: option for option in COMMANDS[command].params}
    stated = {OPTIONS.get(name, name): option for name, option in given.items()}
    contract = set() if command == "batch" else set(by_name(CONTRACT_FIELDS))
    assert contract | {"tolerance"} <= set(stated)
    for name in set(by_name(INPUT_FIELDS)) & set(stated):
        field, option = input_field(name), stated[name]
        units = [entry.unit for entry in field.entries if entry.required and entry.unit]
        if field.kind != "list":
            units = field.in_brief.split(" or ") if field.kind == "time" else [field.in_brief]
        assert all(unit in option.help for unit in units), name
        if not (option.required or option.multiple or field.required):
            assert option.default == field.default
    assert ("greeks" in stated) == ("greek_errors" in stated) == (command in ("price", "batch"))
