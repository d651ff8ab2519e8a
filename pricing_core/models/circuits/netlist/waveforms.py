"""The values of independent sources over time: DC, SIN, PULSE, EXP and PWL."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import Exosystem, piecewise_linear, pulses
from pricing_core.models.circuits.netlist.lines import Card
from pricing_core.models.circuits.signals import Sine, Value

SIN = "SIN(offset amplitude hertz [delay=0 damping=0 degrees=0])"
PULSE = "PULSE(low high delay rise fall width period)"
EXP = "EXP(first second delay time_constant delay time_constant)"
PWL = "PWL(time value time value ...)"


def waveform(card: Card) -> Value:
    """Return the value of an independent source, whose words follow its nodes.

    Raises
    ------
    InvalidInputError
        It is none of these, or has other numbers.
    """
    words = list(card.words[3:])
    if words and words[0].lower() == "dc":
        words = words[1:]
        if len(words) > 1 and words[1].lower() in _SHAPES:  # DC for the operating point, and a waveform
            words = words[1:]
    shape = words[0].lower() if words else ""
    if shape not in _SHAPES and len(words) != 1:
        allowed = "one value: a number, SIN(...), PULSE(...), EXP(...) or PWL(...)"
        raise InvalidInputError(card.field, card.line.text, allowed)
    if shape not in _SHAPES:
        return card.value(words[0])
    form, read = _SHAPES[shape]
    numbers = [float(card.value(word)) for word in words[1:]]
    try:
        found = read(numbers)
    except InvalidInputError as fault:
        raise InvalidInputError(
            f"{card.field}: {fault.field}", fault.value, f"{fault.allowed}, in {form}"
        ) from None
    if found is None:
        raise InvalidInputError(card.field, card.line.text, form)
    return found


def _sine(numbers: Sequence[float]) -> Value | None:
    if not 3 <= len(numbers) <= 6:
        return None
    offset, amplitude, frequency, delay, damping, degrees = [*numbers, 0.0, 0.0, 0.0][:6]
    wave = Sine(amplitude, frequency, math.radians(degrees), offset)
    if not (delay or damping):
        return wave
    omega = 2.0 * math.pi * wave.frequency
    start = [math.sin(wave.phase), math.cos(wave.phase)]
    generator = [[-damping, omega, 0.0], [-omega, -damping, 0.0], [0.0, 0.0, 0.0]]
    before = [0.0, 0.0, offset + amplitude * start[0]]  # as the sine begins
    states = [before, [*start, offset]]
    if amplitude == 0.0:
        return offset
    return Exosystem(generator, [[amplitude, 0.0, 1.0]], states, [delay - 1.0, delay])


def _pulse(numbers: Sequence[float]) -> Value | None:
    if len(numbers) != 7:
        return None
    low, high, delay, rise, fall, width, period = numbers
    return pulses(low, high, period, width, rise, fall, delay)


def _exponential(numbers: Sequence[float]) -> Value | None:
    if len(numbers) != 6:
        return None
    first, second, up, rise, down, fall = numbers
    if not (rise > 0.0 and fall > 0.0 and down > up):
        raise InvalidInputError(
            "time constants and delays", numbers[2:], "positive, the second delay the later"
        )
    change = second - first
    left = change * math.exp(-(down - up) / rise)
    states = [[first, 0.0, 0.0], [second, -change, 0.0], [first, -left, change]]
    generator = [[0.0, 0.0, 0.0], [0.0, -1.0 / rise, 0.0], [0.0, 0.0, -1.0 / fall]]
    return Exosystem(generator, [[1.0, 1.0, 1.0]], states, [up - 1.0, up, down])


def _polyline(numbers: Sequence[float]) -> Value | None:
    if len(numbers) < 4 or len(numbers) % 2:
        return None
    return piecewise_linear(numbers[::2], numbers[1::2])


_SHAPES: dict[str, tuple[str, Callable[[Sequence[float]], Value | None]]] = {
    "sin": (SIN, _sine),
    "pulse": (PULSE, _pulse),
    "exp": (EXP, _exponential),
    "pwl": (PWL, _polyline),
}
