import numpy as np
import pytest

from benchmarks.option_engine.march_scaling import STEP_COUNTS, march_costs
from tests.problems.needs_kernel import needs_kernel


@needs_kernel
def test_more_steps_mean_more_time_and_less_error():
    costs = march_costs(40, 2000.0)
    assert tuple(cost.steps for cost in costs) == STEP_COUNTS
    assert costs[-1].microseconds > costs[0].microseconds
    errors = np.array([cost.rmse for cost in costs])
    assert np.all(errors[1:] < 0.3 * errors[:-1])
    for cost in costs:
        assert cost.cycles == pytest.approx(cost.nanoseconds * 2.0, rel=1e-12)
        assert cost.with_derivatives > cost.microseconds


@needs_kernel
def test_cycles_are_unknown_without_a_clock():
    assert march_costs(4, None)[0].cycles is None
