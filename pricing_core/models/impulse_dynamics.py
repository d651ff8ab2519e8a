"""The velocity at the end of a step: without contacts, and what impulses there add to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lu_factor, lu_solve

from pricing_core.arrays import Matrix, Vector
from pricing_core.models.contacts import Contacts

if TYPE_CHECKING:
    from pricing_core.models.mechanics import MechanicalSystem

REMEMBERED_STEP_SIZES = 16


class Motion(NamedTuple):
    """Positions and velocities, and the impulses that led to them."""

    q: Vector  # (n,)
    v: Vector  # (n,)
    impulse: Vector  # (k + r,)


class Response(NamedTuple):
    """What a step of one size needs of the matrices."""

    factors: tuple[Matrix, NDArray[np.int32]]  # LU of M + theta h D + (theta h)^2 K
    by_impulse: Matrix  # velocities per impulse, (n, k + r)
    coupling: Matrix  # rows by_impulse, (k + r, k + r)


@dataclass(frozen=True, slots=True, eq=False)
class ImpulseDynamics:
    """M (v+ - v) = h (f - D v_theta - K q_theta) + rows^T impulse, q_theta = q + theta h v_theta.

    Parameters
    ----------
    system : MechanicalSystem
    contacts : Contacts
    theta : float
    """

    system: MechanicalSystem
    contacts: Contacts
    theta: float
    response: Callable[[float], Response] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        remembered = lru_cache(REMEMBERED_STEP_SIZES)(
            partial(_response, self.system, self.contacts, self.theta)
        )
        object.__setattr__(self, "response", remembered)

    def free_velocity(self, start: Motion, force: Vector, h: float) -> Vector:
        """Return v+ without impulses, shape (n,)."""
        system = self.system
        impetus = force - system.damping @ start.v - system.stiffness @ (start.q + self.theta * h * start.v)
        return np.asarray(start.v + h * lu_solve(self.response(h).factors, impetus))


def _response(system: MechanicalSystem, contacts: Contacts, theta: float, h: float) -> Response:
    matrix = system.mass + theta * h * system.damping + (theta * h) ** 2 * system.stiffness
    # lu_solve with several right-hand sides wakes BLAS threads even for small ones.
    by_impulse = np.asarray(np.linalg.solve(matrix, contacts.rows.T))
    return Response(lu_factor(matrix), by_impulse, contacts.rows @ by_impulse)
