"""The contacts of a mechanical system, and the LCP of their impulses with Coulomb friction."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.errors import NumericalError
from pricing_core.lcp import LCP, Method, least_norm_solution, solve
from pricing_core.lcp.lemke import follow_path
from pricing_core.lcp.problem import DEFAULT_TOLERANCE
from pricing_core.lcp.time_limit import TimeLimit
from pricing_core.lcs.time_stepping import Multipliers

ROUNDING = 1e-14  # share of the largest velocity at contacts below which one is rounding
PERTURBATION = 1e-12  # share of the largest velocity at contacts
GOLDEN = 0.6180339887498949


@dataclass(frozen=True, slots=True, eq=False)
class Contacts:
    """Rows of F, and directions of friction d_j with force beta_j >= 0, sum of beta_j <= mu p at each contact.

    The impulses (p, beta) of a step after which a velocity is v = free + response (p, beta) solve, with the slip
    speed lambda of each contact,

        0 <= F v + wanted            _|_ p      >= 0
        0 <= d_j v + lambda          _|_ beta_j >= 0
        0 <= mu p - sum of beta_j    _|_ lambda >= 0

    For wanted >= 0 the LCP has a solution, and Lemke's method finds it, whatever the friction: its matrix is copositive
    for a positive definite M, and z >= 0 with z^T M z = 0 has q^T z = wanted^T p >= 0. It need not be the only one.

    Parameters
    ----------
    normals : Matrix, shape (k, n)
        F.
    tangents : Matrix, shape (k d, n)
        d for each contact: 1 in the plane, m in space, 0 without friction.
    friction : Vector, shape (k,)
        mu.
    rows : Matrix, shape (k + r, n)
        F, and the directions of friction of the contacts with mu > 0.
    selection : Matrix, shape (k d, r)
        Friction along the tangents per beta: a tangent in the plane is two directions.
    owners : array of int, shape (r,)
        The contact of each direction.

    Notes
    -----
    Source: Stewart and Trinkle 1996; Anitescu and Potra 1997, theorem 3.4.
    """

    normals: Matrix
    tangents: Matrix
    friction: Vector
    rows: Matrix
    selection: Matrix
    owners: NDArray[np.intp]

    def impulses(
        self,
        coupling: Matrix,
        free: Vector,
        wanted: Vector,
        active: BoolVector,
        choice: tuple[Method, Multipliers],
    ) -> Vector:
        """Return (p, beta), shape (k + r,), zero at contacts that are not active.

        Parameters
        ----------
        coupling : Matrix, shape (k + r, k + r)
            rows @ response.
        free : Vector, shape (n,)
        wanted : Vector, shape (k,)
        active : BoolVector, shape (k,)
        choice : (lcp_method, multipliers)
            The fields of `TimeStepping`; multipliers of least norm are for systems without friction.

        Raises
        ------
        NumericalError
            No solution was found.
        """
        k = self.friction.size
        contacts, sliding = np.flatnonzero(active), np.flatnonzero(active[self.owners])
        used = np.concatenate([contacts, k + sliding])
        q = self.rows[used] @ free
        q[: contacts.size] += wanted[contacts]
        q[np.abs(q) <= ROUNDING * np.max(np.abs(q), initial=0.0)] = 0.0
        M, (method, multipliers) = coupling[np.ix_(used, used)], choice
        if sliding.size:
            problem = LCP(*self._with_cones(M, q, contacts, sliding))
            found = _solution(problem, method)
        else:
            problem = LCP(M, q)
            found = solve(problem, method=method).z
        if multipliers == "least-norm":
            found = least_norm_solution(problem, found)
        impulse = np.zeros(len(self.rows))
        impulse[used] = found[: used.size]
        return impulse

    def _with_cones(
        self, coupling: Matrix, q: Vector, contacts: NDArray[np.intp], sliding: NDArray[np.intp]
    ) -> tuple[Matrix, Vector]:
        """Return M and q with the rows of the friction cones below."""
        owners = self.owners[sliding]
        cones = np.unique(owners)
        owned = (owners[:, None] == cones).astype(np.float64)
        size, count = q.size, cones.size
        M = np.zeros((size + count, size + count))
        M[:size, :size] = coupling
        M[contacts.size : size, size:] = owned
        M[size:, contacts.size : size] = -owned.T
        M[size:, : contacts.size] = self.friction[cones][:, None] * (cones[:, None] == contacts)
        return M, np.concatenate([q, np.zeros(count)])

    def forces(self, impulse: Vector, h: float) -> Vector:
        """Return contact forces, and friction forces along the tangents, shape (k + k d,)."""
        k = self.friction.size
        return np.concatenate([impulse[:k], self.selection @ impulse[k:]]) / h


def _solution(problem: LCP, method: Method) -> Vector:
    """Return a solution of an LCP with friction, of one nearby where rounding leads Lemke's method astray.

    Contacts that share their load make the problem degenerate. What is added to q makes it less so, and takes energy
    from the motion, if anything.
    """
    if method != "auto":
        return solve(problem, method=method).z
    with suppress(NumericalError):
        return follow_path(problem, None, None, DEFAULT_TOLERANCE, TimeLimit(None)).z
    irregular = 1.0 + np.modf(GOLDEN * np.arange(1, problem.size + 1))[0]
    diagonal = np.diag(problem.dense())
    # A velocity for contacts, an impulse for cones.
    scale = np.where(diagonal > 0.0, 1.0, 1.0 / np.mean(diagonal[diagonal > 0.0]))
    added = PERTURBATION * np.max(np.abs(problem.q)) * irregular * scale
    with suppress(NumericalError):
        return follow_path(
            LCP(problem.M, problem.q + added), None, None, DEFAULT_TOLERANCE, TimeLimit(None)
        ).z
    return solve(problem).z


def contacts_of(normals: Matrix, tangents: NDArray[np.float64] | None, friction: Vector | None) -> Contacts:
    """Return the contacts of a system as it was stated, see `MechanicalSystem`."""
    k, n = normals.shape
    if tangents is None or friction is None:
        nothing = np.zeros((0, n))
        return Contacts(normals, nothing, np.zeros(k), normals, np.zeros((0, 0)), np.zeros(0, dtype=np.intp))
    in_plane = tangents.ndim == 2
    each = 1 if in_plane else tangents.shape[1]
    table = tangents.reshape(k * each, n)
    rough = np.flatnonzero(np.repeat(friction > 0.0, each))
    selection = np.zeros((k * each, rough.size))
    selection[rough, np.arange(rough.size)] = 1.0
    if in_plane:
        selection = np.hstack([selection, -selection])
    owners = (np.tile(rough, 2) if in_plane else rough) // max(each, 1)
    return Contacts(normals, table, friction, np.vstack([normals, selection.T @ table]), selection, owners)
