"""Numbers as netlists write them: 4.7k, 4k7, 100n, 2MEG, 10uF."""

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
    "r": Fraction(1),
    "mil": Fraction(254, 10**7),
    "m": Fraction(1, 1000),
    "u": Fraction(1, 10**6),
    "\N{MICRO SIGN}": Fraction(1, 10**6),
    "\N{GREEK SMALL LETTER MU}": Fraction(1, 10**6),
    "n": Fraction(1, 10**9),
    "p": Fraction(1, 10**12),
    "f": Fraction(1, 10**15),
}
LARGEST_EXPONENT = 300
LONGEST_TEXT = 100

_SUFFIX = "meg|mil|[tgkmunpf\N{MICRO SIGN}\N{GREEK SMALL LETTER MU}]"
_UNIT = "[a-z\N{GREEK CAPITAL LETTER OMEGA}\N{OHM SIGN}]*"
# An unsigned number, with its suffix and unit; or with the suffix in the place of the point.
NUMBER = (
    rf"(?:[0-9]+(?:{_SUFFIX}|r)[0-9]+|(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e[+-]?[0-9]+)?(?:{_SUFFIX})?){_UNIT}"
)
_INFIX = re.compile(rf"([+-]?[0-9]+)({_SUFFIX}|r)([0-9]+){_UNIT}", re.IGNORECASE)
_NUMBER = re.compile(
    rf"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e([+-]?[0-9]+))?)({_SUFFIX}|){_UNIT}", re.IGNORECASE
)


def quantity(field: str, text: str) -> Fraction:
    """Return the exact value of a number with an engineering suffix.

    As in SPICE the case does not matter, so M is milli and MEG is mega; letters after the suffix are units and do not
    count, so 1F is a femtofarad. A suffix, or R, may stand in the place of the point. A mil is 25.4 micrometres.

    Raises
    ------
    InvalidInputError
        That is no number.

    Examples
    --------
    >>> [str(quantity("value", text)) for text in ("4.7k", "4k7", "100nF", "2MEG", "1e-3", "-.5", "3R3")]
    ['4700', '4700', '1/10000000', '2000000', '1/1000', '-1/2', '33/10']
    """
    if len(text) <= LONGEST_TEXT:
        infix = _INFIX.fullmatch(text)
        if infix is not None:
            return Fraction(f"{infix[1]}.{infix[3]}") * SUFFIXES[infix[2].lower()]
        match = _NUMBER.fullmatch(text)
        if match is not None and abs(int(match[2] or 0)) <= LARGEST_EXPONENT:
            return Fraction(match[1]) * SUFFIXES[match[3].lower()]
    raise InvalidInputError(field, text, "a number such as 4.7k, 100n or 1e-3")
