"""What the comparison of the method of lines with Crank-Nicolson measured."""

from collections.abc import Sequence
from dataclasses import dataclass

from benchmarks.method_of_lines.accuracy import OUTPUTS
from benchmarks.method_of_lines.accuracy_study import Run
from benchmarks.method_of_lines.findings import Verdict
from benchmarks.method_of_lines.lcp_study import RelaxationRun, SolverRun
from benchmarks.method_of_lines.order_study import Refinement, StepCounts
from benchmarks.method_of_lines.profiles import Profile
from benchmarks.problems.classic_sets import Problem


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


def results(found: Comparison, by_time: Sequence[Verdict], by_work: Sequence[Verdict]) -> dict[str, object]:
    """Return all of it in plain values, with the verdicts by time and by node-steps."""
    return {
        "note": found.note,
        "runs": [
            run._asdict() | {"errors": {name: error._asdict() for name, error in run.errors.items()}}
            for run in found.runs
        ],
        "winners_by_time": [_verdict_result(verdict) for verdict in by_time],
        "winners_by_node_steps": [_verdict_result(verdict) for verdict in by_work],
        "orders_in_time": [_refinement_result(one) for one in found.in_time],
        "orders_in_space": [_refinement_result(one) for one in found.in_space],
        "solvers": [run._asdict() for run in found.solvers],
        "relaxation": [run._asdict() for run in found.relaxation],
    }


def _verdict_result(verdict: Verdict) -> dict[str, object]:
    families = {"lcs": verdict.lcs, "crank_nicolson": verdict.crank_nicolson}
    bests = {name: None if one is None else one._asdict() for name, one in families.items()}
    return {"output": verdict.output, "rmse": verdict.rmse, **bests, "ratio": verdict.ratio}


def _refinement_result(refinement: Refinement) -> dict[str, object]:
    return {
        "method": refinement.method,
        "orders": {output: refinement.order(output) for output in OUTPUTS},
        "levels": [
            {"work": level.work, "rmse": {name: error.rmse for name, error in level.errors.items()}}
            for level in refinement.levels
        ],
    }
