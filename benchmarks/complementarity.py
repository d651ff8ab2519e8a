"""Which solvers of complementarity problems solve which problems, and how does the time grow with the order?"""

import os
from collections import Counter
from collections.abc import Sequence

from matplotlib.figure import Figure

from benchmarks.lcs.large_problems import DEGENERATE_CLASSES, LargeRun, dense_runs, sparse_runs
from benchmarks.lcs.solver_table import METHODS, PEER_METHODS, Cell, cells
from benchmarks.problems.complementarity_sets import all_sets
from benchmarks.reporting.plots import curves
from benchmarks.reporting.report import Report, Section, Table, table
from benchmarks.reporting.scaling import exponent

SPARSE = {False: (50, 200, 1000, 10_000, 100_000, 1_000_000), True: (50, 900)}
DENSE = {False: (50, 100, 200, 500, 1000, 2000), True: (50, 120)}
DEGENERATE = {False: (50, 100, 200), True: (20, 50)}
FITTED = 3  # the largest orders, for an exponent
LEMKE_UP_TO = 1000
QUICK_SETS = 3
WORDS = ("solved", "refused", "not found", "wrong", "not for it")


def run(*, quick: bool) -> Report:
    """Measure and report; `quick` takes the first sets, and small orders."""
    sets = list(all_sets())[: QUICK_SETS if quick else None]
    found = [cell for name, problems in sets for cell in cells(name, problems)]
    sparse = list(sparse_runs(SPARSE[quick]))
    dense = list(dense_runs(DENSE[quick], LEMKE_UP_TO))
    degenerate = list(dense_runs(DEGENERATE[quick], LEMKE_UP_TO, DEGENERATE_CLASSES))
    return Report(
        "complementarity",
        "Complementarity problems: who solves what, and in what time",
        "Which solvers of complementarity problems solve which problems, and how does the time grow with the order?",
        (
            _solvers(found),
            _large(sparse),
            _dense(dense, "Dense random P-matrices", "dense"),
            _dense(degenerate, "Dense degenerate problems", "degenerate"),
        ),
        {"cells": [cell._asdict() for cell in found]},
    )


def _solvers(found: Sequence[Cell]) -> Section:
    peers = [f"Siconos {method}" for method in PEER_METHODS]
    solvers = [name for name in (*METHODS, *peers) if any(cell.solver == name for cell in found)]
    counts = {name: Counter(cell.verdict for cell in found if cell.solver == name) for name in solvers}
    totals_rows: list[tuple[str | int, ...]] = [
        (name, *[counts[name][word] for word in WORDS]) for name in solvers
    ]
    totals = Table("totals", ("solver", *WORDS), tuple(totals_rows))
    by_problem: dict[tuple[str, str, int], dict[str, Cell]] = {}
    for cell in found:
        by_problem.setdefault((cell.group, cell.problem, cell.unknowns), {})[cell.solver] = cell
    rows: tuple[tuple[str | int, ...], ...] = tuple(
        (*key, *(_shown(answers.get(name)) for name in solvers)) for key, answers in by_problem.items()
    )
    full = Table("problems", ("set", "problem", "unknowns", *solvers), rows)
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
        without that of forming the matrix; Siconos is given dense matrices, which is the form that its methods take.

        The time of `solve` grows with the unknowns to the power of: {_powers(runs)}.
        """
    return Section(
        "Sparse and tridiagonal problems", text, (table("sparse", runs),), {"scaling": _figure(runs)}
    )


def _lines(runs: Sequence[LargeRun]) -> dict[str, list[tuple[float, float]]]:
    """Return (unknowns, seconds) by problem and solver."""
    lines: dict[str, list[tuple[float, float]]] = {}
    for run in runs:
        label = run.problem if run.solver == "solve" else f"{run.problem}, {run.solver}"
        pairs = lines.setdefault(label, [])
        if run.seconds:
            pairs.append((run.unknowns, run.seconds))
    return lines


def _powers(runs: Sequence[LargeRun]) -> str:
    lines = _lines([run for run in runs if run.solver == "solve"])
    return ", ".join(f"{name} {exponent(pairs, FITTED):.2f}" for name, pairs in lines.items())


def _figure(runs: Sequence[LargeRun]) -> Figure:
    return curves({"": _lines(runs)}, "unknowns", "processor seconds")


def _dense(runs: Sequence[LargeRun], title: str, name: str) -> Section:
    """Return what became of dense problems of several kinds and orders, beside Lemke's method here and elsewhere."""
    sentences = [f"The time of `solve` grows with the unknowns to the power of: {_powers(runs)}."]
    seconds = {(run.problem, run.unknowns, run.solver): run.seconds for run in runs if run.solved}
    for peer in ("Lemke", "Siconos, Lemke"):
        ratios = {
            key[:2]: theirs / ours
            for key, theirs in seconds.items()
            if key[2] == peer and theirs and (ours := seconds.get((*key[:2], "solve")))
        }
        if ratios:
            problem, order = max(ratios, key=lambda key: key[1])
            ratio = ratios[problem, order]
            sentences.append(f"At {order:,} unknowns ({problem}) it is {ratio:.2g} times as fast as {peer}.")
    for solver in dict.fromkeys(run.solver for run in runs):
        of_it = [run for run in runs if run.solver == solver]
        solved = sum(run.solved for run in of_it)
        sentences.append(
            f"{solver[0].upper()}{solver[1:]} finds an answer to {solved} of {len(of_it)} problems."
        )
    return Section(title, " ".join(sentences), (table(name, runs),), {name: _figure(runs)})
