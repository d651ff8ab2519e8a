"""`pricing simulate` on every model but "lcs": its example, its own columns, its errors."""

import csv
import json
import math
from pathlib import Path
from typing import Any

import pytest

from pricing_core.models import StateConstrainedLQ

MODELS = Path(__file__).parents[3] / "examples" / "models"
PNG = b"\x89PNG\r\n\x1a\n"
EXAMPLES = (
    *("relays_to_origin", "saturation", "oligopoly"),
    *("bouncing_ball", "spinning_ball", "sliding_boxes", "rectifier_netlist", "railway", "cart_to_floor"),
    *("buck_converter", "hysteretic_relay", "buck_netlist"),
)
COLUMNS = {
    "relays_to_origin": "t x1 x2 u1 u2 y1 y2",
    "saturation": "t x1 u1 y1",
    "oligopoly": "t x1 x2 x3 u1 u2 u3 u4 u5 u6 y1 y2 y3 y4 y5 y6",
    "bouncing_ball": "t q1 v1 u1 y1",
    "spinning_ball": "t|x|height|rotation|x'|height'|rotation'|force floor|friction floor|slip floor|gap floor",
    "sliding_boxes": (
        "t x1 y1 turn1 x2 y2 turn2 x3 y3 turn3 x1' y1' turn1' x2' y2' turn2' x3' y3' turn3'|"
        "force left1|force right1|force left2|force right2|force left3|force right3|"
        "friction left1|friction right1|friction left2|friction right2|friction left3|friction right3|"
        "slip left1|slip right1|slip left2|slip right2|slip left3|slip right3|"
        "gap left1|gap right1|gap left2|gap right2|gap left3|gap right3"
    ),
    "rectifier_netlist": "t v(in) v(out) i(V1) i(D1) i(C1) i(R1)",
    "buck_converter": "t v(in) v(x) v(out) i(V1) i(S1) i(D1) i(L1) i(C1) i(R1)",
    "buck_netlist": "t v(in) v(g) v(x) v(out) i(V1) i(VG) i(S1) i(D1) i(L1) i(C1) i(R1)",
    "hysteretic_relay": "t v(in) v(a) i(V1) i(R1) i(C1) i(S1)",
    "railway": "k|west|west ring|east|east ring",
    "cart_to_floor": "t x1 x2 u1 lambda1 lambda2 eta1",
}


def example(name: str) -> dict[str, Any]:
    return dict(json.loads((MODELS / f"{name}.json").read_text(encoding="utf-8")))


@pytest.fixture
def answer(simulate: Any) -> Any:
    """Run an example with changes; return its JSON."""

    def run(name: str, **changes: object) -> dict[str, Any]:
        status, output, errors = simulate(example(name) | changes, "--json")
        assert (status, errors) == (0, "")
        return dict(json.loads(output))

    return run


def test_the_relays_come_to_the_origin_where_both_slide(answer: Any) -> None:
    found = answer("relays_to_origin")
    assert found["x"][-1] == found["u"][-1] == found["y"][-1] == [0.0, 0.0]
    zeno = found["events"][-1]
    assert (zeno["kind"], zeno["pieces_after"]) == ("zeno", [1, 1])
    assert zeno["time"] == pytest.approx(2.0, rel=1e-12)
    sampled = answer("relays_to_origin", t_eval=[1, "5/2"])
    assert sampled["x"][0] == pytest.approx([4 / 3, -2 / 3], rel=1e-12)


def test_relays_have_bounds_of_their_own(answer: Any) -> None:
    found = answer("relays_to_origin", lower=-2, upper=[1, "5/2"], t_eval=[0, 0.1])
    assert found["u"] == [[-2.0, -2.0], [-2.0, -2.0]]
    assert found["x"][1] == pytest.approx([3.2, 0.4], rel=1e-12)


def test_saturation_ends_where_the_exponential_does(answer: Any) -> None:
    found = answer("saturation")
    assert found["x"][-1] == pytest.approx([math.exp(-3.0)], rel=1e-12)
    (switch,) = found["events"]
    assert (switch["time"], switch["pieces_before"], switch["pieces_after"]) == (2.0, [2], [1])


