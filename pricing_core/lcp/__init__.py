"""Linear complementarity problems: find z with 0 <= w = M z + q _|_ z >= 0, or with other bounds on z."""

from __future__ import annotations

from pricing_core.lcp.attempts import Method
from pricing_core.lcp.block_pivoting import solve_block_pivoting
from pricing_core.lcp.enumeration import SolutionSet, enumerate_solutions
from pricing_core.lcp.exact import solve_exact
from pricing_core.lcp.extended_horizontal import (
    ExtendedHorizontalLCP,
    ExtendedHorizontalSolution,
    solve_extended_horizontal,
)
from pricing_core.lcp.feasibility import infeasibility_certificate
from pricing_core.lcp.horizontal import HorizontalLCP, HorizontalSolution, solve_horizontal
from pricing_core.lcp.least_norm import least_norm_solution
from pricing_core.lcp.lemke import solve_lemke
from pricing_core.lcp.mixed import MixedLCP
from pricing_core.lcp.multigrid import solve_multigrid
from pricing_core.lcp.murty import solve_murty
from pricing_core.lcp.policy_iteration import solve_policy_iteration
from pricing_core.lcp.polyhedron import Face
from pricing_core.lcp.problem import LCP, LCPSolution, natural_residual, scaled_residual
from pricing_core.lcp.problem_files import ProblemFormat, read_problem, write_problem
from pricing_core.lcp.projected_gradients import solve_projected_gradients
from pricing_core.lcp.psor import solve_psor
from pricing_core.lcp.solve import solve
from pricing_core.lcp.tridiagonal import (
    solve_brennan_schwartz,
    solve_double_sweep,
    solve_tridiagonal_m_matrix,
)
from pricing_core.lcp.w_property import column_w_violation, has_column_w_property
from pricing_core.linalg.matrix_classes import is_p_matrix

__all__ = [
    "LCP",
    "ExtendedHorizontalLCP",
    "ExtendedHorizontalSolution",
    "Face",
    "HorizontalLCP",
    "HorizontalSolution",
    "LCPSolution",
    "Method",
    "MixedLCP",
    "ProblemFormat",
    "SolutionSet",
    "column_w_violation",
    "enumerate_solutions",
    "has_column_w_property",
    "infeasibility_certificate",
    "is_p_matrix",
    "least_norm_solution",
    "natural_residual",
    "read_problem",
    "scaled_residual",
    "solve",
    "solve_block_pivoting",
    "solve_brennan_schwartz",
    "solve_double_sweep",
    "solve_exact",
    "solve_extended_horizontal",
    "solve_horizontal",
    "solve_lemke",
    "solve_multigrid",
    "solve_murty",
    "solve_policy_iteration",
    "solve_projected_gradients",
    "solve_psor",
    "solve_tridiagonal_m_matrix",
    "write_problem",
]
