"""The engine of the closed formulas: contracts that have expired, are certain, European, or never exercised early."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import Prices, prices
from pricing_core.american.engines.black_scholes import european_columns
from pricing_core.american.engines.certain import (
    certain_value,
    is_far_out_of_the_money,
    moved_boundary,
    uncertainty,
)
from pricing_core.american.engines.differences import plan_differences
from pricing_core.american.engines.engine import Boundaries, BoundariesAt, Request
from pricing_core.american.engines.exercise_region import region_at_expiry
from pricing_core.american.engines.formulas import has_formula, may_exercise
from pricing_core.american.engines.held import ROUNDING, held_theta
from pricing_core.arrays import BoolVector, Vector, every, some

SMALLEST_SPREAD = 1e-12  # Standard deviation of ln S at expiry below which it makes no difference; chosen.
SURE_SHARE = 0.1  # Largest effect of a volatility that is left out, as a share of the tolerance; chosen.
# Largest bound on the effect of the volatility, in strikes, at which the certain path is tried: SURE_SHARE of the
# largest tolerance.
LARGEST_UNCERTAINTY = 1e-3
# Steps of differences over the usual ones: certain values are exact; calibrated on the formula.
CERTAIN_STEPS = 1e-2
SPOT_STEP = 1e-5  # Step of the spot for the delta on a certain path, as a share of spot and strike; chosen.


class ClosedForm:
    """Black, Scholes and Merton's formula, its limits, and the best time to exercise where nothing is uncertain."""

    name = "closed form"
    method = "closed-form"
    least_error = 0.0

    def serves(self, book: Book) -> BoolVector:
        """Tell which contracts have expired, are certain, or have a formula because early exercise never pays."""
        worthless = book.spot == 0.0
        served: BoolVector = has_formula(book) | _is_certain(book) | worthless
        return (
            served if book.local is None else served & (~book.is_local() | worthless | (book.expiry == 0.0))
        )

    def solve(self, book: Book, request: Request) -> Prices:
        """Price by formula; certain contracts are settled where volatility adds at most a tenth of the tolerance."""
        formula = has_formula(book) & (book.deviation >= SMALLEST_SPREAD) & (book.spot > 0.0)
        far = np.flatnonzero(is_far_out_of_the_money(book))  # where the formula rounds to a part of the spot
        formula[far] &= ~_is_certain(book.take(far))
        if every(formula):
            return _by_formula(book, request)
        rows = np.flatnonzero(formula)
        certain = _on_certain_path(book, request)
        return certain.replaced(rows, _by_formula(book.take(rows), request.take(rows)))

    def boundary(self, book: Book, request: Request) -> BoundariesAt:
        """Return the limit at expiry, where early exercise never pays; of a certain contract the same at all times."""
        return lambda times: self._boundary(book, times, request)

    def _boundary(self, book: Book, times: Vector, request: Request) -> Boundaries:
        nothing, none = np.full(times.size, math.nan), np.zeros(times.size, dtype=bool)
        (near, far), expired = _certain_boundary(book), book.expiry[0] == 0.0
        if has_formula(book)[0] and not (expired and may_exercise(book)[0]):
            at_expiry = np.where(times == book.expiry[0], near, math.nan)
            return Boundaries(at_expiry, nothing, nothing, ~none)
        at_strike = book.diffusing_at(book.strike)
        sure = expired or _uncertain_by(at_strike)[0] <= SURE_SHARE * request.tolerance[0] * book.strike[0]
        if not sure or book.has_events()[0]:
            return Boundaries(nothing, nothing, nothing, none)
        error = moved_boundary(book, near)
        near, far, error = (np.full(times.size, one[0]) for one in (near, far, error))
        return Boundaries(near, far, error, ~none)


def _uncertain_by(book: Book) -> Vector:
    """Return what the volatility may add to or take from the value, money, as if the spot were at least the strike.

    A spot of 0 does not diffuse, but the exercise boundary of its contract does not depend on the spot.
    """
    return uncertainty(replace(book, spot=np.maximum(book.spot, book.strike)))


