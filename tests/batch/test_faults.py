"""Disks that are full, files that are traps, runs that meet or are interrupted: one clear message, and nothing lost."""

import os
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from benchmarks.problems.portfolios import everyday
from pricing_core.batch import parts_path, run_batch
from pricing_core.errors import InvalidInputError
from tests.app.held_work import HeldWork
from tests.problems.eventually import PATIENCE, eventually

COARSE = 1e-3
# Runs a batch in a process whose memory, or whose files, have a limit, and prints its peak memory in MiB.
LIMITED = """
import resource, sys
from pricing_core.batch import run_batch
kind, limit, source, target = sys.argv[1], int(sys.argv[2]), sys.argv[3], sys.argv[4]
number = getattr(resource, kind)
resource.setrlimit(number, (limit, resource.getrlimit(number)[1]))
try:
    run_batch(source, target, tolerance=1e-3, resume=True, block_size=500)
except (OSError, ValueError) as error:
    print(type(error).__name__, error)
(peak,) = [line.split()[1] for line in open("/proc/self/status") if line.startswith("VmHWM")]
print(int(peak) >> 10)
"""


def limited(kind: str, limit: int, source: Path, target: Path) -> list[str]:
    command = [sys.executable, "-W", "ignore", "-c", LIMITED, kind, str(limit), str(source), str(target)]
    return subprocess.run(
        command, capture_output=True, text=True, timeout=120, check=True
    ).stdout.splitlines()


def book(path: Path, rows: int) -> Path:
    pq.write_table(
        pa.table({name: pa.array(cells) for name, cells in everyday(rows).columns().items()}), path
    )
    return path


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_file_that_cannot_grow_leaves_no_output_and_what_resumes(tmp_path: Path, ending: str) -> None:
    source, target = book(tmp_path / "in.parquet", 6_000), tmp_path / f"out.{ending}"
    told = limited("RLIMIT_FSIZE", 400_000, source, target)  # a part fits, the output does not
    assert told[0] == f"OSError [Errno 27] File too large: '{parts_path(target)}'"
    assert not target.exists()
    assert len(list(Path(parts_path(target)).glob("*.arrow"))) > 0
    run_batch(source, target, tolerance=COARSE, block_size=500, resume=True)
    run_batch(source, tmp_path / f"whole.{ending}", tolerance=COARSE, block_size=500)
    assert target.read_bytes() == (tmp_path / f"whole.{ending}").read_bytes()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="this system has no /dev/full")
def test_a_full_device_is_said(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="No space left on device: '/dev/full"):
        run_batch(book(tmp_path / "in.parquet", 100), "/dev/full", output_format="csv", tolerance=COARSE,
                  rejects=tmp_path / "rejects.csv")  # fmt: skip


def test_a_second_run_on_one_output_is_refused_and_the_first_goes_on(tmp_path: Path) -> None:
    source, target = book(tmp_path / "in.parquet", 3_000), tmp_path / "out.csv"
    refused = []

    def meanwhile(_: object) -> None:
        with pytest.raises(InvalidInputError, match="no other run is writing to") as raised:
            run_batch(source, target, tolerance=COARSE)
        refused.append(raised.value.field)

    assert run_batch(source, target, tolerance=COARSE, progress=meanwhile).priced == 3_000
    assert set(refused) == {"output"}
    assert target.exists()


def terms(rows: int) -> dict[str, pa.Array]:
    numbers = {"spot": 100.0, "strike": 100.0, "expiry": 1.0, "rate": 0.05, "volatility": 0.2}
    columns = {name: pa.array(np.full(rows, value)) for name, value in numbers.items()}
    return {"option_type": pa.array(["put"] * rows), **columns}


def long_text(rows: int) -> pa.Array:
    """Return a text of a mebibyte in every row, which a file holds once."""
    return pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int32)), pa.array(["x" * (1 << 20)]))


