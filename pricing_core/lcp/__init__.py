"""Linear complementarity problems: find z with 0 <= w = M z + q _|_ z >= 0."""

from pricing_core.lcp.enumeration import SolutionSet, enumerate_solutions
from pricing_core.lcp.feasibility import infeasibility_certificate
from pricing_core.lcp.lemke import solve_lemke
from pricing_core.lcp.murty import solve_murty
from pricing_core.lcp.policy_iteration import solve_policy_iteration
from pricing_core.lcp.polyhedron import Face
from pricing_core.lcp.problem import LCP, LCPSolution, natural_residual, scaled_residual
from pricing_core.lcp.psor import solve_psor
from pricing_core.lcp.solve import Method, solve
from pricing_core.lcp.tridiagonal import solve_brennan_schwartz, solve_double_sweep
from pricing_core.linalg.matrix_classes import is_p_matrix

__all__ = [
    "LCP",
    "Face",
    "LCPSolution",
    "Method",
    "SolutionSet",
    "enumerate_solutions",
    "infeasibility_certificate",
    "is_p_matrix",
    "natural_residual",
    "scaled_residual",
    "solve",
    "solve_brennan_schwartz",
    "solve_double_sweep",
    "solve_lemke",
    "solve_murty",
    "solve_policy_iteration",
    "solve_psor",
]
