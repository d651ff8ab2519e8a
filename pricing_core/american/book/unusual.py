"""Columns of numbers that look as if they were in other units than those of the library."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from pricing_core.arrays import Vector, some
from pricing_core.errors import UnusualColumnWarning


class Usual(NamedTuple):
    """From which median on a column seems to be in another unit, and which unit that would be."""

    below: float
    other_unit: str
    wanted: str


USUAL = {
    "expiry": Usual(15.0, "days", "years"),
    "rate": Usual(0.4, "percent", "1/year: 0.05 is 5 %"),
    "dividend_yield": Usual(0.4, "percent", "1/year: 0.05 is 5 %"),
    "volatility": Usual(4.0, "percent", "1/sqrt(year): 0.2 is 20 %"),
}
MOST_RATIO = 50.0  # Largest median of strike/spot, or of its inverse, that passes without a word.
EXAMINED = (*USUAL, "spot", "strike")


def unusual_columns(numbers: Mapping[str, Vector]) -> list[str]:
    """Return one sentence for each column whose median looks like days, percent or cents.

    Examples
    --------
    >>> unusual_columns({"expiry": np.array([30.0, 90.0]), "rate": np.array([0.05, 0.05])})
    ['column expiry looks like days: its median is 60; it is read in years']
    """
    found = []
    for name, usual in USUAL.items():
        column = numbers.get(name)
        if column is None or not some(np.abs(column) > usual.below):
            continue
        median = _median(column)
        if abs(median) > usual.below:
            found.append(
                f"column {name} looks like {usual.other_unit}: its median is {median:.6g}; it is read in {usual.wanted}"
            )
    ratio = _median_ratio(numbers["strike"], numbers["spot"]) if {"spot", "strike"} <= set(numbers) else 1.0
    if ratio > MOST_RATIO or 0.0 < ratio < 1.0 / MOST_RATIO:
        name = "strike" if ratio > 1.0 else "spot"
        found.append(
            f"column {name} looks like cents, or another unit than the other: the median of strike/spot is {ratio:.6g}"
        )
    return found


def warn_of(sentences: Sequence[str], callers: int) -> None:
    """Issue one warning for each sentence, at the user's call, which is `callers` frames above."""
    for sentence in sentences:
        warnings.warn(sentence, UnusualColumnWarning, stacklevel=callers + 1)


def _median_ratio(strike: Vector, spot: Vector) -> float:
    """Return the median of strike/spot, or 1 where no ratio is large or small enough to ask for it."""
    with np.errstate(all="ignore"):
        if not some((strike > MOST_RATIO * spot) | (spot > MOST_RATIO * strike)):
            return 1.0
        return _median(strike / spot)


def _median(column: Vector) -> float:
    known = column[np.isfinite(column)]
    return float(np.median(known)) if known.size else np.nan
