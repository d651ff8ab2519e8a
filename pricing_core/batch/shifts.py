"""The columns of contracts as a scenario has them: moved markets, and later dates."""

from __future__ import annotations

import datetime as dt
import json
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pricing_core.american.arrow.arrow_column import ArrowColumn, is_number, is_text
from pricing_core.american.arrow.cells import is_empty, number_array
from pricing_core.american.contracts.dates import is_meant_as_date, read_moment, year_fraction
from pricing_core.american.contracts.json_text import parse_json
from pricing_core.american.contracts.local_volatility import LocalVolatility
from pricing_core.american.contracts.vocabulary import DATES
from pricing_core.arrays import BoolVector, Vector
from pricing_core.batch.scenario import Scenario

Cells: TypeAlias = list[Any]
Curve: TypeAlias = dict[str, list[Any]]


class ShiftedContracts:
    """Contracts whose columns can be had as any of some scenarios has them, always of the same types.

    A spot is multiplied by 1 + shift; a shift of the volatility or the rate is added to every value of a curve. Days
    that pass bring the expiry, the times of curves, of dividends and of exercise nearer, or move the valuation date.
    What lies behind by then is gone: a dividend whose ex-time has come is removed and the spot stays what the shift
    makes it, because it stands for the spot of that day. A contract whose expiry has come has expiry 0.

    Parameters
    ----------
    columns : mapping of str to ArrowColumn
        The columns that describe contracts.
    sound : bool array, shape (n,)
        Which rows are to be read; the others become anything.
    scenarios : sequence of Scenario
    """

    def __init__(
        self, columns: Mapping[str, ArrowColumn], sound: BoolVector, scenarios: Sequence[Scenario]
    ) -> None:
        self._columns, self._sound = columns, sound
        self._moves_time = any(scenario.days_forward for scenario in scenarios)
        self._moves_volatility = any(scenario.volatility_shift for scenario in scenarios)
        self._moves_rate = any(scenario.rate_shift for scenario in scenarios)

    def under(self, scenario: Scenario) -> pa.RecordBatch:
        """Return the contracts as a scenario has them."""
        arrays = {name: column.array for name, column in self._columns.items()}
        arrays["spot"] = number_array(self._columns["spot"].numbers() * (1.0 + scenario.spot_shift))
        years = scenario.years_forward
        for name, moves, shift in (
            ("volatility", self._moves_volatility, scenario.volatility_shift),
            ("rate", self._moves_rate, scenario.rate_shift),
            *((name, False, 0.0) for name in ("dividend_yield", "borrow_rate", "foreign_rate")),
        ):
            if name in arrays and (moves or self._moves_time):
                arrays[name] = self._curves(self._columns[name], shift, years)
        if self._moves_time:
            arrays |= self._later(scenario)
        return pa.RecordBatch.from_pydict(arrays)

    def _curves(self, column: ArrowColumn, shift: float, years: float) -> pa.Array:
        """Return numbers and curves with a shift, and the times of the curves nearer."""
        numbers = column.numbers()
        if is_number(column.array.type) or not np.isnan(numbers[self._sound]).any():
            return number_array(numbers + shift)
        curves: dict[str, str] = {}

        def changed(cell: Any, number: float) -> str:
            if not np.isnan(number):
                return repr(number + shift)
            if not isinstance(cell, str):
                return json.dumps(_moved_curve(cell, shift, years))
            if cell not in curves:
                curves[cell] = json.dumps(_moved_curve(parse_json(cell), shift, years))
            return curves[cell]

        cells = zip(column.array.to_pylist(), numbers.tolist(), self._sound.tolist(), strict=True)
        return pa.array(
            [changed(cell, number) if sound else None for cell, number, sound in cells], pa.string()
        )

    def _later(self, scenario: Scenario) -> dict[str, pa.Array]:
        """Return the columns that tell times as they are later."""
        years, columns = scenario.years_forward, self._columns
        arrays: dict[str, pa.Array] = {}
        moments, left = self._dates(scenario)
        if "valuation_date" in columns:
            dates = [None if moment is None else moment.isoformat() for moment in moments]
            arrays["valuation_date"] = pa.array(dates, pa.string())
        if "expiry" in columns:
            arrays["expiry"] = number_array(np.maximum(columns["expiry"].numbers() - years, 0.0))
        for name in ("cash_dividends", "proportional_dividends"):
            if name in columns:
                cells = self._lists(columns[name], lambda entries, _: _dividends_due(entries, years))
                arrays[name] = pa.array(cells, pa.string())
        if "exercise_start" in columns:
            arrays["exercise_start"] = self._starts(columns["exercise_start"], years, left)
        if "exercise_times" in columns:
            times = self._lists(
                columns["exercise_times"],
                lambda entries, row: _times_left(entries, years, moments[row], left[row]),
            )
            arrays["exercise_times"] = pa.array(times, pa.string())
            arrays["exercise"] = self._exercises(times)
        return arrays

    def _dates(self, scenario: Scenario) -> tuple[Sequence[dt.datetime | None], Vector]:
        """Return the date on which each row is valued, at most its last, and the years left; nothing for no date."""
        moments: list[dt.datetime | None] = [None] * self._sound.size
        left = np.full(self._sound.size, np.inf)
        if not all(name in self._columns for name in DATES):
            return moments, left
        passed = dt.timedelta(days=scenario.days_forward)
        known: dict[Any, tuple[dt.datetime, float]] = {}
        starts, ends = (self._columns[name].array.to_pylist() for name in DATES)
        for row in np.flatnonzero(self._sound).tolist():
            pair = starts[row], ends[row]
            if is_empty(pair[0]):
                continue
            if pair not in known:
                start, end = (read_moment("", _stripped(date)) for date in pair)
                moment = start + passed if end - start > passed else end
                known[pair] = moment, year_fraction(moment, end)
            moments[row], left[row] = known[pair]
        return moments, left

    def _lists(self, column: ArrowColumn, changed: Callable[[Cells, int], Cells]) -> list[str | None]:
        """Return lists changed one by one, as JSON text; None for an empty one."""
        texts: list[str | None] = []
        for row, (cell, sound) in enumerate(zip(column.array.to_pylist(), self._sound.tolist(), strict=True)):
            entries = []
            if sound and not is_empty(cell):
                entries = changed(parse_json(cell) if isinstance(cell, str) else cell, row)
            texts.append(json.dumps(entries, default=_as_json) if entries else None)
        return texts

    def _starts(self, column: ArrowColumn, years: float, left: Vector) -> pa.Array:
        """Return when exercise windows open; dates stay, and those that have passed are known to be open."""
        numbers = np.minimum(np.maximum(column.numbers() - years, 0.0), left)
        if is_number(column.array.type):
            return number_array(numbers)
        if not is_text(column.array.type):
            return column.array
        texts = pa.array(
            [None if np.isnan(number) else repr(number) for number in numbers.tolist()], pa.string()
        )
        return pc.coalesce(texts, column.array.cast(pa.string()))

    def _exercises(self, times: Sequence[str | None]) -> pa.Array:
        """Return how contracts are exercised; a Bermudan one without an exercise time left is a European one."""
        column = self._columns["exercise"]
        bermudan = column.is_word("bermudan").tolist()
        words = column.array.cast(pa.string()).to_pylist()
        return pa.array(
            [
                "european" if has_times and listed is None else word
                for word, has_times, listed in zip(words, bermudan, times, strict=True)
            ],
            pa.string(),
        )


