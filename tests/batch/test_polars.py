"""Frames of polars, whose texts are views in Arrow, through every function that takes frames."""

import json

import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pricing_core.american import price_many
from pricing_core.batch import explain_profit_and_loss, price_table, run_batch, value_scenarios

DIVIDENDS = [{"time": 0.25, "amount": 1.0}]
TERMS = {
    "id": ["a", "b"],
    "option_type": ["put", "call"],
    "spot": [100.0, 100.0],
    "strike": [100.0, 95.0],
    "expiry": [1.0, 0.5],
    "rate": [0.05, 0.03],
    "volatility": [0.2, 0.3],
}


@pytest.mark.parametrize(
    "cash_dividends", [[json.dumps(DIVIDENDS), None], [DIVIDENDS, []]], ids=["text", "lists"]
)
def test_frames_of_polars_give_what_tables_of_arrow_give(cash_dividends, tmp_path) -> None:
    frame = pl.DataFrame({**TERMS, "cash_dividends": cash_dividends})
    table = pa.table({**TERMS, "cash_dividends": cash_dividends})
    assert (
        price_many(frame, tolerance=1e-3)["price"].to_list()
        == price_table(table, tolerance=1e-3)["price"].to_pylist()
    )
    for function, more in ((value_scenarios, {"spot_shifts": [0.1]}), (explain_profit_and_loss, {})):
        frames, tables = ([frame], [table]) if more else ([frame, frame], [table, table])
        found, wanted = (function(*given, tolerance=1e-3, **more) for given in (frames, tables))
        assert found["profit_and_loss"].to_pylist() == wanted["profit_and_loss"].to_pylist()
        assert found["id"].to_pylist() == wanted["id"].to_pylist()
    pq.write_table(pa.table(frame), tmp_path / "in.parquet")
    assert run_batch(tmp_path / "in.parquet", tmp_path / "out.parquet", tolerance=1e-3).priced == 2
