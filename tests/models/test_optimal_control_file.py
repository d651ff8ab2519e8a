"""The model file's keys, and what is said when one is wrong."""

import json

import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.models import optimal_control_from
from tests.problems.control_problems import stopped_scalar

TEXT = """{"model": "optimal-control", "A": [[-1]], "B": [[1]], "C": [[1]], "Q": [[1]],
           "x0": [2], "horizon": 3, "bound": [1]}"""


def test_a_file_states_the_problem():
    answer = optimal_control_from(json.loads(TEXT)).solve()
    assert answer.cost == pytest.approx(stopped_scalar(3.0).cost, rel=1e-12)


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("model", {"model": "lcs"}),
        ("A", {"A": None}),
        ("A", {"A": [[1], [1, 2]]}),
        ("A", {"A": []}),
        ("B", {"B": [1]}),
        ("C", {"C": [["1"]]}),
        ("Q", {"Q": [[True]]}),
        ("x0", {"x0": 2}),
        ("x0", {"x0": [0]}),
        ("horizon", {"horizon": "3"}),
        ("horizon", {"horizon": True}),
        ("horizon", {"horizon": 10**400}),
        ("bound", {"bound": [1, 2]}),
        ("t_span", {"t_span": [0, 1]}),
    ],
)
def test_a_wrong_key_is_named(field: str, change: dict[str, object]):
    with pytest.raises(InvalidInputError) as caught:
        optimal_control_from({**json.loads(TEXT), **change})
    assert caught.value.field == field


@pytest.mark.parametrize("key", ["A", "B", "C", "Q", "x0", "horizon", "model"])
def test_a_missing_key_is_named(key: str):
    document = json.loads(TEXT)
    del document[key]
    with pytest.raises(InvalidInputError) as caught:
        optimal_control_from(document)
    assert caught.value.field == key


def test_only_an_object_will_do():
    with pytest.raises(InvalidInputError, match="an object with the keys"):
        optimal_control_from([1, 2])
