"""The picture of a simulation."""

import numpy as np
import pytest

from app.commands.labels import Labels
from app.commands.model_files import MODULES, simulate_model
from app.commands.simulation import Columns, Simulation, of_trajectory
from app.commands.simulation_plots import TITLES, panels_of, simulation_figure
from pricing_core.lcs import LCS, simulate
from tests.problems.lcs_problems import diode_bridge, two_relays
from tests.problems.lcs_systems import two_carts


def carts() -> Simulation:
    return of_trajectory(
        simulate(two_carts(), [0.0, 0.0, 0.5, 0.5], (0.0, 9.0)), Labels({"x": ["a", "b", "c", "d"]}, {})
    )


def test_states_stand_above_multipliers_and_slacks() -> None:
    figure = simulation_figure(carts())
    assert [axes.get_ylabel() for axes in figure.axes] == ["state", "multiplier", "slack", "mode"]
    assert [line.get_label() for line in figure.axes[0].get_lines()] == ["a", "b", "c", "d"]


def test_the_curves_are_smooth_and_jump_upright() -> None:
    line = simulation_figure(carts()).axes[0].get_lines()[2]  # the velocity of the first cart
    t, v = line.get_xdata(), line.get_ydata()
    jumps = np.flatnonzero(np.diff(t) == 0.0)
    assert t[jumps] == pytest.approx([np.pi * np.sqrt(2), np.pi * (1 + np.sqrt(2))])
    inside = np.delete(np.abs(np.diff(v)), jumps)
    assert inside.max() < 0.01


def test_quantities_of_very_different_size_have_panels_of_their_own() -> None:
    problem = diode_bridge()
    figure = simulation_figure(of_trajectory(simulate(problem.system, problem.x0, (0.0, 1e-3))))
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert labels == ["state", "state", "multiplier", "multiplier", "slack", "slack", "mode", "x2"]


def test_what_is_zero_throughout_makes_no_panel() -> None:
    values = np.array([[0.0, 3.0], [0.0, 4.0]])
    (panel,) = panels_of(Columns("x", "state", ("a", "b"), values))
    assert panel.names == ["a", "b"]


def test_every_kind_of_event_is_explained_once() -> None:
    figure = simulation_figure(of_trajectory(simulate(two_relays(), [3.0, 1.0], (0.0, 3.0))))
    (legend,) = (legend for part in figure.subfigs for legend in part.legends)
    assert [text.get_text() for text in legend.get_texts()] == ["switch", "zeno"]


def test_a_single_point_and_many_lines_can_be_drawn() -> None:
    n = 30
    system = LCS(-np.eye(n), np.eye(n)[:, :1], np.eye(n)[:1])
    trajectory = simulate(system, np.ones(n), (0.0, 1.0), method="time-stepping", t_eval=[0.5])
    figure = simulation_figure(of_trajectory(trajectory))
    texts = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert (len(texts), texts[-1]) == (12, "... 19 more")


def test_legends_stay_inside_the_picture() -> None:
    figure = simulation_figure(carts())
    figure.draw_without_rendering()
    for axes in figure.axes:
        assert axes.get_legend().get_window_extent().x1 <= figure.bbox.x1


def test_a_picture_has_a_title_and_its_axes_names_and_units() -> None:
    model = {"model": "circuit", "netlist": "V1 1 0 1\nR1 1 2 2\nC1 2 0 1e-3\n", "t_span": [0, 0.01]}
    simulation = simulate_model(model)
    figure = simulation_figure(simulation)
    assert figure.get_suptitle().splitlines() == ["Circuit with ideal diodes", simulation.headline]
    assert {axes.get_ylabel() for axes in figure.axes} == {"voltage (V)", "current (A)"}
    assert simulation.band is None
    assert figure.axes[-1].get_xlabel() == "time t (s)"


def test_every_model_has_a_title() -> None:
    assert set(TITLES) == set(MODULES)


def ball(**changes: object) -> Simulation:
    """Return a ball that falls on a floor and stops there by its friction."""
    model: dict[str, object] = {
        "model": "mechanics",
        "mass": [[1, 0, 0], [0, 1, 0], [0, 0, 0.004]],
        "F": [[0, 1, 0]],
        "force": [0, -9.81, 0],
        "tangents": [[1, 0, 0.1]],
        "friction": [0.2],
        "q0": [0, 0.05, 0],
        "v0": [1, 0, 0],
        "t_span": [0, 1],
        "method": "time-stepping",
        "h": 0.01,
        "names": {"q": ["x", "height", "turn"], "contacts": ["floor"]},
        "units": {"t": "s", "q": ["m", "m", "rad"], "u": "N", "y": "m", "slip": "m/s"},
    }
    return simulate_model({**model, **changes})


def test_names_and_units_of_the_model_stand_in_its_picture() -> None:
    figure = simulation_figure(ball())
    assert [axes.get_ylabel() for axes in figure.axes] == [
        *("position (m)", "position (rad)", "velocity (m/s)", "velocity (rad/s)", "contact force (N)"),
        *("friction force (N)", "slip velocity (m/s)", "gap (m)", "mode"),
    ]
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ["x", "height"]
    assert figure.axes[-1].get_xlabel() == "time t (s)"


