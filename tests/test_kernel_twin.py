"""The NumPy twin of the kernel on problems solved by hand."""

import numpy as np
import pytest

from pricing_core import kernel_twin

MINUS_ONE, TWO = -np.ones(2), np.full(3, 2.0)


@pytest.mark.parametrize(
    ("q", "contact_first", "expected"),
    [
        ([-2.0, 0.0, 4.0], False, [4 / 3, 2 / 3, 0.0]),  # contact at the last index
        ([4.0, 0.0, -2.0], True, [0.0, 2 / 3, 4 / 3]),  # its mirror image
        # Contact in the middle, solution (1, 0, 2): each direction is a lower bound.
        ([-2.0, 5.0, -4.0], True, [0.0, 0.0, 2.0]),
        ([-2.0, 5.0, -4.0], False, [1.0, 0.0, 1.0]),
        ([0.0, 0.0, -4.0], True, [1.0, 2.0, 3.0]),  # no contact
        ([0.0, 0.0, -4.0], False, [1.0, 2.0, 3.0]),
        ([1.0, 1.0, 1.0], True, [0.0, 0.0, 0.0]),
    ],
)
def test_one_sweep_of_brennan_and_schwartz_by_hand(
    q: list[float], contact_first: bool, expected: list[float]
) -> None:
    found = kernel_twin.brennan_schwartz(MINUS_ONE, TWO, MINUS_ONE, np.array(q), contact_first)
    np.testing.assert_allclose(found, expected, atol=1e-15)


def test_two_sweeps_of_gauss_seidel_by_hand() -> None:
    # From z = 0 with q = (-2, 0, -8): (1, 1/2, 17/4), then (5/4, 11/4, 43/8).
    q = np.array([-2.0, 0.0, -8.0])
    for max_sweeps, expected in ((1, [1.0, 0.5, 4.25]), (2, [1.25, 2.75, 5.375])):
        z, sweeps = kernel_twin.projected_sor(MINUS_ONE, TWO, MINUS_ONE, q, np.zeros(3), 1.0, 0.0, max_sweeps)
        np.testing.assert_array_equal(z, expected)
        assert sweeps == max_sweeps + 1


def test_a_sweep_that_changes_nothing_ends_the_iteration() -> None:
    solution = np.array([1.0, 0.0, 2.0])
    z, sweeps = kernel_twin.projected_sor(
        MINUS_ONE, TWO, MINUS_ONE, np.array([-2.0, 5.0, -4.0]), solution, 1.7, 1e-14, 100
    )
    np.testing.assert_allclose(z, solution, atol=1e-14)
    assert sweeps == 1


@pytest.mark.parametrize(
    ("q", "start", "expected", "expected_systems"),
    [
        # Solution (1, 0, 2) with w = (0, 2, 0). Without contact z = (0, -2, 1): row 1 leaves.
        ([-2.0, 5.0, -4.0], [True, True, True], [1.0, 0.0, 2.0], 2),
        ([-2.0, 5.0, -4.0], [False, False, False], [1.0, 0.0, 2.0], 2),
        ([-2.0, 5.0, -4.0], [True, False, True], [1.0, 0.0, 2.0], 1),
        # One row enters at a time: z = 0, then (0, 0, 2), (0, 4/3, 8/3), (1, 2, 3).
        ([0.0, 0.0, -4.0], [False, False, False], [1.0, 2.0, 3.0], 4),
        ([1.0, 1.0, 1.0], [True, True, True], [0.0, 0.0, 0.0], 2),
    ],
)
def test_policy_iteration_by_hand(
    q: list[float], start: list[bool], expected: list[float], expected_systems: int
) -> None:
    z, systems = kernel_twin.policy_iteration(
        MINUS_ONE, TWO, MINUS_ONE, np.array(q), np.array(start), 1e-14, 5
    )
    np.testing.assert_allclose(z, expected, atol=1e-15)
    assert systems == expected_systems


def test_policy_iteration_leaves_rows_alone_that_are_wrong_by_rounding_only() -> None:
    q = np.array([-1.0, 0.5 - 1e-16, 1.0])  # w_1 = -1e-16 beside terms of 1
    start = np.array([True, False, False])
    for tolerance, expected_systems in ((1e-14, 1), (0.0, 2)):
        _, systems = kernel_twin.policy_iteration(MINUS_ONE, TWO, MINUS_ONE, q, start, tolerance, 5)
        assert systems == expected_systems
