"""How many prices a second does the service answer, how long does each take or a batch, what do hostile clients change?

Random American puts without dividends, tolerance 1e-6, all Greeks, by `POST /v1/price` over connections that are kept.
Clients and server share the machine.
"""

import asyncio
from collections.abc import Coroutine, Iterator, Sequence
from typing import Any, NamedTuple

from benchmarks.reporting.report import Report, Section, table
from benchmarks.serving.load import (
    CONSTANT,
    HOSTILE,
    IDLE,
    NO_OP,
    SERVE,
    Measured,
    batch_answers,
    beside_batches,
    beside_hostile,
    beside_idle,
    closed_loop,
    megabytes,
    open_loop,
    price_requests,
    server,
    server_process,
)

CLIENTS = (1, 8, 32)
TWO_WORKERS = SERVE.replace("'0']", "'0', '--workers', '2']")


class ClosedLoop(NamedTuple):
    """Clients that ask again when they have their answer: rates in answers a second, latencies in milliseconds.

    `no_op` is the same server with a constant answer, `constant` a server that does not read the request.
    """

    clients: int
    prices_a_second: float
    of_the_no_op_rate: float
    median_ms: float
    p99_ms: float
    added_to_the_no_op_ms: float
    constant_a_second: float


class Arrivals(NamedTuple):
    """Questions at a fixed rate, and how long after each was due it was answered, in milliseconds."""

    what: str
    asked_a_second: float
    answered_a_second: float
    median_ms: float
    p99_ms: float
    other_answers: str


def run(*, quick: bool) -> Report:
    """Measure and report; `quick` asks for a second or two, without batches and hostile clients."""
    seconds, clients = (0.3, CLIENTS[:2]) if quick else (10.0, CLIENTS)
    with server(CONSTANT) as constant, server(NO_OP + SERVE) as empty, server(SERVE) as port:
        loops = closed_loops((constant, empty, port), seconds, clients)
        peak = max(one.prices_a_second for one in loops)
        sections = [_loop_section(loops), _arrival_section(list(arrivals(port, peak, seconds)))]
        if not quick:
            sections.append(_hostile_section(list(beside(port, seconds))))
            text = "Puts by `POST /v1/batch`, medians of five, in turns with `price_many` of the same arrays."
            sections.append(Section("Batches", text, (table("batches", batch_answers(port, 100_000, 5)),)))
    return Report("service", "The service under load", (__doc__ or "").splitlines()[0], tuple(sections))


def closed_loops(
    ports: tuple[int, int, int], seconds: float, clients: Sequence[int] = CLIENTS
) -> list[ClosedLoop]:
    """Let so many clients ask for so long in turn the servers of a constant, of the no-op and of prices."""
    requests, found = price_requests(500), []
    for port in ports:
        settle(closed_loop(port, 8, min(seconds, 1.0), requests))  # to warm up
    for count in clients:
        bare, nothing, priced = (settle(closed_loop(port, count, seconds, requests)) for port in ports)
        median = priced.milliseconds(50)
        added = median - nothing.milliseconds(50)
        rates = (priced.rate, priced.rate / nothing.rate)
        found.append(ClosedLoop(count, *rates, median, priced.milliseconds(99), added, bare.rate))
    return found


def arrivals(port: int, peak: float, seconds: float) -> Iterator[Arrivals]:
    """Ask at half of the largest rate and at twice that, whether or not the service keeps up."""
    for share in (0.5, 2.0):
        found = settle(open_loop(port, share * peak, seconds, price_requests(500)))
        yield _arrived(f"{share:g} times the largest rate", share * peak, found)


def beside(port: int, seconds: float) -> Iterator[Arrivals]:
    """Ask 20 times a second, alone and beside others of the same address that take what they can."""
    requests, rate = price_requests(500), 20.0
    yield _arrived("alone", rate, settle(open_loop(port, rate, seconds, requests)))
    found, statuses = asyncio.run(beside_hostile(port, seconds, requests))
    yield _arrived(f"beside {HOSTILE} hostile clients, answered {dict(statuses)}", rate, found)
    yield _arrived(f"beside {IDLE} idle connections", rate, settle(beside_idle(port, seconds, requests)))
    yield _arrived(
        "beside batches without a pause", rate, settle(beside_batches(port, seconds, requests, 100_000))
    )
    with server_process(TWO_WORKERS) as (of_two, process):
        settle(closed_loop(of_two, 8, 1.0, requests))
        before = megabytes(process)
        found, statuses = asyncio.run(beside_hostile(of_two, seconds, requests))
        memory = f"{before:.0f} MB before, {megabytes(process):.0f} MB after"
        yield _arrived(
            f"two workers, the same hostile clients, {memory}, answered {dict(statuses)}", rate, found
        )


def _arrived(what: str, rate: float, found: Measured) -> Arrivals:
    others = {status: count for status, count in found.statuses.items() if status != 200}
    return Arrivals(
        what, rate, found.rate, found.milliseconds(50), found.milliseconds(99), str(others or "none")
    )


def _loop_section(loops: Sequence[ClosedLoop]) -> Section:
    best = max(loops, key=lambda one: one.prices_a_second)
    text = f"""At most {best.prices_a_second:,.0f} prices a second, with {best.clients} clients, which is
        {best.of_the_no_op_rate:.2f} of the rate of the same server with a constant answer; a price adds
        {loops[0].added_to_the_no_op_ms:.2f} ms to one client's wait. Clients and server share the machine: a server
        in the same language that does not read the request answers {best.constant_a_second:,.0f} a second."""
    return Section(
        "Clients that ask again when they have their answer", text, (table("closed-loops", loops),)
    )


def _arrival_section(found: Sequence[Arrivals]) -> Section:
    half = found[0]
    text = f"""At half of its largest rate 99 of 100 answers are there {half.p99_ms:.2g} ms after they were due, the
        median after {half.median_ms:.2g} ms."""
    return Section("Arrivals at a fixed rate", text, (table("arrivals", found),))


def _hostile_section(found: Sequence[Arrivals]) -> Section:
    alone, worst = found[0], max(found[1:], key=lambda one: one.median_ms)
    text = f"""A client that asks 20 times a second waits {alone.median_ms:.2g} ms in the median;
        {worst.median_ms:.2g} ms in the worst company: {worst.what}. The hostile ones ask for implied volatilities
        with 600 dividends at the tolerance 1e-8 without a pause."""
    return Section("One client beside others of its address", text, (table("hostile", found),))


def settle(awaited: Coroutine[Any, Any, Measured]) -> Measured:
    """Run one measurement."""
    return asyncio.run(awaited)
