"""Rates, yields and volatilities that are constant between given times."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np

from pricing_core.american.contracts.field import Field
from pricing_core.american.contracts.fields import KNOT_TIMES, KNOT_VALUES
from pricing_core.american.contracts.json_text import from_text
from pricing_core.errors import InvalidInputError, Told


@dataclass(frozen=True, slots=True)
class PiecewiseConstant:
    """A function of time: values[i] up to times[i], the last value for ever.

    Parameters
    ----------
    times : sequence of float, shape (n,)
        Years from now, increasing, above 0; the last one ends nothing.
    values : sequence of float, shape (n,)

    Raises
    ------
    InvalidInputError
        A time or a value is no finite number, the times do not increase, or the lengths differ.

    Examples
    --------
    >>> curve = PiecewiseConstant(times=[0.5, 1.0], values=[0.04, 0.06])
    >>> curve.at(0.25), curve.at(0.5), curve.at(7.0), curve.integral(0.0, 1.0)
    (0.04, 0.06, 0.06, 0.05)
    """

    times: tuple[float, ...]
    values: tuple[float, ...]

    def __post_init__(self) -> None:
        times = _numbers(KNOT_TIMES, self.times)
        values = _numbers(KNOT_VALUES, self.values)
        if len(times) != len(values):
            raise InvalidInputError(
                "values", Told(f"{len(values)} values"), f"as many as there are times ({len(times)})"
            )
        if times[0] <= 0.0 or any(late <= early for early, late in pairwise(times)):
            raise InvalidInputError("times", list(times), "increasing, above 0")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "values", values)

    def at(self, time: float) -> float:
        """Return the value that holds from `time` on."""
        for end, value in zip(self.times, self.values, strict=True):
            if time < end:
                return value
        return self.values[-1]

    def integral(self, start: float, end: float) -> float:
        """Return the integral from start to end, 0 <= start <= end."""
        cuts = [start, *self.knots(start, end), end]
        return math.fsum((b - a) * self.at(a) for a, b in pairwise(cuts))

    def knots(self, start: float, end: float) -> list[float]:
        """Return the times strictly between start and end at which the value changes."""
        return [
            time
            for time, before, after in zip(self.times, self.values, self.values[1:], strict=False)
            if before != after and start < time < end
        ]


Curve: TypeAlias = float | PiecewiseConstant


def times_of(curve: object) -> tuple[float, ...]:
    """Return the times of a curve; there are none for a number or a surface."""
    return curve.times if isinstance(curve, PiecewiseConstant) else ()


def at(curve: Curve, time: float) -> float:
    """Return the value of a curve or number that holds from `time` (years from now) on."""
    return curve.at(time) if isinstance(curve, PiecewiseConstant) else curve


def seen_from(curve: Curve, time: float) -> Curve:
    """Return the curve as a function of the years after `time`."""
    if not isinstance(curve, PiecewiseConstant):
        return curve
    left = [(t - time, value) for t, value in zip(curve.times, curve.values, strict=True) if t > time]
    if not left:
        return curve.values[-1]
    return PiecewiseConstant(*zip(*left, strict=True))


def integral(curve: Curve, time: float) -> float:
    """Return the integral from now to a time, in years from now."""
    return curve.integral(0.0, time) if isinstance(curve, PiecewiseConstant) else curve * time


def read_curve(field: Field, value: object) -> Curve:
    """Return a float where `value` is a number or a curve with one value, and otherwise the curve.

    Parameters
    ----------
    field : Field
        Its limits are those of each of the values.
    value : float, PiecewiseConstant, mapping with "times" and "values", or the JSON of one of these

    Raises
    ------
    InvalidInputError
        It is none of them, or a value lies outside the limits; the message names the field.
    """
    if type(value) is float:
        return field.check(value)
    value = from_text(field, value)
    if isinstance(value, Mapping):
        if set(value) != {"times", "values"}:
            raise InvalidInputError(field.name, dict(value), field.allowed)
        value = _named(field.name, value)
    if not isinstance(value, PiecewiseConstant):
        return field.check(value)
    for number in value.values:
        field.check(number, f"{field.name}.values")
    return value.values[0] if len(set(value.values)) == 1 else value


def _named(field: str, value: Mapping[str, object]) -> PiecewiseConstant:
    try:
        return PiecewiseConstant(value["times"], value["values"])  # type: ignore[arg-type]  # checked inside
    except InvalidInputError as fault:
        raise fault.called(f"{field}.{fault.field}") from None


def _numbers(field: Field, values: object) -> tuple[float, ...]:
    """Return a sequence of numbers, at least one and not too many."""
    if not isinstance(values, Sequence | np.ndarray) or isinstance(values, str | bytes):
        raise InvalidInputError(field.name, values, "a list of numbers")
    if not 1 <= len(values) <= field.most_entries:
        raise InvalidInputError(
            field.name, Told(f"{len(values)} entries"), f"1 to {field.most_entries} numbers"
        )
    return tuple(field.check(value) for value in values)
