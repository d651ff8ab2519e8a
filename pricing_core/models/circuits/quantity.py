"""Numbers as netlists write them: 4.7k, 100n, 2MEG, 10uF."""

from __future__ import annotations

import re
from fractions import Fraction

from pricing_core.errors import InvalidInputError

SUFFIXES = {
    "t": Fraction(10**12),
    "g": Fraction(10**9),
    "meg": Fraction(10**6),
    "k": Fraction(1000),
    "": Fraction(1),
    "m": Fraction(1, 1000),
    "u": Fraction(1, 10**6),
    "n": Fraction(1, 10**9),
    "p": Fraction(1, 10**12),
    "f": Fraction(1, 10**15),
}
LARGEST_EXPONENT = 300
LONGEST_TEXT = 100

_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e([+-]?\d+))?)(meg|[tgkmunpf]?)([a-z]*)", re.IGNORECASE)


def quantity(field: str, text: str) -> Fraction:
    """Return the exact value of a number with an engineering suffix.

    As in SPICE the case does not matter, so M is milli and MEG is mega; letters after the suffix are units and do not
    count, so 1F is a femtofarad.

    Raises
    ------
    InvalidInputError
        That is no number.

    Examples
    --------
    >>> [str(quantity("value", text)) for text in ("4.7k", "100nF", "2MEG", "1e-3", "-.5")]
    ['4700', '1/10000000', '2000000', '1/1000', '-1/2']
    """
    match = _NUMBER.fullmatch(text) if len(text) <= LONGEST_TEXT else None
    if match is None or abs(int(match[2] or 0)) > LARGEST_EXPONENT or match[4].lower() == "il":
        raise InvalidInputError(field, text, "a number such as 4.7k, 100n or 1e-3")
    return Fraction(match[1]) * SUFFIXES[match[3].lower()]
