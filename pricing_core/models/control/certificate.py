"""What derivatives prove of a stationary point of the collocated problem: its residual, and whether it is a maximum."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import Vector
from pricing_core.models.control.nonlinear_programme import Expansion, NonlinearProgramme, Table
from pricing_core.models.control.sequential_programming import Optimum, violation

# Share of 1 + the largest multiplier below which a constraint counts as inactive.
ACTIVE = 1e-6
# Cost of leaving an active constraint, in curvatures.
HELD = 1e6
# Largest error of second differences, as a share of the curvatures.
CURVED = 1e-6


class Certificate(NamedTuple):
    """The first-order residual, and whether the second-order condition holds."""

    stationarity: float
    is_local_maximum: bool


def certificate(programme: NonlinearProgramme, found: Optimum) -> Certificate:
    """Return what derivatives at a point say of it, with multipliers that an exact maximum would have."""
    parts = programme.expansion(found.v, found.costate.reshape(programme.N, -1), found.duals)
    model = programme.model(parts)
    steep = model.gradient + model.equations.T @ found.costate - model.inequalities.T @ found.duals
    apart = np.abs(found.duals * found.values.slacks)
    size = 1.0 + float(np.max(np.abs(np.concatenate([found.costate, found.duals])), initial=0.0))
    largest = max(float(np.max(np.abs(steep))), float(np.max(apart, initial=0.0)), violation(found.values))
    return Certificate(largest / size, _has_strict_minimum(programme, parts, found.duals))


def _has_strict_minimum(programme: NonlinearProgramme, parts: Expansion, duals: Vector) -> bool:
    """Tell whether the loss grows in every direction that keeps (11.10) and the constraints with a multiplier.

    The Riccati recursion: with x_(j+1) = F x_j + G u_j from the linearised equations, P_j is the least second order of
    what follows node j. It exists as long as that is strictly convex in every u_j.
    """
    n, N, h = programme.n, programme.N, programme.h
    split = N * parts.mixed.shape[1]
    strong = duals > ACTIVE * (1.0 + float(np.max(duals, initial=0.0)))
    curvature = max(float(np.max(np.abs(parts.curved))), h)
    mixed = _held(parts.mixed, strong[:split].reshape(N, -1), HELD * curvature)
    pure = _held(parts.pure, strong[split:].reshape(N, -1), HELD * curvature / h**2)
    P = np.zeros((n, n))
    for j in range(N - 1, -1, -1):
        A, B = parts.rates[j, :, :n], parts.rates[j, :, n:]
        step = np.linalg.solve(np.eye(n) - 0.5 * h * A, np.hstack([np.eye(n) + 0.5 * h * A, h * B]))
        local = np.eye(n + programme.m)
        local[:n] = 0.5 * (local[:n] + step)
        H = (
            local.T @ (parts.curved[j] + mixed[j]) @ local
            + step.T @ (P + parts.node_curved[j] + pure[j]) @ step
        )
        inner = 0.5 * (H[n:, n:] + H[n:, n:].T)
        if not float(np.linalg.eigvalsh(inner)[0]) > CURVED * curvature:
            return False
        P = H[:n, :n] - H[:n, n:] @ np.linalg.solve(inner, H[n:, :n])
        P = 0.5 * (P + P.T)
    return True


def _held(rows: Table, strong: NDArray[np.bool_], weight: float) -> Table:
    """Return weight times the squares of the unit rows of the constraints with a multiplier, one sum for each place."""
    lengths = np.linalg.norm(rows, axis=2, keepdims=True)
    unit = np.where(lengths > 0.0, rows / np.where(lengths > 0.0, lengths, 1.0), 0.0) * strong[:, :, None]
    return np.asarray(weight * np.einsum("jki,jkl->jil", unit, unit))
