"""Pictures of max-plus schedules and orbits."""

from collections.abc import Callable
from typing import Any

import pytest

from app.commands.max_plus_plots import gantt, orbit
from pricing_core.errors import InvalidInputError
from pricing_core.max_plus import TimedEventGraph


def test_a_gantt_chart_bars_every_token_that_is_there_at_the_beginning() -> None:
    """Three pallets on their way at time 0: the stays numbered 0, -1 and -2, and one for each later firing."""
    graph = TimedEventGraph(["a", "b"], [("a", "b", 3.0, 0), ("b", "a", 2.0, 3)])
    axes = gantt(graph, graph.run(2).x).axes[0]
    labels = {(text.get_text(), text.get_position()[0]) for text in axes.texts}
    assert labels == {("1", 3.5), ("2", 3.5), ("0", 1.0), ("-1", 1.0), ("-2", 1.0), ("1", 6.0), ("2", 6.0)}
    assert len(axes.patches) == len(axes.texts) == 7


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda graph: gantt(graph, [[0.0]]), "x"),
        (lambda graph: gantt(graph, None), "x"),
        (lambda graph: gantt(5, [[0.0]]), "graph"),
        (lambda graph: orbit([[0.0, 1.0]], ["a"]), "names"),
        (lambda graph: orbit([[0.0, 1.0]], "ab"), "names"),
        (lambda graph: orbit([0.0], ["a"]), "times"),
        (lambda graph: orbit([[0.0]], ["a"], rate="x"), "rate"),
    ],
)
def test_what_cannot_be_drawn_is_refused_by_name(call: Callable[[TimedEventGraph], Any], field: str) -> None:
    graph = TimedEventGraph(["a", "b"], [("a", "b", 3.0, 0), ("b", "a", 2.0, 3)])
    with pytest.raises(InvalidInputError) as caught:
        call(graph)
    assert caught.value.field == field


def test_lists_of_times_are_drawn() -> None:
    graph = TimedEventGraph(["a"], [("a", "a", 2.0, 1)])
    assert len(gantt(graph, [[0], [2]]).axes[0].patches) == 2
    assert len(orbit([[0], [2]], ["a"]).axes) == 2