@pytest.mark.parametrize(
    "curve",
    [
        {"saturation": {"limit": "1/2"}},
        {"points": [["-1/2", "-0.5"], [0.5, "5e-1"]]},
        {"points": [[0, 0], ["1/2", "1/2"]], "left_slope": 1, "right_slope": "0"},
    ],
)
def test_numbers_of_characteristics_may_be_texts_as_all_others(answer: Any, curve: Any) -> None:
    """x' = -min(x, 1/2) from 3: at 1/2 by t = 5."""
    assert answer("saturation", characteristics=[curve])["x"][-1] == pytest.approx([0.5], abs=1e-12)


def test_the_oligopoly_comes_close_to_its_nash_equilibrium(answer: Any) -> None:
    found = answer("oligopoly", t_span=[0, 20])
    assert found["x"][-1] == pytest.approx([30.0, 25.0, 0.0], abs=1e-10)
    assert found["u"][-1] == pytest.approx([0.0, 0.0, 15.0, 5.0, 0.0, 0.0], abs=1e-10)


def test_a_projected_system_may_be_simulated_by_steps(answer: Any) -> None:
    found = answer("oligopoly", t_span=[0, 20], method="time-stepping", rtol=1e-7)
    assert found["scheme"] == "projected-heun"
    assert found["x"][-1] == pytest.approx([30.0, 25.0, 0.0], abs=1e-5)


def test_the_ball_rests_after_infinitely_many_bounces(answer: Any) -> None:
    """It falls for sqrt(2/g), and its bounces take 2 e/(1 - e) times as long together."""
    found = answer("bouncing_ball")
    assert (found["q"][-1], found["v"][-1], found["u"][-1]) == ([0.0], [0.0], [9.81])
    assert found["events"][-1]["time"] == pytest.approx(3.0 * math.sqrt(2.0 / 9.81), rel=1e-12)
    assert found["names"]["x"] == ["q1", "v1"]


def test_a_spinning_ball_comes_to_roll_where_its_point_of_contact_stops(answer: Any) -> None:
    """The velocity of its point of contact, 5 m/s, falls by 7/2 of what friction takes from x'."""
    found = answer("spinning_ball")
    assert found["v"][-1] == pytest.approx([1.0 - 2.0 / 7.0 * 5.0, 0.0, 30.0 / 7.0], abs=1e-9)
    assert (found["slip"][-1], found["friction"][-1]) == ([pytest.approx(0.0, abs=1e-12)],) * 2
    assert found["names"]["u"] == ["force floor"]
    nearer = answer("spinning_ball", scheme="stewart-trinkle", restitution=0)
    assert nearer["v"][-1] == pytest.approx(found["v"][-1], abs=1e-9)


def test_a_box_slides_off_its_speed_on_two_that_rest(answer: Any) -> None:
    """From 1.5 m/s, held back by 0.4 g."""
    found = answer("sliding_boxes")
    assert found["q"][-1] == pytest.approx([0.0] * 6 + [1.5**2 / (0.8 * 9.81), 0.0, 0.0], abs=1e-4)
    one = answer(
        "sliding_boxes",
        boxes={"mass": [2], "width": [1], "height": [1], "friction": [0.5], "slope": 0.4},
        v0=[0, 0, 0],
    )
    assert found["names"]["q"][:3] == ["x1", "y1", "turn1"]
    assert one["names"]["q"] == ["x", "y", "turn"]
    assert one["q"][-1] == pytest.approx([0.0] * 3, abs=1e-12)  # tan 0.4 < 0.5


def test_states_have_names_of_their_own(answer: Any) -> None:
    found = answer("relays_to_origin", names={"x": ["left", "right"]}, units={"x": ["m", "V"], "t": "s"})
    assert found["names"]["x"] == ["left", "right"]
    assert found["names"]["u"] == ["u1", "u2"]


