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
