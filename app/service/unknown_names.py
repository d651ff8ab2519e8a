"""The error of names in a request that are not known: the nearest that are, and nothing of the request."""

from collections.abc import Iterable, Sequence

from pricing_core.american.contracts.names import nearest_names
from pricing_core.errors import InvalidInputError, Told


def unknown_in_request(field: str, unknown: Sequence[str], names: Iterable[str]) -> InvalidInputError:
    """Return the error of names in a request that are not known, without these.

    Examples
    --------
    >>> print(unknown_in_request("key of the body", ["vol"], ["spot", "volatility"]))
    key of the body = an unknown name: must be volatility, or another of the names spot, volatility
    >>> print(unknown_in_request("query", ["foo", "bar"], ["tolerance", "greeks"]))
    query = unknown names: must be one of the names tolerance, greeks
    """
    told = Told("an unknown name" if len(unknown) == 1 else "unknown names")
    return InvalidInputError(field, told, nearest_names(unknown, names))
