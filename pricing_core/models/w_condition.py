"""When a piecewise linear system has one continuation: the W-property of its pieces for large s."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from flint import fmpq, fmpq_poly

from pricing_core.lcs import LCS, Finding
from pricing_core.lcs.parts import strongly_connected_parts
from pricing_core.lcs.pole_shifted_passivity import is_passive_after_pole_shift
from pricing_core.lcs.rational_system import RationalSystem, rational_system
from pricing_core.lcs.theorems import together
from pricing_core.lcs.total_invertibility import LARGEST_PAIRS, transfer_minors
from pricing_core.linalg.rational import rational_array
from pricing_core.models.characteristic import Characteristic

MOST_REPRESENTATIVES = 20_000


def w_condition(plant: LCS, characteristics: Sequence[Characteristic]) -> Finding:
    """Tell whether diag(dy) - G(s) diag(du) has, for all large s, determinants of one sign on all pieces; exact.

    Parameters
    ----------
    plant : LCS
        Its A, B, C, D alone are read.
    characteristics : sequence of Characteristic, length k

    Returns
    -------
    Finding
        See `PiecewiseLinearSystem.w_property`.

    Examples
    --------
    >>> step = Characteristic([(0, 1), (0, -1)])
    >>> w_condition(LCS([[0]], [[-1]], [[1]]), [step]).reason
    'with the slopes (vertical) the determinant has another sign than that of the first pieces'
    """
    parts = [part for part in strongly_connected_parts(plant) if part.pairs]
    return together([_of_part(part.system, [characteristics[i] for i in part.pairs]) for part in parts])


def is_monotone(plant: LCS, characteristics: Sequence[Characteristic]) -> bool:
    """Tell whether the state is unique by monotonicity: each characteristic rises or falls, and the plant dissipates.

    Where two states go on, the differences v of u and w of y have v_i w_i <= 0 for falling characteristics and >= 0
    for rising ones; with the inputs of these reversed, v^T G(s) v <= 0 for large s. Where the plant is passive after
    a shift of the poles this leaves one state. Exact.

    Examples
    --------
    Two relays in one direction: the state is unique, their outputs are not.

    >>> step = Characteristic([(0, 1), (0, -1)])
    >>> is_monotone(LCS([[0]], [[1, 1]], [[1], [1]]), [step, step])
    True
    """
    slopes = [[dy * du for dy, du in _distinct_directions(curve)] for curve in characteristics]
    if any(min(each) < 0 < max(each) for each in slopes):
        return False
    reversed_inputs = rational_array(np.array([-1 if max(each) > 0 else 1 for each in slopes], dtype=int))
    A, B, C, D = rational_system(plant)
    return is_passive_after_pole_shift(RationalSystem(A, B * reversed_inputs, C, D * reversed_inputs))


def _of_part(plant: LCS, characteristics: Sequence[Characteristic]) -> Finding:
    k = plant.shape[1]
    directions = [_distinct_directions(curve) for curve in characteristics]
    if k > LARGEST_PAIRS or math.prod(len(each) for each in directions) > MOST_REPRESENTATIVES:
        return Finding("silent", f"at most {MOST_REPRESENTATIVES} combinations of pieces are examined")
    determinants = _determinants([fmpq_poly(minor) for minor in transfer_minors(plant)], directions)
    wanted = 0
    for chosen, determinant in zip(itertools.product(*directions), determinants, strict=True):
        sign = _sign_at_infinity(determinant)
        if sign in (0, -wanted):
            slopes = ", ".join(_slope(direction) for direction in chosen)
            kind = "vanishes" if sign == 0 else "has another sign than that of the first pieces"
            return Finding("silent", f"with the slopes ({slopes}) the determinant {kind}")
        wanted = sign
    return Finding("holds", "the determinants of all combinations of pieces have one sign for large s")


def _distinct_directions(curve: Characteristic) -> list[tuple[fmpq, fmpq]]:
    """Return (dy, du) of all pieces, exact and each once, up to positive factors."""
    points = rational_array(curve.points)
    between = [(b[0] - a[0], b[1] - a[1]) for a, b in itertools.pairwise(points)]
    rays = [rational_array(curve.tangents[j]) for j in (0, -1)]
    found: list[tuple[fmpq, fmpq]] = []
    for dy, du in ((rays[0][0], rays[0][1]), *between, (rays[1][0], rays[1][1])):
        size = abs(dy) if dy else abs(du)
        if (direction := (dy / size, du / size)) not in found:
            found.append(direction)
    return found


def _determinants(
    minors: list[fmpq_poly], directions: Sequence[Sequence[tuple[fmpq, fmpq]]]
) -> list[fmpq_poly]:
    """Return det(diag(dy) - G diag(du)) for all combinations of directions, in the order of `itertools.product`.

    The common factor is that of the minors det G_II. The determinant is linear in each column: column by column, the
    sets I with and without its index are put together for each of its directions.
    """
    partial = [minors]  # for the directions chosen so far: by the sets of the columns that are left
    for choices in directions:
        partial = [
            [out * dy - with_it * du for out, with_it in zip(table[::2], table[1::2], strict=True)]
            for table in partial
            for dy, du in choices
        ]
    return [table[0] for table in partial]


def _sign_at_infinity(p: fmpq_poly) -> int:
    degree = p.degree()
    return 0 if degree < 0 else int(p[degree] > 0) - int(p[degree] < 0)


def _slope(direction: tuple[fmpq, fmpq]) -> str:
    return "vertical" if direction[0] == 0 else f"{float(direction[1].p) / float(direction[1].q):g}"
