"""Method of lines or Crank-Nicolson finite differences: which is nearer the truth for its work, and at what?"""

from dataclasses import dataclass

from benchmarks.measuring.timing import TURNS
from benchmarks.method_of_lines.accuracy_study import study_accuracy
from benchmarks.method_of_lines.lcp_study import compare_solvers, sweep_relaxation
from benchmarks.method_of_lines.order_study import StepCounts, refine_cells, refine_steps
from benchmarks.method_of_lines.profiles import boundary_errors, gamma_errors
from benchmarks.method_of_lines.report import Comparison, compose
from benchmarks.problems.classic_sets import classic_problems
from benchmarks.reporting.report import Report


@dataclass(frozen=True, slots=True)
class Sizes:
    """How much is solved; pairs are (cells, steps)."""

    note: str
    problems: tuple[str, ...]  # none: all
    order_problems: tuple[str, ...]
    intervals: tuple[int, ...]
    steps_per_interval: tuple[float, ...]
    step_counts: StepCounts
    steps_for_cells: int
    profile: tuple[int, int]
    solver_grids: tuple[tuple[int, int], ...]
    relaxation_grids: tuple[tuple[int, int], ...]
    relaxations: tuple[float, ...]
    turns: int


FULL = Sizes(
    note="",
    problems=(),
    order_problems=("ALO", "A", "C", "D", "G"),
    intervals=(32, 64, 128, 256, 512, 1024),
    steps_per_interval=(1 / 16, 1 / 8, 1 / 4, 1 / 2, 1.0),
    step_counts=StepCounts(512, (16, 32, 64, 128, 256), (6, 10, 16, 26, 40), 4096),
    steps_for_cells=1024,
    profile=(512, 32),
    solver_grids=((64, 16), (256, 64), (1024, 256)),
    relaxation_grids=((128, 32), (512, 128), (1024, 256)),
    relaxations=tuple(1.0 + 0.05 * k for k in range(20)),
    turns=TURNS,
)
QUICK = Sizes(
    note="A quick run on few contracts and coarse grids: it shows that everything works, not who is faster.",
    problems=("A", "C", "D", "Ju call 2"),
    order_problems=("A", "D"),
    intervals=(32, 64, 128),
    steps_per_interval=(1 / 8, 1 / 4, 1 / 2),
    step_counts=StepCounts(128, (8, 16, 32), (6, 8, 10), 256),
    steps_for_cells=128,
    profile=(128, 16),
    solver_grids=((32, 8), (64, 16)),
    relaxation_grids=((64, 16), (128, 32)),
    relaxations=tuple(1.0 + 0.1 * k for k in range(10)),
    turns=2,
)


def run(*, quick: bool) -> Report:
    """Measure and report; `quick` takes fewer contracts, coarser grids and fewer repeats."""
    return compose(compare(QUICK if quick else FULL))


def compare(sizes: Sizes) -> Comparison:
    """Measure everything."""
    problems = classic_problems(sizes.problems)
    few = tuple(problem for problem in problems if problem.name in sizes.order_problems)
    (year,), (quarter,) = classic_problems(("A",)), classic_problems(("C",))
    return Comparison(
        note=sizes.note,
        problems=problems,
        runs=study_accuracy(problems, sizes.intervals, sizes.steps_per_interval, sizes.turns),
        in_time=refine_steps(few, sizes.step_counts),
        in_space=refine_cells(few, sizes.intervals[-5:], sizes.steps_for_cells),
        step_counts=sizes.step_counts,
        profile_grid=sizes.profile,
        gamma=gamma_errors(quarter, *sizes.profile, furthest=1.15),
        boundary=boundary_errors(year, *sizes.profile),
        solvers=compare_solvers(year, sizes.solver_grids, sizes.turns),
        relaxation=sweep_relaxation(year, sizes.relaxation_grids, sizes.relaxations, sizes.turns),
    )
