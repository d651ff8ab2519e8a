"""Timed event graphs as text, one place to a line, and as JSON objects."""

from collections.abc import Mapping
from typing import Any

from pricing_core.errors import InvalidInputError, Told
from pricing_core.max_plus.event_graphs import Place, TimedEventGraph

KEYS = ("transitions", "places", "inputs", "outputs")
PLACE_KEYS = ("source", "target", "holding", "tokens")


def read_event_graph(text: str) -> TimedEventGraph:
    """Read a graph from lines "SOURCE -> TARGET: HOLDING, TOKENS", "input NAME" and "output NAME".

    Tokens may be left out (0), # begins a comment. Transitions come in the order in which they are first named.

    Raises
    ------
    InvalidInputError
        A line cannot be read, and is named by its number; or the graph is no event graph.

    Examples
    --------
    >>> read_event_graph('''
    ... drill -> press: 3          # minutes
    ... press -> drill: 2, 1       # one pallet comes back
    ... ''').cycle_time()
    5.0
    """
    if not isinstance(text, str):
        raise InvalidInputError("text", text, "text, one place to a line")
    names: dict[str, None] = {}
    places: list[Place] = []
    ends: dict[str, list[str]] = {"input": [], "output": []}
    for number, line in enumerate(text.splitlines(), 1):
        content = line.partition("#")[0].strip()
        word, _, name = content.partition(" ")
        if word in ends and name.strip() and "->" not in content:
            ends[word].append(name.strip())
            names[name.strip()] = None
        elif content:
            place = _place_of_line(number, content)
            places.append(place)
            names |= {place.source: None, place.target: None}
    return TimedEventGraph(tuple(names), places, ends["input"], ends["output"] or None)


def event_graph_of(content: Mapping[str, Any]) -> TimedEventGraph:
    """Return the graph of a parsed JSON object: the arguments of `TimedEventGraph` by name.

    A place is an object with the keys source, target, holding and tokens (default 0), or a list of these.

    Raises
    ------
    InvalidInputError
        A key is missing, unknown or wrong, and is named.

    Examples
    --------
    >>> event_graph_of({"transitions": ["tick"], "places": [["tick", "tick", 2, 1]]}).cycle_time()
    2.0
    """
    if not isinstance(content, Mapping):
        raise InvalidInputError("content", content, "an object with " + ", ".join(KEYS))
    unknown = [key for key in content if key not in KEYS]
    if unknown:
        raise InvalidInputError(str(unknown[0]), Told("unknown"), "one of " + ", ".join(KEYS))
    missing = [key for key in ("transitions", "places") if key not in content]
    if missing:
        raise InvalidInputError(missing[0], Told("missing"), "in the object")
    lists = {key: content.get(key) for key in KEYS}
    for key, value in lists.items():
        needed = key in ("transitions", "places")
        if (value is not None or needed) and not isinstance(value, list):
            raise InvalidInputError(key, value, "a list")
    places = [_place_of(f"places[{k}]", entry) for k, entry in enumerate(content["places"])]
    return TimedEventGraph(content["transitions"], places, content.get("inputs") or (), lists["outputs"])


def _place_of_line(number: int, content: str) -> Place:
    way, _, numbers = content.rpartition(":")
    source, arrow, target = way.partition("->")
    holding, _, tokens = numbers.partition(",")
    if not (arrow and source.strip() and target.strip()):
        raise InvalidInputError(f"line {number}", content, "SOURCE -> TARGET: HOLDING, TOKENS")
    try:
        time = float(holding) if not holding.strip().isdecimal() else int(holding)
        return Place(source.strip(), target.strip(), time, int(tokens) if tokens.strip() else 0)
    except InvalidInputError as error:
        raise InvalidInputError(f"line {number}: {error.field}", error.value, error.allowed) from None
    except ValueError:
        raise InvalidInputError(f"line {number}", content, "SOURCE -> TARGET: HOLDING, TOKENS") from None


def _place_of(field: str, entry: object) -> Place:
    if isinstance(entry, list) and 3 <= len(entry) <= 4:
        values = dict(zip(PLACE_KEYS, entry, strict=False))
    elif isinstance(entry, dict) and entry.keys() <= set(PLACE_KEYS) and {"source", "target"} <= entry.keys():
        values = entry
    else:
        raise InvalidInputError(field, entry, "an object with " + ", ".join(PLACE_KEYS))
    for key in ("source", "target"):
        if not isinstance(values[key], str):
            raise InvalidInputError(f"{field}.{key}", values[key], "a name")
    try:
        return Place(**values)
    except InvalidInputError as error:
        raise InvalidInputError(f"{field}.{error.field}", error.value, error.allowed) from None
