"""Model files: what they lead to, what is refused with its key, and that their pictures can be drawn."""

import io
import json

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError, NumericalError
from pricing_core.max_plus import run_model
from pricing_core.max_plus.model_figure import draw_model_run
from pricing_core.max_plus.model_schema import MODEL_SCHEMA
from tests.problems.max_plus_problems import KNOWN, E

MATRICES = {"model": "max-plus", "A": [[2, 5], [3, 3]], "x0": [0, 0], "steps": 4}
GRAPH = {
    "model": "max-plus",
    "transitions": ["drill", "press"],
    "places": [["drill", "press", 3], ["press", "drill", 2, 1], ["press", "press", 4, 1]],
    "steps": 3,
}


def test_the_railway_of_the_literature_as_a_file():
    run = run_model(json.loads(json.dumps(MATRICES)))
    assert run.columns == ("k", "x0", "x1")
    np.testing.assert_array_equal(run.states, KNOWN[2].orbit)
    np.testing.assert_array_equal(run.table[:, 0], range(5))
    np.testing.assert_array_equal(run.cycle_time, [4.0, 4.0])
    assert run.graph is None


def test_null_and_a_text_stand_for_epsilon_and_outputs_have_columns():
    run = run_model(
        MATRICES
        | {
            "A": [[None, 2], [3, "-inf"]],
            "B": [[0], [None]],
            "u": [[10], [11], [12], [13]],
            "C": [[None, 1]],
            "names": ["in", "out"],
            "output_names": ["door"],
        }
    )
    assert run.columns == ("k", "in", "out", "door")
    np.testing.assert_array_equal(run.table[:3], [[0, 0, 0, 1], [1, 10, 3, 4], [2, 11, 13, 14]])


def test_an_implicit_model_waits_within_the_step():
    run = run_model(MATRICES | {"A0": [[None, None], [2, None]], "A": [[3, 7], [None, None]]})
    np.testing.assert_array_equal(run.states[1], [7, 9])
    with pytest.raises(NumericalError, match="circuit x0 -> x0"):
        run_model(MATRICES | {"A0": [[1, None], [None, None]]})


def test_an_event_graph_as_a_file():
    run = run_model(GRAPH)
    assert run.columns == ("k", "drill", "press")
    np.testing.assert_array_equal(run.states, [[0, 0], [2, 5], [7, 10], [12, 15]])
    np.testing.assert_array_equal(run.cycle_time, [5.0, 5.0])


@pytest.mark.parametrize(
    ("content", "field"),
    [
        (MATRICES | {"model": "lcs"}, "model"),
        ({"A": [[1]]}, "model"),
        (MATRICES | {"t_span": [0, 1]}, "t_span"),
        (MATRICES | {"places": []}, "A"),
        (MATRICES | {"steps": 0}, "steps"),
        (MATRICES | {"steps": 1.5}, "steps"),
        (MATRICES | {"steps": True}, "steps"),
        ({"model": "max-plus", "steps": 1, "x0": [0]}, "A"),
        (MATRICES | {"x0": None}, "x0"),
        (MATRICES | {"x0": [0]}, "x0"),
        (MATRICES | {"x0": [0, "1"]}, "x0[1]"),
        (MATRICES | {"A": [[1, 2], [3]]}, "A"),
        (MATRICES | {"A": [[1, 2]]}, "A"),
        (MATRICES | {"A": []}, "A"),
        (MATRICES | {"A": [[1, float("nan")], [0, 0]]}, "A[0][1]"),
        (MATRICES | {"A": [[1, True], [0, 0]]}, "A[0][1]"),
        (MATRICES | {"u": [[1]]}, "u"),
        (MATRICES | {"names": ["a"]}, "names"),
        (MATRICES | {"names": "ab"}, "names"),
        (GRAPH | {"places": [["drill", "press", 3]]}, "transitions"),
        (GRAPH | {"places": [["drill", "press", 3], ["press", "drill", 2]]}, "places"),
        (GRAPH | {"x0": [1]}, "x0"),
        (GRAPH | {"places": [["drill", "press", 3], ["press", "drill", 2, 501]]}, "places"),
        (GRAPH | {"places": [["drill", "press", 3], ["press", "drill", 2**53 + 1, 1]]}, "places[1].holding"),
        (MATRICES | {"A": [[2**53 + 1, 2], [3, 4]]}, "A[0][0]"),
        (MATRICES | {"x0": [0, 10**400]}, "x0[1]"),
        (MATRICES | {"x0": [0, 1e151]}, "x0[1]"),
        (5, "content"),
        (None, "content"),
        (GRAPH | {"u": [[1], [2], [3]]}, "u"),
    ],
)
def test_a_wrong_key_is_named(content, field):
    with pytest.raises(InvalidInputError) as caught:
        run_model(content)
    assert caught.value.field == field


@pytest.mark.parametrize("content", [MATRICES, GRAPH, GRAPH | {"steps": 100}, MATRICES | {"x0": [0, None]}])
def test_every_run_has_a_picture(content):
    figure = draw_model_run(run_model(content))
    file = io.BytesIO()
    figure.savefig(file, format="png")
    assert file.getvalue().startswith(b"\x89PNG")


def test_the_schema_names_every_key_that_is_taken():
    matrices, graph = (set(part["properties"]) for part in MODEL_SCHEMA["oneOf"])
    assert matrices == {"model", "x0", "steps", "u", "A", "A0", "B", "C", "names", "output_names"}
    assert graph == {"model", "x0", "steps", "u", "transitions", "places", "inputs", "outputs"}
    assert json.loads(json.dumps(MODEL_SCHEMA))


def test_a_state_that_never_waits_stays_at_minus_infinity():
    run = run_model(MATRICES | {"A": [[1, None], [None, None]]})
    np.testing.assert_array_equal(run.states[-1], [4.0, E])


def test_times_that_leave_the_range_of_floats_are_an_error_and_no_null():
    with pytest.raises(NumericalError, match="beyond 1e\\+150"):
        run_model(MATRICES | {"A": [[9e149, None], [None, 0]]})
