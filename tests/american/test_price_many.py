import math

import numpy as np
import pytest

from pricing_core.american import Market, Option, price, price_many
from pricing_core.errors import InvalidInputError

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
    table = price_many(COLUMNS, tolerance=1e-3, greeks=False)
    assert np.isnan(table["vega"][:2]).all()
    assert np.isfinite(table["delta"]).all()


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
        ("columns", {**COLUMNS, "colour": "red"}, {}),
        ("columns", {**COLUMNS, "rate": [0.05, 0.05]}, {}),
        ("columns", {**COLUMNS, "rate": [[0.05]]}, {}),
        ("tolerance", COLUMNS, {"tolerance": 1.0}),
        ("threads", COLUMNS, {"threads": 0}),
    ],
)
def test_a_bad_table_is_refused_as_a_whole(field, columns, options):
    with pytest.raises(InvalidInputError, match=field):
        price_many(columns, **options)
