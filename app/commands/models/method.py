"""The keys that say how a model is simulated, and the method of the library that they make."""

from collections.abc import Mapping
from typing import Any, get_args

from app.commands.model_keys import INTEGER, NUMBER, Key, choice
from app.commands.models.inputs import NUMBER_OR_VECTOR
from pricing_core.errors import InvalidInputError
from pricing_core.lcp import Method
from pricing_core.lcs import EventDriven, TimeStepping

BY_EVENTS: Mapping[str, Key] = {
    "on_nonunique": choice("raise", "first").described("where a state has several continuations"),
    "max_events": INTEGER.described("of an event-driven run"),
}
BY_STEPS: Mapping[str, Key] = {
    "scheme": choice("auto", "implicit-euler", "sdirk2", "theta").described("of time stepping"),
    "theta": NUMBER.described("implicit weight of the scheme theta"),
    "h": NUMBER.described("constant step of time stepping"),
    "rtol": NUMBER.described("relative tolerance of time stepping"),
    "atol": NUMBER_OR_VECTOR.described("absolute tolerance of time stepping"),
    "lcp_method": choice(*get_args(Method)).described("of time stepping"),
    "multipliers": choice("any", "least-norm").described("of time stepping, where they are not unique"),
}
METHOD: Mapping[str, Key] = {
    "method": choice("event-driven", "time-stepping").described("event-driven where missing"),
    **BY_EVENTS,
    **BY_STEPS,
}
# The keys of a file by the fields of `TimeStepping` that they are, where the two differ.
KEYS_OF_FIELDS = {"step": "h", "tolerance": "rtol", "absolute_tolerance": "atol"}


def method_in(values: Mapping[str, Any], keys: Mapping[str, Key] = METHOD) -> EventDriven | TimeStepping:
    """Return the method that a file asks for; `keys` are those of `METHOD` that its model has.

    Raises
    ------
    InvalidInputError
        A key belongs to the other method.

    Examples
    --------
    >>> method_in({"x0": [1], "max_events": 9})
    EventDriven(on_nonunique='raise', max_events=9, rebound=None)
    >>> method_in({"method": "time-stepping", "max_events": 9})
    Traceback (most recent call last):
        ...
    pricing_core.errors.InvalidInputError: max_events = 9: must be left out with method="time-stepping"
    """
    given = {name: values[name] for name in keys if name in values}
    name = given.pop("method", "event-driven")
    foreign = BY_STEPS if name == "event-driven" else BY_EVENTS
    for key, value in given.items():
        if key in foreign:
            raise InvalidInputError(key, value, f'left out with method="{name}"')
    fields_of_keys = {key: field for field, key in KEYS_OF_FIELDS.items()}
    fields = {fields_of_keys.get(key, key): value for key, value in given.items()}
    return EventDriven(**fields) if name == "event-driven" else TimeStepping(**fields)
