"""The flow of one mode in coordinates of its consistent space, and the jump that leads there."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import IndexSet, Matrix, Vector
from pricing_core.lcs.autonomous import AutonomousForm
from pricing_core.lcs.geometry import mode_geometry

Table: TypeAlias = NDArray[np.float64]

REACH = 2.0  # time that one Taylor polynomial reaches, in units of 1/|rate|
DEGREE = 26  # degree of that polynomial: REACH**27/27! is 1e-20
LONGEST = 1e308  # any interval of finite numbers
VANISHES = 1e-11  # share of its terms' sizes below which an output counts as zero
VANISHING_RATE = 1e-9  # the same for its derivatives
FAINT = 1e-7  # the same for impulses, next to derivatives that are taken for zero
ROUNDING = 1e-13  # share of the terms that an entry is made of, below which it is zero
SOLVED = 1e-9  # residual of the impulses' equations, relative


@dataclass(frozen=True, slots=True, eq=False)
class ModeDynamics:
    """z = V c, c' = R c on V_I (11.71), after the jump c = W z, W = V^T P_I.

    All numbers are in the units of the autonomous form. The outputs are what must not be negative: u_i for i in I
    and y_i otherwise.

    Parameters
    ----------
    mode : tuple of int
        I.
    basis : Matrix, shape (N, d)
        V, orthonormal.
    coordinates : Matrix, shape (d, N)
        W.
    rate : Matrix, shape (d, d)
        R.
    outputs : Matrix, shape (k, d)
        The outputs as functions of the coordinates.
    impulses : array, shape (r, k, N)
        The outputs' coefficients of the derivatives of delta as functions of z before the jump, the highest first.
    step : float
        The time that one Taylor polynomial reaches.
    """

    mode: IndexSet
    basis: Matrix
    coordinates: Matrix
    rate: Matrix
    outputs: Matrix
    impulses: Table
    step: float

    def expansion(self, c: Vector) -> Table:
        """Return the Taylor coefficients of the coordinates in time/step, shape (DEGREE + 1, d)."""
        terms = np.empty((DEGREE + 1, c.size))
        terms[0] = c
        scaled = self.rate * self.step
        for j in range(DEGREE):
            terms[j + 1] = scaled @ terms[j] / (j + 1)
        return terms

    def coordinates_of(self, z: Vector) -> Vector:
        """Return W z, zero where that is no more than rounding."""
        return _without_rounding(self.coordinates @ z, np.abs(self.coordinates) @ np.abs(z))

    def is_consistent(self, z: Vector) -> bool:
        """Tell whether z is in V_I, to rounding: no jump."""
        left = z - self.basis @ self.coordinates_of(z)
        return bool(np.all(np.abs(left) <= VANISHES * max(float(np.max(np.abs(z), initial=0.0)), 1e-300)))

    def leading_impulses(self, z: Vector, share: float = VANISHES) -> tuple[Vector, int]:
        """Return each output's sign of its leading impulse from z, 0 without one, and the highest order + 1.

        `share` is that of its terms' sizes below which an impulse counts as none.
        """
        signs, order = np.zeros(self.outputs.shape[0]), 0
        for depth, coefficients in enumerate(self.impulses):
            size = np.linalg.norm(coefficients, axis=1) * np.linalg.norm(z)
            found = _signs(coefficients @ z, share * size)
            if order == 0 and found.any():
                order = self.impulses.shape[0] - depth
            signs = np.where(signs == 0.0, found, signs)
        return signs, order

    def initial_signs(self, c: Vector) -> Vector:
        """Return each output's sign just after the coordinates are c: of its first derivative that is not zero."""
        signs = np.zeros(self.outputs.shape[0])
        rows, scaled, length = self.outputs, self.rate * self.step, float(np.linalg.norm(c))
        # Size of the terms that make up a derivative in time/step.
        largest = np.linalg.norm(rows, axis=1) * length
        for order in range(c.size + 1):
            share = VANISHES if order == 0 else VANISHING_RATE
            size = np.maximum(share * np.linalg.norm(rows, axis=1) * length, ROUNDING * largest)
            found = _signs(rows @ c, size)
            signs = np.where(signs == 0.0, found, signs)
            if signs.all():
                break
            rows, largest = rows @ scaled, REACH * largest
        return signs

    def signs(self, z: Vector, share: float = VANISHES) -> Vector:
        """Return each output's sign from z on: of its leading impulse, else just after the jump."""
        leading, _ = self.leading_impulses(z, share)
        return np.where(leading != 0.0, leading, self.initial_signs(self.coordinates_of(z)))

    def admits(self, z: Vector, share: float = VANISHES) -> bool:
        """Tell whether I is in S(z) (11.77): every output is initially nonnegative (Definition 11.1)."""
        return bool(np.all(self.signs(z, share) >= 0.0))

    def continues(self, c: Vector) -> bool:
        """Tell whether the mode can go on from the coordinates c."""
        return bool(np.all(self.initial_signs(c) >= 0.0))


