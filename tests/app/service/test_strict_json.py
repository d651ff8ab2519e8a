import contextlib
import json
import sys
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.service.strict_json import InvalidJsonError, parse_object

JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=10,
)


@given(st.dictionaries(st.text(), JSON))
def test_every_json_object_is_read_back(value: dict[str, object]) -> None:
    assert parse_object(json.dumps(value).encode()) == value


@given(st.binary())
def test_any_bytes_give_an_object_or_the_one_error(raw: bytes) -> None:
    with contextlib.suppress(InvalidJsonError):
        assert isinstance(parse_object(raw), dict)


@pytest.mark.parametrize("nested", [b'{"a": {"b": 1, "b": 2}}', b'{"a": [{"b": 1, "b": 1}]}'])
def test_a_key_twice_is_refused_at_any_depth(nested: bytes) -> None:
    with pytest.raises(InvalidJsonError, match="twice"):
        parse_object(nested)


@pytest.mark.parametrize("raw", [b"", b" \r\n", bytearray()])
def test_an_empty_body_is_called_empty(raw: bytes) -> None:
    with pytest.raises(InvalidJsonError, match="the body is empty"):
        parse_object(raw)


def test_both_halves_of_a_surrogate_pair_are_one_character() -> None:
    assert parse_object(b'{"a": "\\ud83d\\ude00"}') == {"a": "\N{GRINNING FACE}"}


@pytest.mark.parametrize("number", ["1", "0.25", "1e-3"])
def test_other_threads_run_between_the_numbers_of_a_long_body(number: str) -> None:
    turns, ended = 0, threading.Event()

    def count() -> None:
        nonlocal turns
        while not ended.is_set():
            turns += 1
            time.sleep(0)

    def turns_beside(count: int) -> int:
        """Return how often the other thread runs while so many numbers are read."""
        body = f'{{"spot": [{",".join([number] * count)}]}}'.encode()
        before = turns
        parse_object(body)
        return turns - before

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    other = threading.Thread(target=count)
    other.start()
    try:
        # However fast the machine is, some body is long enough; no body is if the other thread has to wait for its end.
        assert any(turns_beside(100_000 << k) > 20 for k in range(7))
    finally:
        ended.set()
        other.join()
        sys.setswitchinterval(interval)
