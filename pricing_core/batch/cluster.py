"""Units priced by the worker processes of a Dask cluster."""

from __future__ import annotations

import logging
import platform
from collections.abc import Iterator, Mapping
from concurrent.futures import CancelledError
from contextlib import ExitStack, contextmanager, suppress
from typing import Any
from uuid import uuid4

from pricing_core.batch.unit import Counts, Unit, price_unit
from pricing_core.batch.work_folder import WorkFolder
from pricing_core.errors import ClusterError
from pricing_core.extras import needs_extra
from pricing_core.kernel import instruction_set, kernel_name
from pricing_core.version import ENGINE_VERSION

with needs_extra("cluster"):
    import distributed

SECONDS_TO_CONNECT = 10.0
UNITS_PER_THREAD = 2  # on their way to or with a worker, so that no worker waits for its next


class DaskCluster:
    """The workers of a scheduler, or processes of this machine.

    Every worker must reach the folder of the parts under the name that it has here.

    Parameters
    ----------
    scheduler : str, optional
        Address of a running scheduler, as "tcp://10.0.0.1:8786"; by default workers are started here, and end with
        the run.
    workers : int
        How many are started here, a process each.
    """

    def __init__(self, scheduler: str | None, workers: int) -> None:
        self._scheduler, self._workers = scheduler, workers

    def price(self, units: Iterator[Unit], folder: WorkFolder) -> Iterator[tuple[int, Counts]]:
        """Yield what has been priced. Units that killed their workers are named when all others have their parts.

        Raises
        ------
        ClusterError
            There is no such scheduler, it is lost, its workers are of another version or do not see the folder, or
            units have killed their workers.
        """
        killers: list[Unit] = []
        with self._client() as client, _lost_scheduler_told():
            suspects: list[Unit] = []
            yield from _priced(client, units, folder, suspects)
            for unit in suspects:  # each alone, as what a worker had beside it may have killed it
                yield from _priced(client, iter([unit]), folder, killers)
        if killers:
            named = ", ".join(f"unit {unit.index}" for unit in killers)
            raise ClusterError(f"{named}: killed each worker that priced it; the others are priced")

    @contextmanager
    def _client(self) -> Iterator[Any]:
        """Yield a client of the scheduler, or of workers that end with it."""
        with ExitStack() as stack:
            try:
                address = self._scheduler
                if address is None:
                    cluster = distributed.LocalCluster(
                        n_workers=self._workers,
                        threads_per_worker=1,
                        processes=True,
                        dashboard_address=":0",
                        silence_logs=logging.CRITICAL,
                    )
                    address = stack.enter_context(cluster)
                client = stack.enter_context(distributed.Client(address, timeout=SECONDS_TO_CONNECT))
                client.wait_for_workers(1, timeout=SECONDS_TO_CONNECT)
            except (OSError, ValueError, TimeoutError) as error:
                raise ClusterError(
                    f"no cluster with a worker at {self._scheduler or 'this machine'}: {error}"
                ) from None
            yield client


@contextmanager
def _lost_scheduler_told() -> Iterator[None]:
    try:
        yield
    except (distributed.comm.CommClosedError, CancelledError, TimeoutError) as error:
        raise ClusterError(f"the scheduler is lost: {error or type(error).__name__}") from None


def price_on_worker(unit: Unit, folder: WorkFolder, versions: Mapping[str, str]) -> tuple[int, Counts]:
    """Price a unit on a worker whose versions are those of the run.

    Raises
    ------
    ClusterError
        They are others: bits would not agree.
    """
    check_versions(versions)
    return price_unit(unit, folder)


def versions_here() -> dict[str, str]:
    """Return the versions of this process on which the last digits of a price depend."""
    return {"engine": ENGINE_VERSION, "kernel": kernel_name(), "instructions": instruction_set()}


def check_versions(wanted: Mapping[str, str]) -> None:
    """Accept the versions of another process.

    Raises
    ------
    ClusterError
        They are not those of this one.
    """
    here = versions_here()
    different = [
        f"{name} {here.get(name)} for {wanted[name]}" for name in wanted if here.get(name) != wanted[name]
    ]
    if different:
        raise ClusterError(f"a worker on {platform.node()} has {', '.join(different)}")


def _priced(
    client: Any, units: Iterator[Unit], folder: WorkFolder, killers: list[Unit]
) -> Iterator[tuple[int, Counts]]:
    """Yield what has been priced, and put aside the units whose workers were killed."""
    for unit, future in _completed(client, units, folder):
        try:
            index, counts = future.result()
        except distributed.KilledWorker:
            killers.append(unit)
            continue
        if unit.part not in folder.names():
            raise ClusterError(f"a worker has priced unit {index}, but its part is not in {folder}")
        yield index, counts


def _completed(client: Any, units: Iterator[Unit], folder: WorkFolder) -> Iterator[tuple[Unit, Any]]:
    """Yield each unit with its future, once that is done, with few more than the workers are pricing."""
    running: dict[Any, Unit] = {}
    versions = versions_here()
    try:
        for unit in units:
            future = client.submit(
                price_on_worker, unit, folder, versions, key=f"{unit.part}-{uuid4().hex}", pure=False
            )
            running[future] = unit
            while len(running) >= UNITS_PER_THREAD * _threads(client):
                yield from _done(running)
        while running:
            yield from _done(running)
    finally:
        for future in running:
            with suppress(Exception):
                future.cancel()


def _threads(client: Any) -> int:
    """Return the number of threads of all workers, at least 1."""
    try:
        threads: int = sum(client.nthreads().values())
    except OSError as error:  # there is nobody to ask
        raise distributed.comm.CommClosedError(str(error)) from None
    return max(1, threads)


def _done(running: dict[Any, Unit]) -> Iterator[tuple[Unit, Any]]:
    """Wait for the next, and yield all that are done."""
    done = distributed.wait(list(running), return_when="FIRST_COMPLETED").done
    for future in done:
        yield running.pop(future), future
