import numpy as np
import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import LCS, leading_markov_parameter, markov_parameters, transfer_matrix
from tests.problems.lcs_systems import integrators, oscillator, random_system


def test_markov_parameters_are_the_expansion_around_infinity():
    system = random_system(np.random.default_rng(3), 3, 2, feedthrough=True)
    H, s = markov_parameters(system, 12), 1e3
    series = sum(parameter / s**j for j, parameter in enumerate(H))
    assert series == pytest.approx(transfer_matrix(system)(s), rel=1e-13)


def test_s_over_s_squared_plus_one_has_alternating_parameters():
    assert markov_parameters(oscillator(), 6).ravel().tolist() == [0, 1, 0, -1, 0, 1]


def test_large_systems_are_computed_in_floating_point():
    system = random_system(np.random.default_rng(3), 24, 3)
    assert markov_parameters(system, 3)[2] == pytest.approx(system.C @ system.A @ system.B)


def test_the_leading_parameter_of_a_chain_is_its_length():
    leading = leading_markov_parameter(integrators(3))
    assert (leading.power, leading.matrix.tolist()) == (3, [[1.0]])
    assert leading_markov_parameter(LCS([[1]], [[0]], [[1]])) is None


def test_a_difference_of_decimal_numbers_is_zero_as_written():
    """CB = 0.1 * 3 - 0.3 is 5.6e-17 in floating point."""
    assert leading_markov_parameter(LCS([[1, 0], [0, 2]], [[0.1], [0.3]], [[3, -1]])).power == 2


def test_no_parameters_and_a_negative_number_of_them():
    assert markov_parameters(oscillator(), 0).shape == (0, 1, 1)
    with pytest.raises(InvalidInputError, match="count"):
        markov_parameters(oscillator(), -1)
