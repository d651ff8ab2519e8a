"""How the end of a run from event to event depends on its start: the derivative of the flow, events included."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.linalg import expm

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcs.flow import Flow

MEETS = (
    1e-7  # share of the coordinates by which the next flow may start elsewhere than where the last one led
)


def end_by_start(
    flows: Sequence[Flow], carry: Callable[[Flow, Flow], Matrix], first: Matrix
) -> Matrix | None:
    """Return the derivative of the last flow's coordinates at its end, shape (d, m).

    Where an output h c falls through zero at the end of a flow, the time of that moves by dt = -h dc/(h c'), and the
    next flow starts T (dc + c' dt) - c'_next dt apart, both as seen at the same time: the saltation matrix (Leine and
    Nijmeijer 2004, Dynamics and bifurcations of non-smooth mechanical systems, section 7). At given times dt is zero.

    Parameters
    ----------
    flows : sequence of Flow
    carry : callable
        T: the coordinates of a flow's start as a function of those at the end of the one before.
    first : Matrix, shape (d, m)
        How the coordinates of the first flow's start depend on m parameters.

    Returns
    -------
    Matrix or None
        None where a flow does not start where T leads: several jumps at one instant, or the limit of infinitely many
        events. An output that falls with no slope has no derivative either.
    """
    change = first
    for flow, following in zip(flows, [*flows[1:], None], strict=True):
        rate = flow.dynamics.rate * flow.form.units.rate  # per unit of time
        change = expm(rate * (flow.end - flow.start)) @ change
        if following is None:
            return change
        end = flow.coordinates_at(flow.end)
        T, start = carry(flow, following), following.coordinates[0]
        size = max(float(np.abs(start).max(initial=0.0)), float(np.abs(T @ end).max(initial=0.0)))
        if float(np.abs(T @ end - start).max(initial=0.0)) > MEETS * size:
            return None
        slope = rate @ end
        moved: Vector | None = None
        if flow.falls is not None:
            speed = float(flow.falls @ slope)
            if speed == 0.0:
                return None
            moved = -(flow.falls @ change) / speed
        change = T @ change
        if moved is not None:
            next_slope = following.dynamics.rate * following.form.units.rate @ start
            change = change + np.outer(T @ slope - next_slope, moved)
    return change
