"""The method of lines: the option as a complementarity system, semidiscretised, stepped implicitly, extrapolated.

In every segment between two events V' = L V + u, 0 <= u _|_ V - g >= 0 at the nodes of a grid in the spot, (11.63):
`segment_form` states it (and `as_lcs` gives it to the general theory), `stage` solves the complementarity problem of
one implicit stage (11.65), `boundary_cell` places the exercise boundary inside its cell, `event_transfer` carries the
value over an event, `sweep` puts these together from expiry to now, `refinement` repeats that at doubling resolutions
until the extrapolated price meets the tolerance, and `joint_work` has the sweeps of many contracts done at once. It
serves every contract that has time left and a spot, and is the reference of the other engines.
"""

from __future__ import annotations

from pricing_core.american.book.resolution import Resolution, Scheme
from pricing_core.american.engines.method_of_lines.engine import MethodOfLines
from pricing_core.american.engines.method_of_lines.stage import LCPMethod

__all__ = ["LCPMethod", "MethodOfLines", "Resolution", "Scheme"]
