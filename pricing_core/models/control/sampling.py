"""The values of a shot between its junctions: state, costate, multiplier, and the cost."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.models.control.layout import Layout
from pricing_core.models.control.problem import LQData
from pricing_core.models.control.shooting import Shot

PER_PIECE = 24
GAUSS_NODES, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(12)
CUTS = 4  # panels of a piece in the quadrature


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Values on one segment, from its first to its last instant."""

    t: Vector  # (r,)
    x: Matrix  # (r, n)
    costate: Matrix  # (r, n)
    multiplier: Matrix  # (r, k)


def sample(data: LQData, plan: Layout, shot: Shot) -> tuple[Samples, ...]:
    """Return equally spaced values on every segment, both ends included."""
    places = np.arange(PER_PIECE) / PER_PIECE
    return tuple(
        _segment(data, plan, shot, s, places, with_end=True)
        for s in range(len(plan.arcs))
        if shot.times[s + 1] > shot.times[s]
    )


def cost(data: LQData, plan: Layout, shot: Shot) -> float:
    """Return (11.21) by Gauss-Legendre quadrature, exact to rounding."""
    nodes = ((0.5 * (GAUSS_NODES + 1.0))[None, :] + np.arange(CUTS)[:, None]).ravel() / CUTS
    total = 0.0
    for s, pieces in enumerate(plan.pieces):
        values = _segment(data, plan, shot, s, nodes, with_end=False)
        u = values.costate @ data.B
        integrand = np.einsum("ji,il,jl->j", values.x, data.Q, values.x) + np.sum(u**2, axis=1)
        panel = float(shot.times[s + 1] - shot.times[s]) / (pieces * CUTS)
        total += 0.25 * panel * float(np.tile(GAUSS_WEIGHTS, pieces * CUTS) @ integrand)
    return total


def _segment(data: LQData, plan: Layout, shot: Shot, s: int, places: Vector, *, with_end: bool) -> Samples:
    """Evaluate at `places` (shares of a piece) in every piece of a segment, and at the segment's end."""
    flow, pieces, n = plan.arcs[s], plan.pieces[s], data.states
    start, length = float(shot.times[s]), float(shot.times[s + 1] - shot.times[s]) / pieces
    states = np.stack([shot.starts[s] @ flow.transition(place * length).T for place in places], axis=1)
    extended = states.reshape(-1, flow.size + 1)
    t = start + length * (np.arange(pieces)[:, None] + places[None, :]).ravel()
    if with_end:
        extended = np.vstack([extended, shot.starts[s][-1] @ flow.transition(length).T])
        t = np.append(t, shot.times[s + 1])
    z = flow.state(extended)
    eta = np.zeros((t.size, data.C.shape[0]))
    eta[:, list(flow.mode)] = extended @ flow.multiplier.T
    return Samples(t, z[:, :n], z[:, n:], eta)
