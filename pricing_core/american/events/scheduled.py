"""Price options with events: dividends at known times, curves, Bermudan dates, exercise windows."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pricing_core.american.contracts.contract import Option
from pricing_core.american.contracts.market import Market
from pricing_core.american.contracts.schedule import Schedule, make_schedule
from pricing_core.american.events.certain_schedule import certain_value, uncertainty
from pricing_core.american.events.collocated_greeks import DeadlinePassedError, collocated_greeks
from pricing_core.american.events.scheduled_book import ScheduledBook, scheduled_book
from pricing_core.american.events.scheduled_greeks import ScheduledGreeks, plan_greeks
from pricing_core.american.events.scheduled_lcs import (
    ScheduledSolution,
    solve_schedule_lcs,
    values_on_same_grid,
)
from pricing_core.american.events.scheduled_values import (
    Found,
    Settled,
    collocate,
    found_alone,
    further_greeks,
    is_certain,
    priced_rows,
)
from pricing_core.american.price_table import SENSITIVITIES, Table, empty_table, fill_row, fill_rows
from pricing_core.american.results import Diagnostics, Status, Valuation, without_price
from pricing_core.american.solver_settings import Greeks, SolverSettings
from pricing_core.arrays import Vector
from pricing_core.errors import PricingCoreError

COLLOCATION_METHOD = "multiplier-collocation"
SPOT_STEP = 1e-3  # of the spot, for the delta of a certain path


def price_scheduled_many(
    book: ScheduledBook,
    tolerance: Vector,
    *,
    greeks: bool,
    threads: int,
    interrupt: Callable[[], bool] | None = None,
) -> Table:
    """Price contracts with events; what cannot be priced gets the status "out_of_domain".

    Parameters
    ----------
    tolerance : Vector, shape (n,)
        Fractions of the strikes.
    greeks : bool
    threads : int
    interrupt : callable, optional
        Asked before every time step of the general path; rows that it ends have the status "deadline".
    """
    table = empty_table(book.spot.size)
    settled = collocate(book.schedules, tolerance, threads)
    rows, part, found = settled.rows, book.take(settled.rows), settled.found
    derivatives = _derivatives(part, settled, greeks, threads=threads)
    fill_rows(
        table,
        rows,
        priced_rows(part, found, derivatives),
        payoff=part.payoff(),
        tolerance=tolerance[rows] * part.schedules.strike,
        method=COLLOCATION_METHOD,
    )
    for row in (*np.flatnonzero(found.exercised).tolist(), *derivatives):
        further = further_greeks(part, found, derivatives, row)
        table[SENSITIVITIES][rows[row]] = further.dividend_sensitivities or ()
    for row in np.setdiff1d(np.arange(book.spot.size), rows).tolist():
        option, market = book.contract(row)
        settings = SolverSettings(tolerance.item(row), greeks=greeks, interrupt=interrupt)
        try:
            valuation = price_scheduled_alone(option, market, settings)
        except (PricingCoreError, ArithmeticError) as error:
            nothing = without_price(option, market.spot, math.nan)
            valuation = replace(nothing, status="out_of_domain", diagnostics=Diagnostics(str(error)))
        fill_row(table, row, valuation)
    return table


def price_scheduled(option: Option, market: Market, settings: SolverSettings) -> Valuation:
    """Price one contract with events."""
    book = scheduled_book([(option, market)])
    if settings.is_interrupted():
        return without_price(option, market.spot, math.nan)
    if settings.is_automatic:
        settled = collocate(book.schedules, np.array([settings.tolerance]), 1)
        if settled.rows.size:
            derivatives, interrupted = {}, False
            try:
                derivatives = _derivatives(book, settled, settings.greeks, interrupt=settings.interrupt)
            except DeadlinePassedError:
                interrupted = True
            diagnostics = Diagnostics("multiplier collocation", solves=1 + settled.level.item())
            method, tolerance = COLLOCATION_METHOD, settings.tolerance
            valuation = _valuation(book, settled.found, derivatives, tolerance, method, diagnostics)
            return replace(valuation, status="deadline") if interrupted else valuation
    return price_scheduled_alone(option, market, settings)


def price_scheduled_alone(option: Option, market: Market, settings: SolverSettings) -> Valuation:
    """Price one contract by its certain path or on the general path."""
    book, schedule = scheduled_book([(option, market)]), make_schedule(option, market)
    interrupted = False
    if is_certain(book.schedules, np.array([settings.tolerance]))[0]:
        found, solve = _certain(schedule, uncertainty(book.schedules).item()), _certain_values
        diagnostics = Diagnostics("zero volatility" if schedule.spot > 0.0 else "worthless underlying")
        method = diagnostics.solved_by.replace(" ", "-")
    else:
        solution = solve_schedule_lcs(
            schedule,
            settings.tolerance,
            scheme=settings.scheme,
            lcp_method=settings.lcp_method,
            resolution=settings.resolution,
            interrupt=settings.interrupt,
        )
        if math.isnan(solution.value):
            return without_price(option, market.spot, solution.european)
        found, solve = _from_lcs(option, solution), partial(values_on_same_grid, solution)
        diagnostics, interrupted = _diagnostics(solution, settings.lcp_method), solution.interrupted
        method = solution.resolution.scheme or "sdirk2"
    derivatives = {}
    if settings.greeks is not False and not interrupted and not found.exercised[0]:
        plan = plan_greeks(option, market, extended=settings.greeks == "extended")
        values = solve((schedule, *plan.schedules))
        derivatives[0] = plan.finish(values[0][0], values[1:])
        if not derivatives[0].is_whole() and settings.is_interrupted():
            derivatives, interrupted = {}, True
    valuation = _valuation(book, found, derivatives, settings.tolerance, method, diagnostics)
    return replace(valuation, status="deadline") if interrupted else valuation


def _derivatives(
    book: ScheduledBook,
    settled: Settled,
    greeks: Greeks,
    *,
    threads: int = 1,
    interrupt: Callable[[], bool] | None = None,
) -> dict[int, ScheduledGreeks]:
    """Return the derivatives by the parameters of the rows that are held."""
    if greeks is False:
        return {}
    held = np.flatnonzero(~settled.found.exercised).tolist()
    return collocated_greeks(
        {row: book.contract(row) for row in held},
        {row: settled.level.item(row) for row in held},
        extended=greeks == "extended",
        threads=threads,
        interrupt=interrupt,
    )


def _valuation(
    book: ScheduledBook,
    found: Found,
    derivatives: Mapping[int, ScheduledGreeks],
    tolerance: float,
    method: str,
    diagnostics: Diagnostics,
) -> Valuation:
    """Return the valuation of a book of one row."""
    option, market = book.contract(0)
    status: Status = "ok" if found.error[0] <= tolerance * option.strike else "tolerance_not_met"
    return priced_rows(book, found, derivatives).valuation(
        option,
        market.spot,
        status=status,
        method=method,
        diagnostics=diagnostics,
        further=further_greeks(book, found, derivatives, 0),
    )


def _certain_values(schedules: Sequence[Schedule]) -> list[tuple[float, float]]:
    return [(certain_value(schedule), math.nan) for schedule in schedules]


def _certain(schedule: Schedule, error: float) -> Found:
    """Return the value on the certain path; its derivatives by the spot are differences."""
    value = certain_value(schedule)
    step = SPOT_STEP * schedule.spot
    delta = math.nan
    if step > 0.0:
        up, down = (certain_value(replace(schedule, spot=schedule.spot + by)) for by in (step, -step))
        delta = (up - down) / (2.0 * step)
    first = schedule.segments[0]
    pays = (schedule.strike - first.escrow_at(0.0) - schedule.spot) * (1.0 if schedule.is_put else -1.0)
    return found_alone(
        value=value,
        european=certain_value(schedule, exercise=False),
        delta=delta,
        gamma=0.0,
        error=error,
        boundary=math.nan,
        exercised=first.exercisable and 0.0 < value <= pays,
    )


def _from_lcs(option: Option, solution: ScheduledSolution) -> Found:
    return found_alone(
        value=solution.value,
        european=solution.european,
        delta=solution.delta,
        gamma=solution.gamma,
        error=solution.error,
        boundary=solution.region.boundaries(option)[0],
        exercised=solution.exercised,
    )


def _diagnostics(solution: ScheduledSolution, lcp_method: str) -> Diagnostics:
    return Diagnostics(
        "method of lines",
        resolution=solution.resolution,
        solves=solution.solves,
        steps_taken=solution.steps,
        lcp_method=lcp_method,
        lcp_residual=solution.lcp_residual,
        fitted=solution.fitted,
    )
