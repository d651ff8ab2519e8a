"""The rate of the value now, V_t, as the march's last stage has it: next to a contact set as elsewhere.

At a contact set's end V_t is the obstacle's own rate, which V - obstacle has not: polynomials through the nodes between
two contact sets take the set's end in the place of the node next to it, whose cell holds the end and whose rate is
wrong.
"""

from __future__ import annotations

import math

import numpy as np

from pricing_core.arrays import Matrix, Vector
from pricing_core.obstacle.march import March
from pricing_core.obstacle.obstacle import Obstacle
from pricing_core.obstacle.profile import POINTS

TIME_STEP = 1e-6  # of the first segment, over which an obstacle's own rate is differenced


def rates(march: March, x: Vector) -> Matrix:
    """Return V_t and V_tx now at places x inside the interval, shape (2, m)."""
    return np.array([_rate(march, float(place)) for place in x]).T


def _rate(march: March, x: float) -> tuple[float, float]:
    profile, stage = march.now, march.parts[-1].steps[-1].stages[-1]
    at_nodes = (stage.base - stage.values.value) / stage.a  # V_t, which runs against the march
    index = float(profile.grid.index(np.array([x]))[0])
    held = profile.side(np.array([x]))[0]
    if held:
        obstacle = march.problem.obstacles[0 if held > 0 else 1]
        assert obstacle is not None
        step = 0.01 * march.grid.map.size / march.grid.refined
        around = _own_rate(march, obstacle, x + step * np.array([-1.0, 0.0, 1.0]))
        return float(around[1]), float(around[2] - around[0]) / (2.0 * step)
    left, right = next(run for run in profile.free_runs() if run[0] <= index <= run[1])
    first, last = profile.free_nodes(left, right)
    places, values, obstacle = _points(march, at_nodes, (left, right), (first, last), index)
    scaled = places - index
    powers = np.vander(scaled, increasing=True)
    value, slope, *_ = np.linalg.solve(powers, values).tolist()
    width = (
        float(profile.grid.map.place(np.array([index / profile.grid.refined]), 1)[0]) / profile.grid.refined
    )
    by_x = slope / width
    if obstacle is not None:
        step = 0.01 * width
        around = _own_rate(march, obstacle, x + step * np.array([-1.0, 0.0, 1.0]))
        value, by_x = value + around[1], by_x + (around[2] - around[0]) / (2.0 * step)
    return float(value), float(by_x)


def _points(
    march: March, at_nodes: Vector, run: tuple[float, float], nodes: tuple[int, int], index: float
) -> tuple[Vector, Vector, Obstacle | None]:
    """Return where a polynomial takes its values, in numbers of nodes, the values, and the obstacle they go without."""
    profile, chosen = march.now, np.zeros(0)
    inside = list(range(nodes[0], nodes[1] + 1))
    edges = [
        (edge, near)
        for edge, near in zip(run, (nodes[0], nodes[1]), strict=True)
        if math.isfinite(edge) and abs(edge - near) <= 1.0
    ]
    if len(inside) < POINTS or not edges:
        start = min(
            max(math.floor(index) - (POINTS // 2 - 1), inside[0]), max(inside[-1] - POINTS + 1, inside[0])
        )
        chosen = np.arange(start, min(start + POINTS, inside[-1] + 1), dtype=np.float64)
        return chosen, at_nodes[chosen.astype(np.intp)], None
    own = np.array(
        sorted([*(float(i) for i in inside if i not in {n for _, n in edges}), *(e for e, _ in edges)])
    )
    middle = int(np.searchsorted(own, index))
    start = min(max(middle - POINTS // 2, 0), own.size - POINTS)
    chosen = own[start : start + POINTS]
    ends = {edge for edge, _ in edges}
    if not ends & set(chosen.tolist()):
        return chosen, at_nodes[chosen.astype(np.intp)], None
    nearest = min(edges, key=lambda pair: abs(pair[0] - index))[0]
    side = profile.side(profile.grid.place(np.array([nearest])))[0]
    obstacle = march.problem.obstacles[1 if side < 0 else 0]
    assert obstacle is not None
    own_rates = _own_rate(march, obstacle, profile.grid.place(chosen))
    values = [
        0.0 if place in ends else at_nodes[int(place)] - rate
        for place, rate in zip(chosen.tolist(), own_rates.tolist(), strict=True)
    ]
    return chosen, np.array(values), obstacle


def _own_rate(march: March, obstacle: Obstacle, x: Vector) -> Vector:
    """Return the obstacle's rate now."""
    if not obstacle.function.has_t:
        return np.zeros(x.size)
    step = TIME_STEP * march.parts[-1].segment.duration
    return np.asarray((obstacle(x, step) - obstacle(x, 0.0)) / step)
