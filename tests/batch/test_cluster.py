"""A real scheduler, real worker processes, and what becomes of a book when they are killed."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from app.cli import app
from pricing_core.batch import Progress, run_batch
from pricing_core.batch.runner import parts_path
from pricing_core.errors import ClusterError, InvalidInputError
from tests.problems.eventually import PATIENCE, eventually

pytestmark = pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning")
ROWS, BLOCK = 4_000, 250
POISON = """
import os, signal
from pricing_core.batch import cluster
from pricing_core.batch.unit import price_unit
def poisoned(unit, folder):
    if unit.index == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return price_unit(unit, folder)
cluster.price_unit = poisoned
"""
NEVER_DONE = """
import time
from pricing_core.batch import cluster
from pricing_core.batch.unit import price_unit
def never_done(unit, folder):
    while unit.index >= 8:
        time.sleep(1.0)
    return price_unit(unit, folder)
cluster.price_unit = never_done
"""
OTHER_VERSION = """
from pricing_core.batch import cluster
cluster.ENGINE_VERSION = "0.0.1"
"""


@pytest.fixture(autouse=True)
def time_to_connect(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pricing_core.batch.cluster.SECONDS_TO_CONNECT", PATIENCE)


@pytest.fixture(scope="module")
def book(tmp_path_factory: pytest.TempPathFactory) -> Path:
    rng, path = np.random.default_rng(5), tmp_path_factory.mktemp("book") / "in.parquet"
    columns = {
        "id": np.arange(ROWS),
        "option_type": np.where(rng.random(ROWS) < 0.5, "put", "call"),
        "spot": rng.uniform(80, 120, ROWS),
        "strike": np.full(ROWS, 100.0),
        "expiry": rng.uniform(0.1, 2, ROWS),
        "rate": rng.uniform(0, 0.1, ROWS),
        "dividend_yield": rng.uniform(0, 0.1, ROWS),
        "volatility": np.where(np.arange(ROWS) % 97 == 0, -1.0, rng.uniform(0.1, 0.6, ROWS)),
    }
    pq.write_table(pa.table(columns), path)
    return path


@pytest.fixture(scope="module")
def undisturbed(book: Path) -> pa.Table:
    target = book.with_name("undisturbed.parquet")
    run_batch(book, target, block_size=BLOCK)
    return pq.read_table(target)


class Cluster:
    """A scheduler and workers as an operator starts them."""

    def __init__(self, folder: Path) -> None:
        self._folder, self.processes = folder, list[subprocess.Popen[bytes]]()
        place = folder / "scheduler.json"
        self.scheduler = self._start(
            "scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", str(place)
        )
        assert eventually(lambda: place.exists() and bool(place.read_text().strip()))
        self.address: str = json.loads(place.read_text())["address"]

    def worker(self, *options: str, preload: str = "") -> subprocess.Popen[bytes]:
        if preload:
            script = self._folder / "preload.py"
            script.write_text(preload)
            options = (*options, "--preload", str(script))
        return self._start("worker", self.address, "--nthreads", "1", "--no-dashboard", *options)

    def _start(self, *words: str) -> subprocess.Popen[bytes]:
        environment = os.environ | {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1"}
        process = subprocess.Popen(
            [sys.executable, "-m", "dask", *words],
            cwd=self._folder,
            env=environment | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
            stderr=(self._folder / "log").open("ab"),
            start_new_session=True,
        )
        self.processes.append(process)
        return process


@pytest.fixture
def there(tmp_path: Path) -> Iterator[Cluster]:
    started = Cluster(tmp_path)
    yield started
    for process in started.processes:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def after(units: int, do: Callable[[], None]) -> Callable[[Progress], None]:
    """Return a callback that does something once so many units are priced."""
    seen = []

    def told(progress: Progress) -> None:
        seen.append(progress)
        if len(seen) == units:
            do()

    return told


def test_processes_of_this_machine_give_the_bits_of_its_threads(book: Path, undisturbed: pa.Table) -> None:
    target = book.with_name("processes.parquet")
    summary = run_batch(book, target, block_size=BLOCK, engine="dask", threads=2)
    assert pq.read_table(target).equals(undisturbed)
    assert summary.rejected == len(range(0, ROWS, 97))


def test_a_killed_worker_loses_nothing_and_duplicates_nothing(
    book: Path, undisturbed: pa.Table, there: Cluster, tmp_path: Path
) -> None:
    victim, _ = there.worker("--no-nanny"), there.worker("--no-nanny")
    kill = after(3, lambda: victim.send_signal(signal.SIGKILL))
    target = tmp_path / "out.parquet"
    run_batch(book, target, block_size=BLOCK, engine="dask", scheduler=there.address, progress=kill)
    assert victim.wait() == -signal.SIGKILL
    assert pq.read_table(target).equals(undisturbed)
    assert not Path(parts_path(target)).exists()


@pytest.mark.nightly
def test_a_unit_that_kills_its_workers_is_named_when_all_others_are_priced(
    book: Path, undisturbed: pa.Table, there: Cluster, tmp_path: Path
) -> None:
    target = tmp_path / "out.parquet"
    there.worker(preload=POISON)
    with pytest.raises(ClusterError, match=r"^unit 3: killed each worker"):
        run_batch(book, target, block_size=BLOCK, engine="dask", scheduler=there.address)
    assert not target.exists()
    priced: list[int] = []
    run_batch(book, target, block_size=BLOCK, resume=True, progress=lambda told: priced.append(told.unit))
    assert priced == [3]
    assert pq.read_table(target).equals(undisturbed)


def test_a_lost_scheduler_is_told_and_the_work_goes_on_from_there(
    book: Path, undisturbed: pa.Table, there: Cluster, tmp_path: Path
) -> None:
    target = tmp_path / "out.parquet"
    there.worker(preload=NEVER_DONE)  # so that not all are done when it is lost
    kill = after(3, lambda: there.scheduler.send_signal(signal.SIGKILL))
    with pytest.raises(ClusterError, match="the scheduler is lost"):
        run_batch(book, target, block_size=BLOCK, engine="dask", scheduler=there.address, progress=kill)
    assert not target.exists()
    priced: list[int] = []
    run_batch(book, target, block_size=BLOCK, resume=True, progress=lambda told: priced.append(told.unit))
    assert ROWS // BLOCK - 8 <= len(priced) <= ROWS // BLOCK - 3
    assert pq.read_table(target).equals(undisturbed)


def test_a_worker_of_another_version_is_refused(book: Path, there: Cluster, tmp_path: Path) -> None:
    there.worker(preload=OTHER_VERSION)
    with pytest.raises(ClusterError, match=r"a worker on .* has engine 0\.0\.1 for "):
        run_batch(book, tmp_path / "out.parquet", engine="dask", scheduler=there.address)


def test_no_scheduler_and_no_engine_are_refused_in_one_sentence(book: Path, tmp_path: Path) -> None:
    target = tmp_path / "out.parquet"
    with pytest.raises(InvalidInputError, match='must be "local" or "dask"'):
        run_batch(book, target, engine="spark")
    with pytest.raises(InvalidInputError, match=r"scheduler = .*: must be left out where the engine is not"):
        run_batch(book, target, scheduler="tcp://127.0.0.1:8786")


def test_a_scheduler_that_is_not_there_is_named(
    book: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("pricing_core.batch.cluster.SECONDS_TO_CONNECT", 0.3)
    words = [
        "batch",
        str(book),
        str(tmp_path / "out.parquet"),
        "--engine",
        "dask",
        "--scheduler",
        "tcp://127.0.0.1:1",
    ]
    assert app(words, standalone_mode=False) == 2
    message = capsys.readouterr().err
    assert message.startswith("pricing: no cluster with a worker at tcp://127.0.0.1:1: ")
    assert message.count("\n") == 1
