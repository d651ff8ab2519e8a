"""Passivity after a shift of the poles, A -> A - rho I, which is enough for existence and uniqueness."""

from __future__ import annotations

from pricing_core.lcs.rational_system import RationalSystem
from pricing_core.linalg.rational import exact_kernel, exact_product, exact_rank
from pricing_core.linalg.rational_definite import negative_vector

CRITERION = "D + D^T >= 0, and some Q > 0 has Q B = C^T on ker(D + D^T)"


def is_passive_after_pole_shift(system: RationalSystem) -> bool:
    """Decide exactly whether (A - rho I, B, C, D) is passive with some Q > 0 for all large rho.

    It is so iff D + D^T >= 0 and some Q > 0 has Q X = Y for X = B V, Y = C^T V, V a basis of ker(D + D^T): the rest
    of (11.6) holds for every such Q once rho is large. Such a Q exists iff X^T Y is symmetric and semidefinite and has
    the rank of X and of Y. The substitution x = e^{rho t} x', u = e^{rho t} u' keeps complementarity, so that what
    passivity says of existence, uniqueness and jumps holds for the system itself, whatever A is.

    Notes
    -----
    Cost: a few eliminations of order k. Source: Camlibel, Heemels and Schumacher 2002, passifiability by pole shifting.

    Examples
    --------
    C = B^T and D = 0, with B of any rank and any A; and B with the other sign:

    >>> from pricing_core.lcs import LCS
    >>> from pricing_core.lcs.rational_system import rational_system
    >>> B = [[1, 2], [2, 4]]
    >>> is_passive_after_pole_shift(rational_system(LCS([[5, 0], [1, 7]], B, [[1, 2], [2, 4]])))
    True
    >>> is_passive_after_pole_shift(rational_system(LCS([[5]], [[-1]], [[1]])))
    False
    """
    resistance = system.D + system.D.T
    if negative_vector(resistance) is not None:
        return False
    kernel = exact_kernel(resistance)
    X, Y = exact_product(system.B, kernel), exact_product(system.C.T, kernel)
    product = exact_product(X.T, Y)
    if (product != product.T).any() or negative_vector(product) is not None:
        return False
    return exact_rank(product) == exact_rank(X) == exact_rank(Y)
