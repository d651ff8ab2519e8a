"""Hamiltonian systems with unilateral constraints (11.7), stepped from impact to impact."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.arrays import (
    Matrix,
    Vector,
    as_array,
    as_share,
    as_vector,
    as_whole_number,
    check_callable,
)
from pricing_core.errors import InvalidInputError
from pricing_core.lcs.overflow import check_size
from pricing_core.lcs.run_table import named_columns, table_of
from pricing_core.lcs.simulation_times import checked_span
from pricing_core.models.hamiltonian_flow import Energy, Function, Gradient, HamiltonianFlow
from pricing_core.models.hamiltonian_impacts import MotionWithImpacts, closed_gap

if TYPE_CHECKING:
    import pyarrow

MOST_STEPS = 1_000_000


@dataclass(frozen=True, slots=True, eq=False)
class HamiltonianTrajectory:
    """What `HamiltonianSystem.simulate` returns.

    Parameters
    ----------
    t : Vector, shape (m,)
    q, p : Matrix, shape (m, n)
    impulses : Matrix, shape (m, k)
        Impulses of the step that ends there, impacts and lasting contacts (h u) together.
    gaps : Matrix, shape (m, k)
        C(q).
    energy : Vector, shape (m,)
        H(q, p).
    """

    t: Vector
    q: Matrix
    p: Matrix
    impulses: Matrix
    gaps: Matrix
    energy: Vector

    def to_table(
        self, *, coordinates: Sequence[str] | None = None, momenta: Sequence[str] | None = None
    ) -> pyarrow.Table:
        """Return the run as a `pyarrow.Table` of m rows: t, q1, ..., p1, ..., impulse1, ..., gap1, ..., energy.

        Parameters
        ----------
        coordinates, momenta : sequence of str, optional
            Names of the columns of q and p.

        Raises
        ------
        InvalidInputError
            Names that are not one for each column, or not different.
        MissingExtraError
            pyarrow, of the extra "batch", is not installed.
        """
        parts = [
            ("coordinates", "q", self.q, coordinates),
            ("momenta", "p", self.p, momenta),
            ("impulses", "impulse", self.impulses, None),
            ("gaps", "gap", self.gaps, None),
            ("energy", "energy", self.energy, ["energy"]),
        ]
        return table_of(named_columns(self.t, parts))


@dataclass(frozen=True, slots=True, eq=False)
class HamiltonianSystem:
    """q' = H_p, p' = -H_q + C_q^T u, 0 <= C(q) _|_ u >= 0 (11.7), with impacts.

    Every step solves the discrete gradient equations (Gonzalez 1996), which keep H exactly while nothing touches.
    Impacts are located inside the steps, and obey C_q v+ >= -e C_q v-, with equality where there is an impulse (Moreau
    1988), an LCP. Where e < 1 and the flights that would follow die out within a step, the contact comes to rest. With
    e <= 1 impacts and contacts add no energy for a constant mass; otherwise no more than the square of the step.

    Parameters
    ----------
    energy : callable (q, p) -> float
        H.
    gradient : callable (q, p) -> (H_q, H_p), shapes (n,) and (n,)
    constraints : callable q -> C(q), shape (k,)
    constraint_jacobian : callable q -> C_q, shape (k, n)
    restitution : float
        e, from 0 to 1.

    Examples
    --------
    A ball of mass 1 falls on the floor and stays there; before, its energy does not change:

    >>> ball = HamiltonianSystem(
    ...     energy=lambda q, p: 0.5 * p @ p + 9.81 * q[0],
    ...     gradient=lambda q, p: (np.array([9.81]), p),
    ...     constraints=lambda q: q,
    ...     constraint_jacobian=lambda q: np.eye(1),
    ... )
    >>> fall = ball.simulate([1.0], [0.0], (0.0, 1.0), steps=1000)
    >>> bool(np.ptp(fall.energy[:450]) < 1e-12), bool(abs(fall.q[-1, 0]) < 5e-3), fall.p[-1].round(12) + 0.0
    (True, True, array([0.]))
    """

    energy: Energy
    gradient: Gradient
    constraints: Function
    constraint_jacobian: Function
    restitution: float = 0.0

    def __post_init__(self) -> None:
        check_callable("energy", self.energy, "(q, p)")
        check_callable("gradient", self.gradient, "(q, p)")
        check_callable("constraints", self.constraints, "q")
        check_callable("constraint_jacobian", self.constraint_jacobian, "q")
        object.__setattr__(self, "restitution", as_share("restitution", self.restitution))

    def simulate(
        self, q0: ArrayLike, p0: ArrayLike, t_span: tuple[float, float], *, steps: int
    ) -> HamiltonianTrajectory:
        """Simulate over t_span in equal steps of order 2, impacts and contacts included.

        Parameters
        ----------
        q0, p0 : array_like, shape (n,)
            Positions and momenta at the start.
        t_span : tuple of float
            Beginning and end.
        steps : int
            How many steps are taken, from 1 to 1,000,000.

        Raises
        ------
        InvalidInputError
            Shapes do not fit, q0 violates a constraint, or the number of steps is out of range.
        IterationLimitError
            Newton's method does not converge, or there are thousands of impacts in a step: take more steps.
        NumericalError
            A function has no finite value where the motion goes, the state overflows, or a step is too long for the law
            of impact.
        """
        q = as_vector("q0", q0)
        if q.size == 0:
            raise InvalidInputError("q0", q0, "one coordinate or more")
        p = as_vector("p0", p0, q.size)
        span = checked_span(t_span)
        t = np.linspace(*span, as_whole_number("steps", steps, 1, MOST_STEPS) + 1)
        gaps = as_vector("constraints", np.atleast_1d(as_array("constraints", self.constraints(q))))
        flow = HamiltonianFlow(
            self.energy, self.gradient, self.constraints, self.constraint_jacobian, gaps.size
        )
        z = np.concatenate([q, p])
        closed = closed_gap(flow, z)
        if np.any(gaps < -closed):
            i = int(np.flatnonzero(gaps < -closed)[0])
            raise InvalidInputError("q0", q0, f"such that constraint {i} holds: it is {gaps[i]:.6g} there")
        motion = MotionWithImpacts(flow, self.restitution, float(t[1] - t[0]))
        states, impulses = [z], [np.zeros(gaps.size)]
        with np.errstate(over="ignore", invalid="ignore"):  # told by `as_values` and `check_size`
            for start, end in itertools.pairwise(t):
                check_size(z, float(start))
                z, impulse = motion.advance(z, float(end - start), float(end))
                states.append(z)
                impulses.append(impulse)
        table = np.array(states)
        positions, momenta = table[:, : q.size], table[:, q.size :]
        return HamiltonianTrajectory(
            t,
            positions,
            momenta,
            np.array(impulses),
            np.array([flow.gaps(state) for state in states]),
            np.array([flow.energy(state) for state in states]),
        )
