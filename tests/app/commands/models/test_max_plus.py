"""Max-plus models of model files: what they lead to, what is refused with its key, and that they can be drawn."""

import io
from typing import Any

import numpy as np
import pytest

from app.commands.model_files import schema, simulate_model
from app.commands.simulation import Simulation
from app.commands.simulation_plots import draw_simulation
from pricing_core.errors import InvalidInputError, NumericalError
from tests.problems.max_plus_problems import KNOWN, E

MATRICES: dict[str, Any] = {"model": "max-plus", "A": [[2, 5], [3, 3]], "x0": [0, 0], "steps": 4}
GRAPH: dict[str, Any] = {
    "model": "max-plus",
    "transitions": ["drill", "press"],
    "places": [["drill", "press", 3], ["press", "drill", 2, 1], ["press", "press", 4, 1]],
    "steps": 3,
}


def states(run: Simulation) -> Any:
    return run.samples.columns[0].values


def test_the_railway_of_the_literature_as_a_file() -> None:
    run = simulate_model(MATRICES)
    assert [columns.names for columns in run.samples.columns] == [("x0", "x1")]
    np.testing.assert_array_equal(states(run), KNOWN[2].orbit)
    np.testing.assert_array_equal(run.samples.points, range(5))
    np.testing.assert_array_equal(run.facts["cycle_time"], [4.0, 4.0])


