import json
import math

import numpy as np
import pytest

from pricing_core.american import CashDividend, Market, Option, PiecewiseConstant, price, price_many
from pricing_core.american.book.columns import as_objects
from pricing_core.american.contracts.result_fields import GREEK_ERROR_FIELDS
from pricing_core.american.contracts.vocabulary import contract_from
from pricing_core.american.engines.solve import BOUNDS_ALONE, UNRESOLVED
from pricing_core.errors import InvalidInputError, UnusualColumnWarning
from tests.problems.engine_with_errors import ERRORS
from tests.problems.needs_kernel import needs_kernel

COLUMNS = {
    "option_type": ["put", "call", "put", "put"],
    "spot": [100.0, 110.0, 70.0, 100.0],
    "strike": 100.0,
    "expiry": [1.0, 0.5, 1.0, 0.0],
    "rate": 0.05,
    "volatility": [0.2, 0.3, 0.2, 0.2],
    "dividend_yield": [0.0, 0.03, 0.0, 0.0],
}


def test_rows_equal_single_prices_bit_for_bit():
    table = price_many(COLUMNS, tolerance=1e-4)
    for i, option_type in enumerate(COLUMNS["option_type"]):
        option = Option(option_type, 100.0, COLUMNS["expiry"][i])
        market = Market(COLUMNS["spot"][i], 0.05, COLUMNS["volatility"][i], COLUMNS["dividend_yield"][i])
        single = price(option, market, tolerance=1e-4)
        for name in (
            "price",
            "delta",
            "gamma",
            "theta",
            "vega",
            "rho",
            "exercise_boundary",
            "error_estimate",
        ):
            assert table[name][i] == getattr(single, name)
        assert table["status"][i] == single.status == "ok"
        assert table["exercise_now"][i] == single.exercise_now


def test_neither_order_nor_threads_nor_bad_neighbours_change_a_row():
    alone = price_many(COLUMNS, tolerance=1e-4)
    reversed_columns = {k: v[::-1] if isinstance(v, list) else v for k, v in COLUMNS.items()}
    backwards = price_many(reversed_columns, tolerance=1e-4, threads=3)
    with_bad = price_many(
        {
            k: [*v, bad] if isinstance(v, list) else v
            for (k, v), bad in zip(COLUMNS.items(), ["put", -1.0, 0, 1.0, 0, 0.2, 0.0], strict=True)
        },
        tolerance=1e-4,
    )
    assert np.array_equal(alone["price"], backwards["price"][::-1])
    assert np.array_equal(alone["price"], with_bad["price"][:-1])
    assert with_bad["status"][-1] == "invalid_input"
    assert with_bad["message"][-1] == "spot = -1.0: must be a number from 0 to 1e+30"
    assert math.isnan(with_bad["price"][-1])
    assert not with_bad["exercise_now"][-1]


def test_greeks_can_be_left_out():
    none, standard, extended = (
        price_many(COLUMNS, tolerance=1e-3, greeks=g) for g in ("none", "standard", "extended")
    )
    greeks = {"delta", "gamma", "theta", "theta_per_day", "vega", "vega_per_point", "rho", "rho_per_point"}
    greeks |= {"dividend_rho", "delta_sticky_moneyness"}
    assert standard.keys() - none.keys() == greeks
    assert extended.keys() - standard.keys() >= {"vanna", "volga", "charm"}
    for name in none:
        assert none[name].tobytes() == standard[name].tobytes() or none[name].dtype == object
    assert np.isfinite(
        [extended[name] for name in (*greeks - {"delta_sticky_moneyness"}, "vanna", "volga")]
    ).all()
    with pytest.raises(InvalidInputError, match="greeks"):
        price_many(COLUMNS, greeks=True)


