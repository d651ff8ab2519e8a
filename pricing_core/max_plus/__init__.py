"""Max-plus algebra: arrays, spectra, residuation, systems, timed event graphs, and complementarity."""

from __future__ import annotations

from pricing_core.max_plus import min_plus
from pricing_core.max_plus.algebra import add, identity, multiply, power
from pricing_core.max_plus.complementarity import (
    ComplementaritySystem,
    MaxMinPlusScalingSystem,
    StepProblem,
    as_lcp,
)
from pricing_core.max_plus.composition import feedback, parallel, series
from pricing_core.max_plus.critical import CriticalGraph, critical_graph, cyclicity
from pricing_core.max_plus.cycle_time import cycle_ratio, cycle_time
from pricing_core.max_plus.eigenvectors import Eigenmode, eigenmode, eigenvector, eigenvectors
from pricing_core.max_plus.event_graph_reader import read_event_graph
from pricing_core.max_plus.event_graphs import Place, TimedEventGraph
from pricing_core.max_plus.expressions import Expression, largest, least, variables
from pricing_core.max_plus.just_in_time import JustInTime, just_in_time
from pricing_core.max_plus.longest_paths import least_solution
from pricing_core.max_plus.matrices import EPSILON, TOP, dense, exact, sparse
from pricing_core.max_plus.performance import latency, throughput
from pricing_core.max_plus.residuation import residuate_left, residuate_right, solution_of_equation
from pricing_core.max_plus.simulate import MaxPlusTrajectory, simulate
from pricing_core.max_plus.spectrum import eigenvalue, eigenvalues
from pricing_core.max_plus.star import plus, star
from pricing_core.max_plus.system import ImplicitSystem, MaxPlusSystem
from pricing_core.max_plus.transient import transient
from pricing_core.max_plus.vertical import (
    VerticalLCP,
    VerticalSolution,
    fixed_point_problem,
    solve_vertical,
)

__all__ = [
    "EPSILON",
    "TOP",
    "ComplementaritySystem",
    "CriticalGraph",
    "Eigenmode",
    "Expression",
    "ImplicitSystem",
    "JustInTime",
    "MaxMinPlusScalingSystem",
    "MaxPlusSystem",
    "MaxPlusTrajectory",
    "Place",
    "StepProblem",
    "TimedEventGraph",
    "VerticalLCP",
    "VerticalSolution",
    "add",
    "as_lcp",
    "critical_graph",
    "cycle_ratio",
    "cycle_time",
    "cyclicity",
    "dense",
    "eigenmode",
    "eigenvalue",
    "eigenvalues",
    "eigenvector",
    "eigenvectors",
    "exact",
    "feedback",
    "fixed_point_problem",
    "identity",
    "just_in_time",
    "largest",
    "latency",
    "least",
    "least_solution",
    "min_plus",
    "multiply",
    "parallel",
    "plus",
    "power",
    "read_event_graph",
    "residuate_left",
    "residuate_right",
    "series",
    "simulate",
    "solution_of_equation",
    "solve_vertical",
    "sparse",
    "star",
    "throughput",
    "transient",
    "variables",
]
