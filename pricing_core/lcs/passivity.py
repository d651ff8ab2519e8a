"""Passivity of (A, B, C, D): a verified solution Q > 0 of the linear matrix inequality (11.6), or a refutation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from flint import fmpq

from pricing_core.arrays import Matrix, check_type
from pricing_core.lcs.balancing import Units, balancing_units
from pricing_core.lcs.frequency_witness import FrequencyWitness, frequency_witness
from pricing_core.lcs.parts import Part, independent_parts
from pricing_core.lcs.rational_system import EXACT_SIZE, RationalSystem, rational_system
from pricing_core.lcs.storage_function import Inequality, Storage, storage_function
from pricing_core.lcs.system import LCS
from pricing_core.linalg.rational import RationalMatrix, rational_array, rounded
from pricing_core.linalg.rational_definite import negative_vector

LARGEST = 60  # n + k up to which anything is verified


@dataclass(frozen=True, slots=True, eq=False)
class Passivity:
    """Whether some symmetric Q > 0 satisfies (11.6).

    Parameters
    ----------
    verdict : bool or None
        True and False are proved in exact arithmetic; None: neither was.
    reason : str
        What the verdict rests on.
    storage : Matrix, shape (n, n), or None
        Q, where the verdict is True.
    exact_storage : array of rationals, shape (n, n), or None
    witness : FrequencyWitness or None
        Where the verdict is False and rests on one.
    """

    verdict: bool | None
    reason: str
    storage: Matrix | None = None
    exact_storage: RationalMatrix | None = None
    witness: FrequencyWitness | None = None


def passivity(system: LCS) -> Passivity:
    """Decide whether x' = Ax + Bu, y = Cx + Du is passive with a storage function x^T Q x / 2, Q > 0.

    The offsets f, g do not matter. Exact, for the data as given: wherever (11.6) leaves no room, Q follows from
    linear equations, and what is left is decided by a Riccati equation, whose solution is rounded to a rational
    matrix and verified. False rests on v^T (D + D^T) v < 0, on an eigenvalue of A in the open right half plane, on
    equations for Q without solution, or on a frequency at which the system delivers energy. None is the answer where
    rounding leaves that open.

    Notes
    -----
    Cost: 10 ms for n = k = 10, a second for n + k = 60 with short numbers, and more where numbers of 15 digits must be
    eliminated. Parts that do not act on each other are examined one by one; beyond n + k = 60 None is the answer.
    Source: (11.6); Willems 1972.

    Examples
    --------
    A resistor beside a capacitor of 4, and the same with a negative capacitor:

    >>> passivity(LCS([[-0.5]], [[0.25]], [[1]])).storage
    array([[4.]])
    >>> passivity(LCS([[-0.5]], [[-0.25]], [[1]])).verdict
    False
    """
    check_type("system", system, LCS)
    n, k = system.shape
    data = rational_system(system)
    direction = negative_vector(data.D + data.D.T)
    if direction is not None:
        numbers = ", ".join(f"{float(v):g}" for v in direction)
        return Passivity(False, f"D + D^T is negative on ({numbers})")
    parts = independent_parts(system)
    if len(parts) > 1:
        return _of_parts(n, k, parts)
    return _of_one_part(system, data)


def _of_one_part(system: LCS, data: RationalSystem) -> Passivity:
    n, k = system.shape
    if n + k > LARGEST:
        return Passivity(None, f"n + k = {n + k} is more than {LARGEST}, the limit of the exact verification")
    if _identity_stores(data):
        one = rational_array(np.eye(n, dtype=int))
        return Passivity(True, "Q = 1 satisfies (11.6), verified exactly", rounded(one), one)
    found = storage_function(Inequality(data.A, data.B, data.C, data.D + data.D.T))
    if found.Q is not None:
        return Passivity(True, found.reason, rounded(found.Q), found.Q)
    if found.verdict is False and k and (found.frequencies or n + k <= EXACT_SIZE):
        return _with_witness(found, system, data)
    return Passivity(found.verdict, found.reason)


def _with_witness(found: Storage, system: LCS, data: RationalSystem) -> Passivity:
    """Tell why the system is not passive, by a frequency where one is found."""
    units = balancing_units(system.A, system.B, system.C, system.D)
    rate = rational_array(np.array([units.rate]))[0]
    exact_units = Units(rational_array(units.state), rational_array(units.pair), rate)
    frequencies = [frequency / units.rate for frequency in found.frequencies]
    witness = frequency_witness(RationalSystem(*exact_units.apply(*data)), frequencies)
    if witness is None:
        return Passivity(False, found.reason)
    reason = f"{found.reason}: Re v^* G(s) v < 0 at s = {witness.s:.6g}, in balanced units"
    return Passivity(False, reason, witness=witness)


def _of_parts(n: int, k: int, parts: list[Part]) -> Passivity:
    """Put together what is known of the independent parts: Q is block diagonal."""
    found = [passivity(part.system) for part in parts]
    for verdict in (False, None):
        for part, each in zip(parts, found, strict=True):
            if each.verdict is verdict:
                return replace(each, witness=_of_all_pairs(each.witness, part, k))
    Q = np.full((n, n), fmpq(0), dtype=object)
    for part, each in zip(parts, found, strict=True):
        Q[np.ix_(part.states, part.states)] = each.exact_storage
    return Passivity(True, found[0].reason, rounded(Q), Q)


def _of_all_pairs(witness: FrequencyWitness | None, part: Part, k: int) -> FrequencyWitness | None:
    if witness is None:
        return None
    v = np.zeros(k, dtype=np.complex128)
    v[list(part.pairs)] = witness.v
    return witness._replace(v=v)


def _identity_stores(system: RationalSystem) -> bool:
    """Tell whether Q = 1 satisfies (11.6)."""
    A, B, C, D = system
    corner = C.T - B
    return negative_vector(np.block([[-(A + A.T), corner], [corner.T, D + D.T]])) is None