def test_a_table_has_the_errors_of_its_greeks_where_they_are_asked_for(engine_with_errors):
    columns = COLUMNS | {
        "expiry": 1.0,
        "cash_dividends": [[], [{"time": 0.1, "amount": 1.0}], [], []],
        "volatility": [0.2, {"times": [0.5, 1.0], "values": [0.2, 0.3]}, 0.2, 0.0],
    }
    plain, table = (price_many(columns, greeks="extended", greek_errors=e) for e in (False, True))
    names = [field.name for field in GREEK_ERROR_FIELDS if not field.per]
    lists = ["dividend_sensitivities_error", "volatility_buckets_error"]
    assert table.keys() - plain.keys() >= {*names, *lists}
    for name in names:
        expected = ERRORS.get(name.removesuffix("_error"), math.nan)
        np.testing.assert_array_equal(table[name], [expected] * 4, err_msg=name)
    assert table["dividend_sensitivities_error"].tolist() == [(), (2e-5,), (), ()]
    assert table["volatility_buckets_error"].tolist() == [(), (3e-5, 3e-5), (), ()]
    assert table["charm"].tolist() == [0.5] * 4
    without = [price_many(columns, greeks="none", greek_errors=errors).keys() for errors in (True, False)]
    assert without[0] - without[1] == {"boundary_error"}
    with pytest.raises(InvalidInputError, match="greek_errors = 1: must be True or False"):
        price_many(columns, greek_errors=1)


def test_a_row_may_bring_its_own_tolerance():
    table = price_many({**COLUMNS, "tolerance": [1e-2, 1e-4, 1e-5, 5.0]})
    assert table["status"].tolist() == ["ok", "ok", "ok", "invalid_input"]
    assert table["error_estimate"][0] > table["error_estimate"][2]


def test_scalars_alone_make_one_row_and_empty_columns_none():
    scalars = {"option_type": "put", "spot": 90, "strike": 100, "expiry": 1, "rate": 0.05, "volatility": 0.2}
    assert price_many(scalars, tolerance=1e-3)["price"].shape == (1,)
    assert price_many({**scalars, "spot": []})["price"].shape == (0,)


@pytest.mark.parametrize(
    ("field", "columns", "options"),
    [
        ("volatility", {k: v for k, v in COLUMNS.items() if k != "volatility"}, {}),
        ("column", {**COLUMNS, "colour": "red"}, {}),
        ("columns", {**COLUMNS, "rate": [0.05, 0.05]}, {}),
        ("columns", {**COLUMNS, "rate": [[0.05]]}, {}),
        ("tolerance", COLUMNS, {"tolerance": 1.0}),
        ("threads", COLUMNS, {"threads": 0}),
    ],
)
def test_a_bad_table_is_refused_as_a_whole(field, columns, options):
    with pytest.raises(InvalidInputError, match=field):
        price_many(columns, **options)


ODD_ROWS = [  # option_type, exercise, spot, expiry, rate, dividend_yield, volatility
    ("put", "american", 90.0, 1.0, 0.05, 0.01, 0.0),
    ("call", "american", 110.0, 0.0, 0.05, 0.01, 0.2),
    ("put", "american", 0.0, 1.0, 0.05, 0.01, 0.2),
    ("call", "european", 0.0, 1.0, 0.05, 0.01, 0.2),
    ("put", "american", 100.0, 1.0, -0.02, 0.01, 0.2),  # never exercised
    ("put", "american", 80.0, 1.0, -0.005, -0.05, 0.2),  # two boundaries
    ("call", "american", 120.0, 1.0, -0.05, -0.005, 0.2),
    ("put", "american", 100.0, 1.0, 0.5, 0.0, 0.001),  # a layer that no grid of the march resolves
    ("put", "american", 60.0, 1.0, 0.05, 0.0, 0.2),  # exercised
]
BAD_ROWS = [
    ("put", "american", -1.0, 1.0, 0.05, 0.0, 0.2),
    ("straddle", "american", 100.0, 1.0, 0.05, 0.0, 0.2),
    ("call", "bermudan", 100.0, 1.0, 0.05, 0.0, 0.2),
    ("call", "american", 100.0, 1.0, math.nan, 0.0, 0.2),
    ("put", "american", 100.0, 1.0, 0.05, 0.0, math.inf),
]
NAMES = ("option_type", "exercise", "spot", "expiry", "rate", "dividend_yield", "volatility")


