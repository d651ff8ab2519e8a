"""What time stepping is made of: the scheme for a relative degree, its method, and the trajectory in the end."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError, RelativeDegreeError
from pricing_core.lcs.system import LCS
from pricing_core.lcs.time_stepping import ImpulseScheme, LCSState, Scheme
from pricing_core.lcs.trajectory import Event, Trajectory
from pricing_core.lcs.transfer import relative_degree
from pricing_core.stepping import IMPLICIT_EULER, SDIRK2, DiagonallyImplicit, theta_method
from pricing_core.stepping.implicit import RatedStage
from pricing_core.stepping.method import OneStepMethod

SMALLEST_STEP = 1e-9  # fraction of the interval
LARGEST_RELATIVE_DEGREE = {"sdirk2": 1, "theta": 1, "implicit-euler": 2}
THETA = 0.5


def choose_scheme(system: LCS, scheme: Scheme | ImpulseScheme | Literal["auto"]) -> Scheme:
    """Return the scheme that "auto" stands for, or the given one if it can converge.

    Raises
    ------
    RelativeDegreeError
        It cannot.
    InvalidInputError
        It asks for positions and velocities.

    Examples
    --------
    >>> choose_scheme(LCS([[0.0]], [[1.0]], [[1.0]]), "auto")
    'sdirk2'
    """
    if scheme == "moreau" or scheme == "stewart-trinkle":  # noqa: PLR1714 - so that the type is narrowed
        raise InvalidInputError("scheme", scheme, "another one for this system: it is for a MechanicalSystem")
    degree = relative_degree(system)
    chosen: Scheme = ("sdirk2" if degree <= 1 else "implicit-euler") if scheme == "auto" else scheme
    if degree > LARGEST_RELATIVE_DEGREE[chosen]:
        remedy = (
            "use implicit-euler" if degree == 2 else "no time-stepping scheme of this kind converges for it"
        )
        raise RelativeDegreeError(
            f"the system has relative degree {degree}; {chosen} converges up to "
            f"{LARGEST_RELATIVE_DEGREE[chosen]}: {remedy}"
        )
    return chosen


def one_step_method(
    stage: RatedStage[LCSState], scheme: Scheme, theta: float | None
) -> OneStepMethod[LCSState]:
    """Build the method of a scheme on an implicit stage."""
    if scheme == "theta":
        return DiagonallyImplicit(stage, theta_method(THETA if theta is None else theta))
    return DiagonallyImplicit(stage, SDIRK2 if scheme == "sdirk2" else IMPLICIT_EULER)


def stepped_trajectory(
    times: Sequence[float],
    states: Sequence[LCSState],
    reported: Vector | None,
    *,
    events: Sequence[Event],
    status: Literal["finished", "interrupted"],
    scheme: str,
    counts: tuple[int, int, int],
) -> Trajectory:
    """Return the trajectory through the states, or the part of it at the times to report.

    Parameters
    ----------
    counts : (int, int, int)
        Steps accepted, rejected, forced.
    """
    table = np.array(times)
    if reported is None:
        kept = list(states)
    else:  # the last of equal times: after the jump
        keep = np.searchsorted(table, reported[reported <= table[-1]], side="right") - 1
        table, kept = table[keep], [states[i] for i in keep.tolist()]
    n, k = states[0].value.size, states[0].multiplier.size
    accepted, rejected, forced = counts
    return Trajectory(
        t=table,
        x=np.array([state.value for state in kept]).reshape(len(kept), n),
        u=np.array([state.multiplier for state in kept]).reshape(len(kept), k),
        y=np.array([state.slack for state in kept]).reshape(len(kept), k),
        events=tuple(events),
        status=status,
        scheme=scheme,
        accepted=accepted,
        rejected=rejected,
        forced=forced,
    )
