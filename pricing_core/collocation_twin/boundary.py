"""The exercise boundary on a stretch: a polynomial in the root of time that meets smooth pasting at every stage."""

import math
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np
from scipy.special import ndtr, ndtri

from pricing_core.arrays import Matrix, Vector
from pricing_core.collocation_twin.multiplier import Source, source
from pricing_core.collocation_twin.profile import Profile, propagate
from pricing_core.collocation_twin.stretch import Stretch
from pricing_core.collocation_twin.tables import Table, interpolation, table
from pricing_core.collocation_twin.touching import Touching, search_touching, touching_before

Form: TypeAlias = Literal["plain", "root", "tail", "shifted"]
MOST_ITERATIONS = 40
LEAST_STEP = 0.01
CAUTION = 10.0  # a full step leaves so many times what the one before it lets expect, at the most
SETTLED = 1e-6  # of the boundary, or of a share; Newton's method doubles the digits once more
COARSELY_SETTLED = 1e-4
SMALLEST_SHARE = 1e-12  # of a tail
FIRST_GUESS, SOON = 0.8, 2.0  # spreads
NEAREST = 1e-20  # of a square
CELLS, CELL = 8, 0.6  # where two boundaries are compared: cells of so many spreads,
SMOOTHED = 0.5  # and what the places are blurred by
NEXT = 4  # first cells, whose chance weighs the violation inside the contact set,
VIOLATION_SHARE = 0.7  # and its share in the value's error
LEFT = 0.6  # of a change from one rung to the next: what is left after it
GAIN, FAR = (
    0.7,
    10.0,
)  # a rung that leaves more than such a share of the error and so many budgets brings nothing
# Residuals that are small enough, as shares of the tolerance, and at the least. Where the slope is a little wrong, so
# is the boundary, and the value by a few hundredths of that.
ENOUGH_OF_SLOPE, ENOUGH_OF_VALUE = 0.5, 0.05
LEAST_RESIDUAL = 1e-9
ROUGHLY = 20.0  # of the slope that is small enough, on the first rung, which hardly ever is the last
CHECKED = 0.5  # spreads inside the contact set: where value and payoff are compared


class Rung(NamedTuple):
    """A degree of the polynomial, and what belongs to it.

    Parameters
    ----------
    degree, points : int
        Of the boundary's polynomial, and nodes of each of its integrals.
    value_points : int
        Nodes of the integral that gives the value: near the boundary it sees the youngest contact sets closely.
    """

    degree: int
    points: int
    value_points: int


RUNGS = (
    Rung(2, 4, 8),
    Rung(3, 5, 12),
    Rung(4, 6, 16),
    Rung(6, 8, 20),
    Rung(8, 12, 24),
    Rung(12, 16, 32),
    Rung(16, 24, 40),
)


class Climb(NamedTuple):
    """How far the degree is raised.

    Parameters
    ----------
    top : int
        The last rung.
    budget : float or None
        Strikes: where the value now changes less from one rung to the next is the end; None for the last rung alone.
    tolerance : float
        Strikes, of the whole value; 0 where no budget is given.
    patience : int
        Where so many rungs in a row bring nothing, no further one is tried.
    centre, deviation : float
        x at the stretch's beginning as it is expected now, and its standard deviation.
    """

    top: int
    budget: float | None
    tolerance: float
    patience: int
    centre: float
    deviation: float

    def enough(self, form: Form) -> float:
        """Return the residual that is small enough: of the slope, or of the value."""
        share = ENOUGH_OF_VALUE if form == "shifted" else ENOUGH_OF_SLOPE
        return max(LEAST_RESIDUAL, share * self.tolerance)

    def chances(self, stretch: Stretch, origin: float) -> Vector:
        """Return the chance to be in each of the cells from `origin` outwards at the stretch's beginning."""
        spread = stretch.spread
        deviation = math.hypot(self.deviation, SMOOTHED * spread)
        ends = stretch.sign * (origin - self.centre) + CELL * spread * np.arange(CELLS + 1)
        return np.diff(ndtr(ends / deviation))


@dataclass(frozen=True, slots=True)
class Start:
    """How the contact set begins.

    Parameters
    ----------
    form : {"plain", "root", "tail", "shifted"}
        What is a polynomial in eta = sqrt((s - time)/(duration - time)): the boundary b; the square of b less the place
        where it begins; the share N((b - centre)/scale), where the boundary comes from far away and the value without
        exercise fades towards the payoff like a normal tail; b less the place where the value without exercise is the
        payoff.
    time, place : float
        When, s, and where, x.
    touching : Touching or None
        Where the value without exercise is the payoff, at the stretch's beginning; forms "tail" and "shifted" need it.
    centre, scale : float
        Of the tail.
    """

    form: Form
    time: float
    place: float
    touching: Touching | None = None
    centre: float = 0.0
    scale: float = 1.0


def shifted_start(profile: Profile, stretch: Stretch, time: float, place: float) -> Start:
    """Return the start of a contact set that is measured from the touching point."""
    touching = search_touching(profile, stretch, time, place, stretch.duration)
    return Start("shifted", time, place, touching)