def as_columns(rows):
    return dict(zip(NAMES, (np.array(column) for column in zip(*rows, strict=True)), strict=True))


def joined(first, second):
    return {name: np.concatenate([first[name], second[name]]) for name in NAMES}


def mixed_book(count, seed):
    """Return American and European puts and calls, some odd ones first, with tolerances of their own."""
    random = np.random.default_rng(seed)
    ordinary = {
        "option_type": random.choice(["put", "call"], count),
        "exercise": random.choice(["american", "american", "european"], count),
        "spot": random.uniform(50.0, 200.0, count),
        "expiry": random.uniform(0.1, 2.0, count),
        "rate": random.uniform(-0.01, 0.12, count),
        "dividend_yield": random.uniform(0.0, 0.12, count),
        "volatility": random.uniform(0.15, 0.6, count),
    }
    book = joined(as_columns(ODD_ROWS), ordinary)
    tolerance = random.choice([1e-2, 5e-3, 1e-3], book["spot"].size)
    return {**book, "strike": np.full(tolerance.size, 100.0), "tolerance": tolerance}


def take(columns, rows):
    return {name: column[rows] for name, column in columns.items()}


def assert_same_bits(one, other):
    assert one.keys() == other.keys()
    for name, column in one.items():
        if column.dtype == object:
            assert column.tolist() == other[name].tolist(), name
        else:
            assert column.tobytes() == other[name].tobytes(), name


@needs_kernel
def test_a_row_is_bit_identical_whatever_stands_beside_it():
    book = mixed_book(491, seed=1)
    expected = price_many(book)
    assert {"premium-march", "closed-form", "obstacle-march", "expired", "zero-volatility"} <= set(
        expected["method"]
    )
    count = expected["price"].size
    for row in [*range(len(ODD_ROWS)), 100, 250, count - 1]:
        assert_same_bits(take(expected, [row]), price_many(take(book, [row])))
    order = np.random.default_rng(2).permutation(count)
    assert_same_bits(take(expected, order), price_many(take(book, order), threads=2))
    for part in (slice(0, 7), slice(200, 215), slice(30, 400, 3)):
        assert_same_bits(take(expected, part), price_many(take(book, part), threads=3))


@needs_kernel
def test_bad_rows_do_not_change_a_bit_of_the_others():
    book = mixed_book(60, seed=3)
    expected = price_many(book)
    places = np.array([0, 5, 20, 21, 69])
    bad = as_columns(BAD_ROWS)
    beside = {name: np.insert(book[name].astype(object), places, bad[name]) for name in NAMES}
    beside["strike"], beside["tolerance"] = 100.0, np.insert(book["tolerance"], places, 1e-4)
    found = price_many(beside)
    refused = found["status"] == "invalid_input"
    np.testing.assert_array_equal(np.flatnonzero(refused), places + np.arange(5))
    assert_same_bits(expected, take(found, ~refused))
    for name, column in take(found, refused).items():
        if column.dtype == float:
            assert np.isnan(column).all(), name
    assert all(found["message"][refused])


@pytest.mark.parametrize("greeks", ["none", "standard", "extended"])
def test_every_field_of_a_row_is_that_of_the_single_price(greeks):
    book = mixed_book(12, seed=4)
    table = price_many(book, greeks=greeks)
    for row in range(table["price"].size):
        cells = {name: column[row].item() for name, column in book.items()}
        option = Option(cells["option_type"], cells["strike"], cells["expiry"], cells["exercise"])
        market = Market(cells["spot"], cells["rate"], cells["volatility"], cells["dividend_yield"])
        single = price(option, market, tolerance=cells["tolerance"], greeks=greeks)
        for name, column in table.items():
            wanted = "" if name == "message" else getattr(single, name)
            if wanted is None:
                empty = isinstance(column[row], tuple) and column[row] == ()
                assert empty or math.isnan(column[row]), (row, name)
            else:
                assert column[row] == wanted, (row, name)


