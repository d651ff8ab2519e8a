"""Animations of simulations: what moves, and what is refused."""

import json
import math
from io import BytesIO
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from app.commands.animation import animate_simulation, scene_of
from app.commands.circuit_scene import ring
from app.commands.model_files import simulate_model
from app.commands.simulation import Simulation
from pricing_core.errors import InvalidInputError
from pricing_core.models.circuits.elements import Branch

MODELS = Path(__file__).parents[3] / "examples" / "models"


def example(name: str, **changes: object) -> Simulation:
    return simulate_model(json.loads((MODELS / f"{name}.json").read_text(encoding="utf-8")) | changes)


def shown(simulation: Simulation) -> tuple[Any, Any]:
    """Return the scene and the axes that it is on."""
    scene, axes = scene_of(simulation), Figure().add_subplot()
    scene.prepare(axes)
    return scene, axes


@pytest.mark.parametrize("name", ["spinning_ball", "bouncing_ball", "rectifier_netlist", "relays_to_origin"])
def test_an_animation_is_a_gif_that_repeats_and_moves(name: str) -> None:
    changes = {"h": 0.05} if name == "spinning_ball" else {}
    file = BytesIO()
    animate_simulation(example(name, **changes), file, frames=4)
    image = Image.open(file)
    assert (image.format, image.n_frames, image.info["loop"], image.info["duration"]) == ("GIF", 4, 0, 50)
    frames = []
    for i in range(4):
        image.seek(i)
        frames.append(np.array(image.convert("RGB"), dtype=int))
    assert all((np.abs(a - b).max(axis=2) > 60).sum() > 50 for a, b in pairwise(frames))


def test_bodies_are_where_their_coordinates_are() -> None:
    simulation = example("spinning_ball", h=0.05)
    scene, axes = shown(simulation)
    disc, mark = scene.show(0.2)
    middle = disc.get_xy()[:-1].mean(axis=0)
    assert middle == pytest.approx([0.2, 0.1 + 0.5 - 0.5 * 9.81 * 0.04], abs=0.01)
    line = np.ptp(mark.get_xydata(), axis=0)
    assert math.hypot(*line) == pytest.approx(0.09)
    low, high = axes.get_ylim()
    assert low < 0.0
    assert high > 0.7


def test_a_box_stands_on_its_slope() -> None:
    """It slides along the x of the model, which is downhill."""
    model = {
        "model": "mechanics",
        "mass": [[1, 0], [0, 1]],
        "F": [[0, 1]],
        "force": [5, -8],
        "tangents": [[1, 0]],
        "friction": [0.1],
        "q0": [0, 0],
        "v0": [0, 0],
        "t_span": [0, 1],
        "method": "time-stepping",
        "h": 0.1,
        "drawing": {
            "slope": 0.5,
            "bodies": [{"shape": "box", "width": 0.4, "height": 0.2, "at": [0, 0.1], "x": "q1", "y": "q2"}],
        },
    }
    scene, _ = shown(simulate_model(model))
    corners = scene.show(1.0)[0].get_xy()[:-1]
    way = simulate_model(model).samples.columns[0].values[-1, 0]
    downhill = np.array([math.cos(0.5), -math.sin(0.5)])
    assert way == pytest.approx(0.5 * (5.0 - 0.8), abs=1e-9)
    assert corners.mean(axis=0) == pytest.approx(
        way * downhill + 0.1 * np.array([math.sin(0.5), math.cos(0.5)])
    )


def test_a_diode_is_filled_while_it_conducts_and_nodes_show_their_voltages() -> None:
    scene, axes = shown(example("rectifier_netlist"))
    triangle = next(patch for patch in axes.patches)
    scene.show(0.002)
    conducting = triangle.get_facecolor()
    scene.show(0.012)
    assert triangle.get_facecolor() != conducting
    texts = {text.get_text() for text in axes.texts}
    assert "ground" in texts
    assert {"V1", "D1", "C1", "R1"} <= texts
    assert any(text.startswith("in\n-5.88 V") for text in texts)


