"""Linear complementarity systems: modes of a linear system chosen by complementarity."""

from __future__ import annotations

from pricing_core.lcs.distributions import InitialSolution, initial_solution
from pricing_core.lcs.exosystem import Exosystem, piecewise_linear, pulses, sine
from pricing_core.lcs.frequency_witness import FrequencyWitness
from pricing_core.lcs.geometry import ModeGeometry, mode_geometry
from pricing_core.lcs.ill_posedness import IllPosedness
from pricing_core.lcs.joined_exosystem import JoinedExosystem
from pricing_core.lcs.markov import LeadingMarkovParameter, leading_markov_parameter, markov_parameters
from pricing_core.lcs.nonlinear import simulate_nonlinear
from pricing_core.lcs.one_step_problem import OneStepProblem, one_step_problem
from pricing_core.lcs.passivity import Passivity, passivity
from pricing_core.lcs.properness import (
    LeadingCoefficients,
    is_column_proper,
    is_row_proper,
    leading_column_coefficients,
    leading_row_coefficients,
)
from pricing_core.lcs.rational_complementarity import RationalComplementarity, rational_complementarity
from pricing_core.lcs.relay_criteria import has_guaranteed_direction, theorem_11_6
from pricing_core.lcs.semi_explicit import SemiExplicitSystem
from pricing_core.lcs.simulate import simulate
from pricing_core.lcs.simulation_method import EventDriven, TimeStepping
from pricing_core.lcs.system import LCS, PiecewiseConstant
from pricing_core.lcs.theorems import Finding
from pricing_core.lcs.time_stepping import LCSStage, LCSState
from pricing_core.lcs.total_invertibility import singular_modes
from pricing_core.lcs.trajectory import Event, Trajectory
from pricing_core.lcs.transfer import relative_degree
from pricing_core.lcs.transfer_matrix import TransferMatrix, transfer_matrix
from pricing_core.lcs.well_posedness import WellPosedness, well_posedness

__all__ = [
    "LCS",
    "Event",
    "EventDriven",
    "Exosystem",
    "Finding",
    "FrequencyWitness",
    "IllPosedness",
    "InitialSolution",
    "JoinedExosystem",
    "LCSStage",
    "LCSState",
    "LeadingCoefficients",
    "LeadingMarkovParameter",
    "ModeGeometry",
    "OneStepProblem",
    "Passivity",
    "PiecewiseConstant",
    "RationalComplementarity",
    "SemiExplicitSystem",
    "TimeStepping",
    "Trajectory",
    "TransferMatrix",
    "WellPosedness",
    "has_guaranteed_direction",
    "initial_solution",
    "is_column_proper",
    "is_row_proper",
    "leading_column_coefficients",
    "leading_markov_parameter",
    "leading_row_coefficients",
    "markov_parameters",
    "mode_geometry",
    "one_step_problem",
    "passivity",
    "piecewise_linear",
    "pulses",
    "rational_complementarity",
    "relative_degree",
    "simulate",
    "simulate_nonlinear",
    "sine",
    "singular_modes",
    "theorem_11_6",
    "transfer_matrix",
    "well_posedness",
]
