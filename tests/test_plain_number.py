"""What counts as a number in a table or on the command line."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pricing_core.errors import InvalidInputError
from pricing_core.plain_number import read_number


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_finite_number_is_read_back_from_its_shortest_text(number: float) -> None:
    assert read_number("spot", repr(number)) == number


@pytest.mark.parametrize(
    ("text", "number"), [("1", 1.0), (" 1\t", 1.0), ("+1.", 1.0), (".5", 0.5), ("5E-2", 0.05), ("-0", 0.0)]
)
def test_plain_notation_is_read(text: str, number: float) -> None:
    assert read_number("spot", text) == number


@pytest.mark.parametrize(
    "text",
    [
        "abc",
        "nan",
        "NaN",
        "inf",
        "-Infinity",
        "1e999",
        "1,5",
        "1_000",
        "0x10",
        "\uff11\uff10",
        "1e",
        ".",
        "1 0",
        "TRUE",
        "\u0661",
        "100\n",
        "1\x00",
        "$5",
        "5%",
        "--1",
        "1d3",
    ],
)
def test_any_other_notation_is_refused(text: str) -> None:
    with pytest.raises(InvalidInputError, match=r"^spot = "):
        read_number("spot", text)
