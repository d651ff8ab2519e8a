"""Diagonally implicit Runge-Kutta methods as data; every one ends on its last stage (stiffly accurate)."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Tableau:
    """Y_i = y + h sum_{j <= i} a_ij F(t + c_i h, Y_j), and y+ is the last of them.

    Parameters
    ----------
    a : tuple of tuple of float
        Row i holds a_i1 ... a_ii. Where a_11 = 0 the first stage is y itself, whose rate is known.
    order : int
        Order for smooth solutions.
    """

    a: tuple[tuple[float, ...], ...]
    order: int

    @property
    def c(self) -> tuple[float, ...]:
        """The times of the stages as fractions of the step."""
        return tuple(math.fsum(row) for row in self.a)

    @property
    def has_explicit_start(self) -> bool:
        """Whether the first stage is the state at the beginning."""
        return self.a[0] == (0.0,)


def theta_method(theta: float) -> Tableau:
    """Return y+ = y + (1 - theta) h F(y) + theta h F(y+): Crank-Nicolson, or the trapezoidal rule, for theta = 1/2.

    Stable for theta >= 1/2; only theta = 1 damps the fastest components.
    """
    return Tableau(((0.0,), (1.0 - theta, theta)), 2 if theta == 0.5 else 1)


# Order 1, L-stable; a state off the constraints is carried onto them.
IMPLICIT_EULER = Tableau(((1.0,),), 1)

_THETA = 1.0 - math.sqrt(0.5)
# Alexander 1977, two stages: L-stable.
SDIRK2 = Tableau(((_THETA,), (1.0 - _THETA, _THETA)), 2)

_GAMMA = 0.43586652150845899942  # the root of x^3 - 3 x^2 + 3/2 x - 1/6 between 1/6 and 1/2
# Alexander 1977, three stages: L-stable.
SDIRK3 = Tableau(
    (
        (_GAMMA,),
        ((1.0 - _GAMMA) / 2.0, _GAMMA),
        (
            -1.5 * _GAMMA * _GAMMA + 4.0 * _GAMMA - 0.25,
            1.5 * _GAMMA * _GAMMA - 5.0 * _GAMMA + 1.25,
            _GAMMA,
        ),
    ),
    3,
)

_G3 = 1767732205903 / 4055673282236
# Kennedy and Carpenter 2016, ESDIRK3(2)4L[2]SA: stage order 2, L-stable.
ESDIRK3 = Tableau(
    (
        (0.0,),
        (_G3, _G3),
        (2746238789719 / 10658868560708, -640167445237 / 6845629431997, _G3),
        (
            1471266399579 / 7840856788654,
            -4482444167858 / 7529755066697,
            11266239266428 / 11593286722821,
            _G3,
        ),
    ),
    3,
)
