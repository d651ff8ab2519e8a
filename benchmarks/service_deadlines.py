"""Which batch is answered latest, in deadlines? A search over shapes of bodies on a real server with short deadlines.

Random shapes first: format, rows, other columns, long texts, dictionaries, dividends of each row, contracts that are
hard; then changes of the worst ones, round after round. Times are from the last byte sent to the first byte and to the
last one of the answer. Run from the root of the project:
.venv/bin/python -m benchmarks.service_deadlines [--quick]
"""

import json
import os
import sys
import time
from collections.abc import Iterator
from http.client import HTTPConnection, HTTPException
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa

from benchmarks.reporting.report import table
from benchmarks.service_attack import until_ready
from benchmarks.serving.load import ARROW, HOST, JSON, LINES, SERVE, server_process

DEADLINE = 4.0
LIMITS = {"PRICING_BATCH_DEADLINE_SECONDS": str(DEADLINE)}
MOST_BYTES = 45 << 20
FORMS = (JSON, LINES, ARROW)
KNOWN = ("dividend_yield", "borrow_rate", "settlement_lag", "quanto_covariance")
MOST_PARTS = 2_000_000  # of all rows' dividends, so that making a body takes seconds


class Shape(NamedTuple):
    """What a body is made of."""

    form: str
    rows: int
    other_columns: int
    text_length: int
    dividends: int
    is_hard: bool
    is_dictionary: bool


class Asked(NamedTuple):
    """One shape, and its answer: status, and seconds in deadlines."""

    form: str
    rows: int
    other_columns: int
    text_length: int
    dividends: int
    hard: str
    megabytes: float
    status: int
    first_byte: float
    last_byte: float


def random_shape(rng: np.random.Generator) -> Shape:
    """Return a random shape."""
    form = FORMS[int(rng.integers(len(FORMS)))]
    rows = int(10.0 ** rng.uniform(0.0, 5.5))
    return Shape(
        form,
        rows,
        int(rng.integers(0, 40)) if rng.random() < 0.4 else 0,
        int(10.0 ** rng.uniform(0.5, 4.0)) if rng.random() < 0.4 else 3,
        int(rng.integers(1, 60)) if rng.random() < 0.5 else 0,
        bool(rng.random() < 0.5),
        bool(rng.random() < 0.5),
    )


def changed(shape: Shape, rng: np.random.Generator) -> Shape:
    """Return a shape with one thing changed."""
    other = random_shape(rng)
    which = int(rng.integers(len(Shape._fields)))
    if which == 1:
        return shape._replace(rows=max(1, int(shape.rows * 10.0 ** rng.uniform(-0.5, 0.5))))
    return Shape._make([*shape[:which], other[which], *shape[which + 1 :]])


def columns(shape: Shape, rng: np.random.Generator) -> dict[str, Any]:
    """Return the columns of a shape; those that are not known are to be refused as soon as others are answered."""
    n = max(1, min(shape.rows, MOST_PARTS // max(1, shape.dividends)))
    found: dict[str, Any] = {
        "option_type": ["put" + " " * max(0, shape.text_length - 3)] * n,
        "spot": rng.uniform(70.0, 130.0, n).tolist(),
        "strike": [100.0] * n,
        "expiry": rng.uniform(0.5, 30.0 if shape.is_hard else 3.0, n).tolist(),
        "rate": rng.uniform(0.0, 0.1, n).tolist(),
        "volatility": rng.uniform(0.01 if shape.is_hard else 0.1, 0.6, n).tolist(),
    }
    if shape.dividends:
        times = np.linspace(0.05, 0.45, shape.dividends).round(4).tolist()
        found["cash_dividends"] = [[{"time": time, "amount": 0.1} for time in times]] * n
    names = [*KNOWN[: shape.other_columns], *(f"column_{k}" for k in range(shape.other_columns - len(KNOWN)))]
    return found | {name: [0.0] * n for name in names}


def body(shape: Shape, rng: np.random.Generator) -> bytes:
    """Return the body of a shape, of as many rows as fit."""
    found = columns(shape, rng)
    names = [*found]
    while True:
        rows = len(found["spot"])
        if shape.form == ARROW:
            made = _arrow(found, shape)
        elif shape.form == JSON:
            made = json.dumps(found).encode()
        else:
            made = "\n".join(json.dumps(dict(zip(names, row, strict=True))) for row in _rows(found)).encode()
        if len(made) <= MOST_BYTES:
            return made
        kept = max(1, int(0.9 * rows * MOST_BYTES / len(made)))
        found = {name: cells[:kept] for name, cells in found.items()}


def _rows(found: dict[str, Any]) -> Iterator[tuple[Any, ...]]:
    return zip(*found.values(), strict=True)


def _arrow(found: dict[str, Any], shape: Shape) -> bytes:
    arrays = {name: pa.array(cells) for name, cells in found.items()}
    if shape.is_dictionary:
        arrays["option_type"] = arrays["option_type"].dictionary_encode()
    batch = pa.table(arrays)
    sink = pa.BufferOutputStream()
    with pa.ipc.new_stream(sink, batch.schema) as stream:
        stream.write_table(batch)
    return bytes(sink.getvalue())


def ask(port: int, shape: Shape, seed: int) -> Asked:
    """Send a body, and measure the answer."""
    sent = body(shape, np.random.default_rng(seed))
    asked = HTTPConnection(HOST, port, timeout=20.0 * DEADLINE)
    status, first, last = 0, float("nan"), float("nan")
    try:
        asked.request(
            "POST",
            "/v1/batch?tolerance=1e-8" if shape.is_hard else "/v1/batch",
            sent,
            {"Content-Type": shape.form},
        )
        begun = time.perf_counter()
        answer = asked.getresponse()
        first, status = time.perf_counter() - begun, answer.status
        while answer.read(1 << 20):
            pass
        last = time.perf_counter() - begun
    except (OSError, HTTPException):
        pass
    finally:
        asked.close()
    hard = "hard" if shape.is_hard else ""
    return Asked(*shape[:5], hard, len(sent) / 1e6, status, first / DEADLINE, last / DEADLINE)


def search(port: int, first: int, rounds: int, seed: int = 1) -> list[Asked]:
    """Return what was asked, the latest answers first."""
    rng = np.random.default_rng(seed)
    found: list[tuple[Asked, Shape]] = []

    def tried(shape: Shape) -> None:
        found.append((ask(port, shape, len(found)), shape))

    for _ in range(first):
        tried(random_shape(rng))
    for _ in range(rounds):
        found.sort(key=lambda one: -np.nan_to_num(one[0].last_byte, nan=99.0))
        for _, shape in found[:4]:
            for _ in range(3):
                tried(changed(shape, rng))
    return [one for one, _ in sorted(found, key=lambda one: -np.nan_to_num(one[0].last_byte, nan=99.0))]


def main() -> None:
    """Print the latest answers."""
    os.environ.update(LIMITS)
    quick = "--quick" in sys.argv
    with server_process(SERVE) as (port, _):
        until_ready(port)
        found = search(port, 6 if quick else 40, 1 if quick else 5)
    print(table("latest answers", found[:12]))
    late = [one for one in found if not one.last_byte <= 1.05]
    print(f"\n{len(found)} bodies, {len(late)} answered later than the deadline and 5 %")


if __name__ == "__main__":
    main()
