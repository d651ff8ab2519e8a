"""The exercise boundary on a stretch: a polynomial in the root of time that meets smooth pasting at every stage."""

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy.special import ndtr, ndtri

from pricing_core.arrays import Matrix, Vector
from pricing_core.collocation_twin.multiplier import Source, source
from pricing_core.collocation_twin.profile import Profile, propagate
from pricing_core.collocation_twin.stretch import Stretch
from pricing_core.collocation_twin.tables import Table, interpolation, table
from pricing_core.roots import find_root

Form: TypeAlias = Literal["plain", "tail", "shifted"]
LADDER = (3, 6, 10, 16)  # degrees solved before the one that is asked for
MOST_ITERATIONS = 40
MOST_STEPS = 200  # of a search
LEAST_STEP = 0.01
SETTLED = 1e-6  # of the coefficients; Newton's method doubles the digits once more
COARSELY_SETTLED = 1e-4
RESIDUAL = 1e-9  # of the slope, or of the value
SMALLEST_SHARE = 1e-12  # of a tail


@dataclass(frozen=True, slots=True)
class Start:
    """How the contact set begins.

    Parameters
    ----------
    form : {"plain", "tail", "shifted"}
        What is a polynomial in eta = sqrt((s - time)/(duration - time)): the boundary b; the share
        N((b - centre)/scale), where the boundary comes from far away and the value without exercise fades towards the
        payoff like a normal tail; b less the place where the value without exercise is the payoff.
    time, place : float
        When, s, and where, x.
    centre, scale : float
        Of the tail.
    """

    form: Form
    time: float
    place: float
    centre: float = 0.0
    scale: float = 1.0


@dataclass(frozen=True, slots=True)
class Boundary:
    """The end of the contact set at every time of a stretch since it began, and what its multiplier is worth."""

    stretch: Stretch
    start: Start
    nodes: Table  # those of the value
    coefficients: Vector  # (m + 1,)
    shift: Vector  # (n,): of those nodes
    residual: float
    profile: Profile

    @property
    def span(self) -> float:
        """Years since the contact set began."""
        return self.stretch.duration - self.start.time

    @property
    def last(self) -> float:
        """The boundary at the stretch's beginning."""
        return self.at(self.stretch.duration)

    def at(self, s: float) -> float:
        """Return the boundary at time s to the stretch's end, NaN before the contact set began."""
        if s < self.start.time:
            return math.nan
        eta = math.sqrt(min((s - self.start.time) / self.span, 1.0))
        if eta == 0.0:
            return self.start.place
        coefficient = interpolation(self.nodes.eta, np.array([eta])) @ self.coefficients
        shift = _shifts(self.profile, self.stretch, self.start, np.array([s]))
        return float(_places(self.start, self.stretch.sign, coefficient, shift)[0])

    def contribution(self, x: Vector) -> Matrix:
        """Return value, slope and second derivative of the multiplier's part at x, at the beginning, shape (3, n)."""
        nodes = self.nodes
        boundary = _places(self.start, self.stretch.sign, nodes.at_end @ self.coefficients, self.shift)
        age = self.span * nodes.cosine**2
        parts = source(self.stretch.sign, self.stretch.flow, x[:, None], boundary, age)
        weight = self.span * nodes.weight
        return np.stack([parts.value @ weight, parts.by_x @ weight, parts.by_xx @ weight])


def _places(start: Start, sign: float, coefficients: Vector, shift: Vector) -> Vector:
    if start.form == "tail":
        share = np.clip(coefficients, SMALLEST_SHARE, 1.0 - SMALLEST_SHARE)
        return np.asarray(start.centre + sign * start.scale * ndtri(share))
    return coefficients + shift


def _turns(start: Start, sign: float, coefficients: Vector) -> Vector:
    """Return the derivative of the place by the coefficient."""
    if start.form != "tail":
        return np.ones(coefficients.shape)
    quantile = ndtri(np.clip(coefficients, SMALLEST_SHARE, 1.0 - SMALLEST_SHARE))
    return np.asarray(sign * start.scale * math.sqrt(2.0 * math.pi) * np.exp(0.5 * quantile**2))


