"""Named linear complementarity systems from the literature, with integer or rational data."""

from fractions import Fraction

from pricing_core.lcs import LCS


def two_carts() -> LCS:
    """Two carts with inelastic stops at x1 = 0 and x1 = x2 (Schumacher, example 11.3), state (x1, x2, v1, v2)."""
    A = [[0, 0, 1, 0], [0, 0, 0, 1], [-2, 1, 0, 0], [1, -1, 0, 0]]
    return LCS(A, [[0, 0], [0, 0], [1, 1], [0, -1]], [[1, 0, 0, 0], [1, -1, 0, 0]])


def bridge(L=Fraction(1, 100), C=Fraction(1, 10**6), R=1000) -> LCS:
    """Diode bridge that feeds a resistor from an LC oscillator (an example of the Siconos project)."""
    return LCS(
        [[0, -1 / Fraction(C)], [1 / Fraction(L), 0]],
        [[0, 0, -1 / Fraction(C), 1 / Fraction(C)], [0, 0, 0, 0]],
        [[0, 0], [0, 0], [-1, 0], [1, 0]],
        [
            [1 / Fraction(R), 1 / Fraction(R), -1, 0],
            [1 / Fraction(R), 1 / Fraction(R), 0, -1],
            [1, 0, 0, 0],
            [0, 1, 0, 0],
        ],
    )


def filtered_bridge(L=Fraction(1, 100), C=Fraction(1, 10**6), R=1000, Cf=Fraction(3, 10**7)) -> LCS:
    """The bridge with a capacitor beside its resistor (an example of the Siconos project)."""
    L, C, R, Cf = (Fraction(value) for value in (L, C, R, Cf))
    return LCS(
        [[0, -1 / C, 0], [1 / L, 0, 0], [0, 0, -1 / (R * Cf)]],
        [[0, 0, -1 / C, 1 / C], [0, 0, 0, 0], [1 / Cf, 0, 1 / Cf, 0]],
        [[0, 0, 1], [0, 0, 0], [-1, 0, 1], [1, 0, 0]],
        [[0, -1, 0, 0], [1, 0, 1, -1], [0, -1, 0, 0], [0, 1, 0, 0]],
    )


def integrators(degree: int) -> LCS:
    """y = x1, x_degree' = u: G = 1 / s**degree."""
    A = [[int(j == i + 1) for j in range(degree)] for i in range(degree)]
    return LCS(A, [[int(i == degree - 1)] for i in range(degree)], [[int(j == 0) for j in range(degree)]])


def two_integrators(B) -> LCS:
    """x' = B u, y = x."""
    return LCS([[0, 0], [0, 0]], B, [[1, 0], [0, 1]])


def coupled_integrators() -> LCS:
    """G = [[1/s, 1/s**2], [0, 1/s]]."""
    return LCS([[0, 1], [0, 0]], [[1, 0], [0, 1]], [[1, 0], [0, 1]])


def oscillator(sign: int = 1) -> LCS:
    """G = sign s / (s**2 + 1)."""
    return LCS([[0, 1], [-1, 0]], [[0], [sign]], [[0, 1]])


def random_system(rng, n: int, k: int, *, feedthrough: bool = False) -> LCS:
    """Integer entries from -3 to 3."""
    return LCS(
        rng.integers(-3, 4, (n, n)),
        rng.integers(-3, 4, (n, k)),
        rng.integers(-3, 4, (k, n)),
        rng.integers(-3, 4, (k, k)) if feedthrough else None,
    )