def test_null_and_a_text_stand_for_epsilon_and_outputs_have_columns() -> None:
    run = simulate_model(
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
    x, y = run.samples.columns
    assert (x.names, y.names) == (("in", "out"), ("door",))
    np.testing.assert_array_equal(x.values[:3], [[0, 0], [10, 3], [11, 13]])
    np.testing.assert_array_equal(y.values[:3], [[1], [4], [14]])


def test_an_implicit_model_waits_within_the_step() -> None:
    run = simulate_model(MATRICES | {"A0": [[None, None], [2, None]], "A": [[3, 7], [None, None]]})
    np.testing.assert_array_equal(states(run)[1], [7, 9])
    with pytest.raises(NumericalError, match="circuit x0 -> x0"):
        simulate_model(MATRICES | {"A0": [[1, None], [None, None]]})


def test_inputs_and_outputs_of_an_implicit_model_act_as_those_of_the_explicit_one() -> None:
    """x1(k+1) = 2 + x0(k+1), y = 1 + x1, and an input that x0 waits for."""
    given = {"A0": [[None, None], [2, None]], "A": [[3, None], [None, None]], "steps": 2, "C": [[None, 1]]}
    run = simulate_model(MATRICES | given | {"B": [[0], [None]], "u": [[10], [11]]})
    x, y = run.samples.columns
    np.testing.assert_array_equal(x.values, [[0, 0], [10, 12], [13, 15]])
    np.testing.assert_array_equal(y.values, [[1], [13], [16]])


def test_an_event_graph_as_a_file() -> None:
    run = simulate_model(GRAPH)
    assert run.state_names == ("drill", "press")
    np.testing.assert_array_equal(states(run), [[0, 0], [2, 5], [7, 10], [12, 15]])
    np.testing.assert_array_equal(run.facts["cycle_time"], [5.0, 5.0])


def test_a_place_may_be_an_object_or_a_list_and_inputs_are_given() -> None:
    graph = {
        "model": "max-plus",
        "transitions": ["order", "drill", "press"],
        "places": [
            {"source": "order", "target": "drill", "holding": 1},
            ["drill", "press", 3],
            ["press", "drill", 2, 2],
            {"source": "press", "target": "press", "holding": 4, "tokens": 1},
            {"source": "drill", "target": "drill", "holding": 3, "tokens": 1},
        ],
        "inputs": ["order"],
        "outputs": ["press"],
        "u": [[0], [2], [20]],
        "steps": 3,
    }
    np.testing.assert_array_equal(states(simulate_model(graph))[1:], [[0, 3, 6], [2, 6, 10], [20, 21, 24]])


@pytest.mark.parametrize(
    ("content", "field"),
    [
        (MATRICES | {"model": "lsc"}, "model"),
        ({"A": [[1]]}, "model"),
        (MATRICES | {"t_span": [0, 1]}, "key"),
        (MATRICES | {"places": []}, "key"),
        (GRAPH | {"A": [[1]]}, "key"),
        (MATRICES | {"steps": 0}, "steps"),
        (MATRICES | {"steps": 1.5}, "steps"),
        (MATRICES | {"steps": True}, "steps"),
        ({"model": "max-plus", "steps": 1, "x0": [0]}, "A"),
        ({"model": "max-plus", "steps": 1, "A": [[0]]}, "x0"),
        (MATRICES | {"x0": None}, "x0"),
        (MATRICES | {"x0": [0]}, "x0"),
        (MATRICES | {"x0": [0, "1"]}, "x0[1]"),
        (MATRICES | {"A": [[1, 2], [3]]}, "A[1]"),
        (MATRICES | {"A": [[1, 2]]}, "A"),
        (MATRICES | {"A": []}, "A"),
        (MATRICES | {"A": [[]]}, "A[0]"),
        (MATRICES | {"A": [[1, float("nan")], [0, 0]]}, "A[0][1]"),
        (MATRICES | {"A": [[1, True], [0, 0]]}, "A[0][1]"),
        (MATRICES | {"A": [[0.0] * 1001] * 1001}, "A"),
        (MATRICES | {"A0": [[None]]}, "A"),
        (MATRICES | {"u": [[1]]}, "u"),
        (MATRICES | {"names": ["a"]}, "names"),
        (MATRICES | {"names": ["a", "a"]}, "names"),
        (MATRICES | {"names": ["a", ""]}, "names"),
        (MATRICES | {"names": ["a", "k"]}, "names"),
        (MATRICES | {"names": "ab"}, "names"),
        (MATRICES | {"output_names": ["a"]}, "output_names"),
        (GRAPH | {"places": [["drill", "press", 3]]}, "transitions"),
        (GRAPH | {"places": [["drill", "press", 3], ["press", "drill", 2]]}, "places"),
        (GRAPH | {"x0": [1]}, "x0"),
        (GRAPH | {"places": [["drill", "press", 3], ["press", "drill", 2, 501]]}, "places"),
        (GRAPH | {"places": [["drill", "press", 3], ["press", "drill", 2**53 + 1, 1]]}, "places[1].holding"),
        (GRAPH | {"places": [["drill", "press", "1", 1]]}, "places[0].holding"),
        (GRAPH | {"places": [["drill", "press", 1, 1.5]]}, "places[0].tokens"),
        (GRAPH | {"places": [3]}, "places[0]"),
        (GRAPH | {"places": [["drill", "press"]]}, "places[0]"),
        (GRAPH | {"places": [{"source": "drill"}]}, "places[0].target"),
        (GRAPH | {"places": [{"source": "drill", "target": 1}]}, "places[0].target"),
        (GRAPH | {"places": [{"source": "drill", "target": "press", "time": 1}]}, "key of places[0]"),
        (GRAPH | {"places": None}, "places"),
        (GRAPH | {"transitions": None}, "transitions"),
        (GRAPH | {"transitions": "a"}, "transitions"),
        (GRAPH | {"transitions": []}, "transitions"),
        (GRAPH | {"outputs": ["drill", "drill"]}, "outputs"),
        ({key: value for key, value in GRAPH.items() if key != "transitions"}, "transitions"),
        (MATRICES | {"A": [[2**53 + 1, 2], [3, 4]]}, "A[0][0]"),
        (MATRICES | {"x0": [0, 10**400]}, "x0[1]"),
        (MATRICES | {"x0": [0, 1e151]}, "x0[1]"),
        (GRAPH | {"u": [[1], [2], [3]]}, "u"),
    ],
)
def test_a_wrong_key_is_named(content: dict[str, Any], field: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        simulate_model(content)
    assert caught.value.field == field


@pytest.mark.parametrize("content", [MATRICES, GRAPH, GRAPH | {"steps": 100}, MATRICES | {"x0": [0, None]}])
def test_every_run_has_a_picture(content: dict[str, Any]) -> None:
    file = io.BytesIO()
    draw_simulation(simulate_model(content), file)
    assert file.getvalue().startswith(b"\x89PNG")


def test_the_schema_names_every_key_that_is_taken() -> None:
    (forms,) = (model["oneOf"] for model in schema()["oneOf"] if model["title"] == "max-plus")
    matrices, graph = (set(form["properties"]) for form in forms)
    assert matrices == {"model", "x0", "steps", "u", "A", "A0", "B", "C", "names", "output_names"}
    assert graph == {"model", "x0", "steps", "u", "transitions", "places", "inputs", "outputs"}


def test_a_state_that_never_waits_stays_at_minus_infinity() -> None:
    run = simulate_model(MATRICES | {"A": [[1, None], [None, None]]})
    np.testing.assert_array_equal(states(run)[-1], [4.0, E])


def test_times_that_leave_the_range_of_floats_are_an_error_and_no_null() -> None:
    with pytest.raises(NumericalError, match="beyond 1e\\+150"):
        simulate_model(MATRICES | {"A": [[9e149, None], [None, 0]]})
