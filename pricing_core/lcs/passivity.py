"""Passivity of (A, B, C, D): a verified solution Q > 0 of the linear matrix inequality (11.6), or a refutation."""

from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np
from flint import fmpq
from scipy.linalg import qr

from pricing_core.arrays import Matrix, Vector
from pricing_core.lcs.balancing import Units, balancing_units
from pricing_core.lcs.frequency_witness import FrequencyWitness, frequency_witness
from pricing_core.lcs.parts import Part, independent_parts
from pricing_core.lcs.rational_system import EXACT_SIZE, RationalSystem, rational_system
from pricing_core.lcs.semidefinite_programme import largest_margin
from pricing_core.lcs.storage_function import StorageFamily, storage_family
from pricing_core.lcs.system import LCS
from pricing_core.linalg.rational import RationalMatrix, exact_kernel, rational_array, rounded, to_flint
from pricing_core.linalg.rational_definite import is_exactly_positive_definite, negative_vector

LARGEST = 60  # n + k up to which anything is verified
# Smallest margin of the semidefinite programme for its solution to be rounded.
SMALLEST_MARGIN = 1e-7
VANISHING = 1e-12  # a row of S so small is taken for zero by the programme
LARGEST_DENOMINATOR = 1000  # Largest denominator in guessed vectors on which S vanishes.
DIGITS = (8, 20, 40)  # binary, to which its solution is rounded, in turn


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

    The offsets f, g do not matter. First Q B = C^T is imposed on ker(D + D^T), and S v = 0 wherever v^T S v is
    zero for every Q left; then a semidefinite programme looks for a Q inside, which is rounded to a rational
    matrix and verified. False rests on v^T (D + D^T) v < 0, on an eigenvalue of A in the open right half plane,
    on equations for Q without solution, or on a frequency at which the system delivers energy.

    Notes
    -----
    Cost: 0.1 s for n = k = 10; the semidefinite programme has n (n + 1) / 2 unknowns. Parts that
    do not act on each other are examined one by one. For n + k > 24 only Q = 1 and frequencies are tried, and None
    is the answer for n + k > 60.
    Source: (11.6); Willems 1972.

    Examples
    --------
    A resistor beside a capacitor of 4, and the same with a negative capacitor:

    >>> passivity(LCS([[-0.5]], [[0.25]], [[1]])).storage
    array([[4.]])
    >>> passivity(LCS([[-0.5]], [[-0.25]], [[1]])).verdict
    False
    """
    n, k = system.shape
    data = rational_system(system)
    direction = negative_vector(data.D + data.D.T)
    if direction is not None:
        numbers = ", ".join(f"{float(v):g}" for v in direction)
        return Passivity(False, f"D + D^T is negative on ({numbers})")
    parts = independent_parts(system)
    if len(parts) > 1:
        return _of_parts(n, k, parts)
    if n + k > LARGEST:
        return Passivity(None, f"n + k = {n + k} is more than {LARGEST}, the limit of the exact verification")
    if n + k > EXACT_SIZE and _identity_stores(data):
        one = rational_array(np.eye(n, dtype=int))
        return Passivity(True, "Q = 1 satisfies (11.6), verified exactly", rounded(one), one)
    units = balancing_units(system.A, system.B, system.C, system.D)
    rate = rational_array(np.array([units.rate]))[0]
    exact_units = Units(rational_array(units.state), rational_array(units.pair), rate)
    balanced = RationalSystem(*exact_units.apply(*data))
    found = _decide(balanced) if n + k <= EXACT_SIZE else _decide_large(balanced)
    if found.exact_storage is None:
        return found
    x = exact_units.state
    Q = found.exact_storage / (rate * np.outer(x, x))
    return Passivity(True, found.reason, rounded(Q), Q)


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


def _decide(system: RationalSystem) -> Passivity:
    if _has_growing_mode(system.A):
        return Passivity(False, "A has an eigenvalue with positive real part")
    family = storage_family(system)
    if family is None:
        return Passivity(False, "no symmetric Q has Q B = C^T on ker(D + D^T)")
    forced = _with_forced_zeros(family)
    if forced is None:
        return Passivity(False, "no symmetric Q makes the rows zero whose diagonal is zero in (11.6)")
    Q = _search(forced)
    if Q is not None:
        return Passivity(True, "a rational Q > 0 satisfies (11.6), verified exactly", None, Q)
    witness = frequency_witness(system)
    if witness is not None:
        s = witness.s
        return Passivity(False, f"Re v^* G(s) v < 0 at s = {s:.6g}, in balanced units", witness=witness)
    return Passivity(None, "no Q was found and verified, and no frequency refutes passivity")


def _decide_large(system: RationalSystem) -> Passivity:
    """Try one energy and many frequencies."""
    witness = frequency_witness(system)
    if witness is not None:
        s = witness.s
        return Passivity(False, f"Re v^* G(s) v < 0 at s = {s:.6g}, in balanced units", witness=witness)
    return Passivity(
        None, f"for n + k > {EXACT_SIZE} Q = 1 alone is tried, and no frequency refutes passivity"
    )


def _has_growing_mode(A: RationalMatrix) -> bool:
    """Tell whether an eigenvalue of A is certified to have a positive real part."""
    if not len(A):
        return False
    roots: list[Any] = to_flint(A).charpoly().complex_roots()  # pairs of an enclosure and a multiplicity
    return any(root.real > 0 for root, _ in roots)


def _with_forced_zeros(family: StorageFamily | None) -> StorageFamily | None:
    while family is not None and (row := family.forced_zero()) is not None:
        family = family.with_zero(_unit(family.S.shape[1], row))
    return family


def _search(family: StorageFamily) -> RationalMatrix | None:
    """Return a verified Q > 0 of the family with S(Q) >= 0, or None.

    Where the programme has no interior, its multiplier shows on which vectors S vanishes. That is taken as a
    guess: it narrows the search, and the verification of Q does not rest on it.
    """
    W = rational_array(np.eye(family.S.shape[1], dtype=int))  # S is zero on a complement of its range
    while True:
        if not family.parameters:
            return _verified(family, np.zeros(0, dtype=object))
        products = rounded(W).T @ rounded(family.S) @ rounded(W)
        rows = np.flatnonzero(np.abs(products).max(axis=(0, 1), initial=0.0) > VANISHING)
        W = W[:, rows]
        margin = largest_margin(products[:, rows][:, :, rows], rounded(family.Q))
        if margin is None:
            return None
        for digits in DIGITS:
            Q = _verified(family, rational_array(_shortened(margin.theta, digits)))
            if Q is not None:
                return Q
        if abs(margin.value) > SMALLEST_MARGIN**0.5:
            return None
        face = _rational_range(margin.multiplier)
        narrowed = None if face is None else _with_forced_zeros(family.with_zero(W @ face))
        if face is None or narrowed is None:
            return None
        family, W = narrowed, W @ exact_kernel(face.T)


def _verified(family: StorageFamily, theta: RationalMatrix) -> RationalMatrix | None:
    Q, S = family.at(theta)
    return Q if negative_vector(S) is None and is_exactly_positive_definite(Q) else None


def _shortened(theta: Vector, digits: int) -> Vector:
    """Round to so many binary digits of the largest entry."""
    size = 2.0 ** np.ceil(np.log2(np.max(np.abs(theta), initial=1e-300)))
    return np.asarray(np.rint(theta / size * 2.0**digits) * (size * 2.0**-digits))


def _rational_range(multiplier: Matrix) -> RationalMatrix | None:
    """Return a basis with small fractions of the range of a semidefinite matrix known to a few digits."""
    values, vectors = np.linalg.eigh(multiplier)
    if not values.size or values[-1] <= 0.0:
        return None
    V = vectors[:, values > 1e-3 * values[-1]]
    if not V.shape[1]:
        return None
    _, _, order = qr(V.T, pivoting=True)
    pivots = np.sort(order[: V.shape[1]])
    reduced = V @ np.linalg.inv(V[pivots])
    fractions = [
        [Fraction(a).limit_denominator(LARGEST_DENOMINATOR) for a in row] for row in reduced.tolist()
    ]
    return rational_array(np.array(fractions, dtype=object))


def _unit(n: int, i: int) -> RationalMatrix:
    return rational_array(np.eye(n, dtype=int)[:, [i]])
