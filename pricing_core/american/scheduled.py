"""Price options with events: dividends at known times, curves, Bermudan dates, exercise windows."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from pricing_core.american.certain_schedule import certain_value, uncertainty
from pricing_core.american.collocated_greeks import DeadlinePassedError, Found, Greeks, collocated_greeks
from pricing_core.american.collocation import is_served, solve_to_tolerance
from pricing_core.american.contract import Option
from pricing_core.american.limits import ClosedValue
from pricing_core.american.market import Market
from pricing_core.american.resolution import Resolution, Scheme
from pricing_core.american.results import (
    NO_FURTHER_GREEKS,
    Diagnostics,
    FurtherGreeks,
    Status,
    Valuation,
    assemble,
    without_price,
)
from pricing_core.american.schedule import Schedule, make_schedule
from pricing_core.american.scheduled_greeks import ScheduledGreeks, plan_greeks
from pricing_core.american.scheduled_lcs import ScheduledSolution, solve_schedule_lcs, values_on_same_grid
from pricing_core.american.tridiagonal_step import LCPMethod
from pricing_core.arrays import Vector
from pricing_core.errors import InvalidInputError, PricingCoreError

COLLOCATION_METHOD = "multiplier-collocation"
SURE_SHARE = 0.1  # of the tolerance: what chance may add where it is left out
SPOT_STEP = 1e-3  # of the spot, for the delta of a certain path


def price_scheduled_many(
    contracts: Sequence[tuple[Option, Market]], tolerance: Sequence[float], *, greeks: Greeks, threads: int
) -> list[Valuation]:
    """Price contracts with events; what cannot be priced gets the status "out_of_domain".

    Parameters
    ----------
    tolerance : sequence of float
        Of each contract, a fraction of its strike.
    greeks : bool or "extended"
    threads : int
    """
    valuations: list[Valuation | None] = [None] * len(contracts)
    schedules: dict[int, Schedule] = {}
    for row, (option, market) in enumerate(contracts):
        try:
            schedules[row] = make_schedule(option, market)
        except InvalidInputError as fault:
            valuations[row] = _refused(option, market, "invalid_input", fault)
    served = [row for row, s in schedules.items() if is_served(s) and not _is_certain(s, tolerance[row])]
    values = _collocate(
        [schedules[row] for row in served], np.array([tolerance[row] for row in served]), threads
    )
    found = {row: value for row, value in zip(served, values, strict=True) if value is not None}
    derivatives = collocated_greeks(contracts, schedules, found, greeks, threads=threads)
    for row, schedule in schedules.items():
        option, market = contracts[row]
        try:
            if row in found:
                valuations[row] = _assembled(
                    option, market, schedule, found[row], tolerance[row], derivatives.get(row)
                )
            else:
                valuations[row] = price_scheduled_alone(
                    option, market, schedule, tolerance[row], greeks=greeks
                )
        except (PricingCoreError, ArithmeticError) as error:
            valuations[row] = _refused(option, market, "out_of_domain", error)
    return [valuation for valuation in valuations if valuation is not None]


def price_scheduled(
    option: Option,
    market: Market,
    tolerance: float,
    *,
    use_collocation: bool,
    scheme: Scheme = "sdirk2",
    lcp_method: LCPMethod = "tridiagonal",
    greeks: Greeks = True,
    resolution: Resolution | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> Valuation:
    """Price one contract with events; parameters as for `pricing_core.american.price`."""
    schedule = make_schedule(option, market)
    if interrupt is not None and interrupt():
        return without_price(option, market.spot, math.nan)
    if use_collocation and is_served(schedule) and not _is_certain(schedule, tolerance):
        found = _collocate([schedule], np.array([tolerance]), 1)[0]
        if found is not None:
            further: dict[int, ScheduledGreeks] = {}
            try:
                rows = [(option, market)], {0: schedule}, {0: found}
                further = collocated_greeks(*rows, greeks, interrupt=interrupt)
            except DeadlinePassedError:
                found = replace(found, interrupted=True)
            return _assembled(option, market, schedule, found, tolerance, further.get(0))
    return price_scheduled_alone(
        option, market, schedule, tolerance,
        scheme=scheme, lcp_method=lcp_method, greeks=greeks, resolution=resolution, interrupt=interrupt,
    )  # fmt: skip


def price_scheduled_alone(
    option: Option,
    market: Market,
    schedule: Schedule,
    tolerance: float,
    *,
    scheme: Scheme = "sdirk2",
    lcp_method: LCPMethod = "tridiagonal",
    greeks: Greeks = True,
    resolution: Resolution | None = None,
    interrupt: Callable[[], bool] | None = None,
) -> Valuation:
    """Price one contract by its certain path or on the general path."""
    if _is_certain(schedule, tolerance):
        found, solve = _certain(schedule), _certain_values
    else:
        solution = solve_schedule_lcs(
            schedule,
            tolerance,
            scheme=scheme,
            lcp_method=lcp_method,
            resolution=resolution,
            interrupt=interrupt,
        )
        if math.isnan(solution.value):
            return without_price(option, market.spot, solution.european)
        found, solve = _from_lcs(option, solution, lcp_method), partial(values_on_same_grid, solution)
    derivatives = None
    if greeks is not False and not found.interrupted and not found.exercised:
        plan = plan_greeks(option, market, extended=greeks == "extended")
        values = solve((schedule, *plan.schedules))
        derivatives = plan.finish(values[0][0], values[1:])
    return _assembled(option, market, schedule, found, tolerance, derivatives)


def _is_certain(schedule: Schedule, tolerance: float) -> bool:
    return uncertainty(schedule) <= SURE_SHARE * tolerance * schedule.strike


def _certain_values(schedules: Sequence[Schedule]) -> list[tuple[float, float]]:
    return [(certain_value(schedule), math.nan) for schedule in schedules]


def _certain(schedule: Schedule) -> Found:
    """Return the value on the certain path; its derivatives by the spot are differences."""
    value = certain_value(schedule)
    step = SPOT_STEP * schedule.spot
    delta = math.nan
    if step > 0.0:
        up, down = (certain_value(replace(schedule, spot=schedule.spot + by)) for by in (step, -step))
        delta = (up - down) / (2.0 * step)
    first = schedule.segments[0]
    pays = (schedule.strike - escrow_now(schedule) - schedule.spot) * (1.0 if schedule.is_put else -1.0)
    return Found(
        value=value,
        european=certain_value(schedule, exercise=False),
        delta=delta,
        gamma=0.0,
        error=uncertainty(schedule),
        boundary=math.nan,
        exercised=first.exercisable and 0.0 < value <= pays,
        method="zero-volatility" if schedule.spot > 0.0 else "worthless-underlying",
        diagnostics=Diagnostics("zero volatility" if schedule.spot > 0.0 else "worthless underlying"),
    )


def _collocate(schedules: Sequence[Schedule], tolerance: Vector, threads: int) -> list[Found | None]:
    """Return what the collocation finds, None where it does not settle."""
    if not schedules:
        return []
    solved = solve_to_tolerance(schedules, tolerance, threads)
    found: list[Found | None] = []
    for row, schedule in enumerate(schedules):
        if not solved.settled[row] or not math.isfinite(solved.error[row]):
            found.append(None)
            continue
        K, S = schedule.strike, schedule.spot
        value, slope, curvature = (float(c[row]) for c in (solved.value, solved.slope, solved.curvature))
        place = float(solved.boundary[row])
        sign = 1.0 if schedule.is_put else -1.0
        without = K * float(solved.european[row])
        error = K * float(solved.error[row])
        least = (
            max(without, sign * (K - escrow_now(schedule) - S))
            if schedule.segments[0].exercisable
            else without
        )
        found.append(
            Found(
                value=max(K * value, least),
                european=without,
                delta=K / S * slope,
                gamma=K / S * ((curvature - slope) / S),
                error=max(error, least - K * value),
                boundary=K * math.exp(place) + escrow_now(schedule) if not math.isnan(place) else math.nan,
                exercised=sign * (place - math.log(S / K)) >= 0.0,
                method=COLLOCATION_METHOD,
                diagnostics=Diagnostics("multiplier collocation", solves=1 + int(solved.level[row])),
            )
        )
    return found


def escrow_now(schedule: Schedule) -> float:
    """Return A now, money."""
    return schedule.segments[0].escrow_at(0.0)


def _from_lcs(option: Option, solution: ScheduledSolution, lcp_method: str) -> Found:
    return Found(
        value=solution.value,
        european=solution.european,
        delta=solution.delta,
        gamma=solution.gamma,
        error=solution.error,
        boundary=solution.region.boundaries(option)[0],
        exercised=solution.exercised,
        method=solution.resolution.scheme or "sdirk2",
        diagnostics=Diagnostics(
            "method of lines",
            resolution=solution.resolution,
            solves=solution.solves,
            steps_taken=solution.steps,
            lcp_method=lcp_method,
            lcp_residual=solution.lcp_residual,
            fitted=solution.fitted,
        ),
        interrupted=solution.interrupted,
    )


def _assembled(
    option: Option,
    market: Market,
    schedule: Schedule,
    found: Found,
    tolerance: float,
    derivatives: ScheduledGreeks | None,
) -> Valuation:
    """Return the valuation; in the exercise region the derivatives are the payoff's."""
    status: Status = "ok" if found.error <= tolerance * option.strike else "tolerance_not_met"
    value, delta, gamma, theta = found.value, found.delta, found.gamma, _theta(schedule, found)
    vega = rho = dividend_rho = math.nan
    further = NO_FURTHER_GREEKS
    if derivatives is not None:
        vega, rho, dividend_rho = derivatives.vega, derivatives.rho, derivatives.dividend_rho
        further = derivatives.further
    if found.exercised:
        value, delta, gamma, theta = option.payoff(market.spot), (-1.0 if option.is_put else 1.0), 0.0, 0.0
        vega = rho = dividend_rho = 0.0
        further = FurtherGreeks(tuple(0.0 for _ in market.cash_dividends) or None)
    return assemble(
        option,
        market.spot,
        ClosedValue(value, delta, gamma, theta, vega, rho, dividend_rho, found.error),
        european=found.european,
        boundary=found.boundary,
        exercise_now=found.exercised and option.payoff(market.spot) > 0.0,
        status="deadline" if found.interrupted else status,
        method=found.method,
        diagnostics=found.diagnostics,
        further=further,
    )


def _theta(schedule: Schedule, found: Found) -> float:
    """Return dV/dt where the option is held, from (11.46); in the escrowed model A grows under a given spot."""
    first, S = schedule.segments[0], schedule.spot
    drift = (first.rate - first.dividend_yield) * S + first.rate * escrow_now(schedule)
    return first.rate * found.value - drift * found.delta - 0.5 * (first.volatility * S) ** 2 * found.gamma


def _refused(option: Option, market: Market, status: Status, error: Exception) -> Valuation:
    """Return a valuation that says why there is no price."""
    nothing = without_price(option, market.spot, math.nan)
    return replace(nothing, status=status, diagnostics=Diagnostics(str(error)))
