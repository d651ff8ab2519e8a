"""Sections on the parts of a method: its time steps, its damping, its complementarity problems."""

from collections.abc import Iterable

from benchmarks.measuring.frontier import Point
from benchmarks.method_of_lines.accuracy import OUTPUTS
from benchmarks.method_of_lines.comparison import Comparison
from benchmarks.method_of_lines.figures import error_figure, profile_figure, relaxation_figure
from benchmarks.method_of_lines.findings import (
    TIME_ERRORS,
    mesh_sentence,
    profile_sentence,
    projection_sentences,
    relaxation_sentences,
)
from benchmarks.method_of_lines.order_study import Refinement, order_row
from benchmarks.reporting.report import Section, Table


def steps_section(found: Comparison) -> Section:
    """Return what time steps do on one grid, and cells at very many steps."""
    counts = found.step_counts
    schemes = ("SDIRK2", "Crank-Nicolson", "implicit Euler")
    sentences = [mesh_sentence(found.in_time, scheme, output) for output in TIME_ERRORS for scheme in schemes]
    text = (
        f"On one grid of {counts.intervals} cells, with the boundary at a node, errors are the distance to "
        f"{counts.reference} square-root SDIRK2 steps on that grid: errors of the time steps alone. Adaptive steps "
        "are controlled by step doubling, whose three solves in place of one are counted; they need not know where "
        "the solution is steep.\n\n"
        + " ".join(sentences)
        + "\n\nThe order is the slope through the three finest levels; errors of gamma and boundary jump when a "
        "node changes sides, and so do their orders. In space, at very many SDIRK2 steps, against the true values, "
        "the exercise boundary lies at a node, as the complementarity problem alone leaves it, or in its cell."
    )
    curves = {
        refinement.method: {
            output: [Point(level.errors[output].rmse, level.work) for level in refinement.levels]
            for output in OUTPUTS
        }
        for refinement in found.in_time
    }
    figure = error_figure(
        curves, "implicit solves", "Errors of the time steps on one grid", envelope_gain=None
    )
    tables = (
        _order_table("method", "implicit solves", found.in_time, "orders-in-time"),
        _order_table("boundary", "cells", found.in_space, "orders-in-space"),
    )
    return Section("Uniform, square-root and adaptive steps", text, tables, (("time-steps", figure),))


def _order_table(what: str, work: str, refinements: Iterable[Refinement], name: str) -> Table:
    columns = (what, work, *(f"{output} {kind}" for output in OUTPUTS for kind in ("RMSE", "order")))
    return Table(columns, tuple(order_row(refinement) for refinement in refinements), name)


def profile_section(found: Comparison) -> Section:
    """Return gamma along the spot, and the boundary along time."""
    intervals, steps = found.profile_grid
    text = (
        f"{intervals} cells, {steps} steps. Crank-Nicolson hardly damps short waves: what the payoff's kink and "
        "nodes changing sides set off stays in delta, gamma and boundary, even where the price is good. SDIRK2 "
        "is L-stable and damps them.\n\n"
        + profile_sentence(found.gamma, "gamma")
        + " "
        + profile_sentence(found.boundary, "the boundary")
    )
    figures = (
        (
            "gamma-errors",
            profile_figure(
                found.gamma,
                ("spot (strikes)", "error of gamma (times the strike)"),
                "Error of gamma above the exercise boundary, set C",
                least=1e-2,
            ),
        ),
        (
            "boundary-errors",
            profile_figure(
                found.boundary,
                ("time to expiry (years)", "error of the exercise boundary (fraction of itself)"),
                "Error of the exercise boundary, set A",
                least=1e-4,
            ),
        ),
    )
    return Section("What averages hide: gamma and the boundary", text, (), figures)


def solver_section(found: Comparison) -> Section:
    """Return what the complementarity problem of a step costs, and what projection in its place does."""
    text = (
        " ".join(projection_sentences(found.solvers, found.runs, found.in_time))
        + "\n\n"
        + " ".join(relaxation_sentences(found.relaxation, found.solvers))
        + " The table has every solver on the same problems, those of all steps of (11.65) for set A; the "
        "residual is max |min(z, w)|, and the difference is that from elimination, both in strikes. The library's "
        "solvers check their answers, which is part of their time."
    )
    columns = (
        "solver",
        "cells",
        "steps",
        "microseconds per step",
        "iterations",
        "largest residual",
        "largest difference",
    )
    sweeps = ("cells", "steps", "relaxation", "sweeps per step", "microseconds per step")
    tables = (Table(columns, found.solvers, "solvers"), Table(sweeps, found.relaxation, "relaxation"))
    figures = (("relaxation", relaxation_figure(found.relaxation)),)
    return Section("Exact complementarity and explicit projection", text, tables, figures)
