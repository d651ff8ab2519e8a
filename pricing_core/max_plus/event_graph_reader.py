"""Timed event graphs as text, one place to a line."""

from __future__ import annotations

from pricing_core.errors import InvalidInputError
from pricing_core.max_plus.event_graphs import Place, TimedEventGraph


def read_event_graph(text: str) -> TimedEventGraph:
    """Read a timed event graph from lines of text.

    Parameters
    ----------
    text : str
        Lines "SOURCE -> TARGET: HOLDING, TOKENS", "input NAME" and "output NAME". Tokens may be left out (0), and #
        begins a comment. Transitions come in the order in which they are first named.

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
        raise error.called(f"line {number}: {error.field}") from None
    except ValueError:
        raise InvalidInputError(f"line {number}", content, "SOURCE -> TARGET: HOLDING, TOKENS") from None
