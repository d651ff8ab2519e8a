"""The values of sources over time, and all of them together as the output of one exosystem."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from pricing_core.arrays import Matrix
from pricing_core.errors import InvalidInputError, Told
from pricing_core.lcs import Exosystem, JoinedExosystem, PiecewiseConstant
from pricing_core.models.circuits.checked import SMALLEST, checked_number, settle
from pricing_core.models.circuits.equations import Number

MOST_KNOTS = 20_000  # of lists of times; a run takes about a millisecond for each
MOST_PERIODS = 1e5  # of sines; and some for each of these
MOST_PULSES = 2e5  # periods of pulses and of clocks, of about 2 kB and some tenths of a millisecond each


@dataclass(frozen=True, slots=True)
class Sine:
    """The signal offset + amplitude sin(2 pi frequency t + phase), t in seconds.

    Parameters
    ----------
    amplitude, offset : float
        Volts or amperes.
    frequency : float
        Hertz, positive.
    phase : float
        Radians.
    """

    amplitude: float
    frequency: float
    phase: float = 0.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        for name in ("amplitude", "frequency", "phase", "offset"):
            settle(self, name, float(checked_number(name, getattr(self, name))))
        if self.frequency < SMALLEST:
            allowed = f"a positive number of hertz, at least {SMALLEST:g}"
            raise InvalidInputError("frequency", self.frequency, allowed)


Value: TypeAlias = Number | Sine | PiecewiseConstant | Exosystem

_CONSTANT = Exosystem([[0.0]], [[1.0]], [1.0])


def stacked(values: Sequence[Value]) -> Exosystem:
    """Return the exosystem whose output has one component for each value.

    Constants share one state, sines of the same frequency two; anything else brings its own.

    Examples
    --------
    >>> both = stacked([5.0, Sine(2.0, frequency=50.0), Sine(1.0, frequency=50.0, phase=np.pi / 2)])
    >>> both.generator.shape, both.after(0.005).round(12)
    ((3, 3), array([5., 2., 0.]))
    """
    blocks: dict[object, Exosystem] = {}
    weights: list[dict[object, Matrix]] = []
    for i, value in enumerate(values):
        parts = _parts(value, i)
        blocks.update({key: block for key, block, _ in parts})
        weights.append({key: weight for key, _, weight in parts})
    if not blocks:
        blocks["constant"] = _CONSTANT
    none = {key: np.zeros((1, block.generator.shape[0])) for key, block in blocks.items()}
    rows = [np.hstack([row.get(key, zero) for key, zero in none.items()]) for row in weights]
    output = np.vstack([np.zeros((0, sum(zero.shape[1] for zero in none.values()))), *rows])
    knots = sum(block.jumps.size for block in blocks.values() if block.period is None)
    if knots >= MOST_KNOTS:
        raise InvalidInputError(
            "sources", Told(f"{knots} knots"), f"of fewer than {MOST_KNOTS} knots together"
        )
    return JoinedExosystem(list(blocks.values()), output)


def check_periods(name: str, value: Value, t_span: tuple[float, float]) -> None:
    """Refuse an interval of so many periods that no simulation would come to its end."""
    if isinstance(value, Sine):
        check_count(name, 1.0 / value.frequency, t_span, MOST_PERIODS)
    elif isinstance(value, Exosystem) and value.period is not None:
        check_count(name, value.period, t_span, MOST_PULSES)


def check_count(name: str, period: float, t_span: tuple[float, float], most: float) -> None:
    """Refuse an interval of more periods than that."""
    if t_span[1] - t_span[0] > (1.0 + 1e-9) * most * period:
        raise InvalidInputError(
            "t_span", t_span, f"no longer than {most * period:g} s: {most:g} periods of {name}"
        )


def _parts(value: Value, index: int) -> list[tuple[object, Exosystem, Matrix]]:
    """Return the blocks of which the value is the weighted sum: key, block, weights of its states."""
    if isinstance(value, Sine):
        omega = 2.0 * math.pi * value.frequency
        oscillator = Exosystem([[0.0, omega], [-omega, 0.0]], np.eye(2), [0.0, 1.0])  # (sin, cos)
        size = value.amplitude * np.array([[math.cos(value.phase), math.sin(value.phase)]])
        offset = [("constant", _CONSTANT, np.array([[value.offset]]))] if value.offset else []
        return [(value.frequency, oscillator, size), *offset]
    if isinstance(value, PiecewiseConstant):
        starts = np.concatenate([value.times[:1] - 1.0, value.jumps])
        return [((index,), Exosystem([[0.0]], [[1.0]], value.values, starts), np.eye(1))]
    if isinstance(value, Exosystem):
        return [((index,), value, value.output)]
    return [("constant", _CONSTANT, np.array([[float(value)]]))]
