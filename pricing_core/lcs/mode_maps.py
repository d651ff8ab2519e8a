"""The matrices of a mode's flow and jump, in coordinates that are some of the states: exact or in floating point."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from pricing_core.arrays import IndexSet, Matrix
from pricing_core.lcs.autonomous import AutonomousForm
from pricing_core.lcs.geometry import RANK_TOLERANCE
from pricing_core.lcs.mode_spaces import Arithmetic, spaces
from pricing_core.lcs.modes import mode_equations
from pricing_core.lcs.rational_system import EXACT_SIZE, RationalSystem, rational_system
from pricing_core.linalg.pivoted_subspaces import pivoted_image, pivoted_kernel, pivoted_solution
from pricing_core.linalg.rational import (
    RationalMatrix,
    exact_image,
    exact_kernel,
    exact_solution,
    rational_array,
    rounded,
)

ROUNDING = 1e-13  # share of the terms that an entry is made of, below which it is zero
SOLVED = 1e-9  # residual of the impulses' equations, relative
REGULAR = 1e-8  # least reciprocal condition of a block that is taken for regular without its spaces
STIFF = 1e4  # size of an entry in balanced units, and ratio of rates, from which on rounding would be felt


class ExactMaps(NamedTuple):
    """R, V and the outputs as rationals."""

    rate: RationalMatrix  # (d, d)
    basis: RationalMatrix  # (N, d)
    outputs: RationalMatrix  # (k, d)


@dataclass(frozen=True, slots=True, eq=False)
class ModeMaps:
    """What `ModeDynamics` consists of; `exact` where it was found in rational arithmetic."""

    basis: Matrix  # (N, d)
    coordinates: Matrix  # (d, N)
    rate: Matrix  # (d, d)
    outputs: Matrix  # (k, d)
    impulses: NDArray[np.float64]  # (r, k, N)
    exact: ExactMaps | None = None


class _Block(NamedTuple):
    """The data of a mode: all pairs for the outputs, those of the mode for the inputs."""

    A: NDArray[Any]
    B: NDArray[Any]
    C: NDArray[Any]
    D: NDArray[Any]
    pairs: list[int]


def exact_maps(form: AutonomousForm, mode: IndexSet) -> ModeMaps | None:
    """Return the maps in rational arithmetic, None where u is not unique or not every state can jump."""
    arithmetic = Arithmetic(
        exact_kernel, exact_image, exact_solution, lambda n: rational_array(np.eye(n, dtype=int))
    )
    A, B, C, D = _rationals(form)
    V, T, W, F = spaces(mode_equations(A, B, C, D, mode), arithmetic)
    if W is None or F is None:
        return None
    index = list(mode)
    rows = coordinate_rows(rounded(V))
    scale = exact_solution(V[rows], rational_array(np.eye(len(rows), dtype=int)))
    assert scale is not None  # the rows are independent
    projection, basis = V @ W, V @ scale
    closed = A + B[:, index] @ F
    outputs = C + D[:, index] @ F
    outputs[index] = F
    exact = ExactMaps((closed @ basis)[rows] if rows else A[:0, :0], basis, outputs @ basis)
    block = _Block(rounded(A), rounded(B[:, index]), rounded(C), rounded(D[:, index]), index)
    return ModeMaps(
        rounded(basis),
        rounded(projection[rows]),
        rounded(exact.rate),
        rounded(exact.outputs),
        _impulses(block, np.linalg.qr(rounded(T))[0], rounded(projection)),
        exact,
    )


@lru_cache(maxsize=4)
def _rationals(form: AutonomousForm) -> RationalSystem:
    return rational_system(form.system)


def floating_maps(form: AutonomousForm, mode: IndexSet) -> ModeMaps | None:
    """Return the maps in floating point; stiff ones of small systems in rational arithmetic where that agrees."""
    system, index = form.system, list(mode)
    block = _Block(system.A, system.B[:, index], system.C, system.D[:, index], index)
    maps = _uniform_maps(block)
    if maps is None:
        maps = _general_maps(block)
    if maps is None or sum(system.shape) > EXACT_SIZE:
        return maps
    if not _is_stiff(maps):
        return maps
    exact = exact_maps(form, mode)
    return exact if exact is not None and exact.rate.shape == maps.rate.shape else maps


def _is_stiff(maps: ModeMaps) -> bool:
    """Tell whether rounding of large entries or fast rates would be felt in what is small or slow."""
    if max(float(np.abs(part).max(initial=0.0)) for part in (maps.rate, maps.outputs)) >= STIFF:
        return True
    sizes = np.abs(np.linalg.eigvals(maps.rate))
    largest = float(sizes.max(initial=0.0))
    return bool(np.any((sizes > ROUNDING * largest) & (sizes * STIFF < largest)))


def coordinate_rows(basis: Matrix) -> list[int]:
    """Return rows of V, as many as columns, that are far from dependent: the states that are its coordinates."""
    if basis.shape[0] == basis.shape[1]:
        return list(range(basis.shape[0]))
    orthonormal = np.linalg.qr(basis)[0]
    order = qr(orthonormal.T, mode="r", pivoting=True)[1]
    return sorted(order[: basis.shape[1]].tolist())


def _uniform_maps(block: _Block) -> ModeMaps | None:
    """Return the maps where all outputs of the mode have one relative degree from 0 to 2, None elsewhere."""
    A, B, C, D, index = block
    N, k = A.shape[0], C.shape[0]
    if not index:
        eye = np.eye(N)
        return ModeMaps(eye, eye, A, C, np.zeros((0, k, N)))
    own, feed = C[index], D[index]
    if np.any(feed):
        return _maps_with_feedthrough(block)
    markov = without_rounding(own @ B, np.abs(own) @ np.abs(B))
    if np.any(markov):
        constraints, inputs, gain = own, B, markov
        moments = gain
    else:
        rows = own @ A
        gain = without_rounding(rows @ B, np.abs(own) @ np.abs(A) @ np.abs(B))
        constraints, inputs = np.vstack([own, rows]), np.hstack([B, A @ B])
        moments = np.block([[np.zeros_like(gain), gain], [gain, rows @ A @ B]])
    if not _is_regular(gain):
        return None
    forces = -np.linalg.solve(moments, constraints)  # coefficients of delta, and of delta' behind
    m = len(index)
    P = np.eye(N) + inputs @ forces
    last = constraints[-m:] @ A
    F = without_rounding(
        -np.linalg.solve(gain, last @ P), np.abs(np.linalg.inv(gain)) @ np.abs(last) @ np.abs(P)
    )
    rows = _coordinate_rows_of(constraints)
    basis = _graph(constraints, rows)
    closed, outputs, sizes = A + B @ F, C + D @ F, np.abs(C) + np.abs(D) @ np.abs(F)
    outputs[index], sizes[index] = F, np.abs(F)
    impulses = np.zeros((forces.shape[0] // m, k, N))
    for order in range(impulses.shape[0]):  # delta', delta
        held = forces[m * (impulses.shape[0] - 1 - order) :][:m]
        impulses[order] = D @ held
        impulses[order][index] = held
    if impulses.shape[0] == 2:  # x has the impulse B U1
        others = [i for i in range(k) if i not in index]
        impulses[1][others] += C[others] @ B @ forces[m:]
    return ModeMaps(
        basis,
        without_rounding(P[rows], np.abs(np.eye(N)[rows]) + np.abs(inputs[rows]) @ np.abs(forces)),
        without_rounding(closed[rows] @ basis, (np.abs(A) + np.abs(B) @ np.abs(F))[rows] @ np.abs(basis)),
        without_rounding(outputs @ basis, sizes @ np.abs(basis)),
        without_rounding(impulses, float(np.abs(impulses).max(initial=0.0))),
    )


def _maps_with_feedthrough(block: _Block) -> ModeMaps | None:
    A, B, C, D, index = block
    feed = D[index]
    if not _is_regular(feed):
        return None
    F = -np.linalg.solve(feed, C[index])
    sizes = np.abs(D) @ np.abs(F) + np.abs(C)
    outputs = without_rounding(C + D @ F, sizes)
    outputs[index] = F
    eye = np.eye(A.shape[0])
    rate = without_rounding(A + B @ F, np.abs(A) + np.abs(B) @ np.abs(F))
    return ModeMaps(eye, eye, rate, outputs, np.zeros((0, *C.shape)))


def _is_regular(M: Matrix) -> bool:
    """Tell whether a block is regular far from rounding, whatever the scales of its rows and columns."""
    rows = np.abs(M).max(axis=1, keepdims=True)
    if not rows.all():
        return False
    scaled = M / rows
    columns = np.abs(scaled).max(axis=0, keepdims=True)
    if not columns.all():
        return False
    values = np.linalg.svd(scaled / columns, compute_uv=False)
    return bool(values[-1] > REGULAR * values[0])


def _coordinate_rows_of(constraints: Matrix) -> list[int]:
    """Return the states that are free in {x: K x = 0}."""
    scaled = constraints / np.abs(constraints).max(axis=1, keepdims=True)
    order = qr(scaled, mode="r", pivoting=True)[1]
    return sorted(order[constraints.shape[0] :].tolist())


def _graph(constraints: Matrix, rows: list[int]) -> Matrix:
    """Return the basis of {x: K x = 0} that is the identity in these rows."""
    N = constraints.shape[1]
    rest = [i for i in range(N) if i not in set(rows)]
    basis = np.zeros((N, len(rows)))
    basis[rows] = np.eye(len(rows))
    X = np.linalg.solve(constraints[:, rest], constraints[:, rows])
    basis[rest] = -without_rounding(X, float(np.abs(X).max(initial=0.0)))
    return basis


def _general_maps(block: _Block) -> ModeMaps | None:
    """Return the maps by the sequences (11.73) and (11.76), ranks decided by singular values."""
    A, B, C, D, index = block
    arithmetic = Arithmetic(
        lambda M: pivoted_kernel(M, RANK_TOLERANCE),
        lambda M: pivoted_image(M, RANK_TOLERANCE),
        _least_squares,
        np.eye,
    )
    equations = mode_equations(A, B, C[index], D[index], tuple(range(len(index))))
    V, T, W, F = spaces(equations, arithmetic)
    if W is None or F is None:
        return None
    rows = coordinate_rows(V)
    basis = V if not rows else np.linalg.solve(V[rows].T, V.T).T
    basis = without_rounding(basis, float(np.abs(basis).max(initial=0.0)))
    basis[rows] = np.eye(len(rows))
    projection = V @ W
    F = without_rounding(F, 10.0 * float(np.abs(F).max(initial=0.0)))
    closed, outputs, sizes = A + B @ F, C + D @ F, np.abs(C) + np.abs(D) @ np.abs(F)
    outputs[index], sizes[index] = F, np.abs(F)
    return ModeMaps(
        basis,
        without_rounding(projection[rows], float(np.abs(projection).max(initial=0.0))),
        without_rounding(closed[rows] @ basis, (np.abs(A) + np.abs(B) @ np.abs(F))[rows] @ np.abs(basis)),
        without_rounding(
            outputs @ basis, np.sum(sizes, axis=1, keepdims=True)
        ),  # the basis: to rounding of 1
        _impulses(block, np.linalg.qr(T)[0], projection),
    )


def _impulses(block: _Block, jumps: Matrix, projection: Matrix) -> NDArray[np.float64]:
    """Return the outputs' coefficients of delta^(r-1), ..., delta' , delta as functions of the state before.

    With u = sum U_m delta^(m) and x = sum X_m delta^(m) + smooth, (11.80) says X_(m-1) = A X_m + B U_m,
    0 = C_I X_m + D_II U_m, and that the state jumps by A X_0 + B U_0.
    """
    A, B, C, D, index = block
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
    return np.asarray(without_rounding(outputs[::-1] @ share, float(np.max(np.abs(outputs), initial=0.0))))


def _least_squares(M: Matrix, R: Matrix) -> Matrix | None:
    X = pivoted_solution(M, R, RANK_TOLERANCE)
    residual = float(np.max(np.abs(M @ X - R), initial=0.0))
    size = max(1.0, float(np.max(np.abs(R), initial=0.0)))
    return np.asarray(X, dtype=np.float64) if residual <= RANK_TOLERANCE**0.5 * size else None


def without_rounding(entries: Any, sizes: Any) -> Any:
    """Return the entries, zero where they are no more than rounding of terms of these sizes."""
    return np.where(np.abs(entries) <= ROUNDING * sizes, 0.0, entries)
