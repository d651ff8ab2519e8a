"""Advice on exercise as columns of a table: what `exercise_advice` says of each contract, through every table."""

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pytest

from pricing_core.american import LocalVolatility, contract_from, exercise_advice, price_many
from pricing_core.american.contracts.result_fields import ADVICE_COLUMN_FIELDS
from pricing_core.batch import price_table, run_batch
from pricing_core.errors import InvalidInputError
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel

NAMES = [field.name for field in ADVICE_COLUMN_FIELDS]
PAID = [{"time": 0.25, "amount": 2.0}, {"time": 0.75, "amount": 2.0}]
EVE = [{"time": 0.5 / 365.0, "amount": 8.0}]
SKEW = LocalVolatility([0.0, 1.0], [50.0, 100.0, 200.0], [[0.3, 0.2, 0.2], [0.3, 0.2, 0.2]])
BASE = {"spot": 100.0, "strike": 100.0, "expiry": 1.0, "rate": 0.05, "volatility": 0.2}
ROWS = [
    BASE | {"option_type": "put"},
    BASE | {"option_type": "call", "spot": 110.0, "cash_dividends": PAID},
    BASE | {"option_type": "call"},
    BASE | {"option_type": "put", "spot": 70.0},
    BASE | {"option_type": "call", "spot": 140.0, "cash_dividends": EVE},
    BASE | {"option_type": "put", "expiry": 0.0, "spot": 90.0},
    BASE | {"option_type": "put", "exercise": "bermudan", "exercise_times": [0.25, 0.5]},
    BASE | {"option_type": "put", "exercise": "american", "exercise_start": 0.4},
    BASE | {"option_type": "put", "volatility": SKEW},
    BASE | {"option_type": "put", "expiry": 1.5 / 365.0, "rate": 0.1, "spot": 99.0},
    BASE | {"option_type": "put", "settlement_lag": 10.0},
]
DEFAULTS = {
    "cash_dividends": [],
    "exercise": "american",
    "exercise_times": [],
    "exercise_start": 0.0,
    "settlement_lag": 0.0,
}


def columns_of(rows):
    names = sorted({name for row in rows for name in row})
    return {name: [row.get(name, DEFAULTS.get(name)) for row in rows] for name in names}


@pytest.fixture(scope="module")
def table():
    return price_many(columns_of(ROWS), advice=True)


@pytest.mark.parametrize("row", range(len(ROWS)))
def test_every_row_has_what_advice_on_it_alone_says(row, table):
    option, market = contract_from(ROWS[row])
    day = min(1.0 / 365.0, option.expiry)
    advice = exercise_advice(option, market, times=[day] if day > 0.0 else None)
    expected = {
        "exercise_probability": advice.probability,
        "expected_exercise_time": advice.expected_time,
        "assignment_probability": advice.probability + advice.exercised_at_expiry,
        "cost_of_waiting": advice.cost_of_waiting[0],
    }
    for name, number in expected.items():
        allowed = 2.0 * advice.cost_error[0] + 1e-9 if name == "cost_of_waiting" else 1e-9
        assert table[name][row] == pytest.approx(number, abs=allowed, nan_ok=True), name
    assert table["exercise_probability_error"][row] <= advice.probability_error + 1e-9


def test_the_eve_of_an_ex_date_is_dear(table):
    assert table["cost_of_waiting"][4] > 2.5
    assert table["exercise_now"][4] or table["exercise_probability"][4] > 0.9


def test_bad_rows_have_no_advice_and_stop_nobody():
    found = price_many(
        columns_of([ROWS[0], ROWS[0] | {"spot": -1.0}, ROWS[0] | {"volatility": 0.0}]), advice=True
    )
    assert found["status"].tolist()[:2] == ["ok", "invalid_input"]
    for name in NAMES:
        assert np.isnan(found[name][1])
        assert not np.isnan(found[name][0])
    assert np.isnan(found["exercise_probability"][2])


def test_advice_is_there_only_where_it_is_asked_for_and_threads_change_nothing():
    plain = price_many(columns_of(ROWS[:3]))
    assert not set(NAMES) & set(plain)
    with pytest.raises(InvalidInputError, match="advice"):
        price_many(columns_of(ROWS[:1]), advice=1)
    one, two = (price_many(columns_of(ROWS[:3]), advice=True, threads=threads) for threads in (1, 2))
    for name in NAMES:
        np.testing.assert_array_equal(one[name], two[name])
        assert list(one).index(name) < list(one).index("message")


def test_frames_and_files_have_the_same_columns(tmp_path):
    rows = pa.table(columns_of(ROWS[:3]))
    expected = price_many(columns_of(ROWS[:3]), advice=True)
    for found in (price_many(rows, advice=True), price_table(rows, advice=True)):
        for name in NAMES:
            got = found[name].to_numpy(zero_copy_only=False)
            np.testing.assert_array_equal(got, expected[name])
    source, target = tmp_path / "in.csv", tmp_path / "out.csv"
    plain = pa.table(columns_of([ROWS[0], ROWS[2]]))
    pyarrow.csv.write_csv(plain, source)
    run_batch(str(source), str(target), advice=True)
    read = pyarrow.csv.read_csv(target)
    np.testing.assert_allclose(
        read["exercise_probability"].to_numpy(), expected["exercise_probability"][[0, 2]]
    )
