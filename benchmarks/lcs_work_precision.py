"""What does simulating a complementarity system cost for a given accuracy, from event to event or by steps?"""

from collections.abc import Sequence

from benchmarks.lcs.problems import PROBLEMS
from benchmarks.lcs.study import LargeRun, LcsRun, study_large, study_problem
from benchmarks.reporting.plots import curves
from benchmarks.reporting.report import Report, Section, table

TOLERANCES = {False: tuple(10.0**-p for p in range(2, 7)), True: (1e-2, 1e-3)}
LARGE = {False: (200, 50, 1000, 10), True: (20, 5, 50, 3)}
LEAST_ERROR = 1e-17  # what an error of zero is drawn at
SLOWEST = 2.0  # seconds that a large question may take


def run(*, quick: bool) -> Report:
    """Simulate four systems with known states by both methods, and two kinds of large systems."""
    runs = {name: study_problem(make(), TOLERANCES[quick]) for name, make in PROBLEMS.items()}
    large = study_large(*LARGE[quick])
    return Report(
        "lcs-work-precision",
        "Linear complementarity systems: error against time",
        "What does a simulation cost for a given accuracy, from event to event or by steps?",
        (_precision(runs), _large(large)),
    )


def _precision(runs: dict[str, tuple[LcsRun, ...]]) -> Section:
    rows = [one for problem in runs.values() for one in problem]
    panels = {
        name: {
            method: [
                (1e3 * one.seconds, max(one.error, LEAST_ERROR)) for one in problem if one.method == method
            ]
            for method in dict.fromkeys(one.method for one in problem)
        }
        for name, problem in runs.items()
    }
    text = f"""
        Errors are the largest at a few times between events, as fractions of the natural size of each state, from
        states known in closed form. Times are the less of two runs.

        {" ".join(_sentence(name, problem) for name, problem in runs.items())}
        """
    figures = {"work-precision": curves(panels, "milliseconds", "error")}
    return Section("Work and precision", text, (table("runs", rows),), figures)


def _sentence(name: str, runs: Sequence[LcsRun]) -> str:
    driven, *stepped = runs
    best = min(stepped, key=lambda found: found.error)
    return (
        f"{name.capitalize()}: from event to event {1e3 * driven.seconds:.2g} ms for an error of "
        f"{driven.error:.1e}; the most accurate stepped run ({best.method}, {best.steps:,} steps) "
        f"{1e3 * best.seconds:,.0f} ms for {best.error:.1e}."
    )


def _large(runs: Sequence[LargeRun]) -> Section:
    late = [found.question for found in runs if found.seconds > SLOWEST]
    verdict = f"over {SLOWEST:g} seconds: {', '.join(late)}" if late else f"each within {SLOWEST:g} seconds"
    text = f"""
        A random passive network is stepped with a constant step; systems with integer entries from -3 to 3 are asked
        whether they are well-posed, in rational arithmetic. All of it: {verdict}.
        """
    return Section("Large systems", text, (table("large", runs),))