def mode_dynamics(form: AutonomousForm, mode: IndexSet) -> ModeDynamics | None:
    """Return the dynamics of a mode, None where u is not unique in it or not every state can jump to it.

    Cost: `mode_geometry` of the autonomous form, and for a jump space of dimension e some least-squares problems
    with up to e |I| unknowns.
    """
    geometry = mode_geometry(form.system, mode, exact=form.is_exact)
    if geometry.projection is None or geometry.feedback is None:
        return None
    index, (A, B, C, D) = list(mode), (form.system.A, form.system.B, form.system.C, form.system.D)
    projection, basis = geometry.projection, geometry.consistent_space
    feedback = _without_rounding(
        geometry.feedback, 10.0 * float(np.max(np.abs(geometry.feedback), initial=0.0))
    )
    closed = A + B[:, index] @ feedback
    outputs = C + D[:, index] @ feedback
    sizes = np.abs(C) + np.abs(D[:, index]) @ np.abs(feedback)
    outputs[index], sizes[index] = feedback, np.abs(feedback)
    rate = basis.T @ closed @ basis
    return ModeDynamics(
        mode=mode,
        basis=basis,
        coordinates=basis.T @ projection,
        rate=rate,
        outputs=_without_rounding(
            outputs @ basis, np.sum(sizes, axis=1, keepdims=True)
        ),  # basis: to eps of 1
        impulses=_impulses((A, B[:, index], C, D[:, index]), index, geometry.jump_space, projection),
        step=longest_step(rate),
    )


def longest_step(rate: Matrix) -> float:
    """Return the time that one Taylor polynomial reaches."""
    norm = float(np.linalg.norm(rate, 2)) if rate.size else 0.0
    return REACH / norm if norm > REACH / LONGEST else LONGEST


def _impulses(
    data: tuple[Matrix, Matrix, Matrix, Matrix], index: list[int], jumps: Matrix, projection: Matrix
) -> Table:
    """Return the outputs' coefficients of delta^(r-1), ..., delta' , delta as functions of the state before.

    With u = sum U_m delta^(m) and x = sum X_m delta^(m) + smooth, (11.80) says X_(m-1) = A X_m + B U_m,
    0 = C_I X_m + D_II U_m, and that the state jumps by A X_0 + B U_0.
    """
    A, B, C, D = data
    n, e = jumps.shape
    if e == 0:
        return np.zeros((0, C.shape[0], n))
    for order in range(1, n + 1):
        # A unit input at each order leads to these X_m: (order, n, order |I|).
        inputs = np.eye(order * B.shape[1]).reshape(order, B.shape[1], -1)
        states = np.zeros((order + 1, n, order * B.shape[1]))
        for m in range(order - 1, -1, -1):
            states[m] = A @ states[m + 1] + B @ inputs[m]
        slacks = C @ states[1:] + D @ inputs
        rows = np.vstack([states[0], *slacks[:, index]])
        wanted = np.vstack([-jumps, np.zeros((rows.shape[0] - n, e))])
        found = np.linalg.lstsq(rows, wanted, rcond=None)[0]
        if float(np.max(np.abs(rows @ found - wanted))) <= SOLVED:
            break
    share = jumps.T @ (np.eye(n) - projection)  # share of each jump direction in (I - P) z
    outputs = slacks @ found
    outputs[:, index] = inputs @ found
    return _without_rounding(outputs[::-1] @ share, float(np.max(np.abs(outputs), initial=0.0)))


def _signs(values: Vector, tolerances: Vector) -> Vector:
    return np.where(np.abs(values) <= tolerances, 0.0, np.sign(values))


def _without_rounding(entries: Table, size: float | Table) -> Table:
    return np.where(np.abs(entries) <= ROUNDING * size, 0.0, entries)