def _shifts(profile: Profile, stretch: Stretch, start: Start, times: Matrix) -> Matrix:
    """Return where the value without exercise is the payoff at each time; zeros unless the form is "shifted"."""
    shifts = np.zeros(times.shape)
    if start.form != "shifted":
        return shifts
    for index, s in np.ndenumerate(times):
        shifts[index] = (
            start.place
            if s <= start.time * (1.0 + 1e-12)
            else touching_point(profile, stretch, start.place, s)
        )
    return shifts


def touching_point(profile: Profile, stretch: Stretch, place: float, s: float) -> float:
    """Return where the value without exercise, below the payoff at `place`, meets it at time s."""

    def above(x: float) -> float:
        return float(propagate(profile, stretch.flow, np.array([x]), s)[0, 0]) - stretch.payoff(x, s)

    step = (
        stretch.sign * stretch.flow.volatility * math.sqrt(s)
    )  # panels are fine enough for it next to the place
    inside = place
    for _ in range(MOST_STEPS):
        if above(inside) <= 0.0:
            break
        inside -= step
    outside = inside + step
    for _ in range(MOST_STEPS):
        if above(outside) >= 0.0:
            break
        inside, outside = outside, outside + step
    return find_root(above, inside, outside)


@dataclass(frozen=True, slots=True)
class _System:
    """The equations of one degree."""

    profile: Profile
    stretch: Stretch
    start: Start
    nodes: Table
    times: Vector  # (m,): s at the stages
    stage_shift: Vector  # (m,)
    node_shift: Matrix  # (m, n)

    def residual(self, coefficients: Vector) -> tuple[Vector, Matrix]:
        """Return (m,) residuals and (m, m) derivatives by the coefficients behind the first."""
        stretch, start = self.stretch, self.start
        places = _places(start, stretch.sign, coefficients[1:], self.stage_shift)
        turns = _turns(start, stretch.sign, coefficients[1:])
        count = places.size
        residual, jacobian = np.empty(count), np.empty((count, count))
        for k in range(count):
            x, span = places[k], self.times[k] - start.time
            rows = self.nodes.at_nodes[k]
            behind = rows @ coefficients
            boundary = _places(start, stretch.sign, behind, self.node_shift[k])
            parts = source(stretch.sign, stretch.flow, x, boundary, span * self.nodes.cosine**2)
            weight = span * self.nodes.weight
            held = propagate(self.profile, stretch.flow, np.array([x]), self.times[k])[:, 0]
            residual[k], by_place, by_boundary = self._equation(k, x, held, parts, weight)
            jacobian[k] = ((by_boundary * weight * _turns(start, stretch.sign, behind)) @ rows)[1:]
            jacobian[k, k] += by_place * turns[k]
        return residual, jacobian

    def _equation(
        self, k: int, x: float, held: Vector, parts: Source, weight: Vector
    ) -> tuple[float, float, Vector]:
        """Return V - g or its slope at the boundary of stage k, with its derivatives by x and by the boundary before.

        The slope, a Volterra equation of the second kind for the boundary, is the better equation; where the contact
        set spreads faster than diffusion follows, the slope jumps in a layer that the integrals do not see, and V - g
        is taken.
        """
        value = held[0] + float(parts.value @ weight) - self.stretch.payoff(x, self.times[k])
        slope = held[1] + float(parts.by_x @ weight) + self.stretch.sign * math.exp(x)
        if self.start.form == "shifted":
            return value, slope, parts.by_boundary
        bend = held[2] + float(parts.by_xx @ weight) + self.stretch.sign * math.exp(x)
        return slope, bend, parts.by_boundary_x