@needs_kernel
def test_a_row_whose_march_is_not_settled_is_priced_by_another_engine():
    row = ("put", "american", 60.9, 2.0, 0.15515858795, 1.5, 0.0813951507)
    found = price_many({**as_columns([row]), "strike": 100.0}, tolerance=1e-3)
    assert found["method"][0] == "obstacle-march"
    assert found["status"][0] == "ok"
    best = 100.0 * math.exp(-0.3103171759) - 60.9 * math.exp(
        -3.0
    )  # nearly certain to be exercised at the end
    assert found["price"][0] >= best - 0.1


def chains(tolerance):
    """Return puts and calls of four expiries at 21 strikes, sorted so that neighbours differ in the strike."""
    option_type, expiry, strike = np.meshgrid(["put", "call"], [0.1, 0.5, 1.0, 3.0], np.linspace(70, 130, 21))
    columns = {"option_type": option_type.ravel(), "expiry": expiry.ravel(), "strike": strike.ravel()}
    market = {"spot": 100.0, "rate": 0.06, "dividend_yield": 0.03, "volatility": 0.25}
    return {**columns, **market, "tolerance": np.broadcast_to(tolerance, expiry.size)}


@needs_kernel
@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
def test_shared_solves_keep_the_tolerance(tolerance):
    columns = chains(tolerance)
    alone, shared = price_many(columns), price_many(columns, share_solves=True)
    assert set(shared["status"]) == {"ok"}
    allowed = alone["error_estimate"] + shared["error_estimate"]
    assert np.all(np.abs(alone["price"] - shared["price"]) <= allowed)
    assert np.all(shared["error_estimate"] <= tolerance * columns["strike"])
    np.testing.assert_allclose(shared["delta"], alone["delta"], atol=10.0 * tolerance)
    np.testing.assert_array_equal(shared["exercise_now"], alone["exercise_now"])


@needs_kernel
def test_shared_solves_of_puts_with_one_tolerance_change_no_bit_of_the_price():
    columns = chains(1e-5)
    puts = {
        name: np.broadcast_to(column, 168)[columns["option_type"] == "put"]
        for name, column in columns.items()
    }
    alone, shared = price_many(puts), price_many(puts, share_solves=True)
    for name in ("price", "delta", "gamma", "vega", "rho", "theta", "error_estimate", "exercise_boundary"):
        assert alone[name].tobytes() == shared[name].tobytes(), name


@needs_kernel
def test_shared_rows_with_nothing_to_share_equal_single_ones():
    book = mixed_book(20, seed=5)
    alone, shared = price_many(book), price_many(book, share_solves=True)
    for name in ("price", "delta", "gamma", "vega", "rho", "exercise_boundary", "error_estimate"):
        np.testing.assert_allclose(shared[name], alone[name], rtol=1e-11, atol=1e-9, err_msg=name)
    assert shared["method"].tolist() == alone["method"].tolist()


@pytest.mark.parametrize("threads", [0, -1, 1.0, True, "2"])
def test_threads_are_a_positive_integer(threads):
    with pytest.raises(InvalidInputError, match="threads"):
        price_many(COLUMNS, threads=threads)


def test_masked_cells_are_refused_row_by_row():
    spot = np.ma.masked_array([90.0, 100.0, 110.0], mask=[True, False, False])
    option_type = np.ma.masked_array(["put", "put", "call"], mask=[False, False, True])
    market = {"strike": 100.0, "expiry": 1.0, "rate": 0.05, "volatility": 0.2}
    found = price_many({"option_type": option_type, "spot": spot, **market})
    assert found["status"].tolist() == ["invalid_input", "ok", "invalid_input"]
    assert np.isnan(found["price"]).tolist() == [True, False, True]


