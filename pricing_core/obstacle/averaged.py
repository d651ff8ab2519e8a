"""The averaged complementarity function: 0 <= u _|_ V - g >= 0 seen at the resolution of the grid.

The compact scheme's row is the equation integrated against the hat function of its node, so that what it needs of the
multiplier is its mass under the hat. Next to a contact set V - g leaves the obstacle as a parabola, V - g = b z / 2
with b = c / D, where c is the multiplier inside the contact set and sqrt(z) the distance of its end in cells. The mass
is then c (1 - sqrt z)^2 / 2 for z < 1, and 0 from there on; with the node inside the contact set, V = g, it is c/2 or
more. Both are functions of one number s = sqrt(z), once continuously differentiable:

    V - g = b (0, s^2 / 2, s - 1/2),   mass = c (1/2 - s, (1 - s)^2 / 2, 0)   for s <= 0, 0 < s < 1, 1 <= s,

so that Newton's method on s needs no list of pinned nodes. Where an obstacle's kink may hold V in a point, and where
two obstacles are nearer to each other than the parabolas reach, the right angle itself takes its place:

    V = clip(s, lower, upper),   mass = (V - s) omega.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pricing_core.arrays import BoolVector, Vector


@dataclass(frozen=True, slots=True, eq=False)
class Contact:
    """The obstacles at the inner nodes at one time, shape (n,) each.

    Parameters
    ----------
    lower, upper : Vector
        Their values; infinite where there is none.
    lower_mass, upper_mass : Vector
        c of either, 0 where it cannot be in contact.
    diffusion : Vector
        D at the nodes, in cells^2 a year.
    right_angle : BoolVector
        Where the right angle takes the place of the averaged function.
    """

    lower: Vector
    upper: Vector
    lower_mass: Vector
    upper_mass: Vector
    diffusion: Vector
    right_angle: BoolVector

    @property
    def is_two_sided(self) -> bool:
        """Whether a node may touch either obstacle, each with its averaged function."""
        return bool((~self.right_angle & (self.lower_mass > 0.0) & (self.upper_mass > 0.0)).any())

    def touching(self, V: Vector, nodes: Any = slice(None)) -> tuple[Any, Any]:
        """Return whether the `nodes`, one or all of them, touch the lower and the upper obstacle, where they may."""
        right_angle = self.right_angle[nodes]
        at_lower = (self.lower[nodes] >= V[nodes]) & (right_angle | (self.lower_mass[nodes] > 0.0))
        at_upper = (self.upper[nodes] <= V[nodes]) & (right_angle | (self.upper_mass[nodes] > 0.0))
        return at_lower, at_upper

    def side(self, V: Vector, omega: Vector) -> Side:
        """Return which of the obstacles each node may touch, the nearer one to V where it may touch both.

        Parameters
        ----------
        V, omega : Vector, shape (n,)
            Values, and the scale of the right angle, above 0.
        """
        down = self.lower_mass > 0.0
        if self.upper_mass.any():
            both = down & (self.upper_mass > 0.0)
            with np.errstate(invalid="ignore"):
                down = np.where(both, V - self.lower <= self.upper - V, down)
        averaged = ~self.right_angle & (down | (self.upper_mass > 0.0))
        c = np.where(averaged, np.where(down, self.lower_mass, -self.upper_mass), 0.0)
        obstacle = np.where(averaged, np.where(down, self.lower, self.upper), 0.5)
        bend = np.where(averaged, c / self.diffusion, 1.0)
        nodes = np.flatnonzero(self.right_angle)
        return Side(
            averaged,
            obstacle,
            bend,
            c,
            np.where(averaged, 0.0, 1.0),
            np.where(averaged, 0.0, -np.inf),
            nodes,
            self.lower[nodes],
            self.upper[nodes],
            omega[nodes],
        )


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """One obstacle for each node: V and the mass of u - w as functions of s, shape (n,) each.

    Parameters
    ----------
    averaged : BoolVector
        Where the averaged function holds.
    obstacle, bend, c : Vector
        g, and b and c with the sign of the obstacle, below 0 for an upper one; 1/2, 1 and 0 elsewhere, so that
        V = s there.
    floor, least : Vector
        0 where the averaged function holds; 1 and -inf elsewhere, where s is not bent.
    right_angle : IntVector
        The nodes of the right angle.
    low, high, omega : Vector
        Its bounds and its scale at these nodes.
    """

    averaged: BoolVector
    obstacle: Vector
    bend: Vector
    c: Vector
    floor: Vector
    least: Vector
    right_angle: NDArray[np.intp]
    low: Vector
    high: Vector
    omega: Vector

    def at(self, s: Vector) -> Point:
        """Return V and the mass of u - w, with their derivatives by s."""
        inside = np.maximum(np.minimum(s, 1.0), self.floor)
        beyond, short = s - inside, 1.0 - inside
        further = np.maximum(beyond, self.least)
        slope, change = self.bend * inside, -self.c * short
        value = self.obstacle + (0.5 * slope * inside + self.bend * further)
        mass = self.c * (further - beyond) - 0.5 * change * short
        if self.right_angle.size:
            nodes = self.right_angle
            plain = np.clip(s[nodes], self.low, self.high)
            value[nodes] = plain
            mass[nodes] = (plain - s[nodes]) * self.omega
            slope[nodes] = inside[nodes] = is_free = plain == s[nodes]
            change[nodes] = np.where(is_free, 0.0, -self.omega)
        return Point(value, mass, slope, change, inside)

    def parameter(self, V: Vector, mass: Vector) -> Vector:
        """Return s of a value and a mass that need not belong together: the value decides off the obstacle."""
        height = 2.0 * (V - self.obstacle) / self.bend
        root = np.sqrt(np.minimum(np.maximum(height, 0.0), 1.0))
        touching = 0.5 - np.maximum(mass / np.where(self.averaged, self.c, 1.0), 0.5)
        near = np.where(height > 0.0, root, touching)
        s = np.where(self.averaged & (height < 1.0), near, 0.5 * (height + 1.0))
        nodes = self.right_angle
        if nodes.size:
            s[nodes] = np.clip(V[nodes], self.low, self.high) - mass[nodes] / self.omega
        return s


class Point(NamedTuple):
    """V and the mass of u - w at some s, and their derivatives, shape (n,) each.

    The last is the distance of the contact set's end from each node, in cells: 0 in contact, 1 where it is further off.
    """

    value: Vector
    mass: Vector
    slope: Vector
    change: Vector
    distance: Vector
