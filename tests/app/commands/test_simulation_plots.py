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
    assert [axes.get_ylabel() for axes in figure.axes] == ["state", "multiplier", "slack"]
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
    assert labels == ["state", "state", "multiplier", "multiplier", "slack", "slack"]


def test_what_is_zero_throughout_makes_no_panel() -> None:
    values = np.array([[0.0, 3.0], [0.0, 4.0]])
    (panel,) = panels_of(Columns("x", "state", ("a", "b"), values))
    assert panel.names == ["a", "b"]


def test_every_kind_of_event_is_explained_once() -> None:
    figure = simulation_figure(of_trajectory(simulate(two_relays(), [3.0, 1.0], (0.0, 3.0))))
    (legend,) = figure.legends
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
    assert figure.axes[-1].get_xlabel() == "time t (s)"


def test_every_model_has_a_title() -> None:
    assert set(TITLES) == set(MODULES)