@pytest.mark.parametrize("threads", [0, -1, 1.5, True, 10**30, "2"])
def test_threads_out_of_range_are_refused(threads):
    with pytest.raises(InvalidInputError, match="threads"):
        price_many(mixed_book(2, seed=1), threads=threads)


def test_ragged_columns_are_refused():
    with pytest.raises(InvalidInputError, match="spot"):
        price_many({**mixed_book(2, seed=1), "spot": [[1.0, 2.0], [3.0]]})


@pytest.mark.filterwarnings("error")
def test_a_rate_next_to_nothing_is_nothing():
    contract = {
        "option_type": ["call", "put"],
        "spot": 100.0,
        "strike": 100.0,
        "expiry": 0.1,
        "volatility": 1.0,
    }
    tiny = price_many({**contract, "rate": [0.3, -1e-300], "dividend_yield": [1e-300, 0.1]})
    none = price_many({**contract, "rate": [0.3, 0.0], "dividend_yield": [0.0, 0.1]})
    assert tiny["status"].tolist() == ["ok", "ok"]
    for name in ("price", "delta", "rho"):
        np.testing.assert_array_equal(tiny[name], none[name])
    alone = price(Option("call", 100.0, 0.1), Market(100.0, 0.3, 1.0, 1e-300))
    assert alone.price == pytest.approx(tiny["price"][0], rel=1e-12)


CURVE = {"times": [0.25, 1.0], "values": [0.1, 0.2]}
DIVIDEND = {"time": 0.5, "amount": 1.0}


def test_rows_with_events_are_single_prices_and_the_others_as_ever():
    book = {**COLUMNS, "rate": [0.05, CURVE, 0.05, 0.05], "tolerance": [1e-4, 1e-3, 1e-4, 1e-4]}
    dividends = [None, None, [DIVIDEND], []]
    table = price_many({**book, "cash_dividends": dividends}, threads=3)
    plain = price_many(COLUMNS, tolerance=1e-4)
    assert_same_bits(take(plain, [0, 3]), take({name: table[name] for name in plain}, [0, 3]))
    curved = Market(110.0, PiecewiseConstant(**CURVE), 0.3, 0.03)
    paying = Market(70.0, 0.05, 0.2, 0.0, (CashDividend(0.5, 1.0),))
    singles = [
        price(Option("call", 100.0, 0.5), curved, tolerance=1e-3),
        price(Option("put", 100.0, 1.0), paying, tolerance=1e-4),
    ]
    for row, single in zip((1, 2), singles, strict=True):
        for name in table.keys() - {"message", "dividend_sensitivities"}:
            wanted = getattr(single, name)
            np.testing.assert_equal(table[name][row], np.nan if wanted is None else wanted, err_msg=name)
    assert table["dividend_sensitivities"].tolist() == [(), (), singles[1].dividend_sensitivities, ()]


def test_the_sensitivities_are_there_where_the_dividends_are():
    assert "dividend_sensitivities" not in price_many({**COLUMNS, "rate": CURVE}, tolerance=1e-3)
    assert "dividend_sensitivities" in price_many({**COLUMNS, "cash_dividends": None}, tolerance=1e-3)


@needs_kernel
def test_one_curve_serves_all_rows():
    table = price_many({**COLUMNS, "volatility": PiecewiseConstant(**CURVE)}, tolerance=1e-3)
    assert table["method"].tolist() == [*["obstacle-march"] * 3, "expired"]


@needs_kernel
def test_empty_events_change_no_bit():
    book = mixed_book(60, seed=6)
    count = book["spot"].size
    empty = {
        "cash_dividends": [None] * (count - 1) + [[]],
        "proportional_dividends": [],
        "exercise_times": None,
        "exercise_start": np.zeros(count),
        "dividend_model": "spot",
        "valuation_date": None,
        "expiration_date": [""] * count,
    }
    found = price_many({**book, **empty})
    assert found.pop("dividend_sensitivities").tolist() == [()] * count
    assert_same_bits(price_many(book), found)


