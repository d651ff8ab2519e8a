"""Linear complementarity systems: modes of a linear system chosen by complementarity."""

from pricing_core.lcs.one_step_problem import OneStepProblem, one_step_problem
from pricing_core.lcs.simulate import simulate
from pricing_core.lcs.system import LCS, PiecewiseConstant
from pricing_core.lcs.time_stepping import LCSStage, LCSState
from pricing_core.lcs.trajectory import Event, Trajectory
from pricing_core.lcs.transfer import relative_degree

__all__ = [
    "LCS",
    "Event",
    "LCSStage",
    "LCSState",
    "OneStepProblem",
    "PiecewiseConstant",
    "Trajectory",
    "one_step_problem",
    "relative_degree",
    "simulate",
]
