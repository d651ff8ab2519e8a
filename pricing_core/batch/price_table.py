"""An Arrow table of contracts in, the same rows with their values out; no file is touched."""

from __future__ import annotations

from numpy.typing import ArrayLike

from pricing_core.american.arrow.frames import AnyFrame, price_frame
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, Greeks
from pricing_core.american.pricing_settings import PricingSettings


def price_table(
    table: AnyFrame,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    greeks: Greeks = "standard",
    greek_errors: bool = False,
    share_solves: bool = False,
    threads: int | None = None,
    deadline: ArrayLike | None = None,
    advice: bool = False,
) -> AnyFrame:
    """Price every row of a table, in order; a bad row gets a status and a message, never an exception.

    Parameters
    ----------
    table : pyarrow.Table, or any frame with the Arrow C stream interface
        Columns as in `price_many`, lists and curves as Arrow's lists and structures or as JSON text; C and P, and
        the words for a choice in any case, are understood; an empty cell takes the default. Others pass through.
    tolerance, greeks, greek_errors, share_solves, threads, deadline, advice
        As in `price_many`.

    Returns
    -------
    pyarrow.Table, or a frame of pandas or polars for one of theirs
        The columns of `table`, then those of the results, "message" the last; missing numbers are null.

    Raises
    ------
    InvalidInputError
        A column is missing, misspelt, of a type that cannot hold its values, or named as a result is.

    Warns
    -----
    UnusualColumnWarning
        A column looks like days, percent or cents.

    Examples
    --------
    >>> import pyarrow as pa
    >>> book = {"option_type": ["P", "call"], "spot": [90.0, -1.0], "strike": [100.0] * 2, "expiry": [1.0] * 2}
    >>> table = price_table(pa.table({**book, "rate": [0.05] * 2, "volatility": [0.2] * 2}), tolerance=1e-4)
    >>> table["status"].to_pylist(), table["price"].null_count
    (['ok', 'invalid_input'], 1)
    """
    settings = PricingSettings(
        tolerance, greeks, greek_errors, share_solves, deadline=deadline, advice=advice
    )
    return price_frame(table, settings, threads)
