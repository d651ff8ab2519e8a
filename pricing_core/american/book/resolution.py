"""How finely a contract is solved on a grid: cells, time steps, and the method that takes them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from pricing_core.errors import InvalidInputError

TimeMesh: TypeAlias = Literal["square-root", "cube-root", "uniform", "adaptive"]
Scheme: TypeAlias = Literal["sdirk2", "implicit-euler", "crank-nicolson"]
LCPMethod: TypeAlias = Literal["tridiagonal", "policy", "psor", "lemke"]

LARGEST_STRETCHING = 10.0  # Largest stretching of a grid; chosen.
SMALLEST_INTERVALS, SMALLEST_STEPS, MOST = 8, 4, 20_000  # Limits of a resolution; chosen.


@dataclass(frozen=True, slots=True)
class Resolution:
    """Grid cells and time steps of one solve.

    Parameters
    ----------
    intervals : int
        Cells of the grid, 8 to 20,000.
    steps : int
        Time steps, 4 to 20,000; with "adaptive" the size of the local tolerance, 0.02/steps**3 of the strike,
        which leads to about as many.
    time_mesh : {"square-root", "cube-root", "uniform", "adaptive"}
        Equal steps in the square root of tau, in its cube root or in tau itself, or step-size control by step
        doubling and a PI controller.
    scheme : {"sdirk2", "implicit-euler", "crank-nicolson"}, optional
        The one-step method; by default "sdirk2".
    stretching : float
        0 to 10: how much closer the nodes lie around the strike; 0 means equally spaced in ln(S + shift).
    """

    intervals: int = 400
    steps: int = 100
    time_mesh: TimeMesh = "square-root"
    scheme: Scheme | None = None
    stretching: float = 0.0

    def __post_init__(self) -> None:
        for field, least in (("intervals", SMALLEST_INTERVALS), ("steps", SMALLEST_STEPS)):
            value = getattr(self, field)
            if not isinstance(value, int) or not least <= value <= MOST:
                raise InvalidInputError(field, value, f"an integer from {least} to {MOST}")
        if not 0.0 <= self.stretching <= LARGEST_STRETCHING:
            raise InvalidInputError(
                "stretching", self.stretching, f"a number from 0 to {LARGEST_STRETCHING:g}"
            )
        choices = {
            "time_mesh": ("square-root", "cube-root", "uniform", "adaptive"),
            "scheme": (None, "sdirk2", "implicit-euler", "crank-nicolson"),
        }
        for field, allowed in choices.items():
            if getattr(self, field) not in allowed:
                raise InvalidInputError(field, getattr(self, field), "one of " + ", ".join(map(str, allowed)))

    def refined(self) -> Resolution:
        """Return twice the cells and twice the steps."""
        return replace(self, intervals=2 * self.intervals, steps=2 * self.steps)

    def coarsened(self) -> Resolution | None:
        """Return half the cells and half the steps, None where there are too few."""
        if self.intervals < 2 * SMALLEST_INTERVALS or self.steps < 2 * SMALLEST_STEPS:
            return None
        return replace(self, intervals=self.intervals // 2, steps=self.steps // 2)
