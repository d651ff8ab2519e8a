"""Timed event graphs: transitions that wait for tokens, and places that hold them for a time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np

from pricing_core.arrays import as_whole_number
from pricing_core.errors import InvalidInputError, Told
from pricing_core.max_plus.arcs import Arcs
from pricing_core.max_plus.circuits import a_circuit, heaviest_circuit, named
from pricing_core.max_plus.cycle_time import largest_ratio
from pricing_core.max_plus.howard import howard
from pricing_core.max_plus.matrices import EPSILON, Numbers, Scalar, as_floats, as_vector, zero_like
from pricing_core.max_plus.scalars import as_number
from pricing_core.max_plus.simulate import MaxPlusTrajectory, simulate
from pricing_core.max_plus.system import ImplicitSystem, MaxPlusSystem

MOST_TOKENS = 1000  # in one place: the state holds that many past firings
MOST_STATES = 10_000  # their matrix takes 800 MB


@dataclass(frozen=True, slots=True)
class Place:
    """Tokens on their way: x_target(k) >= holding + x_source(k - tokens), the times of the k-th firings.

    Parameters
    ----------
    source, target : str
        Names of transitions.
    holding : float or Fraction
        Time that a token stays before it can be used, >= 0.
    tokens : int
        How many there are at the beginning.

    Raises
    ------
    InvalidInputError
        The holding is no finite number >= 0, or tokens no whole number from 0 to 1000.
    """

    source: str
    target: str
    holding: Scalar = 0.0
    tokens: int = 0

    def __post_init__(self) -> None:
        for end in ("source", "target"):
            if not isinstance(getattr(self, end), str):
                raise InvalidInputError(end, getattr(self, end), "the name of a transition")
        try:
            object.__setattr__(self, "holding", as_number("holding", self.holding, least=0.0, what="time"))
            object.__setattr__(self, "tokens", as_whole_number("tokens", self.tokens, 0, MOST_TOKENS))
        except InvalidInputError as error:
            way = f"from {self.source} to {self.target}"
            raise InvalidInputError(error.field, error.value, f"{error.allowed} {way}") from None


@dataclass(frozen=True, slots=True, eq=False)
class TimedEventGraph:
    """x_i(k) = the largest of holding + x_j(k - tokens) over the places from j to i; inputs fire when they like.

    Parameters
    ----------
    transitions : sequence of str
        All of them, each once.
    places : sequence of Place or of tuples (source, target, holding, tokens)
    inputs : sequence of str
        Transitions without places before them, whose firings are given from outside.
    outputs : sequence of str
        Transitions that are looked at. Default: all but the inputs.

    Raises
    ------
    InvalidInputError
        A name is unknown or told twice, an input has a place before it, another transition has none, or a
        circuit holds no token: it is named, as its transitions would wait for each other for ever.

    Examples
    --------
    Two machines in a loop with one pallet, each busy with one piece at a time:

    >>> line = TimedEventGraph(
    ...     ["drill", "press"],
    ...     [("drill", "press", 3.0, 0), ("press", "drill", 2.0, 1), ("press", "press", 4.0, 1)],
    ... )
    >>> line.cycle_time(), line.critical_circuit()
    (5.0, ('drill', 'press'))
    """

    transitions: tuple[str, ...]
    places: tuple[Place, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    _number: dict[str, int] = field(repr=False)  # the number of each transition

    def __init__(
        self,
        transitions: Sequence[str],
        places: Sequence[Place | tuple[str, str, Scalar, int]],
        inputs: Sequence[str] = (),
        outputs: Sequence[str] | None = None,
    ) -> None:
        known = _names("transitions", transitions)
        if not known:
            raise InvalidInputError("transitions", Told("none"), "at least one name")
        given = tuple(_place(k, place) for k, place in enumerate(_listed("places", places)))
        fed = _names("inputs", inputs)
        seen = (
            tuple(name for name in known if name not in set(fed))
            if outputs is None
            else _names("outputs", outputs)
        )
        object.__setattr__(self, "transitions", known)
        object.__setattr__(self, "places", given)
        object.__setattr__(self, "inputs", fed)
        object.__setattr__(self, "outputs", seen)
        object.__setattr__(self, "_number", {name: i for i, name in enumerate(known)})
        self._check()

    def _check(self) -> None:
        ends = {(name, "places") for place in self.places for name in (place.source, place.target)}
        for name, told_in in sorted(
            ends | {(n, "inputs") for n in self.inputs} | {(n, "outputs") for n in self.outputs}
        ):
            if name not in self._number:
                raise InvalidInputError(told_in, name, "the name of a transition")
        waiting, fed = {place.target for place in self.places}, set(self.inputs)
        for name in self.transitions:
            if name in fed and name in waiting:
                raise InvalidInputError("inputs", name, "a transition without places before it")
            if name not in fed and name not in waiting:
                raise InvalidInputError("transitions", name, "an input, or have a place before it")
        graph = self._graph()
        circuit = a_circuit(graph.only(self._tokens() == 0))
        if circuit:
            raise InvalidInputError(
                "places",
                Told("a deadlock"),
                f"such that the circuit {named(circuit, self.transitions)} holds a token",
            )

    @property
    def memory(self) -> int:
        """How many past firings of its transitions the graph remembers: its most tokens in one place, at least 1."""
        return max([1, *(place.tokens for place in self.places)])

    def check_states(self, most: int) -> None:
        """Refuse a graph whose transitions times its memory are more states than `most`."""
        n = len(self.transitions)
        if n * self.memory > most:
            raise InvalidInputError(
                "places",
                Told(f"{n * self.memory} states"),
                f"such that the most tokens of a place ({self.memory}) times {n} transitions are at most {most}",
            )

    def cycle_time(self) -> Scalar:
        """Return the time between two firings if no input makes them wait: the largest of time over tokens.

        -inf where there is no circuit. With several components this is that of the slowest.
        """
        return largest_ratio(self._graph(), self._tokens())

    def throughput(self) -> Scalar:
        """Return the firings per unit of time, 1 / cycle_time."""
        pace = self.cycle_time()
        return 1 / pace if pace > 0 else np.inf

    def critical_circuit(self) -> tuple[str, ...]:
        """Return the transitions of a circuit that sets the pace, in the order of their tokens' way."""
        graph = self._graph()
        circuit = heaviest_circuit(graph, howard(graph, self._tokens()))
        return tuple(self.transitions[i] for i in circuit)

    def implicit(self) -> ImplicitSystem:
        """Return x(k) = A0 x(k) + A1 x(k-1) + ... + B u(k-1), y(k) = C x(k): one A for each number of tokens.

        An input is a state of its own, whose firings are u.

        Raises
        ------
        InvalidInputError
            The last firings of all transitions are more than 10 000 states.
        """
        self.check_states(MOST_STATES)
        n, order = len(self.transitions), self.memory
        A = np.full((order + 1, n, n), EPSILON, dtype=self._holdings().dtype)
        for place, holding in zip(self.places, self._holdings(), strict=True):
            at = place.tokens, *self._ends(place)
            A[at] = max(A[at], holding)
        B = self._selection(self.inputs) if self.inputs else None
        C = self._selection(self.outputs).T
        return ImplicitSystem(tuple(A), B, C, self.transitions)

    def state_space(self) -> MaxPlusSystem:
        """Return x(k+1) = A x(k) + B u(k), y(k) = C x(k), whose state are the last firings of all transitions."""
        return self.implicit().explicit()

    def run(self, firings: int, *, start: object = None, u: object = None) -> MaxPlusTrajectory:
        """Return when each transition fires for the first `firings` times: .x (firings + 1, n), .y (firings + 1, p).

        Row 0 is the start: the tokens that are there at the beginning came with firings at these times.

        Parameters
        ----------
        firings : int
        start : array_like, shape (n,), optional
            Default: 0 for all transitions.
        u : array_like, shape (firings, m), optional
            Times of the inputs; needed where there are inputs.

        Raises
        ------
        InvalidInputError
            Shapes do not fit.

        Examples
        --------
        >>> clock = TimedEventGraph(["tick"], [("tick", "tick", 2.0, 1)])
        >>> clock.run(2).x.ravel()
        array([0., 2., 4.])
        """
        system, n = self.state_space(), len(self.transitions)
        zeros = np.full(n, zero_like(system.A))
        first = zeros if start is None else as_vector("start", start, n, top=False)
        if (u is None) != (not self.inputs):
            raise InvalidInputError(
                "u", Told("none" if u is None else "u"), f"the times of the inputs {self.inputs}"
            )
        x0 = np.tile(first, system.shape[0] // n)
        found = simulate(system.A, x0, firings, None if u is None else system.B, u, system.C)
        return MaxPlusTrajectory(found.x[:, :n], found.y)

    def _ends(self, place: Place) -> tuple[int, int]:
        return self._number[place.target], self._number[place.source]

    def _holdings(self) -> Numbers:
        return _times([place.holding for place in self.places])

    def _tokens(self) -> Numbers:
        """Return the tokens in the order of the arcs of `_graph`."""
        return np.array([place.tokens for place in self._sorted()], dtype=self._holdings().dtype)

    def _sorted(self) -> list[Place]:
        return sorted(self.places, key=self._ends)

    def _graph(self) -> Arcs:
        places = self._sorted()
        ends = np.array([self._ends(place) for place in places], dtype=np.int64).reshape(-1, 2)
        weight = _times([place.holding for place in places])
        return Arcs(len(self.transitions), ends[:, 0], ends[:, 1], weight)

    def _selection(self, names: Sequence[str]) -> Numbers:
        """Return the matrix with a 0 in the row of the k-th name of column k, epsilon elsewhere, shape (n, m)."""
        matrix = np.full((len(self.transitions), max(len(names), 1)), EPSILON, dtype=self._holdings().dtype)
        matrix[[self._number[name] for name in names], np.arange(len(names))] = zero_like(matrix)
        return matrix


def _times(holdings: Sequence[Scalar]) -> Numbers:
    """Return exact times if all are Fractions, else floats."""
    exact = bool(holdings) and all(isinstance(holding, Fraction) for holding in holdings)
    times: Numbers = np.array(holdings, dtype=object)
    return times if exact else np.asarray(as_floats(times), dtype=np.float64)


def _place(k: int, place: object) -> Place:
    if isinstance(place, Place):
        return place
    if not isinstance(place, tuple | list) or not 2 <= len(place) <= 4:
        raise InvalidInputError(f"places[{k}]", place, "a Place, or (source, target, holding, tokens)")
    return Place(*place)


def _listed(field: str, values: object) -> Sequence[Any]:
    if isinstance(values, str) or not isinstance(values, Iterable):
        raise InvalidInputError(field, values, "a list")
    return list(values)


def _names(field: str, names: Sequence[str]) -> tuple[str, ...]:
    found = tuple(_listed(field, names))
    seen: set[str] = set()
    for name in found:
        if not isinstance(name, str) or not name.strip():
            raise InvalidInputError(field, name, "names")
        if name in seen:
            raise InvalidInputError(field, name, "told once")
        seen.add(name)
    return found
