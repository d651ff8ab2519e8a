"""The keys that name the quantities of a model and say their units."""

from collections.abc import Mapping
from typing import Any

from app.commands.labels import Labels
from app.commands.model_keys import TEXT, Key, list_of, object_of

NAMES = list_of(TEXT, "a list of texts")
UNITS = Key(
    lambda field, value: TEXT.read(field, value) if isinstance(value, str) else NAMES.read(field, value),
    {"anyOf": [TEXT.schema, NAMES.schema]},
)


def label_keys(names: Mapping[str, str], units: Mapping[str, str] | None = None) -> Mapping[str, Key]:
    """Return the keys "names" and "units" of a model.

    Parameters
    ----------
    names, units : mapping
        What is said of each symbol; units take the same symbols as names where they are not given, and the time.
    """
    of_names = {symbol: NAMES.described(text) for symbol, text in names.items()}
    of_units = {symbol: UNITS.described(text) for symbol, text in (names if units is None else units).items()}
    of_units["t"] = TEXT.described("of the time")
    return {
        "names": object_of(of_names).described("what tables and pictures call the quantities"),
        "units": object_of(of_units).described(
            "which pictures state: one for all components, or one for each"
        ),
    }


def labels_in(values: Mapping[str, Any]) -> Labels:
    """Return the labels of a model file.

    Examples
    --------
    >>> labels = labels_in({"names": {"x": ["charge"]}, "units": {"t": "s"}})
    >>> labels.names_of("x", 1), labels.names_of("u", 2), labels.units_of("x", 1), labels.time
    (('charge',), ('u1', 'u2'), ('',), 's')
    """
    return Labels(values.get("names", {}), values.get("units", {}))
