"""What the comparison of the method of lines with Crank-Nicolson measured, and its report."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from benchmarks.method_of_lines.accuracy import OUTPUTS, UNITS
from benchmarks.method_of_lines.accuracy_study import COLUMNS, Run
from benchmarks.method_of_lines.findings import (
    TIME_ERRORS,
    Verdict,
    mesh_sentence,
    projection_sentences,
    relaxation_sentences,
    verdicts,
    winner_sentences,
)
from benchmarks.method_of_lines.lcp_study import RelaxationRun, SolverRun
from benchmarks.method_of_lines.order_study import Refinement, StepCounts, order_row
from benchmarks.method_of_lines.profiles import Profile
from benchmarks.problems.classic_sets import Problem
from benchmarks.reporting.plots import Panels, curves
from benchmarks.reporting.report import Report, Section, Table, table

SCHEMES = ("SDIRK2", "Crank-Nicolson", "implicit Euler")
GAIN = 0.2  # Least share by which each point of a drawn envelope is more accurate than the one before.


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
    return Report(
        "crank-nicolson",
        "The LCS method of lines and Crank-Nicolson finite differences",
        "American options as a linear complementarity system, stepped implicitly, or by Crank-Nicolson finite "
        "differences: which is nearer the truth for its work, and at what?",
        (
            _winners(found),
            _accuracy(found.runs),
            _steps(found),
            _profiles(found),
            _solvers(found),
            _method(found.problems),
            Section(
                "All measurements", "", (Table("runs", COLUMNS, tuple(run.row() for run in found.runs)),)
            ),
        ),
    )


def _winners(found: Comparison) -> Section:
    by_time = verdicts(found.runs, lambda run: run.milliseconds)
    by_work = verdicts(found.runs, lambda run: run.node_steps)
    text = """The fastest method of either family for an error (RMSE over all contracts), of all grids, steps and
        variants tried; the last column compares node-steps (unknowns times implicit solves) in place of time."""
    rows = [_winner_row(*pair) for pair in zip(by_time, by_work, strict=True)]
    paragraphs = "\n\n".join([found.note, text, *winner_sentences(by_time)])
    return Section("Where each method wins", paragraphs, (table("winners", rows),))


def _winner_row(verdict: Verdict, work: Verdict) -> dict[str, str | float | None]:
    return {
        "output": verdict.output,
        "RMSE": verdict.rmse,
        "LCS, ms": verdict.lcs.cost,
        "LCS method": verdict.lcs.method,
        "Crank-Nicolson, ms": verdict.crank_nicolson.cost,
        "Crank-Nicolson method": verdict.crank_nicolson.method,
        "Crank-Nicolson / LCS": verdict.ratio,
        "in node-steps": work.ratio,
    }


def _error_figure(panels: Panels, work: str, title: str, envelope: float | None = None) -> Figure:
    return curves(panels, work, [f"RMSE, {UNITS[output]}" for output in OUTPUTS], title, envelope=envelope)


def _accuracy(runs: Sequence[Run]) -> Section:
    text = """Each point is a grid and a number of steps, each line the best of them. "Boundary in its cell" places the
        exercise boundary between two nodes in each stage, as `price` does; "extrapolated" combines two resolutions.
        Crank-Nicolson with exact problems differs from the method of lines in the time step alone."""

    def panels(cost: Callable[[Run], float]) -> Panels:
        methods = dict.fromkeys(run.method for run in runs)
        return {
            output: {
                method: [(cost(run), run.errors[output].rmse) for run in runs if run.method == method]
                for method in methods
            }
            for output in OUTPUTS
        }

    by_time, by_work = panels(lambda run: run.milliseconds), panels(lambda run: run.node_steps / 1e3)
    figures = {
        "error-against-time": _error_figure(by_time, "milliseconds per solve", "Error against time", GAIN),
        "error-against-work": _error_figure(
            by_work, "thousand node-steps per solve", "Error against work", GAIN
        ),
    }
    return Section("Error against work", text, figures=figures)


def _steps(found: Comparison) -> Section:
    sentences = [mesh_sentence(found.in_time, scheme, output) for output in TIME_ERRORS for scheme in SCHEMES]
    text = f"""On one grid of {found.step_counts.intervals} cells, errors are the distance to
        {found.step_counts.reference} square-root SDIRK2 steps on that grid: errors of the time steps alone. All solves
        of adaptive steps are counted, three in place of one. In space, at very many SDIRK2 steps, against the true
        values, the exercise boundary lies at a node or in its cell. The order is the slope through the three finest
        levels; errors of gamma and boundary jump when a node changes sides, and so do their orders."""
    panels = {
        output: {
            one.method: [(level.work, level.errors[output].rmse) for level in one.levels]
            for one in found.in_time
        }
        for output in OUTPUTS
    }
    figures = {"time-steps": _error_figure(panels, "implicit solves", "Errors of the time steps on one grid")}
    ends = tuple(f"{output} {kind}" for output in OUTPUTS for kind in ("RMSE", "order"))
    tables = (
        Table("orders-in-time", ("method", "implicit solves", *ends), tuple(map(order_row, found.in_time))),
        Table("orders-in-space", ("boundary", "cells", *ends), tuple(map(order_row, found.in_space))),
    )
    return Section(
        "Uniform, square-root and adaptive steps", text + "\n\n" + " ".join(sentences), tables, figures
    )


def _profiles(found: Comparison) -> Section:
    intervals, steps = found.profile_grid
    text = f"""{intervals} cells, {steps} steps. Crank-Nicolson hardly damps short waves: what the payoff's kink and
        nodes changing sides set off stays in delta, gamma and boundary, even where the price is good. SDIRK2 is
        L-stable and damps them."""
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
            markers=False,
        )
        for name, (profiles, x, what, least) in drawn.items()
    }
    sizes = [
        {
            "method": gamma.label,
            "RMS error of gamma": _rms(gamma),
            "RMS error of the boundary": _rms(boundary),
        }
        for gamma, boundary in zip(found.gamma, found.boundary, strict=True)
    ]
    return Section("What averages hide: gamma and the boundary", text, (table("profiles", sizes),), figures)


def _rms(profile: Profile) -> float:
    return float(np.sqrt(np.mean(np.square(profile.y))))


def _solvers(found: Comparison) -> Section:
    sentences = projection_sentences(found.solvers, found.runs, found.in_time)
    sentences += relaxation_sentences(found.relaxation, found.solvers)
    text = """The tables have means per step of (11.65) for set A; the residual is max |min(z, w)|, and the difference
        is that from elimination, both in strikes. The library's solvers check their answers as part of their time."""
    grids = dict.fromkeys((run.intervals, run.steps) for run in found.relaxation)
    sweeps = {
        f"{cells} cells, {steps} steps": [
            (run.relaxation, run.sweeps)
            for run in found.relaxation
            if (run.intervals, run.steps) == (cells, steps)
        ]
        for cells, steps in grids
    }
    title = "Projected SOR: sweeps against relaxation"
    figure = curves({"": sweeps}, "relaxation parameter", "sweeps per step", title, scales=("linear", "log"))
    tables = (table("solvers", found.solvers), table("relaxation", found.relaxation))
    paragraphs = " ".join(sentences) + "\n\n" + text
    return Section(
        "Exact complementarity and explicit projection", paragraphs, tables, {"relaxation": figure}
    )


def _method(problems: Sequence[Problem]) -> Section:
    spots = sum(problem.spots.size for problem in problems)
    text = f"""{len(problems)} contracts ({", ".join(problem.name for problem in problems)}) with {spots} spots at which
        they are held; one solve serves all spots of a contract and its boundary at a tenth, a quarter, a half and all
        of its life. Within 1 % of the boundary, where it jumps, gamma is not compared.

        The true values come from the integral equation of the exercise boundary (Kim; Andersen, Lake, Offengenden),
        solved by collocation: no grid in the spot, no time steps, no complementarity problem. They are right to 1e-10
        (price), 1e-9 (delta), 1e-7 (gamma) and 3e-7 (boundary).

        All methods share grid, domain and code but for what is compared, and run on one thread, stage by stage in
        Python; a time is the least of several, methods in turn. Crank-Nicolson begins with two steps of Rannacher's
        damping unless it says otherwise."""
    return Section("How it was measured", text)
