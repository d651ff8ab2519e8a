"""Advice on exercise: now or later, how likely, and what waiting costs."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from pricing_core.american.advice.cost_of_waiting import cost_of_waiting
from pricing_core.american.advice.density_march import DensityMarch
from pricing_core.american.advice.exercise_times import Exercised, ExerciseMarch
from pricing_core.american.advice.region import Boundaries, Region, RegionFinder, Span
from pricing_core.american.book.book import Book
from pricing_core.american.boundary import ExerciseBoundary, exercise_boundary
from pricing_core.american.contracts.checks import check_kind
from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.dates import DAYS_PER_YEAR
from pricing_core.american.contracts.fields import DEFAULT_TOLERANCE, TOLERANCE, VOLATILITY
from pricing_core.american.contracts.market import Market
from pricing_core.american.contracts.times import checked_times
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.solve import boundary_of
from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError, NumericalError

DAILY = "daily"
EVEN_STEPS = 50  # Number of steps of the times where none are given; chosen.
INTERVALS = 128  # Number of intervals of the mesh between two events; chosen.
BOUNDARY_TOLERANCE = 1e-8  # Tolerance of the boundary, which is found to a tenth of its root; chosen.
ROUNDING = 1e-12  # Smallest error that is claimed of a probability; chosen.
INTERRUPTED = "interrupted before the advice was complete: allow more time"


@dataclass(frozen=True, slots=True, eq=False)
class ExerciseAdvice:
    """When a holder who exercises optimally does so, under the risk-neutral law, and what it costs to wait.

    Parameters
    ----------
    exercise_now : bool
        Whether exercise is optimal now.
    exercise_boundary : float or None
        The spot at which it is, money; of two the one nearer the strike. None where there is none now.
    probability : float
        Probability of exercise before expiry.
    probability_error : float
        Estimated error of every probability here.
    expected_time : float
        Years from now, given exercise before expiry; NaN where its probability is 0.
    exercised_at_expiry, expires_worthless : float
        Probabilities; with `probability` they sum to 1.
    time : Vector, shape (m,)
        Years from now.
    cumulative_probability : Vector, shape (m,)
        Probability of exercise before expiry, up to and at each time.
    assignment_probability : Vector, shape (m,)
        Probability that the short side has been assigned up to and at each time: exercise at expiry is included.
    cost_of_waiting : Vector, shape (m,)
        What a holder loses who does not exercise before each time, money today; at expiry the early exercise premium.
    cost_error : Vector, shape (m,)
        Its estimated error, money.
    status : {"ok", "tolerance_not_met"}
        Whether every price behind the costs meets the tolerance.
    method : str
        How boundary and prices were found, with commas where in several ways.
    """

    exercise_now: bool
    exercise_boundary: float | None
    probability: float
    probability_error: float
    expected_time: float
    exercised_at_expiry: float
    expires_worthless: float
    time: Vector
    cumulative_probability: Vector
    assignment_probability: Vector
    cost_of_waiting: Vector
    cost_error: Vector
    status: str
    method: str


def exercise_advice(
    option: Option,
    market: Market,
    times: ArrayLike | Literal["daily"] | None = None,
    *,
    tolerance: float = DEFAULT_TOLERANCE,
    interrupt: Callable[[], bool] | None = None,
) -> ExerciseAdvice:
    """Return whether to exercise, when the holder will have exercised, and what waiting costs.

    The probabilities are those of the first passage of the spot through the exercise boundary, solved as an integral
    equation between the events (Fortet 1943), or with a local volatility by the density of the spot on a grid. The
    costs are differences of prices.

    Parameters
    ----------
    option : Option
    market : Market
        With a volatility above 0.
    times : array_like, shape (m,), optional
        Years from now, increasing, 0 to expiry; by default the ex-times and exercise times, and 50 even steps; "daily":
        every day, 1/365 year, to the expiry.
    tolerance : float
        Tolerance of the prices, as in `price`.
    interrupt : callable, optional
        Asked between the steps of the work; True ends it.

    Raises
    ------
    InvalidInputError
        An argument lies outside what is allowed.
    NumericalError
        The interrupt came before the end; or the law of the spot is too narrow to be resolved.

    Examples
    --------
    >>> advice = exercise_advice(Option("put", 100.0, 1.0), Market(100.0, 0.05, 0.2), times=[0.5, 1.0])
    >>> advice.exercise_now, round(advice.exercise_boundary, 1), round(advice.probability, 4)
    (False, 80.9, 0.4874)
    >>> advice.cumulative_probability.round(4), advice.cost_of_waiting.round(3)
    (array([0.1637, 0.4874]), array([0.071, 0.517]))
    """
    check_kind("option", option, Option, "an Option")
    check_kind("market", market, Market, "a Market")
    tolerance = TOLERANCE.check(tolerance)
    book = Book.of([(option, market)])
    if (book.segments.volatility <= 0.0).any():
        raise InvalidInputError(VOLATILITY.name, 0.0, "above 0 in advice on exercise")
    chosen = _chosen_times(option, book, times)

    def check() -> None:
        if interrupt is not None and interrupt():
            raise NumericalError(INTERRUPTED)

    check()
    waiting = cost_of_waiting(option, market, chosen, tolerance, interrupt)
    now = waiting.exercise_now
    there = exercise_boundary(option, market, [0.0], tolerance=tolerance, interrupt=interrupt)
    boundary = float(there.boundary[0])
    if now or option.expiry == 0.0:
        found, error = _settled(option, market, exercised=now), 0.0
    else:
        boundaries = boundaries_of(Book.at_strike(option, market), interrupt, check)
        found, error = exercised(book, boundaries, chosen, check)
    probability = found.probability
    cumulative = np.minimum(found.cumulative(chosen), probability)
    assigned = cumulative + np.where(chosen >= option.expiry, found.at_expiry, 0.0)
    return ExerciseAdvice(
        exercise_now=now,
        exercise_boundary=None if math.isnan(boundary) else boundary,
        probability=probability,
        probability_error=error,
        expected_time=found.first_moment() / probability if probability > 0.0 else math.nan,
        exercised_at_expiry=found.at_expiry,
        expires_worthless=found.worthless,
        time=chosen,
        cumulative_probability=cumulative,
        assignment_probability=assigned,
        cost_of_waiting=waiting.cost,
        cost_error=waiting.error,
        status=waiting.status,
        method=", ".join(sorted(waiting.methods | set(there.method.split(", ")) - {"none"})),
    )


def _chosen_times(option: Option, book: Book, times: ArrayLike | None) -> Vector:
    if times is None:
        return _default_times(option, book)
    if isinstance(times, str) and times == DAILY:
        days = np.arange(1.0, DAYS_PER_YEAR * option.expiry)
        return np.append(days / DAYS_PER_YEAR, option.expiry)
    return checked_times(option, times)


def _default_times(option: Option, book: Book) -> Vector:
    """Return the times at which something happens, and even steps to the expiry."""
    segments = book.segments
    events = segments.end[(segments.due > 0.0) | (segments.fraction > 0.0) | ~segments.exercisable]
    return np.unique(np.concatenate([np.linspace(0.0, option.expiry, EVEN_STEPS + 1)[1:], events, [0.0]]))


def _settled(option: Option, market: Market, *, exercised: bool) -> Exercised:
    """Return what happens where everything is known now."""
    if exercised and option.expiry > 0.0:
        return Exercised(bursts=[(0.0, 1.0)])
    gains = option.payoff(market.spot) > 0.0
    return Exercised(at_expiry=float(gains), worthless=float(not gains))


def boundaries_of(book: Book, interrupt: Callable[[], bool] | None, check: Callable[[], None]) -> Boundaries:
    """Return what gives the boundary of a book of one contract, whose spot is the strike, at any times."""
    asked = Request(np.array([BOUNDARY_TOLERANCE]), interrupt=interrupt)
    found = boundary_of(book, asked)

    def boundaries(times: Vector) -> ExerciseBoundary:
        check()
        there = found(times)
        tau, other = np.maximum(book.expiry - times, 0.0), None if np.isnan(there.far).all() else there.far
        return ExerciseBoundary(times, tau, there.near, other, there.error, "")

    return boundaries


def exercised(
    book: Book, boundaries: Boundaries, times: Vector, check: Callable[[], None]
) -> tuple[Exercised, float]:
    """Return how much of the mass is exercised at each time, and the estimated error of the probabilities.

    It is how far they move when every mesh has half its points, and when the boundary moves by its own error, with the
    mass that the laws between events missed.

    Parameters
    ----------
    book : Book
        One contract, which is held now.
    boundaries : callable
        Takes increasing times and returns an `ExerciseBoundary`.
    times : Vector, shape (m,)
        At which the cumulative probabilities are to be right.
    check : callable
        Called between the steps of the work; may raise.
    """
    is_put, segments = book.is_put.item(), book.segments_of()
    finder = RegionFinder(boundaries, INTERVALS, is_put=is_put)
    spans: list[list[Span]] = []
    regions: list[Region | None] = []
    for segment in segments:
        spans.append(finder.spans(segment) if segment.exercisable else [Span(segment.start, segment.end)])
        regions.append(
            finder.at_end(segment) if segment.exercise_at_end and segment is not segments[-1] else None
        )

    def run(count: int, shift: float) -> Exercised:
        diffuses_locally = book.local_terms() is not None and book.diffusing().item() > 0.0
        march = DensityMarch if diffuses_locally else ExerciseMarch
        return march(book, count, shift, check).run(spans, regions)

    # A region that becomes smaller: its end is steep where it falls to 0 before a dividend, and its error large.
    outwards = -1.0 if is_put else 1.0
    fine, coarse, moved = run(INTERVALS, 0.0), run(INTERVALS // 2, 0.0), run(INTERVALS // 2, outwards)

    def told(found: Exercised) -> Vector:
        return np.concatenate(
            [found.cumulative(times), [found.probability, found.at_expiry, found.worthless]]
        )

    error = np.abs(told(fine) - told(coarse)).max() + np.abs(told(moved) - told(coarse)).max()
    return fine, float(error + math.fsum(fine.defects) + ROUNDING)