def test_the_band_says_when_a_contact_slides_and_when_it_sticks() -> None:
    """It lands after 0.101 s; the impact takes 0.7 m/s of the 1 m/s at the contact, friction the rest in 0.044 s."""
    band = ball().band
    assert band is not None
    assert (band.names, band.words) == (("floor",), ("sticks", "slides"))
    words = [band.words_at(time) for time in (0.05, 0.125, 0.9)]
    assert words == [[""], ["slides"], ["sticks"]]
    axes = simulation_figure(ball()).axes[-1]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["floor"]
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["sticks", "slides"]


def test_the_band_of_an_event_driven_run_changes_at_its_events() -> None:
    simulation = carts()
    assert simulation.band is not None
    starts = sorted({start for row in range(2) for start, _, _ in simulation.band.bars(row)})
    assert starts == pytest.approx([0.0, *(event.time for event in simulation.events)])
    for event in simulation.events:
        after = [i for i, word in enumerate(simulation.band.words_at(event.time + 1e-6)) if word]
        assert tuple(after) == event.mode_after


def test_the_band_of_relays_names_their_pieces_and_that_of_diodes_whether_they_conduct() -> None:
    relays = simulate_model(
        {"model": "relay", "A": [[0]], "B": [[1]], "C": [[1]], "x0": [1], "t_span": [0, 2]}
    )
    assert relays.band is not None
    assert [relays.band.words_at(time) for time in (0.5, 1.5)] == [["lower"], ["slides"]]
    netlist = "V1 in 0 SIN(0 10 50)\nD1 in out\nR1 out 0 1k\n"
    circuit = simulate_model({"model": "circuit", "netlist": netlist, "t_span": [0, 0.02]})
    assert circuit.band is not None
    assert [circuit.band.words_at(time) for time in (0.005, 0.015)] == [["conducts"], [""]]
    assert circuit.band.names == ("D1",)


def test_the_band_says_when_switches_are_closed_and_which_diodes_conduct_beside_them() -> None:
    netlist = "V1 in 0 10\nS1 in x g 0 SW\nVG g 0 PULSE(0 1 0 0 0 4u 10u)\nD1 0 x\nL1 x out 1m\nR1 out 0 10\n"
    netlist += ".model SW SW(VT=0.5 RON=1m)\n"
    circuit = simulate_model({"model": "circuit", "netlist": netlist, "t_span": [0, 2e-5]})
    assert circuit.band is not None
    assert circuit.band.names == ("S1", "D1")
    words = [circuit.band.words_at(time) for time in (2e-6, 7e-6, 1.2e-5, 1.7e-5)]
    assert words == 2 * [["closed", ""], ["", "conducts"]]
    alone = simulate_model(
        {
            "model": "circuit",
            "elements": [
                {"kind": "voltage_source", "name": "V1", "plus": "in", "minus": "0", "value": 10},
                {"kind": "resistor", "name": "R1", "plus": "in", "minus": "a", "ohms": "1k"},
                {"kind": "capacitor", "name": "C1", "plus": "a", "minus": "0", "farads": "1u"},
                {
                    "kind": "switch",
                    "name": "S1",
                    "plus": "a",
                    "minus": "0",
                    "resistance": 100,
                    "control": {"threshold": {"plus": "a", "minus": "0", "threshold": 5, "hysteresis": 1}},
                },
            ],
            "t_span": [0, 1e-3],
        }
    )
    assert alone.band is not None
    closes = 1e-3 * np.log(10 / 4)  # the capacitor reaches 6 V
    assert [alone.band.words_at(closes + by) for by in (-1e-6, 1e-6)] == [[""], ["closed"]]


def test_equal_curves_are_drawn_in_turn_and_the_legend_says_so() -> None:
    system = LCS(-np.eye(3), np.zeros((3, 1)), np.eye(3)[:1], g=[1.0])
    figure = simulation_figure(of_trajectory(simulate(system, [1.0, 1.0, 2.0], (0.0, 1.0))))
    first, second, third = figure.axes[0].get_lines()
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()] == ["x1", "x2 = x1", "x3"]
    dashes = [line._unscaled_dash_pattern for line in (first, second)]
    assert dashes == [(0.0, (5.0, 5.0)), (5.0, (5.0, 5.0))]
    assert third.get_linestyle() == "-"


def test_two_states_have_a_phase_plane_with_jumps_of_their_own() -> None:
    model = {
        "model": "mechanics",
        "mass": [[1]],
        "F": [[1]],
        "force": [-10],
        "restitution": 0.5,
        "q0": [1],
        "v0": [0],
        "t_span": [0, 0.6],
        "names": {"q": ["height"]},
        "units": {"q": "m", "t": "s"},
    }
    axes = simulation_figure(simulate_model(model)).axes[-1]
    assert (axes.get_title(), axes.get_xlabel(), axes.get_ylabel()) == (
        "phase plane",
        "height (m)",
        "height' (m/s)",
    )
    (jump,) = [line for line in axes.get_lines() if line.get_linestyle() == ":"]
    assert jump.get_xydata() == pytest.approx(
        np.array([[0.0, -np.sqrt(20.0)], [0.0, 0.5 * np.sqrt(20.0)]]), abs=1e-12
    )
