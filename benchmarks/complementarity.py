"""Which solvers of complementarity problems solve which problems, and how does the time grow with the order?"""

import os
from collections import Counter
from collections.abc import Sequence

from matplotlib.figure import Figure

from benchmarks.lcs.large_problems import LargeRun, dense_runs, sparse_runs
from benchmarks.lcs.solver_table import METHODS, PEER_METHODS, Cell, cells
from benchmarks.problems.complementarity_sets import all_sets
from benchmarks.reporting.report import Report, Section, Table

SPARSE = {False: (10_000, 31_600, 100_000, 316_000, 1_000_000), True: (900, 3_600)}
DENSE = {False: (100, 200, 500, 1000, 2000), True: (50, 120)}
LEMKE_UP_TO = 1000
QUICK_SETS = 3
WORDS = ("solved", "refused", "not found", "wrong", "not for it")
# Okabe and Ito's colours, which colour-blind readers can tell apart; with the shapes no two lines are alike.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MARKERS = "os^DvPX*<>h"


def run(*, quick: bool) -> Report:
    """Measure and report; `quick` takes the first sets, and small orders."""
    sets = list(all_sets())[: QUICK_SETS if quick else None]
    table = [cell for name, problems in sets for cell in cells(name, problems)]
    sparse = list(sparse_runs(SPARSE[quick]))
    dense = list(dense_runs(DENSE[quick], LEMKE_UP_TO))
    return Report(
        "complementarity",
        "Complementarity problems: who solves what, and in what time",
        "Which solvers of complementarity problems solve which problems, and how does the time grow with the order?",
        (_solvers(table), _large(sparse), _dense(dense)),
        {
            "cells": [cell._asdict() for cell in table],
            "sparse": [run._asdict() for run in sparse],
            "dense": [run._asdict() for run in dense],
        },
    )


def _solvers(table: Sequence[Cell]) -> Section:
    peers = [f"Siconos {method}" for method in PEER_METHODS]
    solvers = [name for name in (*METHODS, *peers) if any(cell.solver == name for cell in table)]
    counts = {name: Counter(cell.verdict for cell in table if cell.solver == name) for name in solvers}
    totals_rows: list[tuple[str | int, ...]] = [
        (name, *[counts[name][word] for word in WORDS]) for name in solvers
    ]
    totals = Table(("solver", *WORDS), tuple(totals_rows), "totals")
    by_problem: dict[tuple[str, str, int], dict[str, Cell]] = {}
    for cell in table:
        by_problem.setdefault((cell.group, cell.problem, cell.unknowns), {})[cell.solver] = cell
    rows: tuple[tuple[str | int, ...], ...] = tuple(
        (*key, *(_shown(found.get(name)) for name in solvers)) for key, found in by_problem.items()
    )
    full = Table(("set", "problem", "unknowns", *solvers), rows, "problems")
    auto = counts["auto"]
    asked = "PRICING_SICONOS_PYTHON" in os.environ
    missing = "" if asked else " Siconos was not asked: PRICING_SICONOS_PYTHON is not set."
    text = f"""
        `solve` with method="auto" solves {auto["solved"]} of {auto.total()} problems and refuses {auto["refused"]} with
        a proof that there is no solution; {auto["not found"]} are not found and {auto["wrong"]} answers are wrong. The
        other rows are single methods, each of which serves some classes of matrices.{missing}

        A cell holds the scaled residual, the pivots or systems and the milliseconds of an answer whose scaled residual
        is at most 1e-9; else what became of it: refused (with a proof, where no solution is known), not found (nothing
        is claimed), not for it (a matrix that the method does not take), wrong. Each call has five seconds. Siconos is
        asked for the problems without free unknowns and second bounds.
        """
    return Section("Solvers and problems", text, (totals, full))


def _shown(cell: Cell | None) -> str:
    if cell is None:
        return ""
    if cell.verdict != "solved" or cell.milliseconds is None:
        return cell.verdict
    return f"{cell.residual:.0e}; {cell.pivots}; {cell.milliseconds:.2g}"


def _large(runs: Sequence[LargeRun]) -> Section:
    ours = [run for run in runs if run.solver == "solve" and run.seconds is not None]
    largest = max(ours, key=lambda run: (run.problem == "obstacle", run.unknowns))
    slowest = max(ours, key=lambda run: run.seconds or 0.0)
    text = f"""
        The five-point obstacle problem with a wavy obstacle takes {largest.seconds:.2g} s at {largest.unknowns:,}
        unknowns, to a natural residual of {largest.residual:.0e} max |q|, in {largest.iterations} iterations; the
        process had used at most {largest.memory:.2g} GB by then. The slowest of all is {slowest.problem} at
        {slowest.unknowns:,} unknowns with {slowest.seconds:.2g} s. Times are those of the processor in single runs,
        without that of forming the matrix.
        """
    table = Table(LargeRun._fields, tuple(tuple(run) for run in runs), "sparse")
    return Section("Large sparse problems", text, (table,), (("scaling", _figure(runs)),))


def _figure(runs: Sequence[LargeRun]) -> Figure:
    figure = Figure(figsize=(10.0, 5.5), layout="constrained")
    axes = figure.subplots()
    names = dict.fromkeys((run.problem, run.solver) for run in runs)
    for k, (problem, solver) in enumerate(names):
        points = [
            (run.unknowns, run.seconds)
            for run in runs
            if (run.problem, run.solver) == (problem, solver) and run.seconds is not None
        ]
        colour, marker = COLOURS[k % len(COLOURS)], MARKERS[k % len(MARKERS)]
        label = problem if solver == "solve" else f"{problem}, {solver}"
        if points:
            line = "-" if solver == "solve" else ":"
            axes.loglog(*zip(*points, strict=True), line, marker=marker, color=colour, label=label)
    axes.set_xlabel("unknowns")
    axes.set_ylabel("processor seconds")
    axes.grid(which="major", alpha=0.3)
    figure.legend(loc="outside right upper")
    return figure


def _dense(runs: Sequence[LargeRun]) -> Section:
    ours = max((run for run in runs if run.solver == "solve"), key=lambda run: run.unknowns)
    sentences = [f"`solve` takes {ours.seconds:.2g} s for {ours.unknowns:,} unknowns."]
    for peer in ("Lemke", "Siconos, Lemke"):
        found = [run for run in runs if run.solver == peer and run.seconds is not None]
        if found:
            last = max(found, key=lambda run: run.unknowns)
            beside = next(run for run in runs if run.solver == "solve" and run.unknowns == last.unknowns)
            if last.seconds is not None and beside.seconds is not None:
                ratio = last.seconds / beside.seconds
                sentences.append(f"At {last.unknowns:,} unknowns it is {ratio:.2g} times as fast as {peer}.")
    table = Table(LargeRun._fields, tuple(tuple(run) for run in runs), "dense")
    return Section("Dense random P-matrices", " ".join(sentences), (table,))
