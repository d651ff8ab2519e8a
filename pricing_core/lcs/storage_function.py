"""Storage functions: Q is known wherever the passivity inequality has no room, else from a Riccati equation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np
from flint import fmpq, fmpq_poly

from pricing_core.lcs.frequency_witness import frequency_witness
from pricing_core.lcs.rational_system import RationalSystem
from pricing_core.lcs.riccati import critical_frequencies, strict_storage
from pricing_core.linalg.rational import (
    RationalMatrix,
    exact_image,
    exact_kernel,
    exact_product,
    exact_solution,
    from_flint,
    pivot_columns,
    rational_array,
    rounded,
    to_flint,
)
from pricing_core.linalg.rational_definite import is_exactly_positive_definite, negative_vector

DIGITS = 16  # binary, of the coefficients of new bases
LARGEST_CONSERVING = 10  # states without inputs whose energies are found by elimination


class Inequality(NamedTuple):
    """[[-(A^T Q + Q A), C^T - Q B], [C - B^T Q, E]] >= 0, to be met by some Q > 0; E is symmetric."""

    A: RationalMatrix  # (n, n)
    B: RationalMatrix  # (n, k)
    C: RationalMatrix  # (k, n)
    E: RationalMatrix  # (k, k)


class Storage(NamedTuple):
    """Q, or why there is none, or why none was found."""

    verdict: Literal[True, False] | None
    reason: str
    Q: RationalMatrix | None = None  # (n, n)
    frequencies: tuple[float, ...] = ()  # near which the inequality fails


EXACT = "a rational Q > 0 satisfies (11.6), verified exactly"
NO_SYMMETRIC = Storage(False, "no symmetric Q > 0 has the values that (11.6) forces on a subspace")
OPEN = Storage(None, "no Q was found and verified, and no frequency refutes passivity")


def storage_function(problem: Inequality) -> Storage:
    """Decide whether some Q > 0 meets the inequality; exact, with Q where there is one.

    Where the matrix S of the inequality vanishes for every Q on [X; U], Q X = Z is known: on ker E at infinite s, on
    eigenvectors of A on the imaginary axis, and where G(s) + G(s)^* is singular there. With X^T Z > 0 and T a basis of
    ker Z^T, Q is block diagonal in the basis [X, T], and an inequality for fewer states is left. At its end E > 0, or
    there are no inputs, and the Q of a Riccati or Lyapunov equation with a margin is rounded and verified.

    Notes
    -----
    Cost: a few eliminations of order n in rational numbers, at most n times. Source: Willems 1972; Weiss, Wang and
    Speyer 1994.

    Examples
    --------
    >>> one = rational_array(np.array([[1]]))
    >>> storage_function(Inequality(-one, one, 3 * one, 0 * one)).Q.tolist()
    [[3]]
    """
    if negative_vector(problem.E) is not None:
        return Storage(False, "a part of (11.6) that does not depend on Q is negative")
    kernel = exact_kernel(problem.E)
    if kernel.shape[1]:
        return _at_infinity(problem, kernel)
    if not len(problem.A):
        return Storage(True, EXACT, problem.A)
    Q = strict_storage(*problem)
    return _at_finite_frequencies(problem) if Q is None else Storage(True, EXACT, Q)


def _at_finite_frequencies(problem: Inequality) -> Storage:
    if _has_growing_mode(problem.A):
        return Storage(False, "A has an eigenvalue with positive real part")
    conserving = _even_factor(problem.A)
    return _with_conserving_part(problem, conserving) if conserving.degree() else _on_the_axis(problem)


def _at_infinity(problem: Inequality, kernel: RationalMatrix) -> Storage:
    """Go on with Q B K = C^T K for the kernel K of E."""
    A, B, C, E = problem
    others = pivot_columns(E)  # these inputs complete the kernel
    outputs, resistance = C[others], E[np.ix_(others, others)]

    def rest(known: _Known) -> Inequality:
        """Return what is left, with the coordinates along X as further inputs."""
        r = known.P.shape[0]
        top = -exact_product(known.P, known.A[:r])
        corner = exact_product(outputs, known.X) - exact_product(known.B[:r].T, known.P)
        return Inequality(
            known.A[r:, r:],
            np.hstack([known.A[r:, :r], known.B[r:]]),
            np.vstack([top[:, r:], exact_product(outputs, known.T)]),
            np.block([[top[:, :r] + top[:, :r].T, corner.T], [corner, resistance]]),
        )

    return _with_known(A, B[:, others], exact_product(B, kernel), exact_product(C.T, kernel), rest)


class _Known(NamedTuple):
    """What is known of Q: X^T Q X = P, X^T Q T = 0; and A and B in the basis [X, T]."""

    X: RationalMatrix
    P: RationalMatrix
    T: RationalMatrix
    A: RationalMatrix
    B: RationalMatrix


def _with_known(
    A: RationalMatrix,
    B: RationalMatrix,
    X: RationalMatrix,
    Z: RationalMatrix,
    rest: Callable[[_Known], Inequality],
) -> Storage:
    """Solve with Q X = Z by the inequality that is left of the other states."""
    if exact_product(Z, exact_kernel(X)).any():
        return NO_SYMMETRIC
    columns = pivot_columns(X)
    sizes = np.abs(rounded(X[:, columns])).max(axis=0, initial=0.0)
    units = rational_array(np.exp2(np.rint(np.log2(sizes))))
    X, Z = X[:, columns] / units, Z[:, columns] / units
    P = exact_product(X.T, Z)
    if (P != P.T).any() or not is_exactly_positive_definite(P):
        return NO_SYMMETRIC
    T = _nearly_orthonormal(exact_kernel(Z.T))
    V = np.hstack([X, T])
    inverse = _inverse(V)
    AV, BV = exact_product(inverse, exact_product(A, V)), exact_product(inverse, B)
    found = storage_function(rest(_Known(X, P, T, AV, BV)))
    if found.Q is None:
        return found
    blocks = _block_diagonal(P, found.Q)
    return found._replace(Q=exact_product(inverse.T, exact_product(blocks, inverse)))


def _with_conserving_part(problem: Inequality, factor: fmpq_poly) -> Storage:
    """Treat the states with eigenvalues on the imaginary axis, whose energy is kept, and the others apart."""
    A, B, C, E = problem
    squarefree = factor / factor.gcd(factor.derivative())
    matrix = _polynomial(squarefree, A)
    V, W = exact_kernel(matrix), exact_kernel(matrix.T)
    if V.shape[1] < factor.degree():
        return Storage(False, "A has a multiple eigenvalue on the imaginary axis, which is not semisimple")
    basis = np.hstack([V, exact_kernel(W.T)])
    inverse = _inverse(basis)
    m = V.shape[1]
    A, B, C = (
        exact_product(inverse, exact_product(A, basis)),
        exact_product(inverse, B),
        exact_product(C, basis),
    )
    if B.shape[1]:
        kept = storage_function(Inequality(A[:m, :m], B[:m], C[:, :m], fmpq(0) * E))
    else:
        kept = _conserved_energy(A[:m, :m])
    if kept.Q is None:
        return kept
    others = storage_function(Inequality(A[m:, m:], B[m:], C[:, m:], E))
    if others.Q is None:
        return others
    blocks = _block_diagonal(kept.Q, others.Q)
    return others._replace(Q=exact_product(inverse.T, exact_product(blocks, inverse)))


def _conserved_energy(A: RationalMatrix) -> Storage:
    """Return Q with A^T Q + Q A = 0, for semisimple eigenvalues on the imaginary axis: the mean of 1 along the flow."""
    n = len(A)
    if n > LARGEST_CONSERVING:
        return Storage(None, f"{n} states without input keep an energy, more than {LARGEST_CONSERVING}")
    one = rational_array(np.eye(n, dtype=int))
    change = np.kron(A.T, one) + np.kron(one, A.T)  # of Q by rows; R^(n n) is its kernel and its image
    kept = exact_kernel(change)
    parts = exact_solution(np.hstack([kept, exact_image(change)]), one.reshape(-1, 1))
    assert parts is not None
    Q = exact_product(kept, parts[: kept.shape[1]]).reshape(n, n)
    return Storage(True, EXACT, Q) if is_exactly_positive_definite(Q) else OPEN


def _on_the_axis(problem: Inequality) -> Storage:
    """Look for frequencies at which G + G^* is not positive definite; A has no eigenvalue on the axis, and E > 0."""
    A, B, C, E = problem
    if not B.shape[1]:
        return OPEN
    frequencies = critical_frequencies(*problem)
    if frequency_witness(RationalSystem(A, B, C, E / 2), frequencies) is not None:
        return Storage(False, "G(s) + G(s)^* is not positive semidefinite", None, frequencies)
    X, Z = _singular_on_the_axis(problem)
    if not X.shape[1]:
        return OPEN

    def rest(known: _Known) -> Inequality:
        r = len(known.P)
        return Inequality(known.A[r:, r:], known.B[r:], exact_product(C, known.T), E)

    return _with_known(A, B, X, Z, rest)


def _singular_on_the_axis(problem: Inequality) -> tuple[RationalMatrix, RationalMatrix]:
    """Return X and Z = Q X for the frequencies at which G + G^* is singular: (x, z) are eigenvectors of a Hamiltonian.

    With (i omega - A) x = B u and (G + G^*) u = 0, S [x; u] = 0 says (A^T + i omega) z = C^T u for z = Q x. The
    eigenvalues have even multiplicity, and the kernels of their minimal polynomials have rational bases.
    """
    A, B, C, E = problem
    n = len(A)
    solved = exact_product(_inverse(E), np.hstack([C, B.T]))
    F = A - exact_product(B, solved[:, :n])
    H = np.block([[F, exact_product(B, solved[:, n:])], [-exact_product(C.T, solved[:, :n]), -F.T]])
    repeated = [p for p, times in to_flint(H).charpoly().factor_squarefree()[1] if times % 2 == 0]
    bases = [
        exact_kernel(_polynomial(factor, H))
        for p in repeated
        for factor, _ in p.factor()[1]
        if _is_on_the_axis(factor)
    ]
    both = np.hstack([np.zeros((2 * n, 0), dtype=object), *bases])
    return both[:n], both[n:]


def _is_on_the_axis(p: fmpq_poly) -> bool:
    """Tell whether all roots of an irreducible polynomial are on the imaginary axis: those of p(sqrt r) are <= 0."""
    coefficients = p.coeffs()
    if p.degree() == 1:
        return not coefficients[0]
    if any(coefficients[1::2]):
        return False
    squares: list[Any] = fmpq_poly(coefficients[::2]).complex_roots()
    return all(root.imag == 0 and root.real < 0 for root, _ in squares)


def _has_growing_mode(A: RationalMatrix) -> bool:
    """Tell whether an eigenvalue of A is certified to have a positive real part."""
    roots: list[Any] = to_flint(A).charpoly().complex_roots()  # pairs of an enclosure and a multiplicity
    return any(root.real > 0 for root, _ in roots)


def _even_factor(A: RationalMatrix) -> fmpq_poly:
    """Return the common factor of det(s - A) and det(-s - A): that of the eigenvalues on the imaginary axis."""
    p = to_flint(A).charpoly()
    return p.gcd(fmpq_poly([c if i % 2 == 0 else -c for i, c in enumerate(p.coeffs())]))


def _polynomial(p: fmpq_poly, A: RationalMatrix) -> RationalMatrix:
    """Return p(A)."""
    one = rational_array(np.eye(len(A), dtype=int))
    value = fmpq(0) * one
    for coefficient in reversed(p.coeffs()):
        value = exact_product(value, A) + coefficient * one
    return np.asarray(value)


def _nearly_orthonormal(T: RationalMatrix) -> RationalMatrix:
    """Return another basis of the range, orthonormal but for a few digits, so that what follows is well conditioned."""
    if not T.size:
        return T
    lengths = np.linalg.norm(rounded(T), axis=0)
    upper = np.linalg.qr(rounded(T) / lengths)[1]
    columns = np.linalg.inv(upper) / lengths[:, None]
    powers = np.exp2(np.rint(np.log2(np.abs(columns).max(axis=0))) - DIGITS)
    return exact_product(T, rational_array(np.rint(columns / powers) * powers))


def _inverse(V: RationalMatrix) -> RationalMatrix:
    return from_flint(to_flint(V).inv()) if V.size else V


def _block_diagonal(P: RationalMatrix, Q: RationalMatrix) -> RationalMatrix:
    r, n = len(P), len(P) + len(Q)
    blocks = np.full((n, n), fmpq(0), dtype=object)
    blocks[:r, :r], blocks[r:, r:] = P, Q
    return blocks
