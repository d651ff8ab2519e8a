"""`pricing simulate`, in this process."""

import csv
import json
import math
from pathlib import Path
from typing import Any

import pytest

from app.commands.model_files import FORMATS, MODULES
from tests.problems.nightly import nightly

MODELS = Path(__file__).parents[3] / "examples" / "models"
PNG = b"\x89PNG\r\n\x1a\n"
HALF_LINE = {
    "model": "lcs",
    "A": [[0]],
    "B": [[1]],
    "C": [[1]],
    "f": [-1],
    "x0": ["1/2"],
    "t_span": [0, 1],
}


def test_the_table_shows_the_end_and_the_events(simulate: Any) -> None:
    status, output, errors = simulate(HALF_LINE)
    assert (status, errors) == (0, "")
    lines = [line.split() for line in output.splitlines() if line]
    assert lines[0] == ["finished", "(event-driven):", "2", "steps,", "1", "event"]
    assert ["x1", "0"] in lines
    assert ["u1", "1"] in lines
    assert ["0.5", "switch", "-", "y1"] in lines


def test_a_jump_is_shown_with_the_states_that_it_changes(pricing: Any) -> None:
    _, output, _ = pricing("simulate", MODELS / "two_carts.json")
    jumps = [" ".join(line.split()) for line in output.splitlines() if " jump " in line]
    assert "7.584475592 jump y1 y2 x3: 0 -> 0.25, x4: 0.5 -> 0.25" in jumps


def test_many_events_are_shortened_to_the_first_and_the_last(simulate: Any) -> None:
    rectifier = HALF_LINE | {"A": [[-1]], "f": {"sine": {"amplitude": 5, "frequency": 1}}, "t_span": [0, 20]}
    _, output, _ = simulate(rectifier)
    assert "... 16 more" in output
    assert len(output.splitlines()) < 40


def test_an_input_may_be_piecewise_linear(simulate: Any) -> None:
    """x' = f from 1/2 with f rising from 0 to 2: x(1) = 3/2."""
    ramp = {"piecewise_linear": {"times": [0, 1], "values": [0, 2]}}
    _, output, _ = simulate(HALF_LINE | {"f": ramp}, "--json")
    assert json.loads(output)["x"][-1] == [pytest.approx(1.5, abs=1e-12)]


def test_json_holds_states_multipliers_slacks_and_whole_events(simulate: Any) -> None:
    status, output, _ = simulate(HALF_LINE, "--json")
    answer = json.loads(output)
    assert status == 0
    assert answer["t"] == [0.0, 0.5, 0.5, 1.0]
    assert answer["x"] == [[0.5], [pytest.approx(0.0, abs=1e-15)], [0.0], [0.0]]
    assert answer["u"] == [[0.0], [0.0], [1.0], [1.0]]
    assert answer["y"] == [[0.5], [0.0], [0.0], [0.0]]
    assert answer["names"] == {"x": ["x1"], "u": ["u1"], "y": ["y1"]}
    (event,) = answer["events"]
    assert (event["kind"], event["mode_before"], event["mode_after"]) == ("switch", [], [0])
    assert set(event) == {
        *("time", "kind", "x_before", "x_after", "impulse", "mode_before", "mode_after", "multiplicity"),
        *("energy_lost", "order_sensitive", "ratio"),
    }
    assert answer["status"] == "finished"


def test_csv_and_picture_are_written(simulate: Any, tmp_path: Path) -> None:
    table, picture = tmp_path / "out.csv", tmp_path / "out.png"
    model = HALF_LINE | {"t_eval": {"steps": 4}}
    assert simulate(model, "--csv", table, "--plot", picture) == (0, "", "")
    with table.open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["t", "x1", "u1", "y1"]
    assert [[float(cell) for cell in row] for row in rows[1:]] == [
        [0.0, 0.5, 0.0, 0.5],
        [0.25, 0.25, 0.0, 0.25],
        [0.5, 0.0, 1.0, 0.0],
        [0.75, 0.0, 1.0, 0.0],
        [1.0, 0.0, 1.0, 0.0],
    ]
    assert picture.read_bytes().startswith(PNG)


