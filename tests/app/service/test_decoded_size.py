"""What is counted for a body before it is read is at least what its values take."""

import json
import random
import tracemalloc
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import pyarrow as pa
import pytest

from app.service.decoded_size import bytes_of_csv, bytes_of_json, bytes_of_table
from app.service.strict_json import InvalidJsonError, parse_object
from pricing_core.chains.raw_files import of_arrow, of_csv
from pricing_core.errors import InvalidInputError

LENGTH = 100_000  # bytes of each body, about
# Parts that a hostile body repeats, smallest first.
PARTS = [
    *("1", "-1", "1.5", "12345678", "1e9", "1e-300", "null", "true"),
    *('""', '"a"', '"ab"', '"\\u00e9"', '"\u00e9"', '"\u20ac"', '"\U0001f600"'),
    *("[]", "[1]", "[[]]", "[[[[]]]]", "{}", '{"":1}', '{"a":{}}', '{"a":1,"b":2}', '{"a":{"b":{"c":[]}}}'),
    *('{"time":1,"amount":1}', '{"ex_date":"2026-01-01","amount":1}', "[0.25,1.5]"),
]


def peak(read: Callable[[], object]) -> int:
    """Return the bytes that a call takes at most."""
    tracemalloc.start()
    try:
        read()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def of_parts(parts: list[str]) -> bytes:
    text, size = [], 0
    while size < LENGTH:
        text.append(parts[len(text) % len(parts)])
        size += len(text[-1]) + 1
    return f'{{"spot":[{",".join(text)}]}}'.encode()


def of_keys(length: int) -> bytes:
    """Return one object with as many different keys as there is room for."""
    count = LENGTH // (length + 5)
    return json.dumps({f"{number:0{length}x}": 1 for number in range(count)}, separators=(",", ":")).encode()


@pytest.mark.parametrize("part", PARTS)
def test_a_body_of_one_part_over_and_over_is_counted_in_full(part: str) -> None:
    body = of_parts([part])
    assert peak(lambda: parse_object(body, 1 << 40)) <= bytes_of_json(body)


@pytest.mark.parametrize("seed", range(30))
def test_no_mixture_of_parts_takes_more_than_is_counted(seed: int) -> None:
    choose = random.Random(seed)
    body = of_parts(choose.choices(PARTS, k=choose.randint(2, 12)))
    assert peak(lambda: parse_object(body, 1 << 40)) <= bytes_of_json(body)


@pytest.mark.parametrize("length", [2, 5, 30, 300])
def test_a_body_of_keys_is_counted_in_full(length: int) -> None:
    body = of_keys(length)
    assert peak(lambda: parse_object(body, 1 << 40)) <= bytes_of_json(body)


class Watched(bytearray):
    """A text that may only be looked at in pieces."""

    def translate(self, *_: object) -> bytearray:
        """Refuse to go through all of it at once, while other threads would wait."""
        raise AssertionError("all of it at once")


@pytest.mark.parametrize("count", [bytes_of_json, bytes_of_csv])
def test_a_long_text_is_looked_at_in_pieces(
    count: Callable[[bytes | bytearray], int], monkeypatch: pytest.MonkeyPatch
) -> None:
    text = b"[1,2]" * 1_000
    whole = count(text)
    monkeypatch.setattr("app.service.decoded_size.PIECE", 37)
    assert count(Watched(text)) == whole


def test_an_ordinary_book_is_not_counted_many_times_over() -> None:
    rng = np.random.default_rng(7)
    book = {name: rng.uniform(50.0, 150.0, 2000).round(4).tolist() for name in ("spot", "strike", "rate")}
    body = json.dumps(book).encode()
    assert bytes_of_json(body) < 10 * len(body)


def test_more_values_than_may_be_are_not_read() -> None:
    body = of_parts(["{}"])
    with pytest.raises(InvalidJsonError, match="more values than are read as one object"):
        parse_object(body, bytes_of_json(body) - 1)


@pytest.mark.parametrize("cell", ["", "1", "ab", "\u20ac", "\U0001f600"])
def test_cells_of_csv_are_counted_in_full(cell: str) -> None:
    rows = "\n".join([",".join(f"c{place}" for place in range(20)), *([",".join([cell] * 20)] * 2000)])
    body = rows.encode()
    assert peak(lambda: of_csv(body.decode())) <= bytes_of_csv(body)


@pytest.mark.parametrize("body", [b"\n" * LENGTH, (b" " * 999 + b"\n") * 100, (b"x" * 9_999 + b"\n") * 10])
def test_a_text_of_few_cells_is_counted_in_full(body: bytes) -> None:
    def read() -> None:
        with suppress(InvalidInputError):  # some are no table, once they have been read
            of_csv(body.decode())

    assert peak(read) <= bytes_of_csv(body)


def test_texts_of_a_dictionary_are_counted_as_often_as_they_are_cells() -> None:
    codes = pa.array(np.zeros(3000, dtype=np.int8))
    table = pa.table({"a": pa.DictionaryArray.from_arrays(codes, ["x" * 5000])})
    assert table.nbytes < 20_000
    assert peak(lambda: of_arrow(table)) <= bytes_of_table(table)
    assert bytes_of_table(table) > 3000 * 5000
