"""What the comparison of the method of lines with Crank-Nicolson measured, and its report."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.measuring.frontier import Point, time_at
from benchmarks.method_of_lines.accuracy import OUTPUTS, UNITS
from benchmarks.method_of_lines.accuracy_study import COLUMNS, Run
from benchmarks.method_of_lines.findings import verdicts, winner_sentences
from benchmarks.method_of_lines.lcp_study import ELIMINATION, PROJECTION, RelaxationRun, SolverRun
from benchmarks.method_of_lines.order_study import Refinement, StepCounts, order_row
from benchmarks.method_of_lines.profiles import Profile
from benchmarks.problems.classic_sets import Problem
from benchmarks.reporting.plots import Panels, curves
from benchmarks.reporting.report import Report, Section, Table, table

TIME_ERRORS = {"price": 1e-6, "delta": 1e-5}  # at which time steps are compared on one grid
GAIN = 0.2  # Least share by which each point of a drawn envelope is more accurate than the one before.
RMSE = [f"RMSE, {UNITS[output]}" for output in OUTPUTS]


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """What was measured; `note` is to be read before the figures."""

    note: str
    problems: tuple[Problem, ...]
    runs: tuple[Run, ...]
    in_time: tuple[Refinement, ...]
    in_space: tuple[Refinement, ...]
    step_counts: StepCounts
    profile_grid: tuple[int, int]
    gamma: tuple[Profile, ...]
    boundary: tuple[Profile, ...]
    solvers: tuple[SolverRun, ...]
    relaxation: tuple[RelaxationRun, ...]


def compose(found: Comparison) -> Report:
    """Return the report."""
    runs = Table("runs", COLUMNS, tuple(run.row() for run in found.runs))
    question = """American options as a linear complementarity system, stepped implicitly, or by Crank-Nicolson finite
        differences: which is nearer the truth for its work, and at what?"""
    parts = (_winners(found), _accuracy(found), _steps(found), _profiles(found), _solvers(found))
    ends = (Section("How it was measured", METHOD), Section("All measurements", "", (runs,)))
    title = "The LCS method of lines and Crank-Nicolson finite differences"
    return Report("crank-nicolson", title, " ".join(question.split()), (*parts, *ends))


def _winners(found: Comparison) -> Section:
    by_time = verdicts(found.runs, lambda run: run.milliseconds)
    by_work = verdicts(found.runs, lambda run: run.node_steps)
    rows = [
        {"output": one.output, "RMSE": one.rmse, "LCS, ms": one.lcs.cost, "LCS method": one.lcs.method}
        | {"Crank-Nicolson, ms": one.crank_nicolson.cost, "Crank-Nicolson method": one.crank_nicolson.method}
        | {"Crank-Nicolson / LCS": one.ratio, "in node-steps": work.ratio}
        for one, work in zip(by_time, by_work, strict=True)
    ]
    text = """The fastest method of either family for an error (RMSE over all contracts), of all grids, steps and
        variants; node-steps are unknowns times implicit solves."""
    return Section(
        "Where each method wins",
        "\n\n".join([found.note, text, *winner_sentences(by_time)]),
        (table("winners", rows),),
    )


def _accuracy(found: Comparison) -> Section:
    text = """Each point is a grid and a number of steps, each line the best of them. "Boundary in its cell" places the
        exercise boundary between two nodes, as `price` does; "extrapolated" combines two resolutions."""

    def panels(cost: Callable[[Run], float]) -> Panels:
        lines = {run.method: [one for one in found.runs if one.method == run.method] for run in found.runs}
        return {
            output: {
                name: [(cost(one), one.errors[output].rmse) for one in runs] for name, runs in lines.items()
            }
            for output in OUTPUTS
        }

    by_time, by_work = panels(lambda run: run.milliseconds), panels(lambda run: run.node_steps / 1e3)
    figures = {
        "error-against-time": curves(by_time, "milliseconds per solve", RMSE, envelope=GAIN),
        "error-against-work": curves(by_work, "thousand node-steps per solve", RMSE, envelope=GAIN),
    }
    return Section("Error against work", text, figures=figures)


def _steps(found: Comparison) -> Section:
    text = f"""Errors are the distance to {found.step_counts.reference} square-root SDIRK2 steps on the same grid of
        {found.step_counts.intervals} cells: those of the time steps alone. The solves that an error needs are empty
        where more are needed than were tried. In space, at very many steps, errors are against true values. The order
        is the slope through the three finest levels; gamma and boundary jump when a node changes sides."""
    needed = [
        {"method": one.method}
        | {
            f"solves for {level:.0e} of {output}": _solves(one, output, level)
            for output, level in TIME_ERRORS.items()
        }
        for one in found.in_time
    ]
    panels = {
        output: {
            one.method: [(level.work, level.errors[output].rmse) for level in one.levels]
            for one in found.in_time
        }
        for output in OUTPUTS
    }
    ends = tuple(f"{output} {kind}" for output in OUTPUTS for kind in ("RMSE", "order"))
    tables = (
        table("solves-needed", needed),
        Table("orders-in-time", ("method", "implicit solves", *ends), tuple(map(order_row, found.in_time))),
        Table("orders-in-space", ("boundary", "cells", *ends), tuple(map(order_row, found.in_space))),
    )
    figures = {"time-steps": curves(panels, "implicit solves", RMSE)}
    return Section("Uniform, square-root and adaptive steps", text, tables, figures)


def _solves(refinement: Refinement, output: str, level: float) -> float | None:
    return time_at([Point(one.errors[output].rmse, one.work) for one in refinement.levels], level)


def _profiles(found: Comparison) -> Section:
    text = f"""{found.profile_grid[0]} cells, {found.profile_grid[1]} steps. Crank-Nicolson hardly damps short waves:
        what the payoff's kink and nodes changing sides set off stays in gamma and boundary, even where the price is
        good."""
    drawn = {
        "gamma-errors": (found.gamma, "spot (strikes)", "error of gamma, set C (times the strike)", 1e-2),
        "boundary-errors": (
            found.boundary,
            "years to expiry",
            "error of the boundary, set A (of itself)",
            1e-4,
        ),
    }
    figures = {
        name: curves(
            {
                one.label: {"error": list(zip(one.x.tolist(), one.y.tolist(), strict=True))}
                for one in profiles
            },
            x,
            "",
            what,
            scales=("linear", "symlog"),
            linear_below=least,
        )
        for name, (profiles, x, what, least) in drawn.items()
    }
    sizes = [
        {"method": gamma.label, "RMS error of gamma": _rms(gamma), "of the boundary": _rms(boundary)}
        for gamma, boundary in zip(found.gamma, found.boundary, strict=True)
    ]
    return Section("What averages hide: gamma and the boundary", text, (table("profiles", sizes),), figures)


def _rms(profile: Profile) -> float:
    return float(np.sqrt(np.mean(np.square(profile.y))))


def _solvers(found: Comparison) -> Section:
    finest = max(run.intervals for run in found.solvers)
    cost = {run.solver: run.microseconds for run in found.solvers if run.intervals == finest}
    fewest = min((run for run in found.relaxation), key=lambda run: (-run.intervals, run.sweeps))
    text = f"""On {finest} cells one step costs {cost[ELIMINATION]:.2g} microseconds by elimination, which solves the
        complementarity problem exactly, and {cost[PROJECTION]:.2g} by a linear solve and the maximum. PSOR needs the
        fewest sweeps on {fewest.intervals} cells, {fewest.sweeps:.0f} a step, with the relaxation parameter
        {fewest.relaxation:g}. The tables have means per step of (11.65) for set A; the residual is max |min(z, w)|,
        the difference is from elimination, both in strikes. The library's solvers check their answers, which is part
        of their time."""
    sweeps: dict[str, list[tuple[float, float]]] = {}
    for run in found.relaxation:
        sweeps.setdefault(f"{run.intervals} cells, {run.steps} steps", []).append(
            (run.relaxation, run.sweeps)
        )
    figure = curves({"": sweeps}, "relaxation parameter", "sweeps per step", scales=("linear", "log"))
    tables = (table("solvers", found.solvers), table("relaxation", found.relaxation))
    return Section("Exact complementarity and explicit projection", text, tables, {"relaxation": figure})


METHOD = """One solve serves all spots of a contract and its boundary at a tenth, a quarter, a half and all of its
life; within 1 % of the boundary, where it jumps, gamma is not compared. The true values come from the integral
equation of the exercise boundary, right to 1e-10 (price), 1e-9 (delta), 1e-7 (gamma) and 3e-7 (boundary). All methods
share grid, domain and code but for what is compared, on one thread, stage by stage in Python; a time is the least of
several, methods in turn. Crank-Nicolson begins with two steps of Rannacher's damping unless it says otherwise."""
