"""From a guessed structure to one whose shot has the right signs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pricing_core.errors import InfeasibleError, NumericalError
from pricing_core.models.control.collocation import Collocation, collocate
from pricing_core.models.control.layout import Layout, layout, with_times
from pricing_core.models.control.problem import LQData, constraint_orders, hamiltonian_system, held_at_start
from pricing_core.models.control.repair import improved, reordered, separated
from pricing_core.models.control.sampling import Samples, sample
from pricing_core.models.control.shooting import Shot, shoot
from pricing_core.models.control.structure import Structure, detect_structure

MOST_REPAIRS = 12
REFINED = 4  # the second and last guess comes from so many times as many intervals


@dataclass(frozen=True, slots=True, eq=False)
class Resolved:
    """A shot that satisfies (11.25) with every sign right."""

    plan: Layout
    shot: Shot
    samples: tuple[Samples, ...]
    structure: Structure


def resolve(data: LQData, intervals: int) -> tuple[Collocation | None, Resolved | None]:
    """Collocate, guess the structure, shoot and repair; once more on finer intervals where that fails.

    Before that the motion that touches no constraint is tried.

    Returns
    -------
    Collocation or None
        The finest one that was computed, None where none was.
    Resolved or None
        None where no structure was found: its contacts may accumulate, as they do for order >= 3.
    """
    free = _from_structure(data, ())
    if free is not None:  # no constraint is touched
        return None, free
    try:
        coarse = collocate(data, intervals)
    except InfeasibleError:
        raise
    except NumericalError:  # controls that are constant for shorter may do
        fine = collocate(data, REFINED * intervals)
        return fine, _from_guess(data, fine)
    found = _from_guess(data, coarse)
    if found is not None:
        return coarse, found
    try:
        fine = collocate(data, REFINED * intervals)
    except NumericalError:  # the coarse answer stands, unresolved
        return coarse, None
    return fine, _from_guess(data, fine)


def _from_guess(data: LQData, solution: Collocation) -> Resolved | None:
    orders = constraint_orders(data)
    held = held_at_start(data, orders)
    slacks = solution.x @ data.C.T - data.bound
    return _from_structure(data, detect_structure(solution, slacks, data.slack_sizes, orders, held))


def _from_structure(data: LQData, structure: Structure) -> Resolved | None:
    """Shoot and repair; no constraint being touched, only the answer to that counts, without repair."""
    system, orders = hamiltonian_system(data), constraint_orders(data)
    repairs = MOST_REPAIRS if structure else 1
    for _ in range(repairs):
        plan = layout(system, data, orders, structure)
        if plan is None:  # constraints that are not active together may hand over to one another
            apart = separated(structure)
            if apart == structure:
                return None
            structure = apart
            continue
        with np.errstate(over="ignore", invalid="ignore"):
            shot = shoot(data, plan)
        if shot.residual == np.inf:
            return None
        if not shot.is_ordered:
            structure = reordered(with_times(structure, plan, shot.times), orders, data.horizon)
            continue
        samples = sample(data, plan, shot)
        better = improved(data, orders, plan, shot, samples, structure)
        if better == with_times(structure, plan, shot.times):  # nothing to repair
            return Resolved(plan, shot, samples, better) if shot.converged else None
        structure = better
    return None