def test_a_chair_on_four_legs_shares_its_weight(answer: Any) -> None:
    legs = [[1, 1, 1], [1, 1, -1], [1, -1, 1], [1, -1, -1]]
    found = answer(
        "bouncing_ball",
        mass=[[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        F=legs,
        force=[-8, 0, 0],
        restitution=0,
        q0=[0, 0, 0],
        v0=[0, 0, 0],
        t_span=[0, 1],
    )
    assert found["u"][-1] == pytest.approx([2.0] * 4, rel=1e-12)


def test_the_relay_switches_at_its_thresholds(answer: Any) -> None:
    """The capacitor reaches 5 + 1 V after 1 ms ln(10/4)."""
    first = answer("hysteretic_relay")["events"][0]
    assert first["time"] == pytest.approx(1e-3 * math.log(10 / 4), rel=1e-12)


def test_a_netlist_may_say_when_it_ends_and_what_it_left_out(answer: Any) -> None:
    found = answer("buck_netlist")
    assert found["t"][-1] == 5e-4
    assert found["notes"][0].endswith("is taken for the title: Buck converter with a gate drive")


def test_the_rectifier_discharges_through_its_resistor(answer: Any) -> None:
    """The diode lets go where the capacitor and the resistor draw no current: tan wt = -w R C."""
    found = answer("rectifier_netlist")
    frequency = 100.0 * math.pi
    opens = (math.pi - math.atan(frequency * 0.1)) / frequency
    assert found["events"][0]["time"] == pytest.approx(opens, rel=1e-12)
    last = opens + 0.08
    end = 10.0 * math.sin(frequency * opens) * math.exp(-(0.1 - last) / 0.1)
    out = found["names"]["v"].index("v(out)")
    assert found["v"][-1][out] == pytest.approx(end, rel=1e-9)
    assert found["i"][-1][found["names"]["i"].index("i(R1)")] == pytest.approx(end / 1000.0, rel=1e-9)


def test_a_circuit_may_be_a_list_of_elements(simulate: Any) -> None:
    """A capacitor of 2 F at 3 V shares its charge with one of 1 F, and a third of its 9 J is lost."""
    model = {
        "model": "circuit",
        "elements": [
            {"kind": "capacitor", "name": "C1", "plus": "a", "minus": "0", "farads": 2, "initial_voltage": 3},
            {"kind": "diode", "name": "D1", "anode": "a", "cathode": "b"},
            {"kind": "capacitor", "name": "C2", "plus": "b", "minus": "0", "farads": "1"},
        ],
        "t_span": [0, 1],
    }
    _, output, _ = simulate(model)
    assert "v(C1): 3 -> 2, v(C2): 0 -> 2" in output
    _, output, _ = simulate(model, "--json")
    found = json.loads(output)
    assert found["v"][-1] == pytest.approx([2.0, 2.0])
    assert found["events"][0]["energy_lost"] == pytest.approx(3.0)


def test_the_cart_stays_on_the_floor_once_it_is_there(answer: Any) -> None:
    """The command prints what the library finds: the junction, the atom there, the arcs, the cost."""
    found = answer("cart_to_floor")
    control = StateConstrainedLQ(
        [[0, 1], [0, 0]], [[0], [1]], [[1, 0]], [[4, 0], [0, 0]], [2, 0], 4.0, bound=[1]
    ).solve()
    (junction,) = found["events"]
    assert (junction["kind"], junction["mode_before"], junction["mode_after"]) == ("switch", [], [0])
    assert (found["status"], found["cost"]) == ("solved", control.cost)
    assert junction["time"] == control.switching_times[0]
    assert junction["x_after"] == pytest.approx([1.0, 0.0], abs=1e-9)
    first = found["multiplier_atoms"][0]
    assert junction["impulse"] == first["weights"] == control.multiplier_atoms[0][1].tolist()


def test_the_railway_runs_every_58_minutes(answer: Any) -> None:
    found = answer("railway")
    assert found["cycle_time"] == [58.0] * 4
    assert found["x"][1] == [56.0, 56.0, 60.0, 60.0]
    assert found["x"][6] == [348.0] * 4
    assert found["k"][-1] == 6.0


def test_a_max_plus_system_may_be_given_by_matrices_with_minus_infinity(simulate: Any) -> None:
    model = {"model": "max-plus", "A": [[3, None], [2, 4]], "x0": [None, 0], "steps": 2, "C": [[0, None]]}
    _, output, _ = simulate(model, "--json")
    found = json.loads(output)
    assert (found["x"], found["y"]) == ([[None, 0.0], [None, 4.0], [None, 8.0]], [[None], [None], [None]])
    _, output, _ = simulate(model)
    lines = [line.split() for line in output.splitlines()]
    assert ["x0", "-inf"] in lines
    assert ["x1", "8"] in lines


def _names(columns: str) -> list[str]:
    """Return names that are parted by bars, or the words of what has none."""
    if "|" not in columns:
        return columns.split()
    return [
        name for part in columns.split("|") for name in (part.split() if part.startswith("t ") else [part])
    ]


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_example_has_a_table_columns_and_a_picture(pricing: Any, name: str, tmp_path: Path) -> None:
    table, picture, path = tmp_path / "out.csv", tmp_path / "out.png", MODELS / f"{name}.json"
    status, output, errors = pricing("simulate", path)
    assert (status, errors) == (0, "")
    assert " at " in output
    assert pricing("simulate", path, "--csv", table, "--plot", picture) == (0, "", "")
    with table.open(newline="") as file:
        rows = list(csv.reader(file))
    columns = COLUMNS[name]
    assert rows[0] == _names(columns)
    assert len({len(row) for row in rows}) == 1
    assert picture.read_bytes().startswith(PNG)


WRONG = [
    ("spinning_ball", {"friction": None}, "friction is missing: tangents needs it"),
    ("spinning_ball", {"friction": [-1]}, "friction = [-1]: must be coefficients >= 0"),
    ("spinning_ball", {"tangents": [[1]]}, "tangents = shape (1, 1): must be of shape (1, 3) in the plane"),
    ("spinning_ball", {"tangents": [[["a"]]]}, "tangents[0][0][0] = 'a': must be a number"),
    ("spinning_ball", {"method": None}, 'h = 0.002: must be left out with method="event-driven"'),
    (
        "spinning_ball",
        {"method": None, "h": None},
        "method = 'event-driven': must be \"time-stepping\" or a TimeStepping(...)",
    ),
    ("spinning_ball", {"scheme": "stewart-trinkle"}, "scheme = 'stewart-trinkle': must be \"moreau\""),
    ("spinning_ball", {"names": {"q": ["x"]}}, "names.q = 1 of them: must be 3, one for each component"),
    (
        "spinning_ball",
        {"names": {"q": ["x", "x", "y"]}, "drawing": None},
        "names = 'x': must be different from all other names",
    ),
    ("spinning_ball", {"names": {"x": ["x"]}}, "names has no key 'x': choose from q"),
    ("spinning_ball", {"units": {"q": ["m"]}}, "units.q = 1 of them: must be 3, one for each component"),
    ("spinning_ball", {"units": {"t": 3}}, "units.t = 3: must be a text"),
    ("sliding_boxes", {"boxes": {"mass": [1]}}, "boxes.width is missing: of each box"),
    ("sliding_boxes", {"boxes": 3}, "boxes = 3: must be an object with the keys mass, width"),
    (
        "sliding_boxes",
        {"boxes": {"mass": [1], "width": [0], "height": [1], "friction": [1]}},
        "boxes.width = [0]: must be one or more numbers > 0",
    ),
    ("sliding_boxes", {"v0": [1]}, "v0 = "),
    ("sliding_boxes", {"names": {"q": ["x"]}}, "there is no key 'names': choose from model, boxes"),
    ("relays_to_origin", {"names": {"x": "ab"}}, "names.x = 'ab': must be a list of texts"),
    ("saturation", {"names": {"x": ["t"]}}, "names = 't': must be different from all other names"),
    ("relays_to_origin", {"B": None}, "B is missing: n x k, by rows"),
    ("relays_to_origin", {"E": 1}, "there is no key 'E': choose from model, A, B, C, D, lower"),
    ("relays_to_origin", {"A": [[1, 2], [3]]}, "A[1] = 1 numbers: must be as long as the first row"),
    ("relays_to_origin", {"A": [["a", 2], [3, 4]]}, "A[0][0] = 'a': must be a number"),
    ("relays_to_origin", {"lower": 2}, "lower[0] = 2.0: must be less than upper[0] = 1"),
    ("relays_to_origin", {"form": "ode"}, "form = 'ode': must be one of "),
    ("saturation", {"characteristics": {}}, "characteristics = {}: must be a list"),
    ("saturation", {"characteristics": []}, "characteristics = 0 of them: must be one for each"),
    (
        "saturation",
        {"characteristics": [{"saturation": {"limit": -1}}]},
        "characteristics[0].saturation.limit = -1",
    ),
    ("oligopoly", {"F": 3}, "F = 3: must be an object with the keys matrix, vector"),
    ("oligopoly", {"F": {"matrix": [[1]]}}, "F.vector is missing"),
    ("oligopoly", {"F": {"matrix": [[1, 2]], "vector": [1]}}, "F.matrix = "),
    ("oligopoly", {"h": [0]}, "h = "),
    ("oligopoly", {"x0": [-1, 1, 1]}, "x0 = "),
    ("oligopoly", {"x0": [1]}, "x0 = 'shape (1,)': must be a vector of length 3"),
    ("bouncing_ball", {"mass": [[0]]}, "mass = [[0]]: must be symmetric and positive definite"),
    ("bouncing_ball", {"restitution": 2}, "restitution = 2.0: must be a number from 0 to 1"),
    ("bouncing_ball", {"q0": [-1]}, "q0 = [-1]: must be such that constraint 0 holds"),
    ("bouncing_ball", {"x0": [1, 0]}, "there is no key 'x0': choose from model"),
    ("rectifier_netlist", {"netlist": None}, "circuit is missing: give "),
    ("rectifier_netlist", {"netlist": 3}, "netlist = 3: must be a text"),
    ("rectifier_netlist", {"netlist": "Q1 a b c"}, ""),
    (
        "rectifier_netlist",
        {"netlist": None, "elements": [{"kind": []}]},
        "elements[0].kind = []: must be one of",
    ),
    ("rectifier_netlist", {"netlist": None, "elements": 1}, "elements = 1: must be a list"),
    ("rectifier_netlist", {"x0": [1, 2]}, "x0 = "),
    ("cart_to_floor", {"Q": None}, "Q is missing: n x n, by rows: the cost is"),
    ("cart_to_floor", {"Q": [[-1, 0], [0, 0]]}, "Q = "),
    ("cart_to_floor", {"x0": [0, 0]}, "x0 = [0.0, 0.0]: must be a state with C x0 >= bound"),
    ("cart_to_floor", {"horizon": "no"}, "horizon = 'no': must be a number"),
    ("cart_to_floor", {"intervals": 3}, "intervals = 3: must be a whole number from 8 to 20000"),
    ("cart_to_floor", {"t_span": [0, 1]}, "there is no key 't_span': choose from model, A, B, C"),
    ("railway", {"steps": None}, "steps is missing: events to compute"),
    ("railway", {"steps": 0}, "steps = 0: must be a whole number from 1 to 100000"),
    ("railway", {"t_span": [0, 1]}, "there is no key 't_span': choose from model, transitions"),
    ("railway", {"A": [[1]]}, "there is no key 'A': choose from model, transitions"),
    ("railway", {"x0": [0]}, "x0 = shape (1,): must be a vector of length 4"),
    (
        "railway",
        {"transitions": ["k"], "places": [["k", "k", 2, 1]], "x0": None},
        "names = ['k']: must be different from k",
    ),
]


@pytest.mark.parametrize(("name", "change", "sentence"), WRONG)
def test_a_wrong_value_is_named_with_what_is_allowed(
    simulate: Any, name: str, change: dict[str, object], sentence: str
) -> None:
    model = {key: value for key, value in (example(name) | change).items() if value is not None}
    status, output, errors = simulate(model)
    assert (status, output, errors.count("\n")) == (2, "", 1)
    assert errors.startswith("pricing: " + sentence)


def test_constraints_that_exclude_each_other_are_named(simulate: Any) -> None:
    status, _, errors = simulate(example("oligopoly") | {"H": [[1, 0, 0], [-1, 0, 0]], "h": [1, 0]})
    assert status == 2
    assert "row 0" in errors
    assert "row 1" in errors


def test_the_schemas_of_max_plus_and_mechanics_have_two_forms(pricing: Any) -> None:
    _, output, _ = pricing("simulate", "--schema")
    models = {model["title"]: model for model in json.loads(output)["oneOf"]}
    forms = models["max-plus"]["oneOf"]
    assert [form["required"][1] for form in forms] == ["A", "transitions"]
    by_matrices, by_boxes = models["mechanics"]["oneOf"]
    assert by_matrices["required"] == ["model", "mass", "F", "q0", "v0", "t_span"]
    assert by_boxes["required"] == ["model", "boxes", "t_span"]
    assert models["circuit"]["properties"]["netlist"]["type"] == "string"


METHODS = ("saturation", "relays_to_origin", "rectifier_netlist", "bouncing_ball")


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"h": 0.1}, 'h = 0.1: must be left out with method="event-driven"'),
        ({"lcp_method": "psor"}, "lcp_method = 'psor': must be left out with method=\"event-driven\""),
        (
            {"method": "time-stepping", "on_nonunique": "first"},
            "on_nonunique = 'first': must be left out with method=\"time-stepping\"",
        ),
        (
            {"method": "time-stepping", "max_events": 9},
            'max_events = 9: must be left out with method="time-stepping"',
        ),
        ({"method": "time-stepping", "h": 0}, "h = 0.0: must be a number > 0"),
        (
            {"method": "time-stepping", "h": 0.1, "rtol": 1e-3},
            "rtol = 0.001: must be left out with a constant step",
        ),
        (
            {"method": "time-stepping", "theta": 0.5},
            'theta = 0.5: must be left out unless scheme is "theta" or "moreau"',
        ),
        ({"method": "time-stepping", "atol": -1}, "atol = -1.0: must be > 0"),
    ],
)
def test_a_key_that_the_method_has_no_use_for_is_refused_by_its_name(
    simulate: Any, name: str, changes: dict[str, Any], sentence: str
) -> None:
    assert simulate(example(name) | changes) == (2, "", f"pricing: {sentence}\n")


