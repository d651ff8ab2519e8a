"""What one pass through a text finds, wherever it is cut."""

import itertools

import pytest

from pricing_core.batch.csv_check import LONGEST_LINE, TextCheck
from pricing_core.errors import InvalidInputError


def checked(*blocks: bytes) -> TextCheck:
    text = TextCheck("in.csv")
    for block in blocks:
        text.feed(block)
    text.end()
    return text


@pytest.mark.parametrize(("word", "found"), [(b'"times"', True), (b'""times""', True), (b'"time"', False)])
def test_a_curve_is_noticed_wherever_the_reads_cut_the_file(word: bytes, found: bool) -> None:
    content = b"..." + word + b"..."
    for first, second in itertools.combinations_with_replacement(range(len(content) + 1), 2):
        text = checked(content[:first], content[first:second], content[second:])
        assert text.mentions_curves is found


@pytest.mark.parametrize(
    ("content", "lines"),
    [(b"", 0), (b"a", 1), (b"a\nb", 2), (b"a\nb\n", 2), (b"a\r\nb\r\n", 2), (b"a\rb", 2)],
)
def test_lines_are_counted_wherever_the_reads_cut_the_file(content: bytes, lines: int) -> None:
    for cut in range(len(content) + 1):
        assert checked(content[:cut], content[cut:]).lines == lines


def test_a_bad_byte_is_found_with_its_line_wherever_the_reads_cut_the_file() -> None:
    content = "id\n\u00e9\n".encode() + "\u00e9".encode("latin-1") + b"\n"
    for cut in range(len(content) + 1):
        with pytest.raises(InvalidInputError, match="line 3 is not"):
            checked(content[:cut], content[cut:])
    with pytest.raises(InvalidInputError, match="line 2 is not"):
        checked(b"id\n\xc3")


def test_a_line_may_be_long_but_must_end() -> None:
    block = b"." * (1 << 20)
    blocks = [block] * (LONGEST_LINE // len(block))
    assert checked(*blocks, b"\n", *blocks).lines == 2
    with pytest.raises(InvalidInputError, match="line 2 has more than 64 MiB without an end"):
        checked(b"\n", *blocks, block)
