"""Whether constraints that become active together lead elsewhere when they do so one after the other (section 11.8)."""

from __future__ import annotations

import itertools

import numpy as np

from pricing_core.arrays import IndexSet, Vector
from pricing_core.lcs.mode_dynamics import ModeDynamics, State
from pricing_core.lcs.mode_selection import ModeSelector

MOST_TOGETHER = 4  # constraints whose orders are all tried
MOST_REBOUNDS = 50
SAME_STATE = 1e-8


def depends_on_order(
    selector: ModeSelector, state: State, active: IndexSet, crossed: tuple[int, ...], at_start: bool
) -> bool:
    """Tell whether the state after a jump depends on the order in which the constraints are met.

    Parameters
    ----------
    state : State
        Before the jump, in the form's units.
    active : tuple of int
        The mode before.
    crossed : tuple of int
        What is violated; at the start, when it is not known, what the mode without constraints violates.
    """
    if at_start:
        crossed = _violated(selector.dynamics(active), state)
    contacts = [i for i in crossed if i not in active]
    if not 2 <= len(contacts) <= MOST_TOGETHER:
        return False
    ends = [_one_by_one(selector, state, active, order) for order in itertools.permutations(contacts)]
    known = [end for end in ends if end is not None]
    size = SAME_STATE * float(np.max(np.abs(state.z), initial=0.0))
    return any(float(np.max(np.abs(end - known[0]))) > size for end in known[1:])


def _one_by_one(
    selector: ModeSelector, state: State, active: IndexSet, order: tuple[int, ...]
) -> Vector | None:
    """Return the state after the constraints are met in this order, None where that does not end."""
    dynamics = selector.dynamics(active)
    for _ in range(MOST_REBOUNDS):
        violated = [i for i in order if i in _violated(dynamics, state)]
        if not violated or dynamics is None:
            return None if dynamics is None else state.z
        looked_at = tuple(sorted({*dynamics.mode, violated[0]}))
        dynamics = _restricted(selector, state, looked_at)
        if dynamics is None:
            return None
        state = dynamics.leave(dynamics.enter(state))
    return None


def _restricted(selector: ModeSelector, state: State, looked_at: IndexSet) -> ModeDynamics | None:
    """Return the mode that admits z as far as these constraints see."""
    pairs = list(looked_at)
    for count in range(len(pairs), -1, -1):
        for mode in itertools.combinations(pairs, count):
            dynamics = selector.dynamics(mode)
            if dynamics is not None and np.all(dynamics.signs(state)[pairs] >= 0.0):
                return dynamics
    return None


def _violated(dynamics: ModeDynamics | None, state: State) -> tuple[int, ...]:
    if dynamics is None:
        return ()
    return tuple(np.flatnonzero(dynamics.signs(state) < 0.0).tolist())