@dataclass(frozen=True, slots=True)
class Boundary:
    """The end of the contact set at every time of a stretch since it began, and what its multiplier is worth."""

    stretch: Stretch
    start: Start
    nodes: Table  # those of the value
    coefficients: Vector  # (m + 1,)
    shift: Vector  # (n,): of those nodes
    residual: float
    enough: float  # residual
    profile: Profile
    violation: float = (
        0.0  # strikes: how far value and payoff are apart inside the contact set, at the beginning
    )
    error: float = 0.0  # strikes, of the value now; 0 where it was not asked for

    @property
    def is_found(self) -> bool:
        """Whether every equation is met."""
        return self.residual <= self.enough and math.isfinite(self.last)

    def is_too_rough(self, climb: Climb) -> bool:
        """Whether the value's error is beyond what it may be."""
        return climb.budget is not None and not self.error <= climb.budget

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
    if start.form == "root":
        return np.asarray(start.place - sign * np.sqrt(np.where(coefficients > NEAREST, coefficients, 0.0)))
    return coefficients + shift


def _turns(start: Start, sign: float, coefficients: Vector) -> Vector:
    """Return the derivative of the place by the coefficient."""
    if start.form == "root":
        distance = np.sqrt(np.maximum(coefficients, NEAREST))
        return np.asarray(np.where(coefficients > NEAREST, -0.5 * sign / distance, 0.0))
    if start.form != "tail":
        return np.ones(coefficients.shape)
    quantile = ndtri(np.clip(coefficients, SMALLEST_SHARE, 1.0 - SMALLEST_SHARE))
    return np.asarray(sign * start.scale * math.sqrt(2.0 * math.pi) * np.exp(0.5 * quantile**2))


def _shifts(profile: Profile, stretch: Stretch, start: Start, times: Matrix) -> Matrix:
    """Return where the value without exercise is the payoff at each time; zeros unless the form is "shifted"."""
    shifts = np.zeros(times.size)
    if start.form == "shifted" and start.touching is not None:
        touching, every = start.touching, times.ravel()
        for index in np.argsort(-every, kind="stable").tolist():
            s = float(every[index])
            if s <= start.time * (1.0 + 1e-12):
                shifts[index] = start.place
                continue
            touching = touching_before(touching, profile, stretch, start.time, start.place, s)
            shifts[index] = touching.x
    return shifts.reshape(times.shape)


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


def solve_boundary(profile: Profile, stretch: Stretch, start: Start, climb: Climb) -> Boundary:
    """Return the boundary of the contact set that begins as told; its residual says whether it was found."""
    last: Boundary | None = None
    least, curvature, stalls = climb.enough(start.form), math.inf, 0
    origin, chances, before = math.nan, np.zeros(CELLS), np.zeros(CELLS)
    for rung in range(climb.top + 1):
        degree, points, value_points = RUNGS[rung]
        is_last = rung == climb.top
        system = _system(profile, stretch, start, table(degree, points))
        if last is None:
            coefficients = _guess(system)
        else:
            coefficients = interpolation(last.nodes.eta, system.nodes.eta) @ last.coefficients
            coefficients[0] = _first(start, stretch.sign)
        settled = SETTLED if is_last or climb.budget is not None else COARSELY_SETTLED
        is_sketch = last is None and climb.budget is not None and start.form != "shifted"
        enough = (ROUGHLY if is_sketch else 1.0) * least
        coefficients, residual, curvature = _newton(system, coefficients, (settled, enough), curvature)
        ends = table(degree, value_points)
        times = start.time + (stretch.duration - start.time) * ends.sine**2
        shift = _shifts(profile, stretch, start, times)
        now = Boundary(stretch, start, ends, coefficients, shift, residual, enough, profile)
        if is_last or climb.budget is not None:
            now = replace(now, violation=_violation_inside(now))
        if climb.budget is not None:
            if math.isnan(origin):
                origin = now.last
                chances = climb.chances(stretch, origin)
            worth = _worth(now, origin)
            is_known = now.is_found and (last is None or last.is_found)
            change = float(np.abs(worth - before) @ chances) if is_known else math.inf
            left = change if last is None else LEFT * change
            seen = float(chances[:NEXT].sum()) * now.violation
            now = replace(now, error=left + VIOLATION_SHARE * seen)
            if now.residual <= least and not now.is_too_rough(climb):
                return now
            if last is not None:
                gains = now.error < max(GAIN * last.error, FAR * climb.budget)
                stalls = 0 if gains else stalls + 1
                if last.residual <= least and last.error <= now.error:
                    now, worth = last, before  # where a degree fails or brings nothing, the one before stays
                if stalls == climb.patience:
                    return now
            before = worth
        last = now
    assert last is not None
    return last


def _violation_inside(boundary: Boundary) -> float:
    """Return how far value and payoff are apart inside the contact set, where they should be equal."""
    stretch, s = boundary.stretch, boundary.stretch.duration
    x = np.array([boundary.last - stretch.sign * CHECKED * stretch.spread])
    held = propagate(boundary.profile, stretch.flow, x, s) + boundary.contribution(x)
    return abs(float(held[0, 0]) - stretch.payoff(float(x[0]), s))


