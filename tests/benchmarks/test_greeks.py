import numpy as np
import pytest

from benchmarks.greeks import ENGINES, GREEKS, cost, costed_rows, moved, report
from benchmarks.problems import random_contracts as kinds
from pricing_core.american.book.prices import GREEK_LISTS


def test_every_greek_of_contracts_with_events_has_a_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(ENGINES, "obstacle-march", (kinds.cash, kinds.curves))
    report("obstacle-march", 1)
    printed = {line.split()[0] for line in capsys.readouterr().out.splitlines()[3:]}
    assert {greek.name for greek in GREEKS} <= printed
    assert set(GREEK_LISTS) <= printed


@pytest.mark.parametrize("option_type", ["put", "call"])
def test_costs_are_those_of_contracts_with_the_dividends_asked_for(
    option_type: str, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = costed_rows(4, "proportional", option_type, 2)
    assert [len(row["proportional_dividends"]) for row in rows] == [4, 4]
    assert {row["option_type"] for row in rows} == {option_type}
    cost("some", rows)
    printed = capsys.readouterr().out.split()
    assert printed[:2] == ["some", "2"]
    assert all(float(number) > 0.0 for number in (printed[2], *printed[4:]))


def test_time_moves_expiry_dividends_and_curves_alike() -> None:
    (row,) = kinds.rows_of(kinds.curves, 1)
    later = moved(row, "time", None, 0.01)
    assert row["expiry"] - later["expiry"] == pytest.approx(0.01)
    paid, paid_later = row["cash_dividends"][0]["time"], later["cash_dividends"][0]["time"]
    assert paid - paid_later == pytest.approx(0.01)
    np.testing.assert_allclose(np.subtract(row["rate"]["times"], later["rate"]["times"]), 0.01)


def test_one_value_of_a_curve_moves_or_all_of_them() -> None:
    (row,) = kinds.rows_of(kinds.curves, 1)
    values = row["volatility"]["values"]
    one = moved(row, "volatility", 1, 0.01)["volatility"]["values"]
    every = moved(row, "volatility", None, 0.01)["volatility"]["values"]
    np.testing.assert_allclose(np.subtract(one, values), [0.0, 0.01, 0.0], atol=1e-15)
    np.testing.assert_allclose(np.subtract(every, values), 0.01)
