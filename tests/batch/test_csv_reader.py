import csv
import io
import tracemalloc
from pathlib import Path
from random import Random

import numpy as np
import pyarrow as pa
import pytest

from pricing_core.batch.chunk import Chunk
from pricing_core.batch.csv_check import LONGEST_LINE, check_csv
from pricing_core.batch.csv_reader import LONGEST_CELL, CsvBlock, CsvReader
from pricing_core.batch.formats import format_of
from pricing_core.batch.tables import TableFile
from pricing_core.errors import InvalidInputError

HEADER = b"id,option_type,spot,strike,expiry,rate,volatility"
ROW = b"a,put,100,100,1,0.05,0.2"


def reader_of(path: Path) -> CsvReader:
    table = TableFile(str(path), path.name, format_of("input", path.name))
    return CsvReader(table, check_csv(table))


def read(path: Path, content: bytes, size: int | None = None) -> list[Chunk]:
    path.write_bytes(content)
    with reader_of(path) as reader:
        return [block.read() for block in reader.blocks(size)]


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
    assert list(chunk.lines) == [2, 3]
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


def test_rows_come_in_blocks_of_about_the_asked_size(path: Path) -> None:
    chunks = read(path, b"\n".join([HEADER, *[ROW] * 7]), size=2 * len(ROW) + 3)
    assert [list(chunk.lines) for chunk in chunks] == [[2, 3, 4], [5, 6, 7], [8]]


PIECES = ["put", "1.5", " padded", "", "a b", "'", "\0", "\u00e9t\u00e9"]
QUOTED = ['with "quotes"', "a, b", "two\nlines", "a\r\nb", "\r", '"', ',"\n']


@pytest.mark.parametrize("seed", range(20))
def test_random_tables_are_read_as_the_standard_library_reads_them_whatever_the_blocks(
    path: Path, seed: int
) -> None:
    random = np.random.default_rng(seed)
    ending = random.choice(["\n", "\r\n"])
    text = HEADER.decode() + ending
    for _ in range(int(random.integers(1, 60))):
        cells = random.choice(PIECES, random.choice([7, 7, 7, 7, 7, 7, 3, 8])).tolist()
        if random.random() < 0.1:
            cells[0] = str(random.choice(QUOTED))
        line = io.StringIO()
        csv.writer(line, lineterminator="").writerow(cells)
        text += line.getvalue() + ending * int(random.choice([1, 1, 1, 1, 2]))
    expected = [row for row in csv.reader(io.StringIO(text, newline="")) if row][1:]
    source = csv.reader(io.StringIO(text, newline=""))
    lines, before = [], 0
    for row in source:
        if row and before:
            lines.append(before + 1)
        before = source.line_num
    for size in (1, 50, 300, None):
        chunks = read(path, text.encode(), size)
        assert [line for chunk in chunks for line in chunk.lines] == lines
        rows = [list(row.values()) for chunk in chunks for row in chunk.table.to_pylist()]
        assert rows == [(row + [""] * 7)[:7] for row in expected]
        faults = [len(row) != 7 for row in expected]
        assert [index in chunk.malformed for chunk in chunks for index in range(len(chunk.lines))] == faults


def test_a_block_without_quotes_is_read_by_whoever_prices_it(path: Path) -> None:
    path.write_bytes(b"\n".join([HEADER, *[ROW] * 7]))
    with reader_of(path) as reader:
        assert all(isinstance(block, CsvBlock) for block in reader.blocks(40))


def test_a_header_alone_is_a_table_without_rows(path: Path) -> None:
    assert read(path, HEADER) == []
    assert read(path, HEADER + b"\n") == []


@pytest.mark.parametrize("quoted", [False, True])
def test_a_line_without_end_is_refused_within_bounded_memory(path: Path, quoted: bool) -> None:
    path.write_bytes(HEADER + b"\n" + b'"' * quoted)
    with path.open("r+b") as file:
        file.truncate(10 << 30)  # a sparse file: nothing but zeros
    tracemalloc.start()
    with pytest.raises(InvalidInputError, match="line 2 has more than 64 MiB without an end"):
        reader_of(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < LONGEST_LINE


def test_a_cell_may_be_longer_than_the_csv_module_s_own_limit(path: Path) -> None:
    (chunk,) = read(path, b"\n".join([HEADER, b"x" * 200_000 + ROW[1:], ROW]), 1 << 20)
    assert chunk.cell(0, "id") == "x" * 200_000
    assert chunk.malformed == {}


def test_a_quoted_cell_beyond_every_limit_is_a_fault_of_its_line(path: Path) -> None:
    long = b'"' + b"x" * (LONGEST_CELL + 1) + b'"'
    (chunk,) = read(path, b"\n".join([HEADER, long + ROW[1:], ROW]), 1 << 26)
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
        (HEADER.replace(b"spot", b"stock"), "spot (money) is missing"),
        (HEADER.replace(b",", b";"), "separated by commas"),
        (HEADER.replace(b",", b"\t"), "separated by commas"),
        (HEADER + b",x" * 2_000, "2007 columns: must be a table of at most 2000 columns"),
        (b'"id' + HEADER[2:], "in its header"),
        (b"\n".join([HEADER, ROW, b'"' + ROW, ROW, ROW]), "starts in line 3"),
        (b"\n".join([HEADER, b'"' + ROW, *[ROW] * 10_000]), "starts in line 2"),
    ],
    ids=range(14),
)
def test_a_file_that_is_no_table_is_one_clear_answer(path: Path, content: bytes, words: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        read(path, content)
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize("ending", ["gz", "zst"])
def test_compressed_text_is_read_and_damage_is_one_clear_answer(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"in.csv.{ending}"
    plain = b"\n".join([HEADER, *[ROW] * 10_000])
    with pa.CompressedOutputStream(str(path), {"gz": "gzip", "zst": "zstd"}[ending]) as file:
        file.write(plain)
    packed = path.read_bytes()
    assert sum(len(chunk.lines) for chunk in read(path, packed)) == 10_000
    assert sum(len(chunk.lines) for chunk in read(path, packed + packed.replace(HEADER, ROW))) >= 10_000
    for damaged in (packed[:-9], packed[: len(packed) // 2], packed[:20] + b"\xff" * 9 + packed[29:], plain):
        with pytest.raises(InvalidInputError, match=r"in\.csv\.\w+': must be an undamaged (gzip|zstd) file"):
            read(path, damaged)


@pytest.mark.parametrize("seed", range(40))
def test_quoted_cells_are_read_as_the_standard_library_reads_them(path: Path, seed: int) -> None:
    random = Random(seed)
    width = len(HEADER.split(b","))
    pieces = ['"a"', '"a,b"', '""', "a", "", '"a""b"', 'a"b', '"a"b', '","', '"a\nb"', "1.5", '" "']
    weights = [9, 3, 1, 9, 3, *([0.02] * 5), 9, 1]
    rows = [random.choices(pieces, weights, k=width) for _ in range(40)]
    text = "\n".join(",".join(row) for row in rows).encode()
    chunks = read(path, HEADER + b"\n" + text + b"\n")
    if not any(chunk.malformed for chunk in chunks):
        found = [
            [*row]
            for chunk in chunks
            for row in zip(*(c.to_pylist() for c in chunk.table.columns), strict=True)
        ]
        assert found == list(csv.reader(io.StringIO(text.decode(), newline=""), strict=True))
