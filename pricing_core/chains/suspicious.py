"""Columns that as a whole look like another unit, or like the other side: refused, never converted by a guess."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import InvalidInputError

LARGEST_RATIO = 10.0  # of the median strike to the spot: listed strikes lie around it; chosen
DEEP = 0.1  # share of the spot by which a deep option is in the money; chosen
MOST_ODD = 0.5  # share of the quotes that may be odd before the column is; chosen
FEWEST = 3  # odd rows that make a column odd; chosen


def check_units(table: pa.Table) -> None:
    """Look at the canonical columns of a table that has been read.

    Raises
    ------
    InvalidInputError
        A column looks like cents, thousandths, or the other side in most of its rows; it names the first of them.
    """
    names = ("underlying_price", "strike", "bid", "ask")
    spot, strike, bid, ask = (_numbers(table, name) for name in names)
    is_call = np.array(table["option_type"].to_pylist(), dtype=object) == "call"
    is_put = np.array(table["option_type"].to_pylist(), dtype=object) == "put"
    with np.errstate(invalid="ignore", divide="ignore"):
        _check_scale(spot, strike)
        two_sided = (bid > 0.0) & (ask > 0.0)
        _refuse("bid", bid, two_sided & (bid > ask), two_sided, "at most the ask: bid and ask look exchanged")
        most = np.where(is_call, spot, strike)
        sided = (is_call | is_put) & (bid > 0.0)
        deep = sided & (np.abs(strike / spot - 1.0) < DEEP)
        _refuse(
            "bid", bid, deep & (bid > most), deep, "below the spot or the strike: the prices look like cents"
        )
        in_the_money = np.where(is_call, spot - strike, strike - spot)
        far = (is_call | is_put) & (ask > 0.0) & (np.abs(in_the_money) > DEEP * spot)
        odd = far & (ask < 0.5 * in_the_money)
        _refuse(
            "option_type",
            np.where(is_call, "call", "put"),
            odd,
            far & (in_the_money > 0.0),
            "the side of the option: the prices are below half of what exercise brings",
        )


def _check_scale(spot: Vector, strike: Vector) -> None:
    known = np.flatnonzero((spot > 0.0) & (strike > 0.0))
    if not known.size:
        return
    ratio = float(np.median(strike[known] / spot[known]))
    if not 1.0 / LARGEST_RATIO < ratio < LARGEST_RATIO:
        row = int(known[0])
        raise InvalidInputError(
            f"column strike, row {row + 1}",
            strike.item(row),
            f"in money like underlying_price, {spot.item(row):g}: one of them looks like cents or thousandths",
        )


def _refuse(name: str, values: np.ndarray, odd: BoolVector, among: BoolVector, allowed: str) -> None:
    count = int(odd.sum())
    if count >= FEWEST and count > MOST_ODD * int(among.sum()):
        row = int(np.flatnonzero(odd)[0])
        raise InvalidInputError(f"column {name}, row {row + 1}", values[row].item(), allowed)


def _numbers(table: pa.Table, name: str) -> Vector:
    return np.array(table[name].to_numpy(zero_copy_only=False), dtype=np.float64)
