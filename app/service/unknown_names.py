"""The error of names in a request that are not known: the nearest that are, and nothing of the request."""

from collections.abc import Iterable, Sequence
from difflib import get_close_matches

from app.service.errors import SHOWN_ERRORS
from pricing_core.errors import InvalidInputError, Told

LONGEST_NAME = 40  # characters of an unknown name that are compared with ours


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
    return InvalidInputError(field, told, nearest_names(unknown[:SHOWN_ERRORS], names))


def nearest_names(unknown: Sequence[str], names: Iterable[str]) -> str:
    """Return what completes "must be ..." where names are not known: the nearest that are, and then all of these.

    Examples
    --------
    >>> nearest_names(["vol", "foo"], ["spot", "volatility"])
    'volatility, or another of the names spot, volatility'
    """
    known = list(names)
    nearest = dict.fromkeys(word for name in unknown for word in _nearest(name[:LONGEST_NAME].lower(), known))
    allowed = f"{', '.join(nearest)}, or another of the names" if nearest else "one of the names"
    return f"{allowed} {', '.join(known)}"


def _nearest(name: str, known: Sequence[str]) -> list[str]:
    """Return the known name that is most like another one, or begins with it; none where none does."""
    begun = [word for word in known if name and word.startswith(name)]
    return (get_close_matches(name, known, n=1) + begun)[:1]