def test_time_stepping_takes_its_options(simulate: Any) -> None:
    model = HALF_LINE | {
        "method": "time-stepping",
        "h": "1/8",
        "scheme": "implicit-euler",
        "t_eval": [0, 0.25],
    }
    _, output, _ = simulate(model, "--json")
    answer = json.loads(output)
    assert (answer["scheme"], answer["x"]) == ("implicit-euler", [[0.5], [0.25]])


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"modle": 1}, "there is no key 'modle': did you mean model?"),
        ({"model": "lsc"}, 'model = \'lsc\': must be one of "lcs", "relay", '),
        ({"A": None}, "A is missing: n x n, by rows"),
        ({"A": [[1, 2], [3]]}, "A[1] = 1 numbers: must be as long as the first row: 2"),
        ({"A": [["1/0"]]}, "A[0][0] = '1/0': must be a number such as 0.5"),
        ({"A": [[True]]}, "A[0][0] = True: must be a number"),
        ({"A": [["1e9999999"]]}, "A[0][0] = '1e9999999': must be a number"),
        ({"A": [1]}, "A[0] = 1: must be a list of numbers"),
        ({"B": [[1], [2]]}, "B = 'shape (2, 1)': must be a matrix of shape (1, 1)"),
        ({"x0": [1, 2]}, "x0 = 'shape (2,)': must be a vector of length 1"),
        ({"x0": ["1e999"]}, "x0[0] = '1e999': must be of a size"),
        ({"t_span": [1, 0]}, "t_span = (1.0, 0.0): must be two finite numbers with t_span[0] < t_span[1]"),
        ({"t_span": [1]}, "t_span = [1]: must be a list of two numbers"),
        (
            {"t_eval": {"steps": 10**12}},
            "t_eval.steps = 1000000000000: must be a whole number from 1 to 1000000",
        ),
        ({"t_eval": {"steps": 0}}, "t_eval.steps = 0: must be a whole number from 1 to 1000000"),
        ({"method": "euler"}, 'method = \'euler\': must be one of "event-driven", "time-stepping"'),
        ({"h": 0.1}, 'h = 0.1: must be left out with method="event-driven"'),
        ({"f": {"times": [0]}}, "f.values is missing: "),
        (
            {"f": {"times": [1, 0], "values": [1, 2]}},
            "f.times = [1, 0]: must be a non-empty increasing vector",
        ),
        ({"f": {"sine": {"frequency": 1}}}, "f.sine.amplitude is missing: a number"),
        ({"f": {"cosine": 1}}, "f = {'cosine': 1}: must be a list of numbers, "),
        ({"f": {"sine": {}, "times": []}}, "f has no key 'times': choose from sine"),
    ],
)
def test_a_wrong_value_is_named_with_what_is_allowed(
    simulate: Any, change: dict[str, object], sentence: str
) -> None:
    model = {key: value for key, value in (HALF_LINE | change).items() if value is not None}
    status, output, errors = simulate(model)
    assert (status, output, errors.count("\n")) == (2, "", 1)
    assert errors.startswith("pricing: " + sentence)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ('{"model": "lcs", "A": [[0]], "A": [[1]]}', "system.json holds the key 'A' twice"),
        ('{"model": "lcs", "A": [[NaN]]}', "system.json holds NaN or Infinity, which are not JSON numbers"),
        ("{", "system.json is not JSON from character 1 on"),
        ("[]", "system.json must hold one JSON object"),
        ("{}", "model is missing: give one of " + ", ".join([*MODULES][:-1]) + f" or {[*MODULES][-1]}"),
    ],
)
def test_a_file_that_is_no_model_is_refused_by_one_line(simulate: Any, text: str, sentence: str) -> None:
    assert simulate(text) == (2, "", f"pricing: {sentence}\n")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"B": [[0]]}, "no mode"),
        ({"B": [[-1]], "f": [1], "x0": [0]}, "several continuations"),
    ],
)
def test_what_the_library_refuses_is_told_in_its_own_sentence(
    simulate: Any, change: dict[str, object], words: str
) -> None:
    status, output, errors = simulate(HALF_LINE | change)
    assert (status, output, errors.count("\n")) == (2, "", 1)
    assert words in errors