@needs_kernel
def test_dates_give_the_bits_of_their_expiries():
    book = mixed_book(30, seed=7)
    days = np.round(365.0 * book["expiry"]).astype(int)
    dates = np.datetime64("2026-01-01") + days
    undated = {name: column for name, column in book.items() if name != "expiry"}
    found = price_many({**undated, "valuation_date": "2026-01-01", "expiration_date": dates})
    assert_same_bits(price_many({**book, "expiry": days / 365.0}), found)


@needs_kernel
def test_a_row_with_events_that_no_engine_prices_has_bounds_and_says_why():
    """The spot of the first one deviates by 30 in its logarithm: no grid has room for both a call and its spot."""
    wide = {
        **COLUMNS,
        "option_type": "call",
        "volatility": [15.0, 0.3, 0.2, 0.2],
        "expiry": [4.0, 0.5, 1.0, 0.0],
    }
    table = price_many({**wide, "cash_dividends": [[DIVIDEND], None, [DIVIDEND], None]}, tolerance=1e-3)
    assert table["status"][0] == "tolerance_not_met"
    assert table["message"][0] == f"{BOUNDS_ALONE}: {UNRESOLVED}"
    assert table["price"][0] >= table["error_estimate"][0]
    assert table["price"][0] + table["error_estimate"][0] <= COLUMNS["spot"][0] + 1e-9
    assert np.isfinite(table["price"]).all()


def test_a_bad_event_is_told_in_its_row():
    dividends = [[DIVIDEND], [DIVIDEND, {"time": 0.5, "amount": -1.0}], "[", None]
    table = price_many({**COLUMNS, "cash_dividends": dividends}, tolerance=1e-3)
    assert table["status"].tolist() == ["ok", "invalid_input", "invalid_input", "ok"]
    assert table["message"][1] == "cash_dividends[1].amount = -1.0: must be a number from 0 to 1e+30"
    assert [len(numbers) for numbers in table["dividend_sensitivities"]] == [1, 0, 0, 0]


EVENTS = [
    {"cash_dividends": [{"time": 0.4, "amount": 3.0}]},
    {
        "cash_dividends": [{"time": 0.4, "amount": 3.0}, {"time": 0.8, "amount": 1.0}],
        "dividend_model": "escrowed",
    },
    {"proportional_dividends": [{"time": 0.4, "fraction": 0.03}], "option_type": "call"},
    {"rate": {"times": [0.5, 1.0], "values": [0.02, 0.08]}},
    {"exercise": "bermudan", "exercise_times": [0.25, 0.5]},
    {"exercise_start": 0.5},
    {"exercise": "european", "cash_dividends": [{"time": 0.4, "amount": 3.0}]},
    {},
]


@pytest.mark.parametrize("greeks", ["none", "standard", "extended"])
def test_rows_with_events_equal_single_prices_bit_for_bit(greeks):
    contract = {
        "option_type": "put",
        "exercise": "american",
        "spot": 95.0,
        "strike": 100.0,
        "expiry": 1.0,
        "rate": 0.05,
        "volatility": 0.25,
    }
    rows = [{**contract, **events} for events in EVENTS]
    names = list(dict.fromkeys(name for row in rows for name in row))
    columns = {name: [row.get(name) for row in rows] for name in names}
    table = price_many(columns, tolerance=1e-3, greeks=greeks)
    for row, cells in enumerate(rows):
        single = price(*contract_from(cells), tolerance=1e-3, greeks=greeks)
        assert table["status"][row] == single.status == "ok"
        for name, column in table.items():
            if name == "message":
                continue
            wanted = getattr(single, name)
            if column.dtype == object and name not in (
                "status",
                "method",
                "engine_version",
                "instruction_set",
            ):
                assert column[row] == (wanted or ()), f"{row} {name}"
            else:
                wanted = math.nan if wanted is None else wanted
                np.testing.assert_array_equal(column[row], wanted, err_msg=f"{row} {name}")


