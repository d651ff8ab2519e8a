"""The comparison of the method of lines with Crank-Nicolson in words, tables and figures."""

from collections.abc import Callable, Mapping, Sequence

from benchmarks.measuring.frontier import Point
from benchmarks.method_of_lines.accuracy import OUTPUTS
from benchmarks.method_of_lines.accuracy_study import COLUMNS, Run
from benchmarks.method_of_lines.comparison import Comparison, results
from benchmarks.method_of_lines.figures import error_figure
from benchmarks.method_of_lines.findings import Verdict, verdicts, winner_sentences
from benchmarks.method_of_lines.sections import profile_section, solver_section, steps_section
from benchmarks.reporting.report import Report, Section, Table

GAIN = 0.2  # Least share by which each point of a drawn envelope is more accurate than the one before.


def compose(found: Comparison) -> Report:
    """Return the report."""
    by_time = verdicts(found.runs, _milliseconds)
    by_work = verdicts(found.runs, _node_steps)
    return Report(
        name="crank-nicolson",
        title="The LCS method of lines and Crank-Nicolson finite differences",
        question=(
            "American options as a linear complementarity system, stepped implicitly, or by Crank-Nicolson "
            "finite differences: which is nearer the truth for its work, and at what?"
        ),
        sections=(
            _winners_section(found.note, by_time, by_work),
            _accuracy_section(found),
            steps_section(found),
            profile_section(found),
            solver_section(found),
            _method_section(found),
            Section(
                "All measurements", "", (Table(COLUMNS, tuple(run.row() for run in found.runs), "runs"),)
            ),
        ),
        results=results(found, by_time, by_work),
    )


def _milliseconds(run: Run) -> float:
    return run.milliseconds


def _node_steps(run: Run) -> float:
    return run.node_steps


def _thousands(run: Run) -> float:
    return run.node_steps / 1e3


def _winners_section(note: str, by_time: Sequence[Verdict], by_work: Sequence[Verdict]) -> Section:
    families = (
        "The fastest method of either family for an error (RMSE over all contracts), of all grids, steps and "
        "variants that were tried. The LCS method of lines is stepped by implicit Euler, as in (11.65), or by "
        "SDIRK2, with the complementarity problem of every stage solved exactly; Crank-Nicolson takes its problems "
        "exactly too, or by explicit projection."
    )
    work_column = (
        "The last column compares node-steps (unknowns times implicit solves) in place of time: SDIRK2 solves "
        "twice a step, Crank-Nicolson once."
    )
    text = "\n\n".join([note, families, *winner_sentences(by_time), work_column])
    rows = tuple(
        (
            verdict.output,
            verdict.rmse,
            *(verdict.lcs or (None, None))[::-1],
            *(verdict.crank_nicolson or (None, None))[::-1],
            verdict.ratio,
            work.ratio,
        )
        for verdict, work in zip(by_time, by_work, strict=True)
    )
    columns = (
        "output",
        "RMSE",
        "LCS, ms",
        "LCS method",
        "Crank-Nicolson, ms",
        "Crank-Nicolson method",
        "Crank-Nicolson / LCS",
        "in node-steps",
    )
    return Section("Where each method wins", text, (Table(columns, rows, "winners"),))


def _accuracy_section(found: Comparison) -> Section:
    text = (
        'Each point is a grid and a number of steps, each line the best of them. With "boundary in its cell" each '
        "stage also places the exercise boundary between two nodes, as `price` does; of a Crank-Nicolson step that "
        'corrects the implicit half alone. "extrapolated" combines two resolutions; `price` moreover takes out the '
        "error that the European value has on the same grids. The boundary is never extrapolated. Crank-Nicolson "
        "with exact problems is the method of lines with another time step: there the two differ in nothing else."
    )
    figures = tuple(
        (
            name,
            error_figure(_curves(found.runs, cost), work, f"Error against {title}", envelope_gain=GAIN),
        )
        for name, cost, work, title in (
            ("error-against-time", _milliseconds, "milliseconds per solve", "time"),
            ("error-against-work", _thousands, "thousand node-steps per solve", "node-steps"),
        )
    )
    return Section("Error against work", text, (), figures)


def _curves(runs: Sequence[Run], cost: Callable[[Run], float]) -> Mapping[str, Mapping[str, Sequence[Point]]]:
    methods = dict.fromkeys(run.method for run in runs)
    return {
        method: {
            output: [Point(run.errors[output].rmse, cost(run)) for run in runs if run.method == method]
            for output in OUTPUTS
        }
        for method in methods
    }


def _method_section(found: Comparison) -> Section:
    spots = sum(problem.spots.size for problem in found.problems)
    names = ", ".join(problem.name for problem in found.problems)
    text = (
        f"{len(found.problems)} contracts ({names}) with {spots} spots at which they are held; one solve serves all "
        "spots of a contract and its boundary at a tenth, a quarter, a half and all of its life. Prices and deltas "
        "are fractions of the strike and absolute, gammas times the strike; within 1 % of the boundary, where it "
        "jumps, gamma is not compared.\n\n"
        "The true values come from the integral equation of the exercise boundary (Kim; Andersen, Lake, "
        "Offengenden), solved by collocation: no grid in the spot, no time steps, no complementarity problem. Delta "
        "and gamma are its derivatives in closed form. They are right to 1e-10 (price), 1e-9 (delta), 1e-7 (gamma) "
        "and 3e-7 (boundary).\n\n"
        "All methods share grid, domain and code but for what is compared, and run on one thread, stage by stage in "
        "Python (`price` marches implicit Euler and SDIRK2 by a compiled loop). A time is the least of several, "
        "methods in turn, and is that of one solve: Python's part of it is large on coarse grids, hence the count "
        "of node-steps beside it, in which placing the boundary in its cell is not counted. Crank-Nicolson begins "
        "with two steps of Rannacher's damping unless it says otherwise; in node-steps of adaptive Crank-Nicolson "
        "they count as ordinary ones."
    )
    return Section("How it was measured", text)
