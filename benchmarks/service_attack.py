"""What does a neighbour of hostile clients notice, and how much memory do they make the service take?

One kind of attack at a time on a server of two workers, and then all kinds together for ten minutes, beside a client
from another address that asks for a price ten times a second and for `/livez` as often. Attackers, neighbour and
server share the machine, the attackers at the lowest priority, as they would not share it elsewhere; nothing else is
spoken to.
"""

import json
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from http.client import HTTPConnection, HTTPException
from typing import NamedTuple

import numpy as np

from benchmarks.reporting.report import Report, Section, table
from benchmarks.serving.attackers import EVERYTHING, PRICE, shapes
from benchmarks.serving.load import HOST, SERVE, megabytes, server_process

TWO_WORKERS = SERVE.replace("'0']", "'0', '--workers', '2']")
QUESTION = json.dumps(PRICE)
PAUSE = 0.1  # seconds between two questions of the neighbour
LONG_SECONDS, MANY = 600.0, 128  # that all kinds last together, and their connections
QUIET = "nobody"


class Beside(NamedTuple):
    """What a neighbour sees beside one kind of attack: milliseconds, answers other than 200, and megabytes in all."""

    attack: str
    connections: int
    price_p50_ms: float
    price_p95_ms: float
    livez_p50_ms: float
    livez_p95_ms: float
    refused: int
    megabytes: float
    attackers_were_answered: str


def run(*, quick: bool) -> Report:
    """Measure and report; `quick` gives every fifth attack a moment."""
    seconds, connections = (0.3, (4,)) if quick else (10.0, (1, MANY))
    names = [*shapes()][:: 5 if quick else 1]
    with server_process(TWO_WORKERS) as (port, process):
        until_ready(port)
        found = [*attacks(names, port, process, seconds, connections)]
        if not quick:
            found.append(beside(EVERYTHING, MANY, port, process, LONG_SECONDS))
    return Report(
        "service-attack",
        "The service beside hostile clients",
        (__doc__ or "").splitlines()[0],
        (Section("Attacks", _text(found), (table("attacks", found),)),),
    )


def attacks(
    names: Sequence[str], port: int, process: int, seconds: float, connections: Sequence[int]
) -> Iterator[Beside]:
    """Let the neighbour ask beside nobody, and then beside each kind of attack, by so many connections."""
    yield beside(QUIET, 0, port, process, seconds)
    for name in names:
        for count in connections:
            yield beside(name, count, port, process, seconds)


def beside(name: str, connections: int, port: int, process: int, seconds: float) -> Beside:
    """Return what the neighbour sees beside one kind of attack."""
    words = [
        "nice",
        "-n",
        "19",
        sys.executable,
        "-m",
        "benchmarks.serving.attackers",
        name,
        str(port),
        str(seconds),
        str(connections),
    ]
    attackers = (
        None if name == QUIET else subprocess.Popen(words, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL)
    )
    latencies: dict[str, list[float]] = {"price": [], "livez": []}
    refused, most = 0, 0.0
    until = time.monotonic() + seconds + (2.0 if attackers else 0.0)
    while time.monotonic() < until:
        for kind, taken in latencies.items():
            begun = time.monotonic()
            refused += _asked(port, kind) != 200
            taken.append(1e3 * (time.monotonic() - begun))
        most = max(most, megabytes(process))
        time.sleep(PAUSE)
    told = {} if attackers is None else json.loads(attackers.communicate(timeout=seconds + 60.0)[0] or "{}")
    price_p50, price_p95 = np.percentile(latencies["price"], [50, 95]).tolist()
    livez_p50, livez_p95 = np.percentile(latencies["livez"], [50, 95]).tolist()
    answers = ", ".join(f"{count} x {status}" for status, count in sorted(told.items()))
    return Beside(name, connections, price_p50, price_p95, livez_p50, livez_p95, refused, most, answers)


def _asked(port: int, kind: str) -> int:
    """Return the status of a question of the neighbour's; 0 where there is no answer."""
    connection = HTTPConnection(HOST, port, timeout=30.0, source_address=("127.0.0.100", 0))
    try:
        if kind == "livez":
            connection.request("GET", "/livez")
        else:
            connection.request("POST", "/v1/price", QUESTION, {"Content-Type": "application/json"})
        answer = connection.getresponse()
        answer.read()
        return answer.status
    except (OSError, HTTPException):
        return 0
    finally:
        connection.close()


def until_ready(port: int) -> None:
    """Wait until the server answers."""
    for _ in range(600):
        if _asked(port, "price") == 200:
            return
        time.sleep(0.1)


def _text(found: list[Beside]) -> str:
    quiet, worst = found[0], max(found[1:], key=lambda one: one.price_p95_ms)
    largest = max(found, key=lambda one: one.megabytes)
    refused = sum(one.refused for one in found)
    return (
        f"Beside nobody 95 % of the neighbour's prices take at most {quiet.price_p95_ms:.3g} ms; beside "
        f"`{worst.attack}`, the worst of {len(found) - 1} attacks, {worst.price_p95_ms:.3g} ms, and {refused} of its "
        f"questions have another answer than 200. The processes take {quiet.megabytes:.0f} MB before and at most "
        f"{largest.megabytes:.0f} MB, beside `{largest.attack}`."
    )
