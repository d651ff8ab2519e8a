"""Greeks from a solved contract: by place and time from the march itself, by parameters from bumped contracts.

Theta is the march's own rate, gamma follows from it by the equation. First derivatives by parameters are walks back
between the problems of contracts with a little more and a little less of one; vanna is the tangent's slope, volga a
difference of tangents. The errors are the differences of two resolutions, beside those of the two before them.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from pricing_core.american.book.book import Book
from pricing_core.american.book.prices import error_of
from pricing_core.american.book.ragged import Ragged
from pricing_core.american.engines.differences import (
    DIVIDENDS,
    STICKY,
    Bump,
    PlannedDirection,
    plan_directions,
    unchanged,
)
from pricing_core.american.engines.engine import Request
from pricing_core.american.engines.obstacle_march.contact_ends import boundary_place
from pricing_core.american.engines.obstacle_march.contract_problem import contract_problem, place_of
from pricing_core.arrays import Matrix, Vector
from pricing_core.obstacle import ObstacleProblem, ObstacleSolution
from pricing_core.obstacle.adjoint import Walk
from pricing_core.obstacle.direction import Neighbours
from pricing_core.obstacle.march import March
from pricing_core.obstacle.rate import rates
from pricing_core.obstacle.solution import apart, march_again
from pricing_core.obstacle.solve import GAIN, PESSIMISM
from pricing_core.obstacle.tangent import tangent

SURFACE_STEP = 1e-4  # How far a surface is moved in ln S; chosen.
VOLGA_STEP = (
    0.02  # Step of the volatility for volga, as a share of the largest one; twice that on the coarser grid.
)
# How far from the boundary, over how far this moves with the step, the place moves along with it; chosen.
CROSSED = 3.0
# Places around the spot, in coarse cells, at which two resolutions are compared: at one they may agree by chance.
AROUND = np.array([-0.7, 0.0, 0.7])
# Error estimates over the differences of two resolutions: of what the extrapolation improves, of rates, and of
# first and second derivatives by parameters; calibrated.
BY_PLACE, BY_TIME, BY_PARAMETER, BY_PARAMETERS = 1.0, 2.0, 2.5, 6.0


def by_place_and_time(book: Book, found: ObstacleSolution, *, extended: bool) -> dict[str, Any]:
    """Return delta, gamma, theta and charm of a contract that is held, with their errors, as columns of money."""
    place, strike = place_of(book), book.strike.item()
    fine, coarse, *_ = marches = _finest(found, place)
    x, s = np.array([place]), math.exp(place)
    around = np.clip(
        x + AROUND * coarse.grid.map.size / coarse.grid.refined, *coarse.grid.x[[0, -1]].tolist()
    )
    held = np.all([march.now.side(around) == 0 for march in marches], axis=0)
    around = around[held | (AROUND == 0.0)]
    slopes = [march.now.derivatives(around)[1] for march in marches]
    slope_error = BY_PLACE * float(apart(slopes, PESSIMISM).max())
    (rate, rate_slope), (rate_error, rate_slope_error) = (
        rates(fine, x)[:, 0].tolist(),
        (BY_TIME * apart([rates(march, around) for march in marches], GAIN).max(axis=1)).tolist(),
    )
    problem = found.problem
    volatility, drift, discount = (float(f(x, 0.0)[0]) for f in problem.diffusion.functions)
    D, value, slope = 0.5 * volatility**2, float(found.value), float(found.slope)
    bend = (discount * value - rate - drift * slope) / D  # V_t + D V_xx + m V_x - r V = 0
    bend_error = (discount * found.error_estimate + rate_error + abs(drift) * slope_error) / D
    gamma, gamma_error = (bend - slope) / s**2, (bend_error + slope_error) / s**2
    delta, delta_error = slope / s, slope_error / s
    grown = book.segments.rate.item(0) * book.escrow_now().item() / strike  # A' of the escrowed model
    columns = {
        "delta": delta,
        "delta_error": delta_error,
        "gamma": gamma / strike,
        "gamma_error": gamma_error / strike,
        "theta": strike * (rate - grown * delta),
        "theta_error": strike * (rate_error + abs(grown) * delta_error),
    }
    if extended:
        columns |= {
            "charm": rate_slope / s - grown * gamma,
            "charm_error": rate_slope_error / s + abs(grown) * gamma_error,
        }
    return {name: np.array([number]) for name, number in columns.items()}


def _finest(found: ObstacleSolution, place: float) -> list[March]:
    """Return the marches on the two finest grids, the finest first, and that on the one before where it holds there."""
    assert found.march is not None
    assert found.coarse is not None
    finest, third = [found.march, found.coarse], found.coarser
    if third is not None and third.now.side(np.array([place]))[0] == 0:
        finest.append(third)
    return finest


def by_parameters(
    book: Book,
    problem: ObstacleProblem,
    found: ObstacleSolution,
    request: Request,
    *,
    held: bool,
) -> dict[str, Any] | None:
    """Return the derivatives by the parameters as columns of money, with their errors; None where interrupted."""
    extended, strike = request.greeks == "extended", book.strike.item()
    columns = unchanged(book, extended=extended)
    columns |= {error_of(name): _copied(column) for name, column in columns.items()}
    local = book.is_local().item(0)
    if not held:
        return columns | ({STICKY: -book.sign} if local else {})
    place, cut = place_of(book), bool(problem.diffusion.breaks)
    marches = _finest(found, place)
    walks = [Walk.of(march, place) for march in marches]
    slopes = [float(march.now.derivatives(np.array([place]))[1, 0]) for march in marches]
    for planned in plan_directions(book, extended=extended):
        if request.is_interrupted():
            return None
        sides = _sides(planned, problem, cut=cut)
        spots = [side.diffusing().item() for side in planned.sides]
        by_place = _central(planned, spots) / book.diffusing().item()
        values = [
            walk.derivative(sides) + slope * by_place for walk, slope in zip(walks, slopes, strict=True)
        ]
        error = BY_PARAMETER * float(apart(values, GAIN))
        for name, number in ((planned.kind, values[0]), (error_of(planned.kind), error)):
            column = columns[name]
            (column.values if isinstance(column, Ragged) else column)[planned.entry] = strike * number
    if local:
        columns |= _sticky(book, walks, found, cut=cut)
    if extended:
        second = _second_order(book, marches, place, request)
        if second is None:
            return None
        columns |= second
    return columns


def _sides(planned: PlannedDirection, problem: ObstacleProblem, *, cut: bool) -> Neighbours:
    """Return the problems of the bumped contracts; they share all but an event where only that differs."""
    high, low = planned.sides
    times = [event.time for event in problem.events]
    own = [contract_problem(side, times, cut=cut) for side in planned.sides]
    if planned.kind == DIVIDENDS and not high.escrowed[0]:
        (changed,) = high.segments.end[high.segments.due != low.segments.due].tolist()
        own = [
            replace(
                problem,
                events=[
                    other if event.time == changed else event
                    for event, other in zip(problem.events, side.events, strict=True)
                ],
            )
            for side in own
        ]
    return Neighbours(own[0], own[1], planned.step)


def _central(planned: PlannedDirection, numbers: list[float]) -> float:
    return (numbers[0] - numbers[1]) / (2.0 * planned.step)


def _sticky(book: Book, walks: list[Walk], found: ObstacleSolution, *, cut: bool) -> dict[str, Any]:
    """Return the delta of a surface that moves with the spot."""
    times = [event.time for event in found.problem.events]
    high, low = (
        contract_problem(book.with_surfaces_moved(by), times, cut=cut) for by in (SURFACE_STEP, -SURFACE_STEP)
    )
    sides = Neighbours(high, low, SURFACE_STEP)
    values = [walk.derivative(sides) for walk in walks]
    share = book.strike / book.spot
    delta = float(found.slope) * math.exp(-place_of(book))
    return {
        STICKY: delta + share * values[0],
        error_of(STICKY): share * BY_PARAMETER * apart(values, GAIN),
    }


def _second_order(book: Book, marches: list[March], place: float, request: Request) -> dict[str, Any] | None:
    """Return vanna and volga with their errors; None where interrupted."""
    x, strike = np.array([place]), book.strike.item(0)
    vannas, volgas = [], []
    for k, march in enumerate(marches):
        if request.is_interrupted():
            return None
        step = 2.0**k * VOLGA_STEP * float(np.max(book.segments.volatility))
        vannas.append(float(_vega_tangent(book, march, x)[1, 0]))
        bumped = [Bump(book, "volatility")(np.array([by])) for by in (step, -step)]
        sides = [march_again(_problem(one, march), march) for one in bumped]
        places = _beside_boundary(book, place, march, sides)
        high, low = (
            float(_vega_tangent(one, side, np.array([at]))[0, 0])
            for one, side, at in zip(bumped, sides, places, strict=True)
        )
        # Along a way outside the contact set, less what the way itself adds.
        speed = (places[0] - places[1]) / (2.0 * step)
        volgas.append((high - low) / (2.0 * step) - vannas[-1] * speed)
    found = {}
    for name, values, scale in (("vanna", vannas, math.exp(-place)), ("volga", volgas, strike)):
        found[name] = np.array([scale * values[0]])
        found[error_of(name)] = np.array([scale * BY_PARAMETERS * apart(values, GAIN)])
    return found


def _beside_boundary(book: Book, place: float, march: March, sides: list[March]) -> list[float]:
    """Return where to look with a higher and with a lower volatility: next to the boundary this moves along with it."""
    is_put = book.is_put.item()
    own, high, low = (boundary_place(one, is_put=is_put) for one in (march, *sides))
    moves = 0.5 * (high - low)
    along = moves if abs(place - own) < CROSSED * abs(moves) else 0.0
    places = []
    for side, end, at in zip(sides, (high, low), (place + along, place - along), strict=True):
        touches = side.now.side(np.array([at]))[0] > 0 and not math.isnan(end)
        places.append(end if touches else at)
    return places


def _problem(book: Book, like: March) -> ObstacleProblem:
    times = [event.time for event in like.problem.events]
    return contract_problem(book, times, cut=bool(like.problem.diffusion.breaks))


def _vega_tangent(book: Book, march: March, x: Vector) -> Matrix:
    """Return the derivatives of V, V_x and V_xx at x by the volatility of a book of one contract, shape (3, 1)."""
    (planned,) = plan_directions(book, extended=False, only="vega")
    high, low = (_problem(side, march) for side in planned.sides)
    return tangent(march, Neighbours(high, low, planned.step), x)


def _copied(column: Vector | Ragged) -> Vector | Ragged:
    return Ragged(column.first, column.values.copy()) if isinstance(column, Ragged) else column.copy()
