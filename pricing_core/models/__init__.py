"""Models as they are stated, each with its linear complementarity system."""

from __future__ import annotations

from pricing_core.lcs import PiecewiseConstant
from pricing_core.models.box_stack import box_stack
from pricing_core.models.characteristic import Characteristic
from pricing_core.models.circuits.circuit_lcs import CircuitLCS
from pricing_core.models.circuits.diode_circuit import DiodeCircuit
from pricing_core.models.circuits.run import CircuitRun
from pricing_core.models.circuits.signals import Sine
from pricing_core.models.circuits.steady_state import SteadyState
from pricing_core.models.circuits.switches import Pulse
from pricing_core.models.contact_trajectory import ContactTrajectory
from pricing_core.models.control.solution import OptimalControl
from pricing_core.models.friction import friction_directions
from pricing_core.models.hamiltonian import HamiltonianSystem, HamiltonianTrajectory
from pricing_core.models.mechanics import MechanicalSystem
from pricing_core.models.named_characteristics import (
    coulomb_friction,
    dead_zone,
    gain_schedule,
    ideal_diode,
    relay_step,
    resistor,
    saturation,
)
from pricing_core.models.nonlinear_control import CollocatedControl, ControlAffineProblem
from pricing_core.models.optimal_control import StateConstrainedLQ
from pricing_core.models.piecewise_linear import PiecewiseLinearSystem
from pricing_core.models.projected import ProjectedSystem
from pricing_core.models.relay import RelaySystem

__all__ = [
    "Characteristic",
    "CircuitLCS",
    "CircuitRun",
    "CollocatedControl",
    "ContactTrajectory",
    "ControlAffineProblem",
    "DiodeCircuit",
    "HamiltonianSystem",
    "HamiltonianTrajectory",
    "MechanicalSystem",
    "OptimalControl",
    "PiecewiseConstant",
    "PiecewiseLinearSystem",
    "ProjectedSystem",
    "Pulse",
    "RelaySystem",
    "Sine",
    "StateConstrainedLQ",
    "SteadyState",
    "box_stack",
    "coulomb_friction",
    "dead_zone",
    "friction_directions",
    "gain_schedule",
    "ideal_diode",
    "relay_step",
    "resistor",
    "saturation",
]
