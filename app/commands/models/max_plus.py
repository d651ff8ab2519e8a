"""The model "max-plus": x(k+1) = A x(k) + B u(k) with max for + and + for x, or a timed event graph."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from app.commands.model_keys import TEXT, Key, array_schema, built, keys_for, list_of, matrix_of, whole_number
from app.commands.simulation import Columns, Modes, Samples, Simulation
from pricing_core.errors import InvalidInputError, Told
from pricing_core.max_plus import EPSILON, ImplicitSystem, MaxPlusSystem, Place, TimedEventGraph, cycle_time
from pricing_core.max_plus import simulate as simulate_system
from pricing_core.max_plus.event_graphs import MOST_TOKENS
from pricing_core.max_plus.matrices import Numbers
from pricing_core.max_plus.scalars import as_number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_STEPS = 100_000
MOST_STATES = 1000
# That many firings can still be told apart in a Gantt chart.
LARGEST_GANTT = 40


def _read_time(field: str, value: Any) -> float:
    if value is None or value == "-inf":
        return EPSILON
    try:
        return float(as_number(field, value))
    except InvalidInputError as fault:
        raise InvalidInputError(field, fault.value, f"{fault.allowed}, or null") from None


def _read_names(field: str, value: Any) -> list[str]:
    names: list[str] = list_of(TEXT, "a list of names").read(field, value)
    if not all(names) or len(set(names)) < len(names):
        raise InvalidInputError(field, names, "a list of names, each given once")
    return names


def _read_place(field: str, value: Any) -> Place:
    if isinstance(value, list) and 3 <= len(value) <= 4:
        value = dict(zip(PLACE, value, strict=False))
    place: Place = PLACE_OBJECT.read(field, value)
    return place


TIME = Key(_read_time, {"anyOf": [{"type": "number"}, {"type": "null"}, {"const": "-inf"}]})
TIMES = list_of(TIME, "a list of numbers, with null for -inf", minItems=1)
TABLE = matrix_of(TIMES, "a list of rows of numbers, with null for -inf")
NAMES = Key(_read_names, array_schema({"type": "string", "minLength": 1}) | {"uniqueItems": True})
PLACE: Mapping[str, Key] = {
    "source": TEXT.described("the transition that brings tokens", required=True),
    "target": TEXT.described("the transition that waits for them", required=True),
    "holding": Key(
        lambda field, value: as_number(field, value, least=0.0, what="time"),
        {"type": "number", "minimum": 0, "default": 0},
    ),
    "tokens": whole_number(0, MOST_TOKENS),
}
PLACE_OBJECT = built(Place, PLACE)
PLACE_LIST = {"type": "array", "minItems": 3, "maxItems": 4, "description": ", ".join(PLACE)}
RUN: Mapping[str, Key] = {
    "steps": whole_number(1, MOST_STEPS).described("events to compute", required=True),
    "u": TABLE.described("a row of input times for each step"),
}
X0 = "times of the events with number 0"
SYSTEM: Mapping[str, Key] = {
    "A": TABLE.described("n x n, by rows", required=True),
    "A0": TABLE.described("n x n, by rows, for x(k+1) = A0 x(k+1) + A x(k) + B u(k)"),
    "B": TABLE.described("n x m, by rows; only with u"),
    "C": TABLE.described("p x n, by rows"),
    "names": NAMES.described("of the states"),
    "output_names": NAMES.described("of the outputs"),
    "x0": TIMES.described(X0, required=True),
    **RUN,
}
GRAPH: Mapping[str, Key] = {
    "transitions": NAMES.described("all of them, each once", required=True),
    "places": list_of(
        Key(_read_place, {"anyOf": [PLACE_OBJECT.schema, PLACE_LIST]}), "a list of places"
    ).described("what the transitions wait for", required=True),
    "inputs": NAMES.described("transitions whose times are given by u"),
    "outputs": NAMES.described("transitions that are looked at; all but the inputs where missing"),
    "x0": TIMES.described(f"{X0}; 0 where missing"),
    **RUN,
}
FORMS: Mapping[str, Mapping[str, Key]] = {
    'matrices, with null or "-inf" for epsilon': SYSTEM,
    "timed event graph": GRAPH,
}


def simulate(values: Mapping[str, Any]) -> Simulation:
    """Run the max-plus system or the event graph of a model file.

    Parameters
    ----------
    values : mapping
        What one of the `FORMS` read.
    """
    return _run_graph(values) if "transitions" in values else _run_system(values)


def _run_graph(values: Mapping[str, Any]) -> Simulation:
    names = values["transitions"]
    graph = TimedEventGraph(names, values["places"], values.get("inputs", ()), values.get("outputs"))
    graph.check_states(MOST_STATES)
    with keys_for({"start": "x0"}):
        times = graph.run(values["steps"], start=values.get("x0"), u=values.get("u")).x
    pace = cycle_time(graph.state_space().A)[: len(names)]
    # The outputs are columns that are there already.
    return _simulation(times, names, pace, graph=graph)


def _run_system(values: Mapping[str, Any]) -> Simulation:
    A, B, C, u = (values.get(key) for key in ("A", "B", "C", "u"))
    n = len(values["A"])
    if n > MOST_STATES:
        raise InvalidInputError("A", Told(f"order {n}"), f"of order at most {MOST_STATES}")
    names = _names(values, "names", "x", n)
    if "A0" in values:
        with keys_for({"A[0]": "A0", "A[1]": "A"}):
            system = ImplicitSystem((values["A0"], A), B, C, names).explicit()
    else:
        system = MaxPlusSystem(A, B, C)
    pushed = None if B is None else system.B
    found = simulate_system(system.A, values["x0"], values["steps"], pushed, u, C)
    outputs = _names(values, "output_names", "y", 0 if found.y is None else found.y.shape[1])
    seen = None if found.y is None else Columns("y", "output", outputs, found.y)
    return _simulation(found.x, names, cycle_time(system.A), outputs=seen)


def _names(values: Mapping[str, Any], key: str, letter: str, count: int) -> tuple[str, ...]:
    names = tuple(values.get(key, [f"{letter}{i}" for i in range(count)]))
    if len(names) != count:
        raise InvalidInputError(key, Told(f"{len(names)} names"), f"{count} names")
    return names


def _simulation(
    times: Numbers,
    names: Sequence[str],
    pace: Numbers,
    *,
    outputs: Columns | None = None,
    graph: TimedEventGraph | None = None,
) -> Simulation:
    columns = (Columns("x", "time", tuple(names), times), *([outputs] if outputs else []))
    every = ["k", *(name for kind in columns for name in kind.names)]
    if len(set(every)) < len(every):
        twice = sorted({name for name in every if every.count(name) > 1})
        raise InvalidInputError("names", twice, "different from k and from one another")

    def picture() -> "Figure":
        from app.commands.max_plus_plots import gantt, orbit  # noqa: PLC0415

        if graph is not None and len(times) <= LARGEST_GANTT + 1:
            return gantt(graph, times)
        return orbit(times, names, rate=float(pace.max()))

    steps = len(times) - 1
    samples = Samples("k", np.arange(steps + 1.0), columns)
    slowest = f", cycle time {pace.max():.10g}" if np.isfinite(pace.max()) else ""
    return Simulation(
        headline=f"{steps} step{'s' * (steps != 1)}{slowest}",
        samples=samples,
        curves=samples,
        events=(),
        state_names=tuple(names),
        modes=Modes(()),
        facts={"steps": steps, "cycle_time": pace},
        picture=picture,
    )
