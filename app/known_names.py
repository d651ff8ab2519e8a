"""The names that are known, told to who has used another."""

from collections.abc import Iterable
from difflib import get_close_matches

LONGEST_NAME = 40  # characters of an unknown name that are compared with ours


def among(names: Iterable[str], unknown: str) -> str:
    """Return the names that are known, and the one nearest to an unknown one once more."""
    known = list(names)
    nearest = get_close_matches(unknown[:LONGEST_NAME], known, n=1)
    return ", ".join(known) + (f"; did you mean {nearest[0]}?" if nearest else "")
