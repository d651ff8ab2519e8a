"""Max-plus models as JSON objects: check one, run it, and return its table."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pricing_core.arrays import as_whole_number
from pricing_core.errors import InvalidInputError, Told
from pricing_core.max_plus.cycle_time import cycle_time
from pricing_core.max_plus.event_graph_reader import KEYS as GRAPH_KEYS
from pricing_core.max_plus.event_graph_reader import event_graph_of
from pricing_core.max_plus.event_graphs import TimedEventGraph
from pricing_core.max_plus.matrices import EPSILON, Numbers
from pricing_core.max_plus.scalars import as_number
from pricing_core.max_plus.simulate import MaxPlusTrajectory, simulate
from pricing_core.max_plus.system import ImplicitSystem, MaxPlusSystem

NAME = "max-plus"
MOST_STEPS = 100_000
MOST_STATES = 1000
COMMON_KEYS = ("model", "x0", "steps", "u")
MATRIX_KEYS = ("A", "A0", "B", "C", "names", "output_names")


@dataclass(frozen=True, slots=True, eq=False)
class ModelRun:
    """What a model file leads to: one row per event number.

    Parameters
    ----------
    columns : tuple of str
        "k", then the names of the states, then those of the outputs.
    table : array, shape (steps + 1, number of columns)
        -inf where an event never has to wait.
    state_count : int
        How many columns after "k" are states.
    cycle_time : array, shape (state_count,)
        The mean time between the events of each state in the long run.
    graph : TimedEventGraph or None
        The event graph of the file, where it holds one.
    """

    columns: tuple[str, ...]
    table: Numbers
    state_count: int
    cycle_time: Numbers
    graph: TimedEventGraph | None

    @property
    def states(self) -> Numbers:
        """The times of the states, shape (steps + 1, state_count)."""
        return np.asarray(self.table[:, 1 : 1 + self.state_count])


def run_model(content: Mapping[str, Any]) -> ModelRun:
    """Run a parsed model file.

    Parameters
    ----------
    content : mapping
        "model": "max-plus" and "steps", with either

        * matrices: "A" and "x0", and if wanted "A0" (for x(k+1) = A0 x(k+1) + A x(k)), "B" with "u", "C",
          "names", "output_names"; null or "-inf" stands for epsilon;
        * or an event graph: "transitions" and "places", and if wanted "inputs" with "u", "outputs", "x0".

    Raises
    ------
    InvalidInputError
        A key is missing, unknown or wrong, and is named; or a circuit without tokens.
    NumericalError
        A circuit of A0 has a positive weight; it is named.

    Examples
    --------
    >>> run = run_model({"model": "max-plus", "A": [[3, 7], [2, 4]], "x0": [1, 0], "steps": 2})
    >>> run.columns, run.table.tolist(), run.cycle_time.tolist()
    (('k', 'x0', 'x1'), [[0.0, 1.0, 0.0], [1.0, 7.0, 4.0], [2.0, 11.0, 9.0]], [4.5, 4.5])
    """
    if not isinstance(content, Mapping):
        raise InvalidInputError("content", content, "an object with the keys of a max-plus model")
    is_graph = any(key in content for key in GRAPH_KEYS)
    allowed = COMMON_KEYS + (GRAPH_KEYS if is_graph else MATRIX_KEYS)
    for key in content:
        if key not in allowed:
            kind = "an event graph" if is_graph else "matrices"
            raise InvalidInputError(str(key), Told("unknown"), f"with {kind} one of " + ", ".join(allowed))
    if content.get("model") != NAME:
        raise InvalidInputError("model", content.get("model"), f'"{NAME}"')
    steps = as_whole_number("steps", content.get("steps"), 1, MOST_STEPS)
    return _run_graph(content, steps) if is_graph else _run_matrices(content, steps)


def _run_graph(content: Mapping[str, Any], steps: int) -> ModelRun:
    graph = event_graph_of({key: value for key, value in content.items() if key in GRAPH_KEYS})
    graph.check_states(MOST_STATES)
    start = _vector(content, "x0", len(graph.transitions)) if content.get("x0") is not None else None
    u = _matrix(content, "u") if content.get("u") is not None else None
    found = graph.run(steps, start=start, u=u)
    pace = cycle_time(graph.state_space().A)[: len(graph.transitions)]
    return _table(found, graph.transitions, graph.outputs, pace, graph)


def _run_matrices(content: Mapping[str, Any], steps: int) -> ModelRun:
    for key in ("A", "x0"):
        if content.get(key) is None:
            raise InvalidInputError(key, Told("missing"), "in a max-plus model with matrices")
    parts = {key: _matrix(content, key) for key in ("A", "A0", "B", "C", "u") if content.get(key) is not None}
    if len(parts["A"]) > MOST_STATES:
        raise InvalidInputError("A", Told(f"order {len(parts['A'])}"), f"of order at most {MOST_STATES}")
    system, n = _system(content, parts), len(parts["A"])
    inputs = (system.B, parts["u"]) if "u" in parts and "B" in parts else (parts.get("B"), parts.get("u"))
    found = simulate(system.A, _vector(content, "x0", n), steps, *inputs, system.C if "C" in parts else None)
    names = _names(content, "names", "x", n)
    outputs = _names(content, "output_names", "y", 0 if found.y is None else found.y.shape[1])
    return _table(found, names, outputs, cycle_time(system.A), None)


def _system(content: Mapping[str, Any], parts: Mapping[str, Numbers]) -> MaxPlusSystem:
    if "A0" not in parts:
        return MaxPlusSystem(parts["A"], parts.get("B"), parts.get("C"))
    names = _names(content, "names", "x", len(parts["A0"]))
    return ImplicitSystem((parts["A0"], parts["A"]), parts.get("B"), parts.get("C"), names).explicit()


def _table(
    found: MaxPlusTrajectory,
    names: Sequence[str],
    outputs: Sequence[str],
    pace: Numbers,
    graph: TimedEventGraph | None,
) -> ModelRun:
    # The outputs of an event graph are columns that are there already.
    shown = found.y if graph is None else None
    number = np.arange(len(found.x), dtype=np.float64)[:, None]
    parts = [number, found.x] if shown is None else [number, found.x, shown]
    columns = ("k", *names, *(outputs if shown is not None else ()))
    return ModelRun(columns, np.hstack(parts), len(names), pace, graph)


def _names(content: Mapping[str, Any], key: str, letter: str, count: int) -> tuple[str, ...]:
    given = content.get(key)
    if given is None:
        return tuple(f"{letter}{i}" for i in range(count))
    if not isinstance(given, list) or not all(isinstance(name, str) and name for name in given):
        raise InvalidInputError(key, given, "a list of names")
    if len(given) != count or len(set(given)) != count:
        raise InvalidInputError(key, Told(f"{len(given)} names"), f"{count} different names")
    return tuple(given)


def _matrix(content: Mapping[str, Any], key: str) -> Numbers:
    rows = content[key]
    if not isinstance(rows, list) or not rows or not all(isinstance(row, list) and row for row in rows):
        raise InvalidInputError(key, rows, "a list of rows of numbers, with null for -inf")
    if len({len(row) for row in rows}) > 1:
        raise InvalidInputError(key, Told("rows of different lengths"), "a matrix")
    return np.array([_numbers(f"{key}[{i}]", row) for i, row in enumerate(rows)])


def _vector(content: Mapping[str, Any], key: str, size: int) -> Numbers:
    given = content[key]
    if not isinstance(given, list) or len(given) != size:
        raise InvalidInputError(key, given, f"a list of {size} numbers, with null for -inf")
    return np.array(_numbers(key, given))


def _numbers(field: str, entries: Sequence[object]) -> list[float]:
    found = []
    for j, entry in enumerate(entries):
        if entry is None or entry == "-inf":
            found.append(EPSILON)
        else:
            try:
                found.append(float(as_number(f"{field}[{j}]", entry)))
            except InvalidInputError as error:
                raise InvalidInputError(error.field, error.value, f"{error.allowed}, or null") from None
    return found