@pytest.mark.parametrize("kind", ["text", "text in lists", "numbers in lists", "compressed"])
def test_a_file_that_would_fill_the_memory_is_refused_before_it_does(tmp_path: Path, kind: str) -> None:
    rows = 20_000
    column = long_text(rows)
    if kind == "text in lists":
        column = pa.ListArray.from_arrays(pa.array(np.arange(rows + 1, dtype=np.int32)), column)
    elif kind == "numbers in lists":
        values = pa.array(np.zeros(70_000_000, np.int8))
        column = pa.ListArray.from_arrays(pa.array([0] * rows + [70_000_000], pa.int32()), values)
    elif kind == "compressed":
        column = pa.array([b"\0" * (1 << 15)] * rows)
    path = tmp_path / "trap.parquet"
    table = pa.table({**terms(rows), "note": column})
    plain = kind == "compressed"
    pq.write_table(
        table, path, store_schema=False, use_dictionary=not plain, compression="zstd", row_group_size=rows
    )
    del table, column
    assert path.stat().st_size < 4 << 20
    told = limited("RLIMIT_AS", 4 << 30, path, tmp_path / "out.parquet")
    assert told[0].startswith("InvalidInputError input = 'trap.parquet': must be a table ")
    assert int(told[-1]) < 700  # MiB
    assert not (tmp_path / "out.parquet").exists()


def test_an_interrupted_command_prints_the_line_that_resumes(tmp_path: Path) -> None:
    held, units = HeldWork(tmp_path / "held", first_unit=3), 16  # which a table of so many rows is cut into
    source, target = book(tmp_path / "in.parquet", 20_000), tmp_path / "out.csv"
    arguments = ["batch", str(source), str(target), "--tolerance", "1e-5"]
    parts = Path(parts_path(target))
    with held.started(*arguments) as process:
        assert eventually(lambda: held.begun > 0 and bool(list(parts.glob("*.arrow"))))
        process.send_signal(signal.SIGINT)
        output, told = process.communicate(timeout=PATIENCE)
    assert (process.returncode, output) == (130, "")
    assert told == f"pricing: interrupted; go on with: {shlex.join(['pricing', *arguments, '--resume'])}\n"
    kept = len(list(parts.glob("*.arrow")))
    assert kept > 0
    assert not target.exists()
    again = shlex.split(told.split("go on with: pricing ")[1])
    log = subprocess.run(
        [sys.executable, "-m", "app", *again, "--log-json"],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    ).stderr.splitlines()
    assert len(log) - 1 <= units - kept  # the units that were left
    run_batch(source, tmp_path / "whole.csv", tolerance=1e-5)
    assert target.read_bytes() == (tmp_path / "whole.csv").read_bytes()


def test_no_price_is_beyond_the_bounds_of_no_arbitrage(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    rows = 100
    columns = {
        "option_type": rng.choice(["put", "call"], rows),
        "spot": 100.0 * 10.0 ** rng.choice([0.0, 0.0, -12.0, 6.0], rows),
        "strike": np.full(rows, 100.0),
        "expiry": rng.choice([1e-9, 1e-3, 1.0, 30.0, 200.0], rows),
        "rate": rng.choice([-0.5, -0.01, 0.0, 0.05, 2.0], rows),
        "dividend_yield": rng.choice([-0.5, -0.02, 0.0, 0.04, 2.0], rows),
        "volatility": rng.choice([1e-12, 1e-3, 0.2, 3.0, 15.0], rows),
    }
    pq.write_table(pa.table(columns), tmp_path / "in.parquet")
    run_batch(tmp_path / "in.parquet", tmp_path / "out.parquet", tolerance=1e-3)
    found = pq.read_table(tmp_path / "out.parquet")
    price, error = (found[name].to_numpy() for name in ("price", "error_estimate"))
    known = ~np.isnan(price)
    assert known.sum() > 75
    put = columns["option_type"] == "put"
    least = np.maximum(np.where(put, 100.0 - columns["spot"], columns["spot"] - 100.0), 0.0)
    growth = columns["expiry"] * np.where(put, -columns["rate"], -columns["dividend_yield"])
    most = np.where(put, 100.0, columns["spot"]) * np.exp(np.maximum(growth, 0.0))
    slack = 1e-12 * most
    assert np.all((price >= least - slack)[known])
    assert np.all((price <= most + slack)[known])
    assert np.all((error <= np.maximum(most - least, COARSE * 100.0))[known])
    unpriced = [status for status, good in zip(found["status"].to_pylist(), known, strict=True) if not good]
    assert "ok" not in unpriced
