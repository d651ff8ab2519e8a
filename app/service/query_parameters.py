"""The parameters of a query, before their values are read."""

from collections.abc import Sequence

from fastapi import Request

from pricing_core.errors import InvalidInputError, Told, UnknownNameError

MOST_PARAMETERS = 100  # of a query: each is compared with all names before the request is admitted; chosen


def query_parameters(request: Request, names: Sequence[str]) -> dict[str, str]:
    """Return the texts of a query by name.

    Raises
    ------
    InvalidInputError
        A name is not one of these, or is given twice.
    """
    if request.scope["query_string"].count(b"&") >= MOST_PARAMETERS:
        raise InvalidInputError("query", Told("more"), f"fewer than {MOST_PARAMETERS} parameters")
    given = request.query_params.multi_items()
    found = dict(given)
    unknown = [name for name in found if name not in names]
    if unknown:
        raise UnknownNameError("parameter", unknown, names, "the query")
    if len(found) < len(given):
        raise InvalidInputError("query", Told("a name twice"), "without a name twice")
    return found
