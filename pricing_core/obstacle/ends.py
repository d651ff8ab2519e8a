"""What holds at an end of the interval, and beyond it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError
from pricing_core.obstacle.functions import Function, Given, read_function


@dataclass(frozen=True, slots=True, eq=False)
class Held:
    """V has a given value at the end of the interval, such as the rebate of a barrier.

    Parameters
    ----------
    value : float or callable
        Money: a number or f(t), held at the end.
    beyond : float or callable, optional
        What a move meets beyond the end; the value where it is left out.
    """

    value: Given
    beyond: Given | None = None
    functions: tuple[Function, Function] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        value = read_function("ends", self.value, always=("t",))
        beyond = value if self.beyond is None else read_function("ends", self.beyond, always=("t",))
        object.__setattr__(self, "functions", (value, beyond))

    def at(self, t: float) -> float:
        """Return the value held at the time t."""
        return float(self.functions[0](np.zeros(1), t)[0])

    def beyond_at(self, t: float) -> float:
        """Return the value beyond the end at the time t."""
        return float(self.functions[1](np.zeros(1), t)[0])


End: TypeAlias = Literal["linear", "exponential"] | Held


def read_end(given: object) -> End:
    """Read what holds at an end.

    Raises
    ------
    InvalidInputError
        It is neither a word that is known nor a value.
    """
    if isinstance(given, Held) or (isinstance(given, str) and given in ("linear", "exponential")):
        return given  # type: ignore[return-value]
    if isinstance(given, str) or given is None:
        raise InvalidInputError("ends", given, '"linear", "exponential", a number or Held(value)')
    return Held(given)  # type: ignore[arg-type]


def measure(end: End, x: Vector) -> Vector:
    """Return the function of x in which V is a straight line at this end, up to a factor and a constant.

    It is that of x less the first place, so that e^x neither overflows nor loses its digits.
    """
    return np.asarray(np.expm1(x - x[0]) if end == "exponential" else x - x[0])


def ratio(end: End, x: Vector) -> float:
    """Return q of V_0 = (1 + q) V_1 - q V_2 at the three places x from the end inwards."""
    s = measure(end, x)
    return float((s[0] - s[1]) / (s[1] - s[2]))
