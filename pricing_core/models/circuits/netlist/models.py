"""The models of diodes and switches that a netlist names."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

from pricing_core.models.circuits.netlist.expressions import as_fraction
from pricing_core.models.circuits.netlist.lines import Line, value_of

THERMAL = 25.85e-3  # volts, kT/q near 300 K
SATURATION = Fraction(1, 10**14)  # SPICE's own, in amperes
CURRENT = Fraction(1, 100)  # amperes, at which the drop of a diode is taken
DIODE_CURRENT = "diode_current"  # the option that gives another

_DIODES = ("is", "n", "rs")
_SWITCHES = {"sw": ("vt", "vh", "ron", "roff"), "csw": ("it", "ih", "ron", "roff")}
_VOLTAGES = ("von", "voff", "ron", "roff")  # of VSWITCH


@dataclass(frozen=True, slots=True)
class DiodeModel:
    """A drop and a resistance in series with an ideal diode."""

    forward_voltage: Fraction
    resistance: Fraction


@dataclass(frozen=True, slots=True)
class SwitchModel:
    """Closes above threshold + hysteresis, opens below threshold - hysteresis: volts, or amperes of a current."""

    threshold: Fraction
    hysteresis: Fraction
    resistance: Fraction
    off_resistance: Fraction | None
    of_current: bool


def read_model(
    line: Line, lookup: Callable[[str], Fraction | None], current: Fraction, notes: list[str]
) -> tuple[str, DiodeModel | SwitchModel]:
    """Return a model and its name in lower case, and note what it leaves out.

    Parameters
    ----------
    current : Fraction
        Amperes at which the drop of a diode is taken.
    """
    words, options = line.options(1)
    if len(words) < 2:
        raise line.fault(".model NAME TYPE(parameter=value ...)")
    name, kind, *rest = words
    values = {key: value_of(f"{line.field}: {name}", text, lookup) for key, text in options.items()}
    if rest:
        raise line.fault(".model NAME TYPE(parameter=value ...)")
    if kind.lower() == "d":
        return name.lower(), _diode(line, name, values, current, notes)
    if kind.lower() == "vswitch":
        return name.lower(), _two_voltages(line, name, values)
    if kind.lower() in _SWITCHES:
        return name.lower(), _switch(line, name, kind.lower(), values)
    raise line.fault("a model of type D, SW, CSW or VSWITCH")


def _diode(
    line: Line, name: str, values: dict[str, Fraction], current: Fraction, notes: list[str]
) -> DiodeModel:
    if not values:
        return DiodeModel(Fraction(0), Fraction(0))
    saturation, factor = values.get("is", SATURATION), values.get("n", Fraction(1))
    if saturation <= 0 or factor < 0 or values.get("rs", 0) < 0:
        raise line.fault("a diode with IS > 0, N >= 0 and RS >= 0")
    drop = as_fraction(float(f"{float(factor) * THERMAL * math.log1p(current / saturation):.12g}"))
    resistance = values.get("rs", Fraction(0))
    left = ", ".join(key.upper() for key in values if key not in _DIODES)
    notes.append(
        f"{line.field}: {name} is an ideal diode with {float(drop):.4g} V, its drop at {float(current):g} A, in "
        f"series with {float(resistance):g} ohms" + (f"; {left} left out" if left else "")
    )
    return DiodeModel(drop, resistance)


def _switch(line: Line, name: str, kind: str, values: dict[str, Fraction]) -> SwitchModel:
    known = _SWITCHES[kind]
    _check_known(line, values, known)
    threshold, hysteresis = (values.get(key, Fraction(0)) for key in known[:2])
    if hysteresis < 0:
        raise line.fault(f"a switch with {known[1].upper()} >= 0")
    return _with_resistances(line, values, threshold, hysteresis, of_current=kind == "csw")


def _two_voltages(line: Line, name: str, values: dict[str, Fraction]) -> SwitchModel:
    _check_known(line, values, _VOLTAGES)
    on, off = values.get("von", Fraction(1)), values.get("voff", Fraction(0))
    if not on > off:
        raise line.fault("a switch with VON > VOFF")
    return _with_resistances(line, values, (on + off) / 2, (on - off) / 2, of_current=False)


def _with_resistances(
    line: Line, values: dict[str, Fraction], threshold: Fraction, hysteresis: Fraction, *, of_current: bool
) -> SwitchModel:
    on, off = values.get("ron", Fraction(1)), values.get("roff")
    if on < 0 or (off is not None and off <= on):
        raise line.fault("a switch with 0 <= RON < ROFF")
    return SwitchModel(threshold, hysteresis, on, off, of_current)


def _check_known(line: Line, values: dict[str, Fraction], known: tuple[str, ...]) -> None:
    for key in values:
        if key not in known:
            raise line.fault(
                f"a switch with {', '.join(word.upper() for word in known)} alone: no {key.upper()}"
            )
