"""The discretised problem at one time between two events: coefficients, contact sets and ends at the nodes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np

from pricing_core.arrays import BoolVector, Matrix, Vector
from pricing_core.errors import InvalidInputError, Told
from pricing_core.obstacle.averaged import Contact
from pricing_core.obstacle.compact import CompactScheme
from pricing_core.obstacle.ends import End, Held, ratio
from pricing_core.obstacle.grid import Grid
from pricing_core.obstacle.obstacle import Obstacle
from pricing_core.obstacle.problem import ObstacleProblem

# Differences of the obstacles, whose functions are exact: their steps in cells and as a part of the segment.
PLACE_STEP, TIME_STEP = 0.25, 1e-5
Complementarity: TypeAlias = Literal["averaged", "right-angle"]
ON_NODE = 1e-6  # cells from a node at which a kink counts as lying on it
ROUNDING = (
    1e-12  # of the values' size: what rounding may make of equal obstacles, and of a slope that does not jump
)
DIFFERENCE_ROUNDING = 1e-15  # of the values' size: what rounding may make of a second difference


@dataclass(frozen=True, slots=True)
class EndRule:
    """V_0 = value + first V_1 + second V_2, counted from the end inwards."""

    value: float
    first: float
    second: float


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """The equation at one time.

    Parameters
    ----------
    scheme : CompactScheme
    rate, source : Vector, shape (n,)
    contact : Contact
        At the inner nodes.
    left, right : EndRule
    lower_ends, upper_ends : Vector, shape (2,)
        The obstacles at the two ends, infinite where there is none.
    """

    scheme: CompactScheme
    rate: Vector
    source: Vector
    contact: Contact
    left: EndRule
    right: EndRule
    lower_ends: Vector
    upper_ends: Vector

    def without_ends(self, bands: Matrix) -> tuple[Vector, Vector, Vector, float, float]:
        """Return (lower, diagonal, upper) of bands (3, n) at the inner nodes with the ends eliminated by their rules.

        The last two are what multiplies the values that are held at the left and at the right end.
        """
        lower, diagonal, upper = (band[1:-1].copy() for band in bands)
        diagonal[0] += lower[0] * self.left.first
        upper[0] += lower[0] * self.left.second
        diagonal[-1] += upper[-1] * self.right.first
        lower[-1] += upper[-1] * self.right.second
        return lower[1:], diagonal, upper[:-1], float(lower[0]), float(upper[-1])

    def with_ends(self, V: Vector) -> Vector:
        """Return the values at all nodes, shape (n,), from those at the inner ones."""
        whole = np.empty(V.size + 2)
        whole[1:-1] = V
        for rule, end, first, second in ((self.left, 0, 0, 1), (self.right, -1, -1, -2)):
            low, high = self.lower_ends[end], self.upper_ends[end]
            value = rule.value + rule.first * V[first] + rule.second * V[second]
            at_lower, at_upper = self.contact.touching(V, first)
            if at_lower:
                value = low
            elif at_upper:
                value = high
            whole[end] = min(max(value, low), high)
        return whole


@dataclass(slots=True, eq=False)
class Segment:
    """An interval of time in which nothing happens, on one grid.

    Parameters
    ----------
    problem : ObstacleProblem
    grid : Grid
    start, end : float
        Years from now.
    complementarity : {"averaged", "right-angle"}
        The averaged function; or at every node the right angle 0 <= u _|_ V - lower >= 0 itself, as in (11.65).
    off_nodes : float
        What may be missed where a kink that can hold V lies between nodes: the jump of its slope times the cell, money.
    """

    problem: ObstacleProblem
    grid: Grid
    start: float
    end: float
    complementarity: Complementarity = "averaged"
    acting: tuple[Obstacle | None, Obstacle | None] = field(init=False)
    off_nodes: float = field(init=False, default=0.0)
    _known: Moment | None = field(init=False, default=None)
    _known_kinks: dict[float, tuple[BoolVector, BoolVector]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        lower, upper = (
            obstacle if obstacle is not None and obstacle.acts_between(self.start, self.end) else None
            for obstacle in self.problem.obstacles
        )
        self.acting = lower, upper

    @property
    def duration(self) -> float:
        """Its length in years."""
        return self.end - self.start

    @property
    def is_constant(self) -> bool:
        """Whether all of its moments are the same."""
        problem = self.problem
        held = (end for end in problem.ends if isinstance(end, Held))
        return (
            problem.diffusion.is_constant
            and not problem.source_function.has_t
            and all(obstacle is None or obstacle.is_constant for obstacle in self.acting)
            and not any(end.functions[0].has_t for end in held)
        )

    def at(self, t: float) -> Moment:
        """Return the equation at the time t."""
        if self._known is not None:
            return self._known
        moment = self._moment(t)
        if self.is_constant:
            self._known = moment
        return moment

    def transport(self, t: float) -> tuple[Vector, Vector]:
        """Return D and the drift at the nodes at the time t, in cells^2 and in cells a year.

        Raises
        ------
        InvalidInputError
            The volatility is not above 0 somewhere.
        """
        return self._in_cells(*self._diffusion_and_drift(t))

    def _diffusion_and_drift(self, t: float) -> tuple[Vector, Vector]:
        """Return volatility^2/2 and the drift at the nodes, per year."""
        x = self.grid.x
        volatility, drift = (function(x, t) for function in self.problem.diffusion.functions[:2])
        if not (volatility > 0.0).all():
            first = int(np.argmin(volatility))
            place = Told(f"{volatility[first]:g} at x = {x[first]:.6g}, t = {t:.6g}")
            raise InvalidInputError("volatility", place, "above 0 at every x and t")
        return 0.5 * volatility * volatility, drift

    def _in_cells(self, diffusion: Vector, drift: Vector) -> tuple[Vector, Vector]:
        slope = self.grid.slope
        return diffusion / slope**2, drift / slope - diffusion * self.grid.bend / slope**3

    def _moment(self, t: float) -> Moment:
        x = self.grid.x
        diffusion, drift = self._diffusion_and_drift(t)
        rate, source = self.problem.diffusion.functions[2](x, t), self.problem.source_function(x, t)
        scheme = CompactScheme.of(*self._in_cells(diffusion, drift))
        coefficients = diffusion, drift, rate, source
        contact, low_ends, high_ends = self._contact(t, scheme.diffusion, coefficients)
        left = _end_rule(self.problem.ends[0], x[:3], t, low_ends[0], high_ends[0])
        right = _end_rule(self.problem.ends[1], x[:-4:-1], t, low_ends[1], high_ends[1])
        return Moment(scheme, rate, source, contact, left, right, low_ends, high_ends)

    def _contact(
        self, t: float, diffusion: Vector, coefficients: tuple[Vector, ...]
    ) -> tuple[Contact, Vector, Vector]:
        """Return the obstacles at the inner nodes and at the ends."""
        n = self.grid.x.size
        values = [np.full(n, -np.inf), np.full(n, np.inf)]
        masses, holds = [np.zeros(n), np.zeros(n)], np.zeros(n, dtype=bool)
        for k, (obstacle, sign) in enumerate(zip(self.acting, (1.0, -1.0), strict=True)):
            if obstacle is not None:
                values[k] = obstacle(self.grid.x, t)
                income, size = self._income(obstacle, t, coefficients)
                at_kinks, holding = self._kinks_once(obstacle, sign, t)
                masses[k] = np.where(at_kinks | (-sign * income <= size), 0.0, -sign * income)
                holds |= holding
        lower, upper = values
        scale = check_order(self.grid.x, lower, upper)
        upper = np.maximum(lower, upper)
        holds |= upper - lower <= scale + (masses[0] + masses[1]) / (2.0 * diffusion)
        if self.complementarity == "right-angle":
            masses = [np.zeros(n), np.zeros(n)]
            holds = np.isfinite(lower) | np.isfinite(upper)
        inner = slice(1, -1)
        contact = Contact(
            lower[inner], upper[inner], masses[0][inner], masses[1][inner], diffusion[inner], holds[inner]
        )
        return contact, lower[[0, -1]], upper[[0, -1]]

    def _income(
        self, obstacle: Obstacle, t: float, coefficients: tuple[Vector, ...]
    ) -> tuple[Vector, Vector]:
        """Return g_t + L g + f at the nodes, what holding earns more than g in money a year, and what counts as 0."""
        diffusion, drift, rate, source = coefficients
        x, step = self.grid.x, PLACE_STEP * self.grid.slope
        centre = x.copy()
        for kink in obstacle.kinks_at(t):  # differences stay on their side of a kink
            gap = x - kink
            centre = np.where((gap >= 0.0) & (gap < step), np.maximum(centre, kink + step), centre)
            centre = np.where((gap < 0.0) & (-gap < step), np.minimum(centre, kink - step), centre)
        centre = np.clip(centre, x[0] + step, x[-1] - step)  # nor do they leave the interval
        n = x.size
        around = obstacle(np.concatenate([centre - step, centre, centre + step, x]), t)
        before, at, after, value = (around[k * n : (k + 1) * n] for k in range(4))
        second = (before - 2.0 * at + after) / step**2
        first = (after - before) / (2.0 * step) + (x - centre) * second
        income = diffusion * second + drift * first - rate * value + source
        if obstacle.function.has_t:
            change = TIME_STEP * self.duration
            early, late = max(t - change, self.start), min(t + change, np.nextafter(self.end, self.start))
            income = income + (obstacle(x, late) - obstacle(x, early)) / (late - early)
        size = ROUNDING * (np.abs(drift * first) + np.abs(rate * value) + np.abs(source))
        size += DIFFERENCE_ROUNDING * diffusion * np.abs(value) / step**2
        return income, size

    def _kinks_once(self, obstacle: Obstacle, sign: float, t: float) -> tuple[BoolVector, BoolVector]:
        """Return what `_kinks` does, looked for once where the obstacle does not change."""
        if not obstacle.is_constant:
            return self._kinks(obstacle, sign, t)
        if sign not in self._known_kinks:
            self._known_kinks[sign] = self._kinks(obstacle, sign, t)
        return self._known_kinks[sign]

    def _kinks(self, obstacle: Obstacle, sign: float, t: float) -> tuple[BoolVector, BoolVector]:
        """Return which nodes lie on a kink, and which next to one that can hold V in a point, or on it.

        Where no node lies on such a kink, as on one that moves, the two next to it have the right angle, which is of
        first order.
        """
        on_kink, holding = (np.zeros(self.grid.x.size, dtype=bool) for _ in range(2))
        for kink in obstacle.kinks_at(t):
            index = float(self.grid.index(np.array([kink]))[0])
            node = round(index)
            if not 0 < node < self.grid.x.size - 1:
                continue
            is_on = abs(index - node) < ON_NODE
            on_kink[node] |= is_on
            width = float(self.grid.slope[node])
            jump = holding_jump(obstacle, sign, kink, width, t)
            if jump > 0.0:
                holding[[node] if is_on else [math.floor(index), math.ceil(index)]] = True
            if not is_on:
                self.off_nodes = max(self.off_nodes, jump * width)
        return on_kink, holding


def check_order(x: Vector, lower: Vector, upper: Vector) -> Vector:
    """Refuse a lower obstacle above an upper one; return what rounding may make of equal ones, shape (n,)."""
    largest = np.maximum(*(np.abs(np.where(np.isfinite(v), v, 0.0)) for v in (lower, upper)))
    scale: Vector = ROUNDING * np.maximum(1.0, largest)
    if (lower > upper + scale).any():
        first = int(np.argmax(lower - upper))
        place = Told(f"{lower[first]:g} at x = {x[first]:.6g}")
        raise InvalidInputError("lower", place, f"at most upper, {upper[first]:g} there")
    return scale


def holding_jump(obstacle: Obstacle, sign: float, kink: float, width: float, t: float) -> float:
    """Return by how much the slope falls at a kink of a lower obstacle (sign 1), or rises at one of an upper (-1).

    It is 0 where the kink cannot hold V in a point.
    """
    step = PLACE_STEP * width
    g = obstacle(kink + step * np.arange(-2.0, 3.0), t)
    slope_before = (3.0 * g[2] - 4.0 * g[1] + g[0]) / (2.0 * step)
    slope_after = (-3.0 * g[2] + 4.0 * g[3] - g[4]) / (2.0 * step)
    size = float(np.abs(g).max()) / step
    jump = float(sign * (slope_before - slope_after))
    return jump if jump > ROUNDING * size else 0.0


def _end_rule(end: End | float, x: Vector, t: float, low: float, high: float) -> EndRule:
    """Return the rule of an end, x from there inwards; a value that is held lies between the obstacles."""
    if isinstance(end, Held):
        return EndRule(min(max(end.at(t), low), high), 0.0, 0.0)
    q = ratio(end, x)  # type: ignore[arg-type]  # a number has become Held
    return EndRule(0.0, 1.0 + q, -q)
