"""The metrics for Prometheus: one registry per process, or files that several processes share."""

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from prometheus_client import (
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    ProcessCollector,
    generate_latest,
    multiprocess,
    values,
)

from app.service.request_record import RequestRecord
from pricing_core import __version__, kernel_name

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
FOLDER = "PROMETHEUS_MULTIPROC_DIR"  # where prometheus_client looks for it
MEMORY = Path("/dev/shm")  # a folder in memory, which is there where everything else is read-only
SECONDS = (5e-4, 1e-3, 2e-3, 5e-3, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0)
NO_ROUTE = "none"  # of a request that no route takes
LEAST_SECONDS = 0.1  # for which one rendering is told to everybody who asks; chosen


@contextmanager
def shared_folder() -> Iterator[None]:
    """Let processes that are forked inside the block share their metrics."""
    in_memory = MEMORY if os.access(MEMORY, os.W_OK) else None
    folder = tempfile.mkdtemp(prefix="pricing-metrics-", dir=in_memory)
    os.environ[FOLDER] = folder
    try:
        yield
    finally:
        remove_folder()
        del os.environ[FOLDER]


def remove_folder() -> None:
    """Remove the folder of the shared metrics; what is open there stays open."""
    shutil.rmtree(os.environ[FOLDER], ignore_errors=True)


def share_as(number: int) -> None:
    """Keep this process's metrics in files under a number; the next process with that number continues them."""
    values.ValueClass = values.MultiProcessValue(lambda: number)  # type: ignore[no-untyped-call]


def forget_process(number: int) -> None:
    """Remove the gauges of a process that has died."""
    multiprocess.mark_process_dead(number)  # type: ignore[no-untyped-call]


class Metrics:
    """The metrics of an application; only the event loop's thread may call the methods."""

    def __init__(self) -> None:
        registry = CollectorRegistry()
        self._registry = registry
        self._rendered, self._until = b"", 0.0
        self._seconds = Histogram(
            "pricing_request_seconds",
            "Seconds from a request's head to its answer's end",
            ["route"],
            buckets=SECONDS,
            registry=registry,
        )
        self._requests = Counter(
            "pricing_requests", "Requests answered", ["route", "status"], registry=registry
        )
        self._waited = Histogram(
            "pricing_queue_seconds",
            "Seconds that an expensive question waited for a thread",
            buckets=SECONDS,
            registry=registry,
        )
        self._refused = Counter(
            "pricing_refusals", "Requests answered with a problem, by its type", ["reason"], registry=registry
        )
        self._contracts = Counter(
            "pricing_contracts", "Contracts answered, by status", ["route", "status"], registry=registry
        )
        self._deadlines = Counter(
            "pricing_deadlines", "Contracts and requests that the deadline ended", registry=registry
        )
        self.in_flight = self._gauge("pricing_requests_in_flight", "Requests being answered", registry)
        self.expensive = self._gauge(
            "pricing_expensive_questions", "Questions waiting for a thread or in one", registry
        )
        self.connections = self._gauge("pricing_connections", "Open connections", registry)
        self.connections_closed = Counter(
            "pricing_connections_closed", "Connections closed to make room for new ones", registry=registry
        )
        built = Gauge(
            "pricing_build",
            "1, with the version and the kernel",
            ["version", "kernel"],
            multiprocess_mode="max",
            registry=registry,
        )
        built.labels(__version__, kernel_name()).set(1.0)
        if FOLDER not in os.environ:
            ProcessCollector(registry=registry)

    @staticmethod
    def _gauge(name: str, meaning: str, registry: CollectorRegistry) -> Gauge:
        gauge = Gauge(name, meaning, multiprocess_mode="livesum", registry=registry)
        gauge.set(0.0)
        return gauge

    def request_ended(self, route: str | None, status: int, seconds: float, record: RequestRecord) -> None:
        """Count a request."""
        place = route or NO_ROUTE
        self._seconds.labels(place).observe(seconds)
        self._requests.labels(place, str(status)).inc()
        if record.waited is not None:
            self._waited.observe(record.waited)
        for outcome, count in record.contracts.items():
            self._contracts.labels(place, outcome).inc(count)
        if record.problem is not None:
            self.refused(record.problem)
        if reached := max(record.contracts["deadline"], record.problem == "deadline"):
            self._deadlines.inc(reached)

    def refused(self, problem: str) -> None:
        """Count a problem, by its name."""
        self._refused.labels(problem).inc()

    def text(self) -> bytes:
        """Return all metrics, of all processes, in the text format."""
        if time.monotonic() >= self._until:
            registry = self._registry
            if FOLDER in os.environ:
                registry = CollectorRegistry()
                multiprocess.MultiProcessCollector(registry)  # type: ignore[no-untyped-call]
            self._rendered = generate_latest(registry)
            self._until = time.monotonic() + LEAST_SECONDS
        return self._rendered
