"""What does simulating a complementarity system cost for a given accuracy, from event to event or by steps?"""

from collections.abc import Sequence

from matplotlib.figure import Figure

from benchmarks.lcs.problems import PROBLEMS
from benchmarks.lcs.study import EVENT_DRIVEN, LargeRun, LcsRun, study_large, study_problem
from benchmarks.reporting.report import Report, Section, Table

TOLERANCES = {False: tuple(10.0**-p for p in range(2, 7)), True: (1e-2, 1e-3)}
LARGE = {False: (200, 50, 1000, 10), True: (20, 5, 50, 3)}
# Okabe and Ito's colours, which colour-blind readers can tell apart.
STYLES = {EVENT_DRIVEN: ("#D55E00", "*"), "implicit-euler": ("#0072B2", "o"), "sdirk2": ("#009E73", "s")}
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
        {
            "runs": [found._asdict() for problem in runs.values() for found in problem],
            "large": [found._asdict() for found in large],
        },
    )


def _precision(runs: dict[str, tuple[LcsRun, ...]]) -> Section:
    table = Table(
        ("system", "method", "tolerance", "error", "milliseconds", "steps", "events"),
        tuple(
            (r.problem, r.method, r.tolerance, r.error, 1e3 * r.seconds, r.steps, r.events)
            for problem in runs.values()
            for r in problem
        ),
        "runs",
    )
    text = f"""
        Errors are the largest at a few times between events, as fractions of the natural size of each state, from
        states known in closed form. Times are the less of two runs.

        {" ".join(_sentence(name, problem) for name, problem in runs.items())}
        """
    return Section("Work and precision", text, (table,), (("work-precision", _figure(runs)),))


def _sentence(name: str, runs: Sequence[LcsRun]) -> str:
    driven, *stepped = runs
    best = min(stepped, key=lambda found: found.error)
    return (
        f"{name.capitalize()}: from event to event {1e3 * driven.seconds:.2g} ms for an error of "
        f"{driven.error:.1e}; the most accurate stepped run ({best.method}, {best.steps:,} steps) "
        f"{1e3 * best.seconds:,.0f} ms for {best.error:.1e}."
    )


def _figure(runs: dict[str, tuple[LcsRun, ...]]) -> Figure:
    figure = Figure(figsize=(10.0, 7.5), layout="constrained")
    figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, (name, problem) in zip(figure.axes, runs.items(), strict=True):
        for method, (colour, marker) in STYLES.items():
            points = [(1e3 * r.seconds, max(r.error, LEAST_ERROR)) for r in problem if r.method == method]
            if points:
                size = 14 if method == EVENT_DRIVEN else 6
                axes.loglog(
                    *zip(*points, strict=True), f"{marker}-", color=colour, markersize=size, label=method
                )
        axes.set_title(name)
        axes.set_xlabel("milliseconds")
        axes.set_ylabel("error")
        axes.grid(which="major", alpha=0.3)
        axes.xaxis.set_minor_formatter("")
    figure.legend(
        *figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, frameon=False
    )
    return figure


def _large(runs: Sequence[LargeRun]) -> Section:
    table = Table(
        ("question", "states", "pairs", "seconds", "answer"),
        tuple((found.question, found.n, found.k, found.seconds, found.answer) for found in runs),
        "large",
    )
    late = [found.question for found in runs if found.seconds > SLOWEST]
    verdict = f"over {SLOWEST:g} seconds: {', '.join(late)}" if late else f"each within {SLOWEST:g} seconds"
    text = f"""
        A random passive network is stepped with a constant step; systems with integer entries from -3 to 3 are asked
        whether they are well-posed, in rational arithmetic. All of it: {verdict}.
        """
    return Section("Large systems", text, (table,))
