"""The run of a model's complementarity system, where the model knows more of uniqueness than its system tells."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.errors import NonUniqueError
from pricing_core.lcs import LCS, EventDriven, TimeStepping, Trajectory, simulate
from pricing_core.lcs.ill_posedness import ambiguous_pairs
from pricing_core.lcs.mode_selection import LARGEST_COMPLETE


def simulate_unique(
    system: LCS,
    x0: ArrayLike,
    t_span: tuple[float, float],
    method: EventDriven | TimeStepping,
    t_eval: ArrayLike | None,
    has_unique_state: Callable[[], Literal[True] | None],
) -> tuple[Trajectory, Literal[True] | None]:
    """Simulate, with the first continuation taken where it is proved to be the only one; tell whether it is.

    Raises
    ------
    NonUniqueError
        A state has several continuations; for systems too large for every mode to be looked at, x0 has.
    """
    if isinstance(method, TimeStepping):
        return simulate(system, x0, t_span, method=method, t_eval=t_eval), None
    unique = has_unique_state()
    if unique and method.on_nonunique == "raise":
        method = replace(method, on_nonunique="first")
    run = simulate(system, x0, t_span, method=method, t_eval=t_eval)
    if (
        method.on_nonunique == "raise"
        and system.shape[1] > LARGEST_COMPLETE
        and ambiguous_pairs(system, x0, t_span[0]) is not None
    ):
        raise NonUniqueError(
            f"several continuations from x = {np.array2string(np.asarray(x0), precision=6, threshold=8)} at "
            f't = {t_span[0]:.12g}: choose with on_nonunique="first"'
        )
    return run, unique
