"""Consistent space, jump space, projection and feedback of a mode (11.73)-(11.76)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from pricing_core.arrays import IndexSet, Matrix, Vector, as_number, check_type
from pricing_core.errors import InvalidInputError
from pricing_core.lcs.balancing import balancing_units
from pricing_core.lcs.mode_spaces import Arithmetic, particular_point, spaces
from pricing_core.lcs.modes import as_mode, mode_equations
from pricing_core.lcs.rational_system import (
    EXACT_SIZE,
    rational_offsets,
    rational_system,
    with_constant_state,
)
from pricing_core.lcs.system import LCS
from pricing_core.linalg.rational import (
    exact_image,
    exact_kernel,
    exact_solution,
    rational_array,
    rounded,
)
from pricing_core.linalg.subspaces import image, kernel

RANK_TOLERANCE = 1e-10


@dataclass(frozen=True, slots=True, eq=False)
class ModeGeometry:
    """The spaces of x' = A x + B_I u_I, 0 = C_I x + D_II u_I, and what follows from V_I (+) T_I = R^n.

    A state x0 jumps to particular + P_I (x0 - particular), and moves on in particular + V_I with
    u_I = particular_input + F_I (x - particular). Without offsets f, g both particular parts are zero.

    Parameters
    ----------
    mode : tuple of int
        I, the pairs with y_i = 0.
    consistent_space : Matrix, shape (n, d)
        Orthonormal basis of V_I (11.73).
    jump_space : Matrix, shape (n, e)
        Orthonormal basis of T_I (11.76).
    projection : Matrix, shape (n, n), or None
        P_I onto V_I along T_I; None unless V_I (+) T_I is the whole space, directly, and (11.74)-(11.75) hold.
    feedback : Matrix, shape (|I|, n), or None
        F_I, extended by zero to T_I: F_I P_I = F_I.
    particular : Vector, shape (n,), or None
        The smallest x for which x' = A x + B_I u_I + f, 0 = C_I x + D_II u_I + g_I has a smooth solution; None
        where there is none.
    particular_input : Vector, shape (|I|,), or None
        The u_I that holds there; None without `particular`, or where it is not unique.
    exact : bool
        The dimensions were decided in rational arithmetic.
    """

    mode: IndexSet
    consistent_space: Matrix
    jump_space: Matrix
    projection: Matrix | None
    feedback: Matrix | None
    particular: Vector | None
    particular_input: Vector | None
    exact: bool


def mode_geometry(
    system: LCS,
    mode: Iterable[int],
    *,
    exact: bool | None = None,
    rank_tolerance: float = RANK_TOLERANCE,
    t: float = 0.0,
) -> ModeGeometry:
    """Compute V_I, T_I, P_I and F_I of the homogeneous part, and the offset that f(t+) and g(t+) cause.

    Parameters
    ----------
    system : LCS
    mode : iterable of int
        I, 0-based.
    exact : bool, optional
        Decide ranks in rational arithmetic (True) or by singular values (False). By default True where
        n + k <= 24. See `pricing_core.linalg.rational.rational` for what a float stands for.
    rank_tolerance : float
        In floating point, singular values below this share of the larger of 1 and the largest one count as zero,
        in units in which the data are of order 1.
    t : float
        The time for which `particular` holds.

    Raises
    ------
    InvalidInputError
        The index set is none.

    Notes
    -----
    Cost: at most n eliminations of n + |I| columns; milliseconds for n + k = 24 and short rational numbers.
    Source: (11.73)-(11.76); Hautus and Silverman 1983.

    Examples
    --------
    Two carts, x1 and x1 - x2 stopped at zero, state (x1, x2, v1, v2): while the carts touch they move together,
    and before that an inelastic impact spreads the momentum.

    >>> A = [[0, 0, 1, 0], [0, 0, 0, 1], [-2, 1, 0, 0], [1, -1, 0, 0]]
    >>> carts = LCS(A, [[0, 0], [0, 0], [1, 1], [0, -1]], [[1, 0, 0, 0], [1, -1, 0, 0]])
    >>> mode_geometry(carts, (1,)).projection @ [0.0, 0.0, -2.0, 1.0]
    array([ 0. ,  0. , -0.5, -0.5])
    """
    check_type("system", system, LCS)
    n, k = system.shape
    chosen = as_mode(mode, k)
    if exact if exact is not None else n + k <= EXACT_SIZE:
        return _exact_geometry(system, chosen, t)
    tolerance = as_number("rank_tolerance", rank_tolerance)
    if not 0.0 < tolerance < 1.0:
        raise InvalidInputError("rank_tolerance", rank_tolerance, "a number between 0 and 1")
    return _floating_geometry(system, chosen, tolerance, t)


def _exact_geometry(system: LCS, mode: IndexSet, t: float) -> ModeGeometry:
    arithmetic = Arithmetic(
        exact_kernel, exact_image, exact_solution, lambda n: rational_array(np.eye(n, dtype=int))
    )
    data = rational_system(system)
    offsets = rational_offsets(system, t)
    V, T, W, F = spaces(mode_equations(*data, mode), arithmetic)
    bases = _orthonormal(rounded(V)), _orthonormal(rounded(T))
    projection = None if W is None else rounded(V @ W)
    feedback = None if F is None else rounded(F)
    offset = particular_point(mode_equations(*with_constant_state(data, *offsets), mode), V, arithmetic)
    particular, held = (None if part is None else rounded(part) for part in offset)
    return _with_offset(mode, bases, projection, feedback, particular, held, exact=True)


def _floating_geometry(system: LCS, mode: IndexSet, tolerance: float, t: float) -> ModeGeometry:
    arithmetic = Arithmetic(
        lambda M: kernel(M, tolerance),
        lambda M: image(M, tolerance),
        lambda M, R: _least_squares(M, R, tolerance),
        np.eye,
    )
    n = system.shape[0]
    units = balancing_units(system.A, system.B, system.C, system.D)
    A, B, C, D = units.apply(system.A, system.B, system.C, system.D)
    V, T, W, F = spaces(mode_equations(A, B, C, D, mode), arithmetic)
    x, u = units.state[:, None], units.pair[list(mode)][:, None]
    projection = None if W is None else V @ W * x / x.T
    feedback = None if F is None else F * u / x.T
    f = system.f.after(t) / (units.rate * units.state)
    g = system.g.after(t) * units.pair
    size = float(np.max(np.abs(np.concatenate([f, g])), initial=0.0)) or 1.0
    bottom = np.zeros((1, n + 1))
    augmented = mode_equations(
        np.vstack([np.hstack([A, f[:, None] / size]), bottom]),
        np.vstack([B, np.zeros((1, B.shape[1]))]),
        np.hstack([C, g[:, None] / size]),
        D,
        mode,
    )
    scaled, held = particular_point(augmented, V, arithmetic)
    particular = None if scaled is None else size * scaled * units.state
    inputs = None if held is None else size * held * u.ravel()
    bases = _orthonormal(x * V), _orthonormal(x * T)
    return _with_offset(mode, bases, projection, feedback, particular, inputs, exact=False)


def _with_offset(
    mode: IndexSet,
    bases: tuple[Matrix, Matrix],
    projection: Matrix | None,
    feedback: Matrix | None,
    point: Vector | None,
    held: Vector | None,
    *,
    exact: bool,
) -> ModeGeometry:
    """Move the particular point to the one nearest the origin, and the input that holds there with it."""
    V = bases[0]
    if point is not None:
        shift = V @ (V.T @ point)
        point = point - shift
        held = None if held is None or feedback is None else held - feedback @ shift
    return ModeGeometry(mode, *bases, projection, feedback, point, held, exact)


def _orthonormal(basis: Matrix) -> Matrix:
    lengths = np.linalg.norm(basis, axis=0)
    return np.asarray(np.linalg.qr(basis / lengths)[0]) + 0.0  # no -0.0


def _least_squares(M: Matrix, R: Matrix, tolerance: float) -> Matrix | None:
    X = np.linalg.lstsq(M, R, rcond=tolerance)[0]
    residual = float(np.max(np.abs(M @ X - R), initial=0.0))
    size = max(1.0, float(np.max(np.abs(R), initial=0.0)))
    return np.asarray(X, dtype=np.float64) if residual <= tolerance**0.5 * size else None
