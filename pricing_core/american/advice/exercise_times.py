"""The march of the law of a holder's spot over the segments of a contract, absorbed where exercise is optimal."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from pricing_core.american.advice.first_passage import Passage
from pricing_core.american.advice.laws import REACH, Law, PointMass, resolved
from pricing_core.american.advice.region import Region, Span, monotone_cubic, parameters, times_in
from pricing_core.american.book.book import Book
from pricing_core.american.book.segments import Segment
from pricing_core.arrays import Vector

NOBODY = 1e-15  # Largest mass that is not followed; chosen.
STILL = 1e-9  # Smallest standard deviation of an increment that is not rounding, in ln(spot); chosen.
NO_SPREAD = 1e-300


@dataclass(slots=True, eq=False)
class Exercised:
    """The exercised mass over time: bursts at single times, and the mass that each span absorbs.

    Parameters
    ----------
    bursts : list of (float, float)
        Time in years from now, and mass.
    flows : list of (float, float, Vector)
        Start and end in years from now, and the mass absorbed up to the points of its mesh.
    at_expiry, worthless : float
        Mass that exercises at expiry, and that lets the option expire.
    defects : list of float
        What each law missed of the mass that it should have had.
    """

    bursts: list[tuple[float, float]] = field(default_factory=list)
    flows: list[tuple[float, float, Vector]] = field(default_factory=list)
    at_expiry: float = 0.0
    worthless: float = 0.0
    defects: list[float] = field(default_factory=list)

    @property
    def probability(self) -> float:
        """The mass that exercises before expiry."""
        return math.fsum([mass for _, mass in self.bursts] + [float(mass[-1]) for *_, mass in self.flows])

    def cumulative(self, time: Vector) -> Vector:
        """Return the mass that has exercised up to each time, both included; before expiry alone."""
        total = np.zeros(time.size)
        for when, mass in self.bursts:
            total += np.where(time >= when, mass, 0.0)
        for start, end, absorbed in self.flows:
            share = np.clip((time - start) / (end - start), 0.0, 1.0)
            total += monotone_cubic(absorbed)(np.arcsin(np.sqrt(share)) / (0.5 * np.pi))
        return total

    def first_moment(self) -> float:
        """Return the integral of the time of early exercise over the mass."""
        parts = [when * mass for when, mass in self.bursts]
        for start, end, absorbed in self.flows:
            times = times_in(start, end, parameters(absorbed.size - 1))
            parts.append(float(0.5 * (times[1:] + times[:-1]) @ np.diff(absorbed)))
        return math.fsum(parts)


@dataclass(slots=True, eq=False)
class ExerciseMarch:
    """The laws of the spot of those who have not exercised yet, from segment to segment.

    Parameters
    ----------
    book : Book
        One contract.
    count : int
        Number of intervals of a span's mesh.
    shift : float
        By how many of its errors every end of the region is moved: for the error that the boundary's own error makes.
    check : callable
        Called between the steps of the work; may raise.
    """

    book: Book
    count: int
    shift: float
    check: Callable[[], None]
    laws: list[Law] = field(default_factory=list)
    found: Exercised = field(default_factory=Exercised)

    def run(self, spans: list[list[Span]], regions: list[Region | None]) -> Exercised:
        """Return how much of the mass is exercised at each time.

        Parameters
        ----------
        spans : list of list of Span
            For each segment.
        regions : list of Region or None
            For each segment, just before what happens at its end; that of the last is not used.
        """
        segments, spot = self.book.segments_of(), self.book.diffusing().item()
        if spot > 0.0:
            self.laws = [PointMass(math.log(spot), 1.0)]
        else:
            exercise_without_spot(self.book, self.found, 1.0, 0)
        for k, segment in enumerate(segments):
            self.check()
            for span in spans[k]:
                self._pass(segment, span)
            if segment is segments[-1]:
                break
            region = regions[k]
            if region is not None:
                self._cut(segment.end, region)
            self._pay(segment, k + 1)
        self._expire(segments[-1])
        return self.found

    def _pass(self, segment: Segment, span: Span) -> None:
        """Move everyone through a span."""
        length = span.end - span.start
        mean = (segment.rate - segment.dividend_yield - 0.5 * segment.volatility**2) * length
        spread = segment.volatility * math.sqrt(length)
        if spread < STILL:
            self.laws = [law.moved(mean) for law in self.laws]
            if span.exists:
                self._cut(span.end, span.region_at(1.0))
            return
        if not span.exists:
            self.laws = [self._diffused(law, mean, spread) for law in self.laws]
            return
        region = span.region_at(0.0)
        self._cut(span.start, region)
        laws, self.laws = self.laws, []
        for law in laws:
            above = law.support[0] >= region.moved(self.shift).high
            edge = span.edge(above=above, errors=self.shift)
            passage = Passage(law, mean / length, segment.volatility, length, edge, self.check)
            if not above:
                passage = passage.mirrored()
            absorbed = passage.absorbed(self.count)
            left, missed = passage.survivors(absorbed)
            self.found.flows.append((span.start, span.end, absorbed))
            self.found.defects.append(missed)
            if left is not None:
                self.laws.append(left if above else left.mirrored())

    def _diffused(self, law: Law, mean: float, spread: float) -> Law:
        """Return the law with a normal increment added."""
        low, high = law.support

        def density(place: Vector) -> Vector:
            self.check()
            return law.density(place, mean, spread)

        return resolved(density, low + mean - REACH * spread, high + mean + REACH * spread).with_mass(
            law.mass
        )

    def _cut(self, time: float, region: Region) -> None:
        """Let those in a region exercise."""
        region = region.moved(self.shift)
        low, high = region.low, region.high
        before = math.fsum(law.mass for law in self.laws)
        parts = [law.between(*side) for law in self.laws for side in ((-math.inf, low), (high, math.inf))]
        self.laws = [law for law in parts if law is not None and law.mass > NOBODY]
        gained = before - math.fsum(law.mass for law in self.laws)
        if gained > 0.0:
            self.found.bursts.append((time, gained))

    def _pay(self, segment: Segment, following: int) -> None:
        """Let the spot drop, s -> max(s (1 - fraction) - amount, 0), before the segment `following`."""
        before = math.fsum(law.mass for law in self.laws)
        share = 1.0 - segment.fraction
        if share <= 0.0:
            self.laws = []
        elif share < 1.0:
            self.laws = [law.moved(math.log(share)) for law in self.laws]
        if segment.amount > 0.0:
            parts = [law.after_cash(math.log(segment.amount)) for law in self.laws]
            self.laws = [law for law in parts if law is not None]
        lost = before - math.fsum(law.mass for law in self.laws)
        if lost > 0.0:
            exercise_without_spot(self.book, self.found, lost, following)

    def _expire(self, last: Segment) -> None:
        """Note who exercises at expiry."""
        left = math.fsum(law.mass for law in self.laws)
        level = self.book.strike.item() - last.escrow_at(last.end)
        below = 0.0
        if level > 0.0:
            place, mean, spread = np.array([math.log(level)]), np.zeros(1), np.full(1, NO_SPREAD)
            below = min(math.fsum(float(law.below(place, mean, spread)[0]) for law in self.laws), left)
        gained = below if self.book.is_put.item() else left - below
        self.found.at_expiry += gained
        self.found.worthless += left - gained


def exercise_without_spot(book: Book, found: Exercised, mass: float, first: int) -> None:
    """Note when the mass whose spot is zero from the start of segment `first` on is exercised."""
    if not book.is_put.item():
        found.worthless += mass
        return
    expiry = book.expiry.item()
    best, when, growth = math.inf, expiry, 0.0
    for segment in book.segments_of()[first:]:
        if segment.exercisable and growth <= best:
            best, when = growth, segment.start
        growth += segment.rate * segment.duration
        if (segment.exercise_at_end or segment.end == expiry) and growth <= best:
            best, when = growth, segment.end
    if when < expiry:
        found.bursts.append((when, mass))
    else:
        found.at_expiry += mass
