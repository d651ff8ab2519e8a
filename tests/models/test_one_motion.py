import math

import numpy as np
import pytest

from pricing_core.lcs import simulate
from pricing_core.models import Characteristic, PiecewiseLinearSystem, ProjectedSystem, RelaySystem


def test_one_motion_in_all_the_models_that_state_it():
    """x' = -3 + u on x >= 0: a diode, one end of a relay that never lets go, a projection, an LCS."""
    times = np.linspace(0.0, 1.0, 11)
    exact = np.maximum(1.0 - 3.0 * times, 0.0)[:, None]
    diode = Characteristic([(0.0, 0.0)], left_slope=-math.inf)
    A, B, C, x0 = [[0, -3], [0, 0]], [[1], [0]], [[1, 0]], [1.0, 1.0]
    projected = ProjectedSystem(([[0.0]], [3.0]), [[1.0]], [0.0])
    runs = [
        RelaySystem(A, B, C, lower=0.0, upper=4.0).simulate(x0, (0, 1), t_eval=times),
        RelaySystem(A, B, C, lower=0.0, upper=4.0).simulate(x0, (0, 1), t_eval=times, form="dae"),
        RelaySystem(A, B, C, lower=0.0, upper=4.0).to_piecewise_linear().simulate(x0, (0, 1), t_eval=times),
        PiecewiseLinearSystem(A, B, C, None, [diode]).simulate(x0, (0, 1), t_eval=times),
        projected.simulate([1.0], (0, 1), t_eval=times),
        simulate(projected.to_lcs(), [1.0], (0, 1), t_eval=times),
    ]
    for run in runs:
        assert run.x[:, :1] == pytest.approx(exact, abs=1e-13)
        assert run.u[-1] == pytest.approx([3.0], abs=1e-12)
