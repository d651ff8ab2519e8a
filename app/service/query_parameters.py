"""The parameters of a query, before their values are read."""

from collections.abc import Sequence

from fastapi import Request

from app.service.unknown_names import unknown_in_request
from pricing_core.errors import InvalidInputError, Told


def query_parameters(request: Request, names: Sequence[str]) -> dict[str, str]:
    """Return the texts of a query by name.

    Raises
    ------
    InvalidInputError
        A name is not one of these, or is given twice.
    """
    given = request.query_params.multi_items()
    found = dict(given)
    unknown = [name for name in found if name not in names]
    if unknown:
        raise unknown_in_request("query", unknown, names)
    if len(found) < len(given):
        raise InvalidInputError("query", Told("a name twice"), "without a name twice")
    return found
