"""The theorems on well-posedness of section 11.6 as tests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

from flint import fmpz_poly

from pricing_core.lcs.markov import leading_markov_parameter
from pricing_core.lcs.properness import (
    LeadingCoefficients,
    leading_column_coefficients,
    leading_row_coefficients,
)
from pricing_core.lcs.system import LCS
from pricing_core.lcs.total_invertibility import LARGEST_PAIRS, modes_of_zero_minors
from pricing_core.lcs.transfer_matrix import transfer_matrix
from pricing_core.linalg.polynomials import common_denominator, sign_at_infinity
from pricing_core.linalg.principal_minors import all_positive, members_of, principal_minors
from pricing_core.linalg.rational_definite import is_exactly_positive_definite


class Finding(NamedTuple):
    """What a theorem tells about a system.

    Parameters
    ----------
    status : {"holds", "fails", "silent"}
        "holds": its conditions are proved; "fails": one without which its conclusion is false is proved to be violated;
        "silent": neither is proved, or it is about other systems.
    reason : str
        The hypothesis that decides, in one sentence.
    """

    status: Literal["holds", "fails", "silent"]
    reason: str


def together(findings: Sequence[Finding]) -> Finding:
    """Return what holds of all parts of a system, or the first finding that keeps it from holding.

    Examples
    --------
    >>> together([Finding("holds", "one"), Finding("silent", "two")])
    Finding(status='silent', reason='two')
    """
    for status in ("fails", "silent"):
        for finding in findings:
            if finding.status == status:
                return finding
    reason = findings[0].reason
    return Finding("holds", reason if len(findings) == 1 else f"in each of {len(findings)} parts: {reason}")


TOO_MANY_MODES = (
    f"the 2**k modes are examined for k <= {LARGEST_PAIRS} pairs only, or so many that all act on each other"
)


def theorem_11_1(minors: list[fmpz_poly] | None) -> Finding:
    """Total invertibility: every mode has unique solutions, and V_I (+) T_I = R^n.

    Examples
    --------
    >>> from pricing_core.lcs.total_invertibility import transfer_minors
    >>> theorem_11_1(transfer_minors(LCS([[0]], [[1, 1]], [[1], [1]]))).status
    'fails'
    """
    if minors is None:
        return Finding("silent", TOO_MANY_MODES)
    singular = modes_of_zero_minors(minors)
    if singular:
        return Finding(
            "fails", f"G_II is singular for {len(singular)} of {len(minors)} modes, first {singular[0]}"
        )
    return Finding("holds", f"G_II is nonsingular for all {len(minors)} modes")


def theorem_11_2(system: LCS) -> Finding:
    """One pair, no feedthrough, G neither 0 nor 1 / polynomial: well-posed iff the leading parameter is positive.

    Examples
    --------
    >>> theorem_11_2(LCS([[0, 1], [-1, 0]], [[0], [1]], [[0, 1]])).status
    'holds'
    """
    k = system.shape[1]
    if k != 1:
        return Finding("silent", f"it speaks of one pair, not of {k}")
    if system.D.any():
        return Finding("silent", "it speaks of systems without feedthrough")
    leading = leading_markov_parameter(system)
    if leading is None:
        return Finding("silent", "G = 0")
    if transfer_matrix(system).numerators[0][0].degree() == 0:
        return Finding("silent", "G is one over a polynomial (degenerate)")
    value = float(leading.matrix[0, 0])
    reason = f"the leading Markov parameter, of 1/s**{leading.power}, is {value:g}"
    return Finding("holds" if value > 0 else "fails", reason)


def theorem_11_3(system: LCS) -> Finding:
    """Row and column properness with leading coefficient P-matrices: well-posed, one reinitialisation at most.

    Examples
    --------
    >>> theorem_11_3(LCS([[0, 1], [0, 0]], [[1, 0], [0, 1]], [[1, 0], [0, 1]])).status
    'holds'
    """
    parts = (("row", leading_row_coefficients(system)), ("column", leading_column_coefficients(system)))
    for name, leading in parts:
        if not leading.is_invertible:
            return Finding(
                "silent", f"G is not {name} proper: its leading {name} coefficient matrix is singular"
            )
        doubt = _doubt_of_p(leading)
        if doubt is not None:
            return Finding("silent", f"the leading {name} coefficient matrix: {doubt}")
    degrees = ", ".join(f"{name} degrees {leading.degrees}" for name, leading in parts)
    return Finding("holds", f"both leading coefficient matrices are P-matrices, {degrees}")


def theorem_11_4(minors: list[fmpz_poly] | None) -> Finding:
    """Total invertibility and unique solutions of every RCP(x0): well-posed; the second by theorem 11.5."""
    if minors is None:
        return Finding("silent", TOO_MANY_MODES)
    if all_positive(minors):
        return Finding("holds", "G is totally invertible, and a P-matrix for all large s")
    return Finding("silent", _minor_that_is_not_positive(minors))


def theorem_11_5(minors: list[fmpz_poly] | None) -> Finding:
    """RCP(q, M) is uniquely solvable iff LCP(q(s), M(s)) is for all large s: for every q where M(s) is a P-matrix."""
    if minors is None:
        return Finding("silent", TOO_MANY_MODES)
    if all_positive(minors):
        return Finding(
            "holds", "G(s) is a P-matrix for all large s: LCP(q(s), G(s)) has one solution for every q"
        )
    return Finding("silent", _minor_that_is_not_positive(minors))


def _minor_that_is_not_positive(minors: list[fmpz_poly]) -> str:
    k = len(minors).bit_length() - 1
    position = next(i for i in range(1, len(minors)) if sign_at_infinity(minors[i]) <= 0)
    return f"G(s) is no P-matrix for large s: its minor {members_of(position, k)} is not positive"


def _doubt_of_p(leading: LeadingCoefficients) -> str | None:
    """Return why the matrix is not proved to be a P-matrix, or None: it is."""
    k = len(leading.degrees)
    if k > LARGEST_PAIRS:
        definite = is_exactly_positive_definite(leading.exact + leading.exact.T)
        return None if definite else f"not positive definite, and {TOO_MANY_MODES}"
    scale = common_denominator(leading.exact.ravel())
    constants = [[fmpz_poly([(scale * entry).p]) for entry in row] for row in leading.exact]
    minors = principal_minors(fmpz_poly([1]), constants)
    violations = (members_of(i, k) for i in range(1, len(minors)) if sign_at_infinity(minors[i]) <= 0)
    violation = next(violations, None)
    return None if violation is None else f"its minor {violation} is not positive"
