"""Whether there is no way on from a state as given: proved in exact arithmetic."""

from __future__ import annotations

from pricing_core.arrays import Vector
from pricing_core.lcs.autonomous import whole_state, with_inputs_as_states
from pricing_core.lcs.exosystem import Exosystem
from pricing_core.lcs.polynomial_problem import polynomial_problem
from pricing_core.lcs.rational_complementarity import all_solutions
from pricing_core.lcs.system import LCS

LARGEST_COMPLETE = 10  # pairs up to which all 2**k modes are examined, in some seconds at the most


def nothing_goes_on(system: LCS, x0: Vector, t: float) -> bool:
    """Tell whether S(x0) (11.77) is proved to be empty at t; False says nothing.

    For up to ten pairs, and inputs that are known exactly just after t: constants, or at a time at which they start.

    Examples
    --------
    y = x + sin t from x = 0 has a way on without u, y = x - sin t has none where u does nothing:

    >>> import numpy as np
    >>> from pricing_core.lcs import sine
    >>> up, down = (LCS([[0]], [[0]], [[1]], g=sine(height, 1.0)) for height in (1.0, -1.0))
    >>> nothing_goes_on(up, np.zeros(1), 0.0), nothing_goes_on(down, np.zeros(1), 0.0)
    (False, True)
    """
    if system.shape[1] > LARGEST_COMPLETE:
        return False
    if isinstance(system.f, Exosystem) or isinstance(system.g, Exosystem):
        system, inputs = with_inputs_as_states(system)
        if any(signal.generator.any() and t not in signal.times for signal in inputs):
            return False  # the states of an input later on are rounded
        x0 = whole_state(x0, inputs, t)
    return not all_solutions(polynomial_problem(system, x0, t))
