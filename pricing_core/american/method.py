"""Which engines the words for a method stand for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias

from pricing_core.american.book.resolution import LCPMethod, Resolution, Scheme
from pricing_core.american.engines.engine import Engine
from pricing_core.american.engines.solve import CLOSED_FORM, ENGINES
from pricing_core.arrays import check_choice
from pricing_core.errors import InvalidInputError

Method: TypeAlias = Literal["auto", "lcs", "crank-nicolson"]
METHODS = ("auto", "lcs", "crank-nicolson")
LCP_METHODS = ("tridiagonal", "policy", "psor", "lemke")


def engines_of(
    method: Method, lcp_method: LCPMethod = "tridiagonal", resolution: Resolution | None = None
) -> Sequence[Engine]:
    """Return the engines that an answer may come from, in the order in which they are asked.

    Parameters
    ----------
    method, lcp_method, resolution
        As in `price`.

    Raises
    ------
    InvalidInputError
        A word is none of those allowed, or the method is not that of the resolution's scheme.
    """
    check_choice("method", method, METHODS)
    check_choice("lcp_method", lcp_method, LCP_METHODS)
    asked = None if resolution is None else resolution.scheme
    scheme: Scheme = asked or ("crank-nicolson" if method == "crank-nicolson" else "sdirk2")
    if method != "auto" and (scheme == "crank-nicolson") != (method == "crank-nicolson"):
        allowed = f'"auto" where the resolution asks for the scheme "{scheme}"'
        raise InvalidInputError("method", method, allowed)
    if method == "auto" and lcp_method == "tridiagonal" and resolution is None:
        return ENGINES
    from pricing_core.american.engines.chapter import Chapter  # noqa: PLC0415  the other engines do without it

    return CLOSED_FORM, Chapter(scheme, lcp_method, resolution)
