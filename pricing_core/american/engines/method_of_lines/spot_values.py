"""What sweeps say at a spot: value and derivatives, from the nodes on the spot's side of the exercise boundary."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pricing_core.american.engines.method_of_lines.interpolation import (
    local_derivatives,
    nearest,
    run_around,
)
from pricing_core.american.engines.method_of_lines.sweep_problem import Sweep
from pricing_core.arrays import Matrix, Vector

FINEST_CELL = 1e-5  # Smallest cell, in strikes, over which differences are more than rounding; derived.


def at_spot(sweep: Sweep, s: float) -> Matrix:
    """Return (v, v_s, v_ss, v_sss) and its derivatives by the parameters at s, shape (1 + P, 4)."""
    found = at_spots([sweep], [s])[0]
    if isinstance(found, Exception):
        raise found
    return found


def at_spots(sweeps: Sequence[Sweep], places: Sequence[float]) -> list[Matrix | Exception]:
    """Return the same of many sweeps, each at a place of its own, or what it raises; none depends on the others."""
    stencils = [_Stencil.around(sweep, s) for sweep, s in zip(sweeps, places, strict=True)]
    found: list[Matrix | Exception] = [np.zeros((0, 4))] * len(stencils)
    for width in {stencil.nodes.size for stencil in stencils}:
        alike = [place for place, stencil in enumerate(stencils) if stencil.nodes.size == width]
        for place, values in zip(alike, _derivatives([stencils[place] for place in alike]), strict=True):
            found[place] = values
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Stencil:
    """A place, the nodes w around it, the values there, and the derivatives by the parameters, if they are carried."""

    s: float
    nodes: Vector  # (w,)
    values: Vector  # (w,)
    tangents: Matrix | None  # (P, w)

    @classmethod
    def around(cls, sweep: Sweep, s: float) -> _Stencil:
        """Return the nodes around s on its side of the boundary."""
        nodes, last = sweep.grid.nodes, sweep.grid.nodes.size - 1
        next_one = min(int(nodes.searchsorted(s)), last)
        if next_one > 0 and s - nodes[next_one - 1] <= nodes[next_one] - s:
            next_one -= 1
        start, stop, stride = 0, last + 1, 1
        if sweep.contact.any():
            is_contact = np.concatenate([sweep.contact[:1], sweep.contact, sweep.contact[-1:]])
            if is_contact[next_one]:  # between the boundary and the first free node
                next_one = min(max(next_one + (1 if s > sweep.region.upper else -1), 0), last)
            start, stop = run_around(is_contact, next_one)
        if nodes[0] == 0.0:  # its first cells are far finer than rounding allows differences of
            cell = nodes[min(next_one + 1, last)] - nodes[max(next_one - 1, 0)]
            stride = max(math.ceil(2.0 * FINEST_CELL / cell), 1)
            start += (next_one - start) % stride
        usable = slice(start, stop, stride)
        near = nearest(nodes[usable], s)
        tangents = None if sweep.tangents is None else sweep.tangents[:, usable][:, near]
        return cls(s, nodes[usable][near], sweep.values[usable][near], tangents)


def _derivatives(stencils: Sequence[_Stencil]) -> list[Matrix | Exception]:
    """Return those of stencils with the same number of nodes, together if none of them raises anything."""
    nodes = np.array([stencil.nodes for stencil in stencils])
    values = np.array([stencil.values for stencil in stencils])
    places = np.array([stencil.s for stencil in stencils])
    try:
        found = local_derivatives(nodes, values[:, None, :], places)
    except np.linalg.LinAlgError as error:
        if len(stencils) == 1:
            return [error]
        return [_derivatives([stencil])[0] for stencil in stencils]
    # Those by parameters on their own, so that a price does not depend on the Greeks by rounding either.
    return [
        own
        if (carried := stencil.tangents) is None
        else np.concatenate(
            [own, local_derivatives(stencil.nodes[None], carried[None], places[row : row + 1])[0]]
        )
        for row, (own, stencil) in enumerate(zip(found, stencils, strict=True))
    ]