def _worth(boundary: Boundary, origin: float) -> Vector:
    """Return what exercise is worth at the cells' middles from `origin` outwards."""
    outwards = CELL * boundary.stretch.spread * np.linspace(0.5, CELLS - 0.5, CELLS)
    x: Vector = origin + boundary.stretch.sign * outwards
    worth: Vector = boundary.contribution(x)[0]
    return worth


def _system(profile: Profile, stretch: Stretch, start: Start, nodes: Table) -> _System:
    span = stretch.duration - start.time
    times = start.time + span * nodes.eta[1:] ** 2
    node_times = start.time + span * (nodes.eta[1:, None] * nodes.sine) ** 2
    shifts = _shifts(profile, stretch, start, np.concatenate([times, node_times.ravel()]))
    node_shift = shifts[times.size :].reshape(node_times.shape)
    return _System(profile, stretch, start, nodes, times, shifts[: times.size], node_shift)


def _first(start: Start, sign: float) -> float:
    if start.form == "tail":
        return float(ndtr(sign * (start.place - start.centre) / start.scale))
    return start.place if start.form == "plain" else 0.0


def _guess(system: _System) -> Vector:
    stretch, start, nodes = system.stretch, system.start, system.nodes
    coefficients = np.full(nodes.eta.size, _first(start, stretch.sign))
    spread = stretch.flow.volatility * math.sqrt(stretch.duration - start.time)
    if start.form == "plain":
        step = 0.0 if system.profile.continues(stretch) else FIRST_GUESS
        coefficients -= stretch.sign * step * spread * nodes.eta
    elif start.form == "root":
        furthest = stretch.sign * (start.place - stretch.perpetual())
        soon = SOON * spread * nodes.eta
        coefficients = (
            np.square(-furthest * np.expm1(-soon / furthest)) if math.isfinite(furthest) else soon**2
        )
    elif start.form == "tail" and start.touching is not None:
        touching, profile = start.touching, system.profile
        for k in reversed(range(system.times.size)):
            s = float(system.times[k])
            touching = touching_before(touching, profile, stretch, start.time, start.place, s)
            coefficients[k + 1] = ndtr(stretch.sign * (touching.x - start.centre) / start.scale)
    return coefficients


def _newton(
    system: _System, coefficients: Vector, ends: tuple[float, float], curvature: float
) -> tuple[Vector, float, float]:
    """Return the zero of the residual and what is left of it, by Newton's method with halved steps, and the curvature.

    Parameters
    ----------
    ends : (float, float)
        The iteration ends after a step that moves the boundary by less than the first, or once the residual is no more
        than the second.
    curvature : float
        A full step leaves the residual's square times that, which is measured at every such step and handed on from
        degree to degree, infinite while unknown: where that is enough, the residual is not evaluated any more.
    """
    settled, enough = ends
    form, spread = system.start.form, system.stretch.spread
    residual, jacobian = system.residual(coefficients)
    for _ in range(MOST_ITERATIONS):
        diagonal = np.diag(jacobian)
        lift = 1e-12 * np.max(np.abs(diagonal)) + 1e-300
        lifted = jacobian + np.diag(np.where(diagonal < 0.0, -lift, lift))
        try:
            step = np.asarray(np.linalg.solve(lifted, -residual), dtype=np.float64)
        except np.linalg.LinAlgError:
            return coefficients, math.nan, curvature
        furthest = _furthest_move(system, coefficients, step)
        length = min(1.0, spread / furthest) if furthest > 0.0 else 1.0
        small = (np.max(np.abs(step)) if form == "tail" else furthest) <= settled
        norm = np.max(np.abs(residual))
        while True:
            trial = coefficients.copy()
            trial[1:] += length * step
            if form == "tail":
                trial[1:] = np.clip(trial[1:], 1e-10, 1.0 - 1e-10)
            elif form == "root":
                trial[1:] = np.maximum(trial[1:], 0.1 * coefficients[1:])
            expected = float(CAUTION * curvature * norm * norm)
            if length >= 1.0 and expected <= enough:
                return trial, expected, curvature
            residual, jacobian = system.residual(trial)
            left = float(np.max(np.abs(residual)))
            if length >= 1.0:
                curvature = float(left / (norm * norm))
            if left <= (1.0 - 0.2 * length) * norm or length < LEAST_STEP or small or left < 1e-14:
                break
            length *= 0.5
        coefficients = trial
        if small or left <= enough or not math.isfinite(left):
            break
    return coefficients, float(np.max(np.abs(residual))), curvature


def _furthest_move(system: _System, coefficients: Vector, step: Vector) -> float:
    """Return how far the step moves the boundary at most."""
    inside = coefficients[1:]
    if system.start.form == "tail":
        inside = np.clip(inside, 1e-9, 1.0 - 1e-9)
    return float(np.max(np.abs(_turns(system.start, system.stretch.sign, inside) * step)))
