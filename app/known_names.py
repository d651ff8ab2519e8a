"""A message that lists the known names, for whoever has used another one."""

from collections.abc import Iterable
from difflib import get_close_matches

LONGEST_NAME = 40  # characters of an unknown name that are compared with ours


def among(names: Iterable[str], unknown: str) -> str:
    """Return the known names in one phrase, with the nearest to an unknown one named again."""
    known = list(names)
    nearest = get_close_matches(unknown[:LONGEST_NAME], known, n=1)
    return ", ".join(known) + (f"; did you mean {nearest[0]}?" if nearest else "")