def _moved_curve(curve: Mapping[str, Any], shift: float, years: float) -> Curve:
    """Return a curve with a shift and nearer times, without the pieces that have passed; the last piece stays."""
    if curve.get("spots") is not None:
        seen = LocalVolatility(curve["times"], curve["spots"], curve["values"])
        seen = seen.seen_from(years) if years else seen
        axes = {"times": seen.times.tolist(), "spots": seen.spots.tolist()}
        return axes | {"values": (seen.values + shift).tolist()}
    times, values = list(curve["times"]), list(curve["values"])
    passed = min(sum(time <= years for time in times), len(times) - 1)
    nearer = [float(time) - years for time in times[passed:]]
    if nearer[-1] <= 0.0:  # the last value holds for ever
        nearer = [float(times[-1])]
    return {"times": nearer, "values": [float(value) + shift for value in values[passed:]]}


def _dividends_due(entries: Cells, years: float) -> Cells:
    """Return the dividends whose times have not come; those with dates are told by the valuation date."""
    if not years:
        return entries
    due = []
    for entry in entries:
        given = {name: value for name, value in entry.items() if value is not None}
        if "time" not in given:
            due.append(given)
        elif (time := float(given["time"]) - years) > 0.0:
            due.append({**given, "time": time})
    return due


def _times_left(entries: Cells, years: float, moment: dt.datetime | None, left: float) -> Cells:
    """Return the exercise times that have not come."""
    if not years:
        return entries
    times: Cells = []
    for entry in entries:
        if is_meant_as_date(entry):
            if moment is not None and read_moment("", entry) > moment:
                times.append(entry)
        elif (time := float(entry) - years) > 0.0:
            times.append(min(time, left))
    return times if left > 0.0 else []


def _stripped(cell: Any) -> Any:
    return cell.strip(" \t") if isinstance(cell, str) else cell


def _as_json(value: Any) -> Any:
    """Return what JSON has for a value that it does not know."""
    return float(value) if isinstance(value, Decimal) else value.isoformat()