def test_tolerances_for_each_state_are_as_many(simulate: Any) -> None:
    changes = {"method": "time-stepping", "atol": [1, 1, 1]}
    status, _, errors = simulate(example("relays_to_origin") | changes)
    assert (status, errors) == (2, "pricing: atol = 'shape (3,)': must be a vector of length 2\n")


def test_projected_systems_take_what_their_steps_use(simulate: Any) -> None:
    """Their h is the vector of H x >= h, and no step."""
    status, _, errors = simulate(example("oligopoly") | {"rtol": 1e-3})
    assert (status, errors) == (2, 'pricing: rtol = 0.001: must be left out with method="event-driven"\n')
    status, _, errors = simulate(example("oligopoly") | {"scheme": "sdirk2"})
    assert (status, errors.startswith("pricing: there is no key 'scheme': choose from ")) == (2, True)


def test_mechanics_without_rebound_may_be_simulated_by_steps(answer: Any, simulate: Any) -> None:
    found = answer("bouncing_ball", restitution=0, method="time-stepping", h=1e-3)
    assert found["scheme"] == "implicit-euler"
    assert (found["q"][-1], found["u"][-1]) == ([pytest.approx(0.0, abs=1e-9)], [pytest.approx(9.81)])
    found = answer("bouncing_ball", method="time-stepping")
    assert found["scheme"] == "moreau"
    status, _, errors = simulate(example("bouncing_ball") | {"method": "time-stepping", "scheme": "theta"})
    assert (status, errors) == (
        2,
        "pricing: scheme = 'theta': must be \"moreau\" where the restitution is > 0\n",
    )
