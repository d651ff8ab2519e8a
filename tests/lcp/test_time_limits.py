"""What takes long ends soon after its time limit, or after an interrupt of the keyboard, wherever it is."""

import time
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError, IterationLimitError, NumericalError
from pricing_core.lcp import (
    LCP,
    HorizontalLCP,
    enumerate_solutions,
    solve,
    solve_horizontal,
    solve_lemke,
    solve_murty,
    solve_policy_iteration,
    solve_psor,
)
from pricing_core.linalg import Tridiagonal
from tests.problems.interrupted import seconds_until_interrupted
from tests.problems.lcp_problems import fathi, murty_exponential
from tests.problems.needs_kernel import needs_kernel


def obstacle(n: int) -> LCP:
    """A string over one obstacle in the middle: policy iteration from z = 0 enters a row at a time."""
    string = Tridiagonal(-np.ones(n - 1), np.full(n, 2.0), -np.ones(n - 1))
    return LCP(string, np.where(np.arange(n) == n // 2, -1.0, 0.0))


SOON = 2.0  # seconds of processor time; a tenth of a second on most machines
LONG: dict[str, Callable[..., object]] = {
    "psor": partial(solve_psor, obstacle(100_000), max_sweeps=10**8),
    "policy iteration": partial(solve_policy_iteration, obstacle(100_000)),
    "lemke": partial(solve_lemke, LCP(fathi(30), -np.ones(30)), covering=np.ones(30), max_pivots=2**31),
    "murty": partial(solve_murty, LCP(murty_exponential(18), -np.ones(18)), max_pivots=2**31),
    "enumeration": partial(enumerate_solutions, LCP(-np.eye(14), np.ones(14))),
    "enumeration by name": partial(
        solve, LCP(-np.eye(18) - 1e-12, -1.0 + 2.0 * np.ones(18)), method="enumeration"
    ),
    "front door": partial(solve, obstacle(100_000), method="psor"),
}


@needs_kernel
@pytest.mark.parametrize("name", LONG)
def test_a_time_limit_ends_the_work(name: str) -> None:
    begin = time.thread_time()
    with pytest.raises(IterationLimitError, match=r"time_limit = 0\.1 seconds"):
        LONG[name](time_limit=0.1)
    assert time.thread_time() - begin < SOON


@needs_kernel
@pytest.mark.parametrize("name", LONG)
def test_an_interrupt_ends_the_work(name: str) -> None:
    assert seconds_until_interrupted(LONG[name], after=0.1) < SOON


@pytest.mark.parametrize("wrong", [0.0, -1.0, float("nan"), "a", True])
def test_a_time_limit_is_a_positive_number(wrong: object) -> None:
    problem = LCP([[1.0]], [-1.0])
    for solver in (solve, solve_lemke, solve_murty, solve_psor, solve_policy_iteration):
        with pytest.raises(InvalidInputError, match="time_limit"):
            solver(problem, time_limit=wrong)  # type: ignore[operator]


def test_enough_time_changes_nothing() -> None:
    problem = LCP([[2.0, 1.0], [1.0, 2.0]], [-4.0, -5.0])
    for solver in (solve, solve_lemke, solve_murty, solve_psor, solve_policy_iteration):
        np.testing.assert_allclose(solver(problem, time_limit=60.0).z, [1.0, 2.0])  # type: ignore[operator]
    found = solve_horizontal(HorizontalLCP(np.eye(2), problem.M, problem.q), time_limit=60.0)
    np.testing.assert_allclose(found.z, [1.0, 2.0])


def test_exact_arithmetic_ends_as_well() -> None:
    random = np.random.default_rng(0)
    A = random.normal(size=(60, 60))
    with pytest.raises(IterationLimitError, match="time_limit"):
        solve(LCP(A @ A.T, random.normal(size=60)), method="exact", time_limit=1e-3)
    with pytest.raises(NumericalError):
        solve(LCP(-A @ A.T, random.normal(size=60)), time_limit=1e-3)
