"""The implied volatilities of frames of quotes: those of Arrow, pandas, polars or any with Arrow's streams."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from pricing_core.american.arrow.frames import (
    AnyFrame,
    cells_of,
    contracts_of,
    known_frame,
    names_of,
    with_results,
)
from pricing_core.american.arrow.price_batch import contract_columns
from pricing_core.american.arrow.schema import check_results
from pricing_core.american.book.reading import read_columns
from pricing_core.american.implied.implied_volatility_many import PRICES, observed_prices, volatilities_of
from pricing_core.american.implied.volatility_targets import ANY_VOLATILITY
from pricing_core.american.pricing_settings import PricingSettings


def implied_frame(frame: AnyFrame, prices: Mapping[str, Any], tolerance: float, workers: int) -> AnyFrame:
    """Return the frame with the implied volatility of every row and what belongs to it as further columns.

    Parameters
    ----------
    prices : mapping of str to array_like, shape (n,), or scalar
        option_price, or bid and ask; where it is empty they are columns of the frame.

    Raises
    ------
    InvalidInputError
        As `implied_volatility_many`; or a column of the frame has the name of a result.
    """
    table = known_frame(frame)
    names = names_of(table)
    prices = prices or {name: cells_of(table, name) for name in PRICES if name in names}
    cells, sides = observed_prices(prices)
    contracts = contracts_of(table, unneeded=["volatility"])
    volatility = pa.array(np.full(contracts.num_rows, ANY_VOLATILITY))
    batch = pa.record_batch(
        [*(column.combine_chunks() for column in contracts.columns), volatility],
        [*contracts.schema.names, "volatility"],
    )
    read = read_columns(contract_columns(batch, PricingSettings(tolerance)), batch.num_rows)
    found = volatilities_of(read, cells, sides, workers)
    check_results(names, [*found])
    results = pa.table({name: pa.array(column, from_pandas=True) for name, column in found.items()})
    return with_results(table, results)  # type: ignore[no-any-return]