def test_charges_move_with_the_current() -> None:
    """Through a resistor at constant voltage they go round evenly, from plus to minus."""
    netlist = "V1 a 0 2\nR1 a 0 1\nC1 a 0 1\n"
    scene, _ = shown(simulate_model({"model": "circuit", "netlist": netlist, "t_span": [0, 1], "x0": []}))
    places = [scene.show(time)[0].get_xydata()[4:8].copy() for time in (0.0, 0.01, 0.02)]
    steps = np.diff(places, axis=0)[:, 1]  # a dot inside the branch
    assert np.linalg.norm(steps[0]) > 0.0
    assert steps[0] == pytest.approx(steps[1], rel=0.1)


def test_the_ring_of_nodes_has_ground_at_the_bottom_and_short_branches() -> None:
    branches = [Branch("1", "a", "b"), Branch("2", "b", "c"), Branch("3", "c", "0"), Branch("4", "0", "a")]
    places = ring(["a", "c", "0", "b"], branches)
    assert places["0"] == pytest.approx([0.0, -1.0])
    assert places["b"] == pytest.approx([0.0, 1.0])


def test_points_on_tracks_show_coordinates_and_closed_gaps() -> None:
    scene, axes = shown(example("bouncing_ball"))
    (dots,) = scene.show(0.0)
    assert dots.get_offsets().tolist() == [[1.0, 0.0], [1.0, 1.0]]
    (dots,) = scene.show(1.6)
    assert dots.get_offsets()[:, 0] == pytest.approx([0.0, 0.0], abs=1e-12)
    assert {text.get_text() for text in axes.texts} == {"q1", "y1", "0", "1"}


def test_what_has_nothing_to_show_is_refused(pricing: Any, tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="animate = a projected model: must be for a circuit"):
        scene_of(example("oligopoly"))
    status, _, errors = pricing("simulate", MODELS / "oligopoly.json", "--animate", tmp_path / "a.gif")
    assert (status, errors.startswith("pricing: animate = a projected model: must be for")) == (2, True)
    assert not (tmp_path / "a.gif").exists()
    status, _, errors = pricing("simulate", MODELS / "bouncing_ball.json", "--animate", tmp_path / "a.mp4")
    assert (status, errors) == (2, "pricing: animate = 'a.mp4': must be a .gif file\n")


def test_the_command_writes_the_file(pricing: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(animate_simulation, "__kwdefaults__", {"frames": 2})
    target = tmp_path / "ball.gif"
    assert pricing("simulate", MODELS / "bouncing_ball.json", "--animate", target) == (0, "", "")
    with Image.open(target) as image:
        assert image.n_frames == 2


@pytest.mark.parametrize(
    ("body", "sentence"),
    [
        ({"shape": "disc"}, r"drawing.bodies[0].at is missing: its middle"),
        ({"shape": "disc", "at": [0, 0]}, "drawing.bodies[0].radius is missing: a disc needs it"),
        ({"shape": "box", "at": [0, 0], "width": 1}, "drawing.bodies[0].height is missing"),
        ({"shape": "cube", "at": [0, 0]}, "drawing.bodies[0].shape = 'cube': must be one of"),
        ({"shape": "disc", "radius": 1, "at": [0]}, "drawing.bodies[0].at = [0]: must be two numbers"),
        ({"shape": "disc", "radius": 0, "at": [0, 0]}, "drawing.bodies[0].radius = 0.0: must be > 0"),
        (
            {"shape": "disc", "radius": 1, "at": [0, 0], "x": "y"},
            "drawing.bodies[0].x = 'y': must be one of x, height, rotation",
        ),
    ],
)
def test_a_drawing_that_does_not_fit_is_refused(
    simulate: Any, body: dict[str, object], sentence: str
) -> None:
    model = json.loads((MODELS / "spinning_ball.json").read_text(encoding="utf-8"))
    status, _, errors = simulate(model | {"drawing": {"bodies": [body]}, "h": 0.1})
    assert (status, errors[: len("pricing: " + sentence)]) == (2, "pricing: " + sentence)
