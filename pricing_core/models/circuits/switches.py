"""Switches, and what controls them: a clock, or a voltage with hysteresis."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from pricing_core.arrays import BoolVector, Vector
from pricing_core.errors import InvalidInputError, Told
from pricing_core.lcs import PiecewiseConstant
from pricing_core.linalg.rational import rational
from pricing_core.models.circuits.checked import (
    checked_ends,
    checked_nonnegative,
    checked_number,
    checked_positive,
    checked_words,
    settle,
)
from pricing_core.models.circuits.elements import Branch
from pricing_core.models.circuits.equations import Number, Row, current, total, voltage

SAME_INSTANT = 1e-12  # of a period


@dataclass(frozen=True, slots=True)
class Pulse:
    """Closed for `width` of each period, from `delay` on, open otherwise and before.

    Parameters
    ----------
    period, width : float
        Seconds, 0 < width < period.
    delay : float
        When the first pulse begins, in seconds.

    Examples
    --------
    >>> Pulse(period=10e-6, width=4e-6).closed_after(np.array([0.0, 3e-6, 4e-6, 1e-5])).tolist()
    [True, True, False, True]
    """

    period: float
    width: float
    delay: float = 0.0

    def __post_init__(self) -> None:
        for name in ("period", "width"):
            settle(self, name, float(checked_positive(name, getattr(self, name))))
        settle(self, "delay", float(checked_number("delay", self.delay)))
        if not self.width < self.period:
            raise InvalidInputError("width", self.width, f"shorter than the period of {self.period:g} s")

    def closed_after(self, t: Vector) -> BoolVector:
        """Return whether the switch is closed just after each of the times `t`, shape (m,)."""
        place = (t - self.delay) / self.period
        place = place + np.maximum(SAME_INSTANT, 4.0 * np.spacing(np.abs(place)))
        inside = place - np.floor(place) < self.width / self.period
        return np.asarray(inside & (place >= 0.0))

    def instants(self, t0: float, t1: float) -> Vector:
        """Return the times strictly between `t0` and `t1` at which the switch opens or closes."""
        first = max(math.floor((t0 - self.delay) / self.period), 0)
        count = max(math.ceil((t1 - self.delay) / self.period) - first + 1, 0)
        starts = self.delay + self.period * np.arange(first, first + count)
        times = np.column_stack([starts, starts + self.width]).ravel()
        return times[(times > t0) & (times < t1)]


@dataclass(frozen=True, slots=True)
class Threshold:
    """Closes where v(plus) - v(minus) rises above threshold + hysteresis, opens where it falls below their difference.

    In between it stays as it is; at the start it is open there, unless `closed` says otherwise. Without `minus` it is
    the current of the element `plus`.
    """

    plus: str
    minus: str
    threshold: Number
    hysteresis: Number = 0
    closed: bool = False


Control: TypeAlias = Pulse | PiecewiseConstant | Threshold


@dataclass(frozen=True, slots=True, eq=False)
class Switch:
    """v = resistance i while it is closed, i = v / off_resistance while it is open (i = 0 where that is None).

    Parameters
    ----------
    control : Pulse, PiecewiseConstant of 0 and 1, Threshold, or (node, node, threshold, hysteresis)
    resistance : number
        Ohms, 0 for an ideal switch.
    off_resistance : number, optional
        Ohms; an ideal switch leaks nothing.
    """

    name: str
    plus: str
    minus: str
    control: Control
    resistance: Number = 0
    off_resistance: Number | None = None

    def __post_init__(self) -> None:
        checked_ends(self.name, self.plus, self.minus)
        settle(self, "control", checked_control(self.name, self.control))
        field = f"resistance of {self.name}"
        settle(self, "resistance", checked_nonnegative(field, self.resistance))
        if self.off_resistance is not None:
            off = checked_positive(f"off_resistance of {self.name}", self.off_resistance)
            settle(self, "off_resistance", off)
            if not off > self.resistance:
                raise InvalidInputError(
                    f"off_resistance of {self.name}", off, f"larger than its resistance, {self.resistance}"
                )

    @property
    def branches(self) -> tuple[Branch, ...]:
        """One branch, from plus to minus."""
        return (Branch(self.name, self.plus, self.minus),)

    @property
    def equations(self) -> tuple[Row, ...]:
        """No rows: they depend on the position, which is not known yet."""
        return ()

    def at(self, closed: bool) -> SwitchAt:
        """Return the element that it is in one of its positions."""
        return SwitchAt(self, closed)


@dataclass(frozen=True, slots=True, eq=False)
class SwitchAt:
    """A switch in one of its positions.

    Examples
    --------
    >>> switch = Switch("S1", "a", "0", Pulse(1, 0.5), resistance=2)
    >>> switch.at(True).equations, switch.at(False).equations
    (({('v', 'a'): 1, ('i', 'S1'): -2},), ({('i', 'S1'): 1},))
    """

    switch: Switch
    closed: bool

    @property
    def name(self) -> str:
        """The name of the switch."""
        return self.switch.name

    @property
    def branches(self) -> tuple[Branch, ...]:
        """The branch of the switch."""
        return self.switch.branches

    @property
    def equations(self) -> tuple[Row, ...]:
        """One row: Ohm's law, no voltage, or no current."""
        switch = self.switch
        across, through = voltage(switch.plus, switch.minus), current(switch.name)
        if self.closed:
            return (total(across, current(switch.name, -rational(switch.resistance))),)
        if switch.off_resistance is None:
            return (through,)
        return (total(across, current(switch.name, -rational(switch.off_resistance))),)


def checked_control(name: str, control: object) -> Control:
    """Return the control of a switch, or refuse."""
    field = f"control of {name}"
    if isinstance(control, PiecewiseConstant):
        if control.size != 1 or not np.isin(control.values, (0.0, 1.0)).all():
            raise InvalidInputError(field, Told("a PiecewiseConstant"), "one component, of values 0 and 1")
        return control
    if isinstance(control, tuple | list) and len(control) in (3, 4):
        control = Threshold(*control)
    if isinstance(control, Threshold):
        checked_words(field, control.plus, control.minus)
        if control.plus == control.minus:
            raise InvalidInputError(field, control.plus, "two different nodes")
        numbers = (
            checked_number(f"threshold of {name}", control.threshold),
            checked_nonnegative(f"hysteresis of {name}", control.hysteresis),
        )
        return Threshold(control.plus, control.minus, *numbers, bool(control.closed))
    if not isinstance(control, Pulse):
        allowed = "a Pulse, a PiecewiseConstant of 0 and 1, or (node, node, threshold, hysteresis)"
        raise InvalidInputError(field, control, allowed)
    return control


def closed_after(control: Pulse | PiecewiseConstant, t: Vector, close: float) -> BoolVector:
    """Return whether a control by the clock is closed just after each of the times, `close` being no time."""
    if isinstance(control, Pulse):
        return control.closed_after(t)
    places = np.searchsorted(control.times, t + close, side="right")
    return np.asarray(control.values[np.minimum(places, control.times.size - 1), 0] == 1.0)


def instants(control: Pulse | PiecewiseConstant, t0: float, t1: float) -> Vector:
    """Return the times strictly inside an interval at which a control by the clock changes."""
    return control.instants(t0, t1) if isinstance(control, Pulse) else control.knots(t0, t1)


def resolution(control: Pulse | PiecewiseConstant) -> float:
    """Return the time below which instants of the control are one."""
    if isinstance(control, Pulse):
        return SAME_INSTANT * control.period
    gaps = np.diff(control.times)
    return SAME_INSTANT * float(gaps.min()) if gaps.size else 0.0