def _is_certain(book: Book) -> BoolVector:
    """Tell contracts of which the certain path may be all that matters, at the largest tolerance."""
    small, far = book.deviation <= LARGEST_UNCERTAINTY, is_far_out_of_the_money(book)
    if some(small):
        rows = np.flatnonzero(small)
        part = book.take(rows)
        small[rows] = _uncertain_by(part) <= LARGEST_UNCERTAINTY * part.strike
    if some(far):
        rows = np.flatnonzero(far)
        part = book.take(rows)
        small[rows] |= uncertainty(part) <= LARGEST_UNCERTAINTY * part.strike
    return small


def has_boundary_elsewhere(book: Book) -> BoolVector:
    """Tell contracts whose value is certain, but whose exercise boundary is that of a spot that diffuses.

    They are those on a spot of 0, and those far out of the money.
    """
    diffuses: BoolVector = (book.spot == 0.0) | is_far_out_of_the_money(book)
    if not some(diffuses):
        return diffuses
    at_strike = book.diffusing_at(book.strike)
    diffuses &= ~has_formula(book) & (_uncertain_by(at_strike) > LARGEST_UNCERTAINTY * book.strike)
    return diffuses


def _is_worthless(book: Book) -> BoolVector:
    worthless: BoolVector = (book.spot == 0.0) & ~_is_certain(book)
    return worthless


def _by_formula(book: Book, request: Request) -> Prices:
    columns = european_columns(book, request.greeks)
    # Nothing is more accurate than the formula: where rounding alone misses the tolerance, no other engine is asked.
    missed = columns["error"] > request.tolerance * book.strike
    status = np.where(missed, "tolerance_not_met", "ok").astype(object) if some(missed) else "ok"
    return prices(
        book.count,
        settled=True,
        complete=True,
        status=status,
        method="closed-form",
        european=columns["value"],
        **columns,
    )


def _on_certain_path(book: Book, request: Request) -> Prices:
    """Return the values of the best times to exercise; derivatives are differences, for the values are exact."""
    value, european = certain_value(book), certain_value(book.european())
    step = SPOT_STEP * np.maximum(book.spot, book.strike)
    below = np.minimum(step, book.spot)
    up, down = (certain_value(replace(book, spot=book.spot + by)) for by in (step, -below))
    delta, gamma = np.where(value > 0.0, (up - down) / (step + below), 0.0), np.zeros(book.count)
    payoff = book.payoff()
    formula = has_formula(book)
    error = np.maximum(uncertainty(book), ROUNDING * value)
    expired = book.expiry == 0.0
    now = book.now.exercisable
    exercised = (payoff > 0.0) & (value <= payoff) & (expired | (now & ~formula))
    delta = np.where(exercised, -book.sign, np.where(expired, 0.0, delta))
    further: dict[str, Any] = {}
    if request.greeks != "none":
        differences = plan_differences(book, extended=request.greeks == "extended", share=CERTAIN_STEPS)
        bumped = certain_value(differences.book)
        further = differences.columns(bumped, np.zeros(bumped.size))
    certain = error <= SURE_SHARE * request.tolerance * book.strike
    worthless = _is_worthless(book)
    words = np.array(["zero-volatility", "worthless-underlying", "closed-form", "expired"], dtype=object)
    unknown = has_boundary_elsewhere(book) | (book.has_events() & ~expired)
    near = np.where(unknown, math.nan, _certain_boundary(book)[0])
    return prices(
        book.count,
        value=value,
        european=european,
        error=error,
        delta=delta,
        gamma=gamma,
        theta=np.where(exercised | expired, 0.0, held_theta(book, value, delta, gamma)),
        boundary=near,
        boundary_error=moved_boundary(book, near),
        exercised=exercised,
        settled=certain | formula | expired,
        complete=True,
        method=words[np.select([expired, formula, worthless], [3, 2, 1], 0)],
        **further,
    )


def _certain_boundary(book: Book) -> tuple[Vector, Vector]:
    """Return the ends of the exercise region just before expiry, (near, far), money, each of shape (n,).

    At volatility 0 they are those of contracts without events at all times; at expiry everything that pays is
    exercised.
    """
    near, far = np.full((2, book.count), math.nan)
    for row in np.flatnonzero(may_exercise(book)).tolist():
        strike, is_put = book.strike.item(row), book.is_put.item(row)
        region = region_at_expiry(book.segments_of(row)[-1], is_put=is_put)
        near[row], far[row] = region.boundaries(strike, is_put=is_put)
    expired = book.expiry == 0.0
    return np.where(expired, book.strike, near), np.where(expired, math.nan, far)
