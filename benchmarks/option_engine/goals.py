"""A goal, the figure reached, and a sentence on it."""

import math
from typing import Literal, NamedTuple


class Goal(NamedTuple):
    """A goal and the figure reached; `least` is the figure that counts as reached where it is less than the goal.

    `reached` is None, or NaN, where nothing was measured.
    """

    what: str
    sense: Literal[">=", "<="]
    goal: float
    reached: float | None
    least: float | None = None

    def shortfall(self, wanted: float) -> float:
        """Return the factor that is missing, 1 or less where nothing is."""
        if self.reached is None or math.isnan(self.reached):
            return math.nan
        better, worse = (wanted, self.reached) if self.sense == ">=" else (self.reached, wanted)
        return better / worse if worse > 0.0 else math.inf

    def verdict(self) -> str:
        """Return "reached", or by how much the goal is missed."""
        missing = self.shortfall(self.goal)
        if math.isnan(missing):
            return "not measured"
        if missing <= 1.0:
            return "reached"
        if math.isinf(missing):
            return "missed altogether"
        missed = f"missed by a factor of {missing:.3g}"
        if self.least is not None and self.shortfall(self.least) <= 1.0:
            return f"{missed}, the least is reached"
        return missed