def test_events_do_not_depend_on_their_neighbours_or_on_threads():
    columns = {**COLUMNS, "cash_dividends": [[DIVIDEND], None, [{"time": 0.25, "amount": 2.0}], None]}
    together = price_many(columns, tolerance=1e-3, threads=2)
    for row in range(4):
        alone = {
            name: [column[row]] if isinstance(column, list) else column for name, column in columns.items()
        }
        assert_same_bits(price_many(alone, tolerance=1e-3), take(together, [row]))


TWO_DIVIDENDS = [{"time": 0.25, "amount": 2.0}, {"time": 0.75, "amount": 1.5}]
DATED = {"expiry": None, "valuation_date": "2026-01-01", "expiration_date": "2027-01-01"}


def of_contracts(rows):
    """Return the columns of contracts with defaults in what they do not say."""
    contract = {"option_type": "put", "exercise": "american", "spot": 95.0, "strike": 100.0, "expiry": 1.0}
    rows = [{**contract, "rate": 0.05, "volatility": 0.25, **row} for row in rows]
    return {name: [row.get(name) for row in rows] for name in dict.fromkeys(n for row in rows for n in row)}


@needs_kernel
@pytest.mark.parametrize("greeks", ["none", "standard"])
def test_dividends_have_the_same_bits_however_they_are_written(greeks):
    ways = [
        TWO_DIVIDENDS,
        json.dumps(TWO_DIVIDENDS),
        tuple(TWO_DIVIDENDS),
        TWO_DIVIDENDS[::-1],
        [CashDividend(**dividend) for dividend in TWO_DIVIDENDS],
        [{**dividend, "ex_date": None} for dividend in TWO_DIVIDENDS],
        [{name: np.float64(number) for name, number in dividend.items()} for dividend in TWO_DIVIDENDS],
        [*TWO_DIVIDENDS, {"time": 1.5, "amount": 1.0}],
    ]
    changes = [{}, {"option_type": "call", "spot": 120.0}, {"spot": 60.0}, {"exercise": "european"}]
    changes = changes[:1] if greeks == "standard" else changes
    columns = of_contracts([{**change, "cash_dividends": way} for change in changes for way in ways])
    table = price_many(columns, tolerance=1e-3, greeks=greeks)
    assert set(table["method"]) == {"obstacle-march"}
    if greeks == "standard":
        assert {len(numbers) for numbers in table.pop("dividend_sensitivities")} <= {2, 3}
    for start in range(0, len(ways) * len(changes), len(ways)):
        first = take(table, [start] * len(ways))
        assert_same_bits(first, take(table, range(start, start + len(ways))))


def test_ex_dates_have_the_bits_of_their_times():
    dated = [{"ex_date": "2026-03-15", "amount": 2.0}, {"ex_date": "2026-10-21", "amount": 1.5}]
    timed = [{"time": days / 365.0, "amount": amount} for days, amount in ((73, 2.0), (293, 1.5))]
    table = price_many(
        of_contracts([{**DATED, "cash_dividends": cell} for cell in (dated, timed)]), tolerance=1e-3
    )
    assert table["status"].tolist() == ["ok", "ok"]
    assert_same_bits(take(table, [0]), take(table, [1]))


def test_plain_dividends_make_no_objects(monkeypatch):
    def refuse(cells):
        raise AssertionError(cells)

    columns = of_contracts([{"cash_dividends": TWO_DIVIDENDS}, {"cash_dividends": json.dumps(TWO_DIVIDENDS)}])
    expected = price_many(columns, tolerance=1e-3, greeks="none")
    monkeypatch.setattr("pricing_core.american.book.reading.checked_contract", refuse)
    assert_same_bits(expected, price_many(columns, tolerance=1e-3, greeks="none"))


