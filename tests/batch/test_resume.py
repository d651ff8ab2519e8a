"""Runs that are killed, and what the next run makes of what they leave."""

import json
import subprocess
import sys
import threading
from pathlib import Path
from unittest.mock import patch

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from benchmarks.problems.portfolios import everyday
from pricing_core.batch import Progress, parts_path, run_batch
from pricing_core.batch.local_threads import LocalThreads
from pricing_core.batch.work_folder import LocalFolder
from pricing_core.errors import DiscardedPartsWarning, InvalidInputError

COARSE = 1e-3
ROWS, BLOCK = 6_000, 300
# Imports once, then lets children run the batch. The first tells how many functions in C it calls, and each of the
# others is killed at a random one of so many calls.
KILLER = """
import contextlib, itertools, os, random, signal, sys, threading
from pathlib import Path
from unittest.mock import patch
with contextlib.suppress(ImportError):
    import pandas  # which pyarrow would import in each child, at its first conversion
from pricing_core.batch import run_batch
from pricing_core.batch.runner import manifest_path
source, target, seed, block = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
random.seed(seed)
kept, most, (reads, writes) = [], None, os.pipe()
for _ in range(21):
    last = None if most is None else random.randrange(most)
    child = os.fork()
    if child == 0:
        calls = itertools.count()
        def called(frame, event, argument):
            if event == "c_call" and next(calls) == last:
                os.kill(os.getpid(), signal.SIGKILL)
        threading.setprofile(called)
        sys.setprofile(called)
        run_batch(source, target, tolerance=1e-3, resume=True, block_size=block, threads=2)
        sys.setprofile(None)
        os.write(writes, b"%d\\n" % next(calls))
        os._exit(0)
    os.waitpid(child, 0)
    most = most or int(os.read(reads, 99))
    parts = Path(target + ".parts")
    kept.append(len(list(parts.glob("*.arrow"))) if parts.exists() else -1)
    if not os.path.exists(manifest_path(target)):
        continue
    for path in Path(target).parent.glob(Path(target).name + "*"):  # complete: begin anew
        path.unlink() if path.is_file() else None
print(kept)
"""


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "in.parquet"
    pq.write_table(
        pa.table({name: pa.array(cells) for name, cells in everyday(ROWS).columns().items()}), path
    )
    return path


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_run_killed_twenty_times_and_resumed_gives_the_table_of_an_undisturbed_one(
    source: Path, tmp_path: Path, ending: str
) -> None:
    undisturbed, target = tmp_path / f"whole.{ending}", tmp_path / f"killed.{ending}"
    run_batch(source, undisturbed, tolerance=COARSE, block_size=BLOCK)
    command = [sys.executable, "-W", "ignore", "-c", KILLER, str(source), str(target), "7", str(BLOCK)]
    found = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True)
    kept = json.loads(found.stdout)
    print(kept)
    assert max(kept) > 0  # some were killed at work
    run_batch(source, target, tolerance=COARSE, block_size=BLOCK, resume=True)
    assert target.read_bytes() == undisturbed.read_bytes()
    left = {path.name for path in tmp_path.glob(f"{target.name}*")}
    assert left == {target.name, f"{target.name}.rejects.csv", f"{target.name}.manifest.json"}


def test_what_differs_from_the_run_before_is_said_and_its_parts_stay(source: Path, tmp_path: Path) -> None:
    target = tmp_path / "out.csv"

    def stop(_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as raised:
        run_batch(source, target, tolerance=COARSE, block_size=BLOCK, progress=stop)
    assert "--resume" in raised.value.__notes__[0]
    told_so = (
        r"begun in .*\.parts, but tolerance was 0\.001 and is 0\.01: state those again .* leave out --resume"
    )
    with pytest.raises(InvalidInputError, match=told_so):
        run_batch(source, target, tolerance=1e-2, block_size=BLOCK, resume=True)
    assert list(Path(parts_path(target)).glob("*.arrow"))
    told: list[object] = []
    run_batch(source, target, tolerance=COARSE, block_size=BLOCK, resume=True, progress=told.append)
    assert len(told) < ROWS // BLOCK
    assert run_batch(source, target, tolerance=COARSE, block_size=BLOCK, resume=True).done_before


def test_a_run_that_begins_afresh_says_how_many_finished_parts_it_discards(
    source: Path, tmp_path: Path
) -> None:
    target = tmp_path / "out.csv"

    def stop(_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_batch(source, target, tolerance=COARSE, block_size=BLOCK, progress=stop)
    for thread in threading.enumerate():
        if thread.name.startswith("pricing"):
            thread.join()
    kept = len(list(Path(parts_path(target)).glob("*.arrow")))
    said = rf"discarded \({kept} in .*\): --resume keeps them"
    with pytest.warns(DiscardedPartsWarning, match=said) as told:
        run_batch(source, target, tolerance=COARSE, block_size=BLOCK)
    assert told[0].filename == __file__
    run_batch(source, target, tolerance=COARSE, block_size=BLOCK)  # nothing is left, and nothing is said


def test_a_file_that_a_thread_renames_meanwhile_does_not_stop_a_run_from_clearing(tmp_path: Path) -> None:
    (tmp_path / "part.arrow.1.half").touch()
    with patch("os.unlink", side_effect=FileNotFoundError):
        LocalFolder(tmp_path).clear()


@pytest.mark.parametrize("damage", ["changed", "cut", "empty"])
def test_a_damaged_part_is_priced_again(source: Path, tmp_path: Path, damage: str) -> None:
    target = tmp_path / "out.csv"

    def stop(progress: Progress) -> None:
        if progress.unit >= 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_batch(source, target, tolerance=COARSE, block_size=BLOCK, threads=1, progress=stop)
    part = sorted(Path(parts_path(target)).glob("*.arrow"))[2]
    content = bytearray(part.read_bytes())
    content[len(content) // 2] ^= 1
    part.write_bytes({"changed": bytes(content), "cut": content[:-9], "empty": b""}[damage])
    run_batch(source, target, tolerance=COARSE, block_size=BLOCK, resume=True)
    run_batch(source, tmp_path / "whole.csv", tolerance=COARSE, block_size=BLOCK)
    assert target.read_bytes() == (tmp_path / "whole.csv").read_bytes()


def test_an_interrupted_start_of_a_resumed_run_keeps_what_is_there(source: Path, tmp_path: Path) -> None:
    target = tmp_path / "out.csv"

    def stop(_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_batch(source, target, tolerance=COARSE, block_size=BLOCK, progress=stop)
    kept = set(Path(parts_path(target)).glob("*.arrow"))
    with (
        patch.object(LocalThreads, "price", side_effect=KeyboardInterrupt),
        pytest.raises(KeyboardInterrupt) as raised,
    ):
        run_batch(source, target, tolerance=COARSE, block_size=BLOCK, resume=True)
    assert "--resume" in raised.value.__notes__[0]
    assert kept <= set(Path(parts_path(target)).glob("*.arrow"))


@pytest.mark.parametrize("name", ["out.csv.manifest.json", "out.csv.parts", "out.csv.parts/rejects.csv"])
def test_rejects_where_the_run_keeps_its_work_are_refused(source: Path, tmp_path: Path, name: str) -> None:
    with pytest.raises(InvalidInputError, match=r"rejects = .*a file beside what the run keeps"):
        run_batch(source, tmp_path / "out.csv", rejects=tmp_path / name, tolerance=COARSE)
