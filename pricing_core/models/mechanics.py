"""Linear mechanical systems with unilateral constraints and impacts (section 11.2.2, example 11.2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeGuard, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import cho_factor, cho_solve

from pricing_core.arrays import Matrix, Vector, as_matrix, as_share, as_square_matrix, as_vector
from pricing_core.errors import InvalidInputError, MissingInputError, Told
from pricing_core.lcs import (
    LCS,
    EventDriven,
    Exosystem,
    PiecewiseConstant,
    TimeStepping,
    Trajectory,
)
from pricing_core.lcs.simulate import simulate_without_energy
from pricing_core.lcs.simulation_method import SimulationMethod, as_method
from pricing_core.lcs.simulation_times import checked_span, checked_times
from pricing_core.lcs.time_stepping import ImpulseScheme
from pricing_core.models.contacts import Contacts, contacts_of
from pricing_core.models.friction import as_friction, as_tangents
from pricing_core.models.impulse_steps import simulate_by_impulses
from pricing_core.models.newtons_law import NewtonsLaw

PENETRATES = 1e-12
SYMMETRIC = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class MechanicalSystem:
    """M q'' + D q' + K q = F^T u + force, 0 <= y = F q + offset _|_ u >= 0 (11.85)-(11.87), state x = (q, q').

    At an impact the velocity is projected on what the active constraints allow, in the metric of M: an inelastic
    collision. With a coefficient of restitution e Newton's law takes its place: F v+ >= -e F v- where there is
    contact, with equality where there is an impulse.

    With tangents and friction, Coulomb's law holds at each contact: sliding at velocity tangent v is opposed by a force
    of friction times u_i along the tangent, and without sliding the force is whatever holds, up to that. Such a system
    is simulated in terms of impulses, by `TimeStepping`.

    Parameters
    ----------
    mass : array_like, shape (n, n)
        M, symmetric and positive definite.
    damping, stiffness : array_like, shape (n, n)
        D and K.
    F : array_like, shape (k, n)
    force : array_like of shape (n,), PiecewiseConstant or Exosystem, optional
    offset : array_like, shape (k,), optional
    restitution : float
        e, from 0 to 1.
    tangents : array_like, shape (k, n) or (k, m, n), optional
        In the plane the tangent of each contact: tangents @ v are the sliding velocities. In space m directions at each
        contact, see `friction_directions`: the cone of Coulomb's law becomes a polyhedral one within it.
    friction : array_like, shape (k,), optional
        The coefficients of friction, >= 0; given together with the tangents.

    Raises
    ------
    InvalidInputError
        Shapes that do not fit, a mass matrix that is not symmetric and positive definite, e outside [0, 1], directions
        that do not oppose every sliding velocity, a negative friction, tangents or friction without the other.

    Examples
    --------
    A ball dropped from a height of 1:

    >>> ball = MechanicalSystem([[1.0]], [[0.0]], [[0.0]], [[1.0]], force=[-9.81])
    >>> impact = ball.simulate([1.0], [0.0], (0.0, 1.0)).events[0]
    >>> round(impact.time, 6), round(impact.energy_lost, 6)
    (0.451524, 9.81)

    A block of mass 1 that slides at 2 m/s along x with friction 1/4 stops after 2/(g/4) seconds:

    >>> block = MechanicalSystem(np.eye(2), np.zeros((2, 2)), np.zeros((2, 2)), [[0, 1]], force=[0, -9.81],
    ...                          tangents=[[1, 0]], friction=[0.25])
    >>> run = block.simulate([0, 0], [2, 0], (0, 1), method=TimeStepping(step=1e-3))
    >>> round(float(run(1.0)[0]), 3), round(2**2 / (2 * 0.25 * 9.81), 3)
    (0.815, 0.815)
    """

    mass: Matrix
    damping: Matrix
    stiffness: Matrix
    F: Matrix
    force: PiecewiseConstant | Exosystem
    offset: Vector
    restitution: float
    tangents: NDArray[np.float64] | None
    friction: Vector | None

    def __init__(
        self,
        mass: ArrayLike,
        damping: ArrayLike,
        stiffness: ArrayLike,
        F: ArrayLike,
        force: ArrayLike | PiecewiseConstant | Exosystem | None = None,
        offset: ArrayLike | None = None,
        restitution: float = 0.0,
        tangents: ArrayLike | None = None,
        friction: ArrayLike | None = None,
    ) -> None:
        M = as_square_matrix("mass", mass)
        n = M.shape[0]
        if n == 0:
            raise InvalidInputError("mass", f"shape {M.shape}", "a square matrix of at least one row")
        if np.max(np.abs(M - M.T)) > SYMMETRIC * np.max(np.abs(M)) or np.linalg.eigvalsh(M).min() <= 0.0:
            raise InvalidInputError("mass", mass, "symmetric and positive definite")
        normals = as_matrix("F", F)
        if normals.shape[1] != n:
            raise InvalidInputError(
                "F", f"{normals.shape[1]} columns", f"{n} columns, one for each coordinate"
            )
        k = normals.shape[0]
        if not isinstance(force, PiecewiseConstant | Exosystem):
            constant = as_vector("force", np.zeros(n) if force is None else force, n)
            force = PiecewiseConstant([0.0], constant[None, :])
        elif force.size != n:
            raise InvalidInputError("force", f"{force.size} components", f"{n} components")
        object.__setattr__(self, "mass", M)
        object.__setattr__(self, "damping", as_matrix("damping", damping, (n, n)))
        object.__setattr__(self, "stiffness", as_matrix("stiffness", stiffness, (n, n)))
        object.__setattr__(self, "F", normals)
        object.__setattr__(self, "force", force)
        object.__setattr__(self, "offset", as_vector("offset", np.zeros(k) if offset is None else offset, k))
        object.__setattr__(self, "restitution", as_share("restitution", restitution))
        for name, given, other_name, other in (
            ("tangents", tangents, "friction", friction),
            ("friction", friction, "tangents", tangents),
        ):
            if given is None and other is not None:
                raise MissingInputError(name, f"{other_name} needs it")
        object.__setattr__(self, "tangents", None if tangents is None else as_tangents(tangents, k, n))
        object.__setattr__(self, "friction", None if friction is None else as_friction(friction, k))

    def contacts(self) -> Contacts:
        """Return the rows of the contacts and of their friction, as time stepping takes them."""
        return contacts_of(self.F, self.tangents, self.friction)

    def to_lcs(self) -> LCS:
        """Return the system of x = (q, q'): relative degree 2, G(s) = F (s^2 M + s D + K)^-1 F^T (11.88).

        Raises
        ------
        InvalidInputError
            There is friction, whose bound is another unknown: that is no system of this kind.
        """
        if self.friction is not None:
            raise InvalidInputError("friction", self.friction, "left out for a linear complementarity system")
        n, k = self.mass.shape[0], self.F.shape[0]
        inverse = cho_factor(self.mass)
        rates = cho_solve(inverse, np.hstack([-self.stiffness, -self.damping]))
        return LCS(
            np.vstack([np.hstack([np.zeros((n, n)), np.eye(n)]), rates]),
            np.vstack([np.zeros((n, k)), cho_solve(inverse, self.F.T)]),
            np.hstack([self.F, np.zeros((k, n))]),
            f=_accelerations(self.force, inverse),
            g=self.offset,
        )

    def energy(self, q: ArrayLike, v: ArrayLike) -> float:
        """Return v^T M v / 2 + q^T K q / 2, for a symmetric K."""
        n = self.mass.shape[0]
        position, velocity = as_vector("q", q, n), as_vector("v", v, n)
        return float(0.5 * (velocity @ self.mass @ velocity + position @ self.stiffness @ position))

    def simulate(
        self,
        q0: ArrayLike,
        v0: ArrayLike,
        t_span: tuple[float, float],
        *,
        method: SimulationMethod = "event-driven",
        t_eval: ArrayLike | None = None,
        interrupt: Callable[[], bool] | None = None,
    ) -> Trajectory:
        """Simulate from q0 and v0 over t_span; x = (q, q'), and jumps carry the energy that they lose.

        Time stepping reports no impacts but those at the start; later the velocity changes from step to step. The
        schemes "moreau", which "auto" means where the restitution is > 0 or there is friction, and "stewart-trinkle",
        for systems without restitution, go by impulses and return a `ContactTrajectory`: u is the impulse of a step
        over its length, and 0 at the start; tolerances are those of q.

        There are impulses for both whatever jams, as Painleve's rod does; where there are several, one is taken. Where
        K and D are symmetric positive semidefinite the energy v^T M v/2 + q^T K q/2 never grows by more than the work
        of the force, but for rounding: a rebound by Newton's law that would let it, as with friction it may, is reduced
        (`ContactTrajectory.bounded_steps` counts these steps). "stewart-trinkle" loses energy in every step, with an
        error of order 1; "moreau" is of order 2 where nothing touches, conserves the energy there, and is of order 1 at
        impacts and changes of contact.

        Parameters
        ----------
        q0, v0 : array_like, shape (n,)
        t_span, method, t_eval, interrupt
            As in `pricing_core.lcs.simulate`.

        Raises
        ------
        InvalidInputError
            q0 violates a constraint, or an argument lies outside what is allowed; with a restitution e > 0, another
            time-stepping scheme than "moreau", or another law of rebound than Newton's; with friction, another method
            than time stepping by impulses, or multipliers of least norm.
        """
        n = self.mass.shape[0]
        position, velocity = as_vector("q0", q0, n), as_vector("v0", v0, n)
        gaps = self.F @ position + self.offset
        sizes = np.abs(self.F) @ np.abs(position) + np.abs(self.offset)
        violated = np.flatnonzero(gaps < -PENETRATES * sizes)
        if violated.size:
            i = int(violated[0])
            raise InvalidInputError(
                "q0", q0, f"such that constraint {i} holds: F q + offset is {gaps[i]:.6g} there"
            )
        x0 = np.concatenate([position, velocity])
        chosen = as_method(method)
        if self._goes_by_impulses(chosen):
            span = checked_span(t_span)
            reported = None if t_eval is None else checked_times(t_eval, span)
            return simulate_by_impulses(self, x0, span, reported, chosen, interrupt)
        trajectory = simulate_without_energy(
            self.to_lcs(),
            x0,
            t_span,
            method=self._with_newtons_law(chosen),
            t_eval=t_eval,
            interrupt=interrupt,
        )
        return replace(
            trajectory,
            events=tuple(
                replace(event, energy_lost=self._kinetic(event.x_before) - self._kinetic(event.x_after))
                if event.kind == "jump"
                else event
                for event in trajectory.events
            ),
        )

    def _goes_by_impulses(self, method: EventDriven | TimeStepping) -> TypeGuard[TimeStepping]:
        """Tell whether the run goes by impulses, or raise InvalidInputError where friction asks for that in vain."""
        rough = self.friction is not None
        if not isinstance(method, TimeStepping):
            if rough:
                raise InvalidInputError(
                    "method", "event-driven", '"time-stepping" or a TimeStepping(...) where there is friction'
                )
            return False
        by_impulses = method.scheme in get_args(ImpulseScheme) or (
            method.scheme == "auto" and (rough or self.restitution > 0.0)
        )
        if rough and not by_impulses:
            raise InvalidInputError(
                "scheme", method.scheme, '"moreau" or "stewart-trinkle" where there is friction'
            )
        if rough and method.multipliers != "any":
            raise InvalidInputError("multipliers", method.multipliers, '"any" where there is friction')
        if method.scheme == "stewart-trinkle" and self.restitution > 0.0:
            raise InvalidInputError("scheme", method.scheme, '"moreau" where the restitution is > 0')
        return by_impulses

    def _with_newtons_law(self, method: EventDriven | TimeStepping) -> EventDriven | TimeStepping:
        """Return the method with the law of impact that the restitution asks for."""
        if self.restitution == 0.0:
            return method
        if isinstance(method, TimeStepping):
            raise InvalidInputError("scheme", method.scheme, '"moreau" where the restitution is > 0')
        if method.rebound is not None:
            raise InvalidInputError("rebound", Told("a law"), "left out where the restitution is > 0")
        response = cho_solve(cho_factor(self.mass), self.F.T)
        return replace(method, rebound=NewtonsLaw(self.F, response, self.restitution))

    def _kinetic(self, x: Vector) -> float:
        v = x[self.mass.shape[0] :]
        return float(0.5 * v @ self.mass @ v)


def _accelerations(
    force: PiecewiseConstant | Exosystem, inverse: tuple[Matrix, bool]
) -> PiecewiseConstant | Exosystem:
    """Return (0, M^-1 force)."""
    if isinstance(force, PiecewiseConstant):
        values = cho_solve(inverse, force.values.T).T
        return PiecewiseConstant(force.times, np.hstack([np.zeros_like(values), values]))
    output = cho_solve(inverse, force.output)
    return Exosystem(force.generator, np.vstack([np.zeros_like(output), output]), force.states, force.times)
