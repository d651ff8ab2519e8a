"""Timed event graphs: the token game against the state space, and what is refused."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pricing_core.errors import InvalidInputError
from pricing_core.max_plus import (
    Place,
    TimedEventGraph,
    cycle_time,
    eigenvalue,
    read_event_graph,
)

LINE = """
# times in minutes
input order
order -> drill: 1
drill -> press: 3
press -> drill: 2, 2       # two pallets come back
press -> press: 4, 1
drill -> drill: 3, 1
output press
"""


def token_game(graph, firings, u=None):
    """Return the firing times by the definition, transition by transition, as often as it takes."""
    x = {(name, k): 0.0 for name in graph.transitions for k in range(-20, 1)}
    for k in range(1, firings + 1):
        for i, name in enumerate(graph.inputs):
            x[name, k] = u[k - 1][i]
        waiting = [name for name in graph.transitions if name not in graph.inputs]
        while waiting:
            for name in list(waiting):
                needs = [(p, x.get((p.source, k - p.tokens))) for p in graph.places if p.target == name]
                if all(time is not None for _, time in needs):
                    x[name, k] = max(time + place.holding for place, time in needs)
                    waiting.remove(name)
    return np.array([[x[name, k] for name in graph.transitions] for k in range(firings + 1)])


@st.composite
def live_graphs(draw):
    """Places without tokens lead from lower to higher numbers only: no deadlock."""
    n = draw(st.integers(1, 4))
    names = [f"t{i}" for i in range(n)]
    times = st.integers(0, 9)
    places = [Place(name, name, draw(times), draw(st.integers(1, 3))) for name in names]
    for _ in range(draw(st.integers(0, 6))):
        i, j = draw(st.integers(0, n - 1)), draw(st.integers(0, n - 1))
        places.append(Place(names[i], names[j], draw(times), draw(st.integers(0 if i < j else 1, 3))))
    return TimedEventGraph(names, places)


@given(live_graphs())
@settings(max_examples=80, deadline=None)
def test_the_state_space_plays_the_token_game(graph):
    np.testing.assert_array_equal(graph.run(8).x, token_game(graph, 8))


@given(live_graphs())
@settings(max_examples=80, deadline=None)
def test_the_cycle_time_is_that_of_the_state_space(graph):
    """Two sides: time over tokens on the graph itself, circuit means of the matrix A."""
    system = graph.state_space()
    assert graph.cycle_time() == pytest.approx(float(eigenvalue(system.A)), abs=1e-12)
    assert graph.cycle_time() == pytest.approx(float(cycle_time(system.A).max()), abs=1e-12)


def test_a_line_with_an_input_runs_as_fast_as_its_press():
    graph = read_event_graph(LINE)
    assert graph.transitions == ("order", "drill", "press")
    assert graph.cycle_time() == 4.0
    assert graph.throughput() == 0.25
    assert graph.critical_circuit() == ("press",)
    u = [[2.0 * k] for k in range(6)]
    found = graph.run(6, u=u)
    np.testing.assert_array_equal(found.x, token_game(graph, 6, u))
    np.testing.assert_array_equal(found.y[:, 0], found.x[:, 2])


def test_times_that_are_fractions_stay_exact():
    graph = TimedEventGraph(["a", "b"], [("a", "b", Fraction(1, 3), 0), ("b", "a", Fraction(1, 7), 2)])
    assert graph.cycle_time() == Fraction(5, 21)


@pytest.mark.parametrize(
    ("transitions", "places", "more", "words"),
    [
        (
            ["a", "b", "c"],
            [("a", "b", 1.0, 0), ("b", "c", 1.0, 0), ("c", "a", 1.0, 0)],
            {},
            "a deadlock: must be such that the circuit a -> b -> c -> a holds a token",
        ),
        (["a"], [("a", "a", 0.0, 0)], {}, "circuit a -> a"),
        ([], [], {}, "at least one name"),
        (["a", "a"], [], {}, "told once"),
        ([""], [], {}, "names"),
        (["a"], [("a", "b", 1.0, 1)], {}, "places = 'b': must be the name of a transition"),
        (["a"], [("a", "a", 1.0, 1)], {"outputs": ["b"]}, "outputs = 'b'"),
        (["a"], [("a", "a", 1.0, 1)], {"inputs": ["a"]}, "without places before it"),
        (["a"], [], {}, "an input, or have a place before it"),
        (["a"], [("a", "a", -1.0, 1)], {}, "a finite time >= 0 from a to a"),
        (["a"], [("a", "a", float("nan"), 1)], {}, "holding = nan"),
        (["a"], [("a", "a", 1.0, -1)], {}, "tokens = -1"),
        (["a"], [("a", "a", 1.0, 1.5)], {}, "tokens = 1.5"),
    ],
)
def test_what_is_no_event_graph_is_refused_with_the_reason(transitions, places, more, words):
    with pytest.raises(InvalidInputError, match=words):
        TimedEventGraph(transitions, places, **more)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a -> b", "line 1 = 'a -> b'"),
        ("\na -> b: x", "line 2"),
        ("a -> a: 1, 1\na: 3", "line 2"),
        ("a -> a: -1, 1", "line 1: holding = -1.0"),
        ("a -> a: 1, 1.5", "line 1"),
    ],
)
def test_a_line_that_cannot_be_read_is_named_by_its_number(text, words):
    with pytest.raises(InvalidInputError, match=words):
        read_event_graph(text)


def test_inputs_need_their_times_and_only_they():
    with pytest.raises(InvalidInputError, match="the times of the inputs"):
        read_event_graph(LINE).run(3)
    with pytest.raises(InvalidInputError, match="the times of the inputs"):
        TimedEventGraph(["a"], [("a", "a", 1.0, 1)]).run(3, u=[[1.0]] * 3)


@pytest.mark.parametrize("number", [np.int64(2), np.float32(2.0), np.float64(2.0), Fraction(2), 2])
def test_times_and_tokens_of_any_kind_of_number_are_taken(number):
    graph = TimedEventGraph(["a"], [Place("a", "a", number, np.int64(1))])
    assert graph.cycle_time() == 2
    np.testing.assert_array_equal(graph.run(2).x, [[0], [2], [4]])


def test_exact_times_run_exactly_and_one_float_makes_floats_of_all():
    third = Fraction(1, 3)
    found = TimedEventGraph(["a"], [("a", "a", third, 1)]).run(3).x
    assert found[:, 0].tolist() == [0, third, 2 * third, 1]
    mixed = TimedEventGraph(["a", "b"], [("a", "b", third, 0), ("b", "a", 0.5, 1)])
    assert mixed.run(1).x.dtype == np.float64
    assert mixed.cycle_time() == pytest.approx(5 / 6, rel=1e-15)


def test_a_ring_of_twenty_thousand_transitions_is_read_once():
    n = 20_000
    names = [f"t{i}" for i in range(n)]
    places = [Place(names[i - 1], names[i], float(i % 7), 1) for i in range(n)]
    assert TimedEventGraph(names, places).cycle_time() == sum(i % 7 for i in range(n)) / n


def test_more_states_than_memory_holds_are_refused():
    graph = TimedEventGraph(["a", *"bcdefghijkl"], [("a", name, 1.0, 1000) for name in "abcdefghijkl"])
    with pytest.raises(
        InvalidInputError, match=r"12000 states: must be .* \(1000\) times 12 transitions"
    ) as caught:
        graph.run(1)
    assert caught.value.field == "places"


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda: TimedEventGraph("ab", []), "transitions"),
        (lambda: TimedEventGraph(5, []), "transitions"),
        (lambda: TimedEventGraph(["a"], None), "places"),
        (lambda: TimedEventGraph(["a"], [("a",)]), "places[0]"),
        (lambda: TimedEventGraph(["a"], [5]), "places[0]"),
        (lambda: TimedEventGraph(["a"], [(1, "a", 1.0, 1)]), "source"),
        (lambda: TimedEventGraph(["a"], [("a", "a", 2**60, 1)]), "holding"),
        (lambda: TimedEventGraph(["a"], [("a", "a", 1e200, 1)]), "holding"),
        (lambda: TimedEventGraph(["a"], [("a", "a", True, 1)]), "holding"),
        (lambda: read_event_graph(5), "text"),
        (lambda: read_event_graph("a -> a: 9007199254740993, 1"), "line 1: holding"),
    ],
)
def test_what_is_no_graph_at_all_is_refused_by_name(call, field):
    with pytest.raises(InvalidInputError) as caught:
        call()
    assert caught.value.field == field
