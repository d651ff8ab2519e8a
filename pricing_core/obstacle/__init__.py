"""Obstacle problems: parabolic linear complementarity, -V_t = L V + f + u - w with V between two obstacles."""

from __future__ import annotations

from pricing_core.obstacle.as_lcs import AsLCS, as_lcs, nodal_method
from pricing_core.obstacle.diffusion import Diffusion
from pricing_core.obstacle.ends import Held
from pricing_core.obstacle.event import Event
from pricing_core.obstacle.obstacle import Obstacle
from pricing_core.obstacle.problem import ObstacleProblem
from pricing_core.obstacle.solution import ObstacleDerivative, ObstacleSolution, ObstacleTangent
from pricing_core.obstacle.solve import solve

__all__ = [
    "AsLCS",
    "Diffusion",
    "Event",
    "Held",
    "Obstacle",
    "ObstacleDerivative",
    "ObstacleProblem",
    "ObstacleSolution",
    "ObstacleTangent",
    "as_lcs",
    "nodal_method",
    "solve",
]