# What `contract_from` says of a cell the table says of its row, whatever reads the plain ones.
BAD_DIVIDENDS = [
    [{"time": 0.5, "amount": True}],
    [{"time": "0.5", "amount": 1.0}],
    [{"time": 0.5, "amount": math.nan}],
    [{"time": 0.5, "amount": 10**400}],
    [{"time": 0.5, "amount": 2e30}],
    [{"time": -0.5, "amount": 1.0}],
    [{"time": 0.5}],
    [{"time": 0.5, "sum": 1.0}],
    [{"time": 0.5, "amount": 1.0, "tax": 0.0}],
    [0.5, 1.0],
    [DIVIDEND] * 1001,
    '[{"time": 0.5, "amount": NaN}]',
    '[{"time": 0.5, "time": 0.6, "amount": 1.0}]',
    '[{"time": 0.5, "amount": 1.0}',
    '{"time": 0.5, "amount": 1.0}',
    "[" * 100_000,
]


@pytest.mark.parametrize("cell", BAD_DIVIDENDS, ids=lambda cell: repr(cell)[:40])
def test_a_bad_cell_of_dividends_has_the_message_of_the_contract(cell):
    columns = of_contracts([{"cash_dividends": way} for way in (TWO_DIVIDENDS, cell)])
    with pytest.raises(InvalidInputError) as caught:
        contract_from({name: column[1] for name, column in columns.items()})
    table = price_many(columns, tolerance=1e-3, greeks="none")
    assert table["status"].tolist() == ["ok", "invalid_input"]
    assert table["message"].tolist() == ["", str(caught.value)]


@pytest.mark.parametrize("method", ["lcs", "crank-nicolson"])
def test_a_method_asked_for_by_name_gives_what_price_gives(method):
    options = [Option("put", 100.0, 1.0), Option("call", 90.0, 0.5), Option("put", 95.0, 0.7, "european")]
    market = Market(98.0, 0.04, 0.3, 0.06)
    columns = {
        "option_type": [option.option_type for option in options],
        "strike": [option.strike for option in options],
        "expiry": [option.expiry for option in options],
        "exercise": [option.exercise for option in options],
        "spot": 98.0,
        "rate": 0.04,
        "volatility": 0.3,
        "dividend_yield": 0.06,
    }
    table = price_many(columns, tolerance=1e-3, method=method, greeks="none")
    expected = [price(option, market, tolerance=1e-3, method=method, greeks="none") for option in options]
    assert table["price"].tolist() == [valuation.price for valuation in expected]
    assert table["method"].tolist() == [valuation.method for valuation in expected]
    assert table["method"][0] == method


def test_an_unknown_method_is_refused():
    with pytest.raises(InvalidInputError, match=r'method = .*one of "auto", "lcs", "crank-nicolson"'):
        price_many(COLUMNS, method="finite-differences")


@pytest.mark.parametrize(
    "dividends", [[(0.5, 1.0), (0.7, 1.0)], [[0.7, 1.0], [0.5, 1.0]], np.array([[0.5, 1.0], [0.7, 1.0]])]
)
def test_dividends_as_pairs_of_numbers_serve_all_rows(dividends):
    book = {"option_type": "put", "spot": [90.0, 100.0, 110.0], "strike": 100.0, "expiry": 1.0, "rate": 0.05}
    listed = [{"time": 0.5, "amount": 1.0}, {"time": 0.7, "amount": 1.0}]
    wanted = price_many({**book, "volatility": 0.2, "cash_dividends": listed})
    for cell in (dividends, [dividends] * 3, as_objects([listed, None, dividends])):
        found = price_many({**book, "volatility": 0.2, "cash_dividends": cell})
        assert found["price"][[0, 2]].tolist() == wanted["price"][[0, 2]].tolist()


def test_a_book_in_days_is_warned_about():
    book = {"option_type": "put", "spot": [90.0, 100.0], "strike": 100.0, "expiry": 90.0, "rate": 0.05}
    with pytest.warns(UnusualColumnWarning, match="column expiry looks like days: its median is 90"):
        price_many({**book, "volatility": 0.2}, tolerance=1e-2, greeks="none")
