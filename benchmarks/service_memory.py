"""Does the memory of the service grow? Minutes of mixed questions at a moderate rate, and the processes' memory.

Two workers are asked for random prices on kept connections, 50 a second; besides, in turn, on connections of their
own, for an implied volatility with 600 dividends, a boundary, a surface, advice on exercise, the metrics, a batch in
each form, a body that is not valid, and by a client that leaves before it is answered. Every minute the resident memory
of each process is printed. Run from the root of the project, with --quick for one minute:
.venv/bin/python -m benchmarks.service_memory
"""

import asyncio
import contextlib
import itertools
import json
import sys
import time
from collections import Counter
from pathlib import Path

from benchmarks.measuring.machine import cpu_model
from benchmarks.problems.hostile_questions import SEARCH
from benchmarks.serving.load import (
    FORMS,
    HOST,
    SERVE,
    as_http,
    batch_body,
    flat_book,
    megabytes,
    open_loop,
    price_requests,
    server_process,
)

MINUTES = 10
RATE = 50.0  # prices a second
PAUSE_SECONDS = 0.5  # between two other questions
ROWS = 2_000  # of a batch
LEAVES_AFTER = 0.1  # seconds, the client that does not wait
CONTRACT = {
    "option_type": "put",
    "spot": 100.0,
    "strike": 100.0,
    "expiry": 1.0,
    "rate": 0.05,
    "volatility": 0.2,
}


def questions() -> list[tuple[str, bytes, float]]:
    """Return the names of the other questions, each as HTTP, and how many seconds its client waits at most."""
    surface = CONTRACT | {"spots": [50.0 + k for k in range(100)], "times": [0.1 * k for k in range(10)]}
    found = [
        ("search", as_http("/v1/implied-volatility", SEARCH), 60.0),
        ("boundary", as_http("/v1/boundary", CONTRACT), 60.0),
        ("surface", as_http("/v1/surface", surface), 60.0),
        ("advice", as_http("/v1/exercise-advice", CONTRACT | {"exercise_start": 0.5}), 60.0),
        ("metrics", f"GET /metrics HTTP/1.1\r\nHost: {HOST}\r\n\r\n".encode(), 60.0),
        ("not valid", as_http("/v1/price", CONTRACT | {"spot": "much"}), 60.0),
        ("leaves", as_http("/v1/implied-volatility", SEARCH), LEAVES_AFTER),
    ]
    for form in FORMS:
        body = batch_body(flat_book(ROWS), form)
        head = (
            f"POST /v1/batch HTTP/1.1\r\nHost: {HOST}\r\nContent-Type: {form}\r\nContent-Length: {len(body)}"
        )
        found.append((f"batch as {form}", head.encode() + b"\r\n\r\n" + body, 60.0))
    return [(name, raw.replace(b"\r\n", b"\r\nConnection: close\r\n", 1), wait) for name, raw, wait in found]


async def ask_others(port: int, ends: Counter[str]) -> None:
    """Ask the other questions in turn, without end, and count how each was answered."""
    for name, raw, wait in itertools.cycle(questions()):
        reader, writer = await asyncio.open_connection(HOST, port)
        status = "not waited for"
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(wait):
                writer.write(raw)
                answer = await reader.read()
                status = answer[9:12].decode()
        writer.close()
        ends[f"{name}: {status}"] += 1
        await asyncio.sleep(PAUSE_SECONDS)


def resident(parent: int) -> list[float]:
    """Return the resident memory of a process and its children, MB."""
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    found = []
    for process in (str(parent), *children):
        lines = Path(f"/proc/{process}/status").read_text().splitlines()
        found.append(next(int(line.split()[1]) for line in lines if line.startswith("VmRSS:")) / 1e3)
    return found


def print_memory(when: str, parent: int) -> None:
    """Print one line."""
    processes = "  ".join(f"{memory:6.1f}" for memory in resident(parent))
    print(
        f"  {when:>8}  {processes}  MB; {megabytes(parent):6.1f} MB together, shared pages once", flush=True
    )


async def measure(port: int, parent: int, minutes: int) -> None:
    """Ask for so many minutes, and print the memory."""
    ends: Counter[str] = Counter()
    statuses: Counter[int] = Counter()
    others = asyncio.create_task(ask_others(port, ends))
    requests = price_requests(500)
    print_memory("start", parent)
    for minute in range(1, minutes + 1):
        found = await open_loop(port, RATE, 60.0, requests)
        statuses += found.statuses
        print_memory(f"{minute} min", parent)
    others.cancel()
    await asyncio.gather(others, return_exceptions=True)
    print(f"  prices by status {dict(statuses)}\n  others {json.dumps(ends)}")


def main(*, quick: bool) -> None:
    """Print the memory from minute to minute."""
    minutes = 1 if quick else MINUTES
    print(f"{cpu_model()}: parent and two workers, {RATE:g} prices a second and others, {minutes} minutes")
    with server_process(SERVE.replace("'0']", "'0', '--workers', '2']")) as (port, process):
        time.sleep(5.0)  # until both are ready
        asyncio.run(measure(port, process, minutes))


if __name__ == "__main__":
    main(quick="--quick" in sys.argv[1:])
