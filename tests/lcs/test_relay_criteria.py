import numpy as np
import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import has_guaranteed_direction, theorem_11_6

ZERO, ONE = np.zeros((2, 2)), np.eye(2)


def test_filippovs_example_satisfies_theorem_11_6():
    """(11.68): B = [[1, -2], [2, 1]], minors 1, 1, 5."""
    assert theorem_11_6(ZERO, [[1, -2], [2, 1]], ONE).status == "holds"
    assert theorem_11_6(ZERO, 2 * np.array([[1, -26], [26, 1]]), ONE).status == "holds"


def test_theorem_11_6_is_silent_where_it_does_not_apply():
    found = theorem_11_6(ZERO, [[1, -3], [-2, 1]], ONE)
    assert found.status == "silent"
    assert "(0, 1)" in found.reason
    assert theorem_11_6([[0]], [[-1]], [[1]]).status == "silent"
    assert (
        theorem_11_6(np.zeros((13, 13)), np.eye(13), np.eye(13)).status == "holds"
    )  # they do not act on each other
    assert theorem_11_6(np.zeros((13, 13)), np.eye(13) + 1, np.eye(13)).status == "silent"


# x' = a - b sgn x: (a, b, guaranteed at 0)
SCALAR = [(0, 1, True), (0, -1, False), (2, -1, True), (-2, -1, True), (1, -1, False), (2, 1, True)]


@pytest.mark.parametrize(("a", "b", "guaranteed"), SCALAR)
def test_filippovs_criterion_on_one_surface(a, b, guaranteed):
    """The constant a is a second state. Away from 0 nothing has to be chosen."""
    system = [[0, a], [0, 0]], [[b], [0]], [[1, 0]], None
    answers = has_guaranteed_direction(*system, [[0, 1], [3, 1], [-1, 1]])
    assert answers.tolist() == [guaranteed, True, True]


def test_where_surfaces_meet_theorem_11_6_decides():
    points = [[0, 0], [0, 1], [1, 0], [1, 1]]
    assert has_guaranteed_direction(ZERO, [[1, -2], [2, 1]], ONE, None, points).all()
    assert has_guaranteed_direction(ZERO, [[1, -3], [-2, 1]], ONE, None, points).tolist() == [
        False,
        True,
        True,
        True,
    ]


def test_one_state_gives_one_answer():
    assert has_guaranteed_direction([[0]], [[1]], [[1]], None, [0]).shape == ()


def test_a_feedthrough_is_refused():
    with pytest.raises(InvalidInputError, match="D"):
        has_guaranteed_direction([[0]], [[1]], [[1]], [[1]], [0])
