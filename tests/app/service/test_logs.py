import json
import logging
import os
import select
import subprocess
import sys
import warnings
from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

from app.service import logs
from app.service.logs import BackgroundHandler, configure_logging
from tests.problems.eventually import eventually


@pytest.fixture(autouse=True)
def _logging_as_before() -> Iterator[None]:
    root = logging.getLogger()
    before = root.handlers[:], root.level
    yield
    logging.captureWarnings(False)
    root.handlers[:] = before[0]
    root.setLevel(before[1])


def test_a_warning_is_a_json_line_like_any_other(capfd: pytest.CaptureFixture[str]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        configure_logging("INFO")
        np.exp(np.float64(1e4))
    logging.getLogger().handlers[0].flush()
    (line,) = [json.loads(line) for line in capfd.readouterr().err.splitlines()]
    assert (line["logger"], line["level"]) == ("py.warnings", "WARNING")
    assert "overflow encountered in exp" in line["message"]


# Writes lines of all lengths, and tracebacks that are longer than a pipe takes as a whole.
WRITER = """
import logging, random, sys
from app.service import logs
from app.service.logs import BackgroundHandler, configure_logging
from tests.problems.eventually import eventually
number, count, in_background = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3] == "in_background"
configure_logging("INFO", in_background=in_background)
log, rng = logging.getLogger("test"), random.Random(number)
letters = "abc" + chr(34) + chr(92) + chr(10) + chr(0x20AC) + chr(0x1F4C8)
for place in range(count):
    long = rng.random() < 0.05
    text = "".join(rng.choices(letters, k=rng.randrange(20_000 if long else 900)))
    if long:
        try:
            raise ValueError(text)
        except ValueError:
            log.exception("a fault", extra={"fields": {"writer": number, "place": place, "length": len(text)}})
    else:
        log.info("text", extra={"fields": {"writer": number, "place": place, "text": text}})
    if place % 20 == 0:
        logging.root.handlers[0].flush()
logging.shutdown()
"""


@pytest.mark.parametrize("ways", [["in_background"] * 4, ["in_background", "in_background", "at once"]])
def test_lines_of_several_processes_never_come_between_each_other(ways: list[str]) -> None:
    reads, writes = os.pipe()
    count = 300
    writers = [
        subprocess.Popen([sys.executable, "-c", WRITER, str(number), str(count), way], stderr=writes)
        for number, way in enumerate(ways)
    ]
    os.close(writes)
    with open(reads, "rb") as pipe:
        raw = pipe.readlines()
    assert [writer.wait(60) for writer in writers] == [0] * len(ways)
    found: defaultdict[tuple[int, int], list[dict[str, Any]]] = defaultdict(list)
    for line in raw:
        assert len(line) <= select.PIPE_BUF
        parsed = json.loads(line)
        found[parsed["writer"], parsed["place"]].append(parsed)
    for number, way in enumerate(ways):
        places = [place for writer, place in found if writer == number]
        assert places == sorted(places)
        if way == "in_background":  # the others leave lines out where the pipe is full
            assert places == [*range(count)]
    for (writer, _), parts in found.items():
        if len(parts) > 1 and ways[writer] == "in_background":
            assert {part["message"] for part in parts} == {"a fault"}
            traceback = "".join(part["traceback"] for part in parts)
            assert traceback.startswith("Traceback (most recent call last):")
            assert len(traceback.partition("ValueError: ")[2]) == parts[0]["length"]


def test_lines_that_nobody_reads_wait_in_a_bounded_number_and_the_rest_is_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(logs, "MOST_LINES", 50)
    reader, writer = os.pipe()
    handler = BackgroundHandler(writer)
    handler.setFormatter(logs.JsonFormatter())
    record = logging.LogRecord("a", logging.INFO, "", 0, "x" * 400, None, None)
    for _ in range(2_000):  # many times what the pipe holds
        handler.emit(record)
        assert handler._waiting.qsize() <= 50
    os.set_blocking(reader, False)
    found = b""

    def told() -> bool:
        nonlocal found
        with suppress(BlockingIOError):
            found += os.read(reader, 1 << 20)
        return b"lines were left out" in found

    assert eventually(told)
    for end in (reader, writer):
        os.close(end)