def test_a_missing_file_and_a_missing_argument_are_named(pricing: Any, tmp_path: Path) -> None:
    missing = tmp_path / "none.json"
    assert pricing("simulate", missing) == (2, "", f"pricing: {missing}: No such file or directory\n")
    status, _, errors = pricing("simulate")
    assert (status, errors) == (
        2,
        "pricing: SYSTEM.json is missing: give a model file, or --schema\n",
    )


def test_the_schema_lists_the_keys_of_every_model(pricing: Any) -> None:
    status, output, _ = pricing("simulate", "--schema")
    schema = json.loads(output)
    assert status == 0
    models = {model["title"]: model for model in schema["oneOf"]}
    assert list(models) == list(MODULES)
    model = models["lcs"]
    assert model["required"] == ["model", "A", "B", "C", "x0", "t_span"]
    assert model["additionalProperties"] is False
    assert model["properties"]["model"]["enum"] == ["lcs"]


@pytest.mark.parametrize("ending", ["CIR", *nightly(["cir", "net", "sp"])])
def test_a_netlist_runs_as_it_does_in_a_model_file(
    pricing: Any, simulate: Any, tmp_path: Path, ending: str
) -> None:
    text = (MODELS / "diode_bridge.cir").read_text(encoding="utf-8")
    file = tmp_path / f"bridge.{ending}"
    file.write_text(text, encoding="utf-8")
    status, output, errors = pricing("simulate", file, "--json")
    assert (status, errors) == (0, "")
    found, expected = (
        json.loads(output),
        json.loads(simulate({"model": "circuit", "netlist": f"* {text}"}, "--json")[1]),
    )
    assert (
        found.pop("notes")[0]
        == "line 1 of the netlist is the title: 12 V at 50 Hz into a bridge of diodes, 1000 uF and a load of 100 ohms"
    )
    del expected["notes"]
    assert found == expected
    assert "note: line 1 of the netlist is the title" in pricing("simulate", file)[1]


def test_a_file_of_another_kind_is_told_which_kinds_there_are(pricing: Any, tmp_path: Path) -> None:
    file = tmp_path / "bridge.txt"
    file.write_text("* bridge\nR1 a 0 1\n")
    told = f"pricing: {file} is not JSON from character 0 on: {FORMATS}\n"
    assert pricing("simulate", file) == (2, "", told)


@pytest.mark.parametrize(
    ("name", "end"),
    [
        ("diode_bridge_lcs", [1.418582833608748, 3.324093982098158e-2]),
        ("two_relays", [0.0, 0.0]),
        ("two_carts", None),
        ("rectifier", None),
    ],
)
def test_the_example_models_run_and_end_where_they_must(
    pricing: Any, name: str, end: list[float] | None
) -> None:
    status, output, errors = pricing("simulate", MODELS / f"{name}.json", "--json")
    assert (status, errors) == (0, "")
    answer = json.loads(output)
    if name == "two_carts":  # mode {2} from the fourth jump on: x1 = x2 = (a sqrt 2) sin(t / sqrt 2), a = 1/8
        begin = answer["events"][-1]["time"]
        assert begin == pytest.approx(2 * math.pi * (1 + math.sqrt(2)), abs=1e-9)
        x1 = math.sqrt(2) / 8 * math.sin((16 - begin) / math.sqrt(2))
        end = [x1, x1, *[math.cos((16 - begin) / math.sqrt(2)) / 8] * 2]
    if end is not None:
        assert answer["x"][-1] == pytest.approx(end, abs=1e-10)
    if name == "two_relays":
        assert [event["time"] for event in answer["events"] if event["kind"] == "zeno"] == pytest.approx(
            [2.0]
        )
