"""An optimal control problem from the parsed JSON of a model file."""

from collections.abc import Mapping

from pricing_core.errors import InvalidInputError
from pricing_core.models.optimal_control import StateConstrainedLQ

MODEL = "optimal-control"
REQUIRED = ("A", "B", "C", "Q", "x0", "horizon")
DIMENSIONS = {"A": 2, "B": 2, "C": 2, "Q": 2, "x0": 1, "horizon": 0, "bound": 1}
SHAPES = ("a number", "a list of numbers", "a list of rows, which are lists of equally many numbers")


def optimal_control_from(document: Mapping[str, object]) -> StateConstrainedLQ:
    """Return the problem that {"model": "optimal-control", constructor arguments by name} states.

    Parameters
    ----------
    document : mapping
        What a JSON parser made of the file: "A", "B", "C", "Q", "x0", "horizon" and, if wanted, "bound".

    Raises
    ------
    InvalidInputError
        Naming the key that is missing, unknown or of the wrong form, or the argument that `StateConstrainedLQ` refuses.

    Examples
    --------
    >>> text = '{"model": "optimal-control", "A": [[-1]], "B": [[1]], "C": [[1]], "Q": [[1]], "x0": [2], "horizon": 3}'
    >>> import json
    >>> optimal_control_from(json.loads(text)).horizon
    3.0
    """
    if not isinstance(document, Mapping):
        raise InvalidInputError("document", document, "an object with the keys model, " + ", ".join(REQUIRED))
    if document.get("model") != MODEL:
        raise InvalidInputError("model", document.get("model"), f'"{MODEL}"')
    for key in document:
        if key != "model" and key not in DIMENSIONS:
            raise InvalidInputError(
                str(key), document[key], "left out; known are model, " + ", ".join(DIMENSIONS)
            )
    for key in REQUIRED:
        if key not in document:
            raise InvalidInputError(key, None, f"given: {SHAPES[DIMENSIONS[key]]}")
    given = {key: value for key, value in document.items() if key != "model"}
    for key, value in given.items():
        if not _has_form(value, DIMENSIONS[key]):
            raise InvalidInputError(key, value, SHAPES[DIMENSIONS[key]])
    return StateConstrainedLQ(**given)  # type: ignore[arg-type]


def _has_form(value: object, dimensions: int) -> bool:
    """Tell whether a value is a number, a list of numbers, or a list of equally long lists of numbers."""
    if dimensions == 0:
        return isinstance(value, int | float) and not isinstance(value, bool)
    if not isinstance(value, list) or not all(_has_form(entry, dimensions - 1) for entry in value):
        return False
    return dimensions == 1 or len({len(row) for row in value}) == 1
