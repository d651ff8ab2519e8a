"""The zero of a function of one variable between two points where its signs differ."""

from __future__ import annotations

from collections.abc import Callable

MOST_STEPS = 60
CLOSE = 1e-13


def find_root(function: Callable[[float], float], a: float, b: float, close: float = CLOSE) -> float:
    """Return a zero between a and b by the Illinois variant of false position, to `close` (relative to 1 + |x|)."""
    f_a, f_b = function(a), function(b)
    if f_a == 0.0:
        return a
    for _ in range(MOST_STEPS):
        if abs(b - a) <= close * (1.0 + abs(b)) or f_b in (0.0, f_a):
            break
        x = b - f_b * (b - a) / (f_b - f_a)
        if not min(a, b) < x < max(a, b):
            x = 0.5 * (a + b)
        f_x = function(x)
        if (f_x < 0.0) != (f_b < 0.0):
            a, f_a = b, f_b
        else:
            f_a *= 0.5
        b, f_b = x, f_x
    return b
