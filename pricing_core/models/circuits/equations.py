"""The linear equations of a network: rows of named unknowns with rational coefficients."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from typing import Literal, TypeAlias

from flint import fmpq

from pricing_core.linalg.rational import rational

GROUND = "0"
ONE = ""  # the source whose value is always 1, in which constants are measured

Number: TypeAlias = int | float | Fraction

# "v" a node's voltage, "i" a branch's current, "reverse" what a diode's voltage from cathode to anode has above that of
# conducting, "state" the voltage of a capacitor or the current of an inductor, "source" the value of an independent
# source. An element that is piecewise linear has more pairs of an "i" and a "reverse" than branches.
Kind: TypeAlias = Literal["v", "i", "reverse", "state", "source"]
Symbol: TypeAlias = tuple[Kind, str]
Row: TypeAlias = dict[Symbol, fmpq]


def voltage(plus: str, minus: str, factor: fmpq | int = 1) -> Row:
    """Return factor (v(plus) - v(minus)), the ground left out.

    Examples
    --------
    >>> voltage("a", "0", 2)
    {('v', 'a'): 2}
    """
    return total(
        {("v", node): fmpq(factor) * sign for node, sign in ((plus, 1), (minus, -1)) if node != GROUND}
    )


def current(branch: str, factor: fmpq | int = 1) -> Row:
    """Return factor i(branch)."""
    return {("i", branch): fmpq(factor)}


def constant(value: Number) -> Row:
    """Return a constant number.

    Examples
    --------
    >>> constant(0.7)
    {('source', ''): 7/10}
    """
    return {("source", ONE): rational(value)}


def total(*rows: Row) -> Row:
    """Return the sum of the rows.

    Examples
    --------
    >>> total(voltage("a", "b"), voltage("b", "0"))
    {('v', 'a'): 1, ('v', 'b'): 0}
    """
    summed: Row = {}
    for row in rows:
        for symbol, coefficient in row.items():
            summed[symbol] = summed.get(symbol, fmpq(0)) + coefficient
    return summed


def symbols(kind: Kind, names: Iterable[str]) -> tuple[Symbol, ...]:
    """Return the symbols of one kind, in the order of the names."""
    return tuple((kind, name) for name in names)