def solve_boundary(
    profile: Profile, stretch: Stretch, start: Start, degree: int, points: int, value_points: int
) -> Boundary:
    """Return the boundary of the contact set that begins as told; its residual says whether it was found.

    Parameters
    ----------
    degree, points : int
        Of the polynomial, and nodes of every integral.
    value_points : int
        Nodes of the integral for the value.
    """
    known: tuple[Vector, Table] | None = None
    for m in (*(k for k in LADDER if k < degree), degree):
        nodes = table(m, points if m == degree else m + 3)
        system = _system(profile, stretch, start, nodes)
        if known is None:
            coefficients = _guess(system)
        else:
            coefficients = interpolation(known[1].eta, nodes.eta) @ known[0]
            coefficients[0] = _first(start, stretch.sign)
        coefficients, residual = _newton(system, coefficients, SETTLED if m == degree else COARSELY_SETTLED)
        known = coefficients, nodes
    ends = table(degree, value_points)
    times = start.time + (stretch.duration - start.time) * ends.sine**2
    return Boundary(
        stretch, start, ends, coefficients, _shifts(profile, stretch, start, times), residual, profile
    )


def _system(profile: Profile, stretch: Stretch, start: Start, nodes: Table) -> _System:
    span = stretch.duration - start.time
    times = start.time + span * nodes.eta[1:] ** 2
    stage_shift = _shifts(profile, stretch, start, times)
    node_times = start.time + span * (nodes.eta[1:, None] * nodes.sine) ** 2
    return _System(
        profile, stretch, start, nodes, times, stage_shift, _shifts(profile, stretch, start, node_times)
    )


def _first(start: Start, sign: float) -> float:
    if start.form == "tail":
        return float(ndtr(sign * (start.place - start.centre) / start.scale))
    return start.place if start.form == "plain" else 0.0


def _guess(system: _System) -> Vector:
    stretch, start, nodes = system.stretch, system.start, system.nodes
    coefficients = np.full(nodes.eta.size, _first(start, stretch.sign))
    if start.form == "plain":
        spread = stretch.flow.volatility * math.sqrt(stretch.duration - start.time)
        step = 0.0 if stretch.is_continuous and stretch.exercise_at_end and system.profile.nodes.size else 0.8
        coefficients -= stretch.sign * step * spread * nodes.eta
    elif start.form == "tail":
        for k, s in enumerate(system.times):
            touching = touching_point(system.profile, stretch, start.place, float(s))
            coefficients[k + 1] = ndtr(stretch.sign * (touching - start.centre) / start.scale)
    return coefficients


def _newton(system: _System, coefficients: Vector, settled: float) -> tuple[Vector, float]:
    """Return the zero of the residual and what is left of it, by Newton's method with halved steps."""
    residual, jacobian = system.residual(coefficients)
    for _ in range(MOST_ITERATIONS):
        diagonal = np.diag(jacobian)
        lift = 1e-12 * np.max(np.abs(diagonal)) + 1e-300
        lifted = jacobian + np.diag(np.where(diagonal < 0.0, -lift, lift))
        step = np.asarray(np.linalg.solve(lifted, -residual), dtype=np.float64)
        length = _longest_step(system, coefficients, step)
        small = np.max(np.abs(step)) <= settled
        norm = np.max(np.abs(residual))
        while True:
            trial = coefficients.copy()
            trial[1:] += length * step
            if system.start.form == "tail":
                trial[1:] = np.clip(trial[1:], 1e-10, 1.0 - 1e-10)
            residual, jacobian = system.residual(trial)
            left = float(np.max(np.abs(residual)))
            if left <= (1.0 - 0.2 * length) * norm or length < LEAST_STEP or small or left < 1e-14:
                break
            length *= 0.5
        coefficients = trial
        if small or not math.isfinite(left):
            break
    return coefficients, float(np.max(np.abs(residual)))


def _longest_step(system: _System, coefficients: Vector, step: Vector) -> float:
    """Return the share of the step that moves the boundary by no more than half a spread."""
    turns = np.abs(_turns(system.start, system.stretch.sign, np.clip(coefficients[1:], 1e-9, 1.0 - 1e-9)))
    if system.start.form != "tail":
        turns = np.ones(step.size)
    furthest = float(np.max(np.abs(turns * step)))
    spread = system.stretch.flow.volatility * math.sqrt(system.stretch.duration)
    return min(1.0, spread / furthest) if furthest > 0.0 else 1.0
