from pathlib import Path

import pytest

from pricing_core.batch.chunk import Chunk
from pricing_core.batch.csv_reader import LONGEST_CELL, CsvReader
from pricing_core.errors import InvalidInputError

HEADER = b"id,option_type,spot,strike,expiry,rate,volatility"
ROW = b"a,put,100,100,1,0.05,0.2"


def read(path: Path, content: bytes, rows: int = 1_000) -> list[Chunk]:
    path.write_bytes(content)
    with CsvReader(path) as reader:
        return list(reader.chunks(rows))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "in.csv"


@pytest.mark.parametrize("mark", [b"", b"\xef\xbb\xbf"])
@pytest.mark.parametrize("ending", [b"\n", b"\r\n", b"\r"])
@pytest.mark.parametrize("last", [True, False])
def test_byte_order_mark_and_line_endings_make_no_difference(
    path: Path, mark: bytes, ending: bytes, last: bool
) -> None:
    content = mark + ending.join([HEADER, ROW, ROW]) + (ending if last else b"")
    (chunk,) = read(path, content)
    assert chunk.lines == [2, 3]
    assert chunk.table.to_pylist()[1] == {
        "id": "a",
        "option_type": "put",
        "spot": "100",
        "strike": "100",
        "expiry": "1",
        "rate": "0.05",
        "volatility": "0.2",
    }


def test_lines_are_physical_lines_across_quoted_newlines_and_blank_lines(path: Path) -> None:
    quoted = b'"a\r\nb\nc"' + ROW[1:]
    (chunk,) = read(path, b"\n".join([HEADER, quoted, b"", ROW, b"", b"", ROW]))
    assert chunk.lines == [2, 6, 9]
    assert chunk.cell(0, "id") == "a\r\nb\nc"


def test_quotes_and_commas_inside_a_quoted_cell_are_kept(path: Path) -> None:
    (chunk,) = read(path, HEADER + b"\n" + b'"say ""a, b"""' + ROW[1:])
    assert chunk.cell(0, "id") == 'say "a, b"'


def test_rows_come_in_chunks_of_the_asked_size(path: Path) -> None:
    chunks = read(path, b"\n".join([HEADER, *[ROW] * 7]), rows=3)
    assert [list(chunk.lines) for chunk in chunks] == [[2, 3, 4], [5, 6, 7], [8]]


def test_a_header_alone_is_a_table_without_rows(path: Path) -> None:
    assert read(path, HEADER) == []


def test_a_cell_may_be_longer_than_the_csv_module_s_own_limit(path: Path) -> None:
    (chunk,) = read(path, b"\n".join([HEADER, b"x" * 200_000 + ROW[1:], ROW]))
    assert chunk.cell(0, "id") == "x" * 200_000
    assert chunk.malformed == {}


def test_a_cell_beyond_every_limit_is_a_fault_of_its_line(path: Path) -> None:
    (chunk,) = read(path, b"\n".join([HEADER, b"x" * (LONGEST_CELL + 1) + ROW[1:], ROW]))
    assert list(chunk.malformed) == [0]
    assert chunk.cell(1, "id") == "a"


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        (ROW + b",more", "a line of 7 cells, as the header; it has 8"),
        (b"a,put,100", "a line of 7 cells, as the header; it has 3"),
        (b'"a"b' + ROW[1:], "a line of CSV"),
    ],
)
def test_a_malformed_line_is_a_fault_of_its_own_and_the_others_are_read(
    path: Path, line: bytes, reason: str
) -> None:
    (chunk,) = read(path, b"\n".join([HEADER, ROW, line, ROW]))
    assert chunk.table.num_rows == 3
    assert list(chunk.malformed) == [1]
    assert reason in chunk.malformed[1].allowed
    assert chunk.cell(2, "volatility") == "0.2"


def test_a_quote_left_open_on_the_last_line_is_a_fault_of_that_line(path: Path) -> None:
    (chunk,) = read(path, b"\n".join([HEADER, ROW, b'"' + ROW]))
    assert list(chunk.malformed) == [1]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "it is empty"),
        (b"\n\n", "it is empty"),
        (b"\xef\xbb\xbf", "it is empty"),
        (b"\n".join([HEADER, ROW, ROW.replace(b"a", b"\xe9")]), "UTF-8 text; line 3 is not"),
        (b"\n".join([HEADER, ROW, b"\xc3"]), "UTF-8 text; line 3 is not"),
        ((HEADER + b"\n" + ROW).decode().encode("utf-16"), "UTF-8"),
        (HEADER.replace(b"spot", b"strike"), "column strike = '2 columns of this name'"),
        (HEADER.replace(b"spot", b"stock"), "column spot = 'missing'"),
        (HEADER.replace(b",", b";"), "separated by commas"),
        (HEADER.replace(b",", b"\t"), "separated by commas"),
        (b'"id' + HEADER[2:], "in its header"),
        (b"\n".join([HEADER, ROW, b'"' + ROW, ROW, ROW]), "starts in line 3"),
        (b"\n".join([HEADER, b'"' + ROW, *[ROW] * 10_000]), "starts in line 2"),
    ],
    ids=range(13),
)
def test_a_file_that_is_no_table_is_one_clear_answer(path: Path, content: bytes, words: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        read(path, content)
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_the_fraction_read_grows_to_1(path: Path) -> None:
    path.write_bytes(b"\n".join([HEADER, *[ROW] * 100]))
    with CsvReader(path) as reader:
        fractions = [reader.fraction_read for _ in reader.chunks(10)]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
