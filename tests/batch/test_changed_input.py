"""Inputs that change while they are read: the run ends, and nothing is published."""

import gzip
import io
import os
import shutil
import threading
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pa_csv
import pyarrow.parquet as pq
import pytest

from app.cli import app
from benchmarks.problems.portfolios import everyday
from pricing_core.batch import Progress, parts_path, run_batch, run_explain, run_scenarios, scenarios_of
from pricing_core.batch.chunk import Chunk
from pricing_core.batch.table_files import InputTable
from pricing_core.errors import InvalidInputError
from tests.app.held_work import HeldWork
from tests.problems.eventually import PATIENCE, eventually

COARSE = 1e-3
ROWS, BLOCK_ROWS, BLOCK_BYTES = 400, 20, 1 << 18
TOLD = r"^the input changed while it was read: '{}'; nothing was written$"
KINDS = ["in.csv", "in.csv.gz", "in.csv.zst", "in.parquet"]


@pytest.fixture(scope="module")
def table() -> pa.Table:
    """A book whose file is longer than all that is read ahead: 8 MB of text that does not shrink."""
    rng = np.random.default_rng(3)
    columns: dict[str, Any] = {"id": np.arange(ROWS), **everyday(ROWS).columns()}
    notes = [rng.bytes(10_000).hex() for _ in range(ROWS)]
    return pa.table({**{name: pa.array(cells) for name, cells in columns.items()}, "note": notes})


def content_of(table: pa.Table, name: str) -> bytes:
    """Return the table as a file of the kind that the name says."""
    sink = pa.BufferOutputStream()
    if name.endswith(".parquet"):
        pq.write_table(table, sink, row_group_size=BLOCK_ROWS)
        return bytes(sink.getvalue())
    pa_csv.write_csv(table, sink)
    return compressed(bytes(sink.getvalue()), name)


def compressed(content: bytes, name: str) -> bytes:
    if name.endswith(".gz"):
        return gzip.compress(content, 1)
    return bytes(pa.compress(content, "zstd", asbytes=True)) if name.endswith(".zst") else content


def append(path: Path) -> None:
    row = b'999999,put,100,100,1,0.05,0,0.2,""\n'
    with path.open("ab") as file:
        file.write(compressed(row, path.name))


def overwrite(path: Path) -> None:
    """Change a byte of the last quarter, and leave size and time as they are."""
    found = path.stat()
    with path.open("r+b") as file:
        file.seek(found.st_size * 3 // 4)
        byte = file.read(1)
        file.seek(-1, io.SEEK_CUR)
        file.write(b"0" if byte != b"0" else b"1")
    os.utime(path, ns=(found.st_atime_ns, found.st_mtime_ns))


def truncate(path: Path) -> None:
    os.truncate(path, path.stat().st_size * 3 // 4)


def replace(path: Path) -> None:
    other = path.with_name("other")
    other.write_bytes(path.read_bytes())
    overwrite(other)
    other.replace(path)


def after_first_unit(change: Callable[[], None]) -> Callable[[Progress], None]:
    """Return a callback that changes something once, when a unit has been priced."""
    told: list[Progress] = []

    def tell(progress: Progress) -> None:
        told.append(progress)
        if len(told) == 1:
            change()

    return tell


def published(folder: Path) -> set[str]:
    """Return the names in a folder, but for a part that a thread has written after the run was given up."""
    for thread in threading.enumerate():
        if thread.name.startswith("pricing"):
            thread.join()
    for parts in folder.glob("*.parts"):
        assert not (parts / "manifest.json").exists()
        shutil.rmtree(parts)
    return {path.name for path in folder.iterdir()}


def block_size(name: str) -> int:
    return BLOCK_BYTES if ".csv" in name else BLOCK_ROWS


@pytest.mark.parametrize("change", [append, overwrite, truncate, replace])
@pytest.mark.parametrize("name", KINDS)
def test_a_file_that_changes_ends_the_run_and_the_output_stays_as_it_was(
    tmp_path: Path, table: pa.Table, name: str, change: Callable[[Path], None]
) -> None:
    source, target = tmp_path / name, tmp_path / "out.csv"
    source.write_bytes(content_of(table, name))
    target.write_text("before")
    changing = after_first_unit(lambda: change(source))
    with pytest.raises(InvalidInputError, match=TOLD.format(name)):
        run_batch(source, target, tolerance=COARSE, block_size=block_size(name), threads=1, progress=changing)
    assert target.read_text() == "before"
    assert published(tmp_path) == {name, "out.csv"}
    run_batch(content_again(source, table), target, tolerance=COARSE, resume=True)
    assert target.read_text().count("\n") == ROWS + 1


def content_again(source: Path, table: pa.Table) -> Path:
    source.write_bytes(content_of(table, source.name))
    return source


@pytest.mark.parametrize("name", KINDS)
def test_what_has_been_read_before_it_changes_is_compared_at_the_end(
    tmp_path: Path, table: pa.Table, name: str
) -> None:
    source, target = tmp_path / name, tmp_path / "out.parquet"
    source.write_bytes(content_of(table.slice(0, 9), name))
    with pytest.raises(InvalidInputError, match=TOLD.format(name)):
        run_batch(source, target, tolerance=COARSE, progress=after_first_unit(lambda: overwrite(source)))
    assert published(tmp_path) == {source.name}


@pytest.mark.parametrize("name", KINDS)
def test_no_part_comes_from_bytes_that_are_put_back_before_the_end(
    tmp_path: Path, table: pa.Table, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pricing_core.batch.parquet_reader.ROWS_PER_READ", BLOCK_ROWS)
    source, target = tmp_path / name, tmp_path / "out.csv"
    sound = content_of(table, name)
    source.write_bytes(sound)
    told: list[Progress] = []

    def change_and_put_back(progress: Progress) -> None:
        told.append(progress)
        if len(told) == 1:
            overwrite(source)
        elif progress.fraction > 0.9:  # the changed byte would have been read
            source.write_bytes(sound)

    with pytest.raises(InvalidInputError, match=TOLD.format(name)):
        run_batch(
            source,
            target,
            tolerance=COARSE,
            block_size=block_size(name),
            threads=1,
            progress=change_and_put_back,
        )
    assert published(tmp_path) == {source.name}


@pytest.mark.parametrize("name", KINDS)
def test_a_file_that_is_only_touched_or_written_anew_has_not_changed(
    tmp_path: Path, table: pa.Table, name: str
) -> None:
    source, target = tmp_path / name, tmp_path / "out.csv"
    source.write_bytes(content_of(table.slice(0, 9), name))

    def touch() -> None:
        source.touch()
        other = tmp_path / "other"
        other.write_bytes(source.read_bytes())
        other.replace(source)

    assert run_batch(source, target, tolerance=COARSE, progress=after_first_unit(touch)).priced == 9


def test_a_file_that_is_removed_ends_the_run_too(tmp_path: Path, table: pa.Table) -> None:
    source, target = tmp_path / "in.csv", tmp_path / "out.csv"
    source.write_bytes(content_of(table, "in.csv"))
    with pytest.raises(FileNotFoundError) as raised:
        run_batch(source, target, tolerance=COARSE, progress=after_first_unit(source.unlink))
    assert raised.value.filename == str(source)
    assert not target.exists()


def add(folder: Path) -> None:
    (folder / "c.parquet").write_bytes((folder / "a.parquet").read_bytes())


def replace_last(folder: Path) -> None:
    replace(folder / "b.parquet")


def replace_first(folder: Path) -> None:
    replace(folder / "a.parquet")


@pytest.mark.parametrize(
    ("change", "named"), [(add, "c.parquet"), (replace_first, "a.parquet"), (replace_last, "b.parquet")]
)
def test_a_folder_whose_files_change_gives_no_folder(
    tmp_path: Path, table: pa.Table, change: Callable[[Path], None], named: str
) -> None:
    source, target = tmp_path / "in", tmp_path / "out"
    source.mkdir()
    for name in ("a.parquet", "b.parquet"):
        pq.write_table(table.slice(0, 9), source / name)
    with pytest.raises(InvalidInputError, match=TOLD.format(named)):
        run_batch(source, target, tolerance=COARSE, progress=after_first_unit(lambda: change(source)))
    assert published(tmp_path) == {source.name}


def test_a_file_that_is_removed_from_a_folder_is_named(tmp_path: Path, table: pa.Table) -> None:
    source, target = tmp_path / "in", tmp_path / "out"
    source.mkdir()
    for name in ("a.parquet", "b.parquet"):
        pq.write_table(table.slice(0, 9), source / name)

    def remove_the_first(progress: Progress) -> None:
        if progress.unit == 1:  # all has been read
            (source / "a.parquet").unlink()

    with pytest.raises(InvalidInputError, match=TOLD.format("a.parquet")):
        run_batch(source, target, tolerance=COARSE, progress=remove_the_first)
    assert not target.exists()


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("rows", [ROWS, 9])
def test_an_object_that_is_replaced_ends_the_run(table: pa.Table, name: str, rows: int) -> None:
    memory = pytest.importorskip("fsspec").filesystem("memory")
    table = table.slice(0, rows)
    place, target = f"/changed-{rows}/{name}", f"/changed-{rows}/{name}.out.csv"
    memory.pipe_file(place, content_of(table, name))
    other = content_of(table.set_column(2, "spot", pa.array(np.full(rows, 90.0))), name)
    changing = after_first_unit(lambda: memory.pipe_file(place, other))
    with pytest.raises(InvalidInputError, match=TOLD.format(name)):
        run_batch(
            f"memory:/{place}",
            f"memory:/{target}",
            tolerance=COARSE,
            block_size=block_size(name),
            progress=changing,
        )
    assert not memory.exists(target)


def test_a_run_that_is_resumed_after_a_change_begins_afresh_or_is_refused(
    tmp_path: Path, table: pa.Table
) -> None:
    source, target = tmp_path / "in.csv", tmp_path / "out.csv"
    source.write_bytes(content_of(table, "in.csv"))

    def stop() -> None:
        raise KeyboardInterrupt

    options: dict[str, Any] = {"tolerance": COARSE, "block_size": BLOCK_BYTES, "threads": 1}
    with pytest.raises(KeyboardInterrupt):
        run_batch(source, target, **options, progress=after_first_unit(stop))
    append(source)
    with pytest.raises(InvalidInputError, match="the input has changed"):
        run_batch(source, target, **options, resume=True)
    assert list(Path(parts_path(target)).glob("*.arrow"))
    content_again(source, table)
    changing = after_first_unit(lambda: append(source))
    with pytest.raises(InvalidInputError, match=TOLD.format("in.csv")):
        run_batch(source, target, **options, resume=True, progress=changing)
    assert published(tmp_path) == {source.name}
    assert run_batch(source, target, **options, resume=True).rows == ROWS + 1


@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning")
def test_a_cluster_is_given_no_rows_of_a_changed_file(
    tmp_path: Path, table: pa.Table, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed")
    monkeypatch.setattr("pricing_core.batch.cluster.SECONDS_TO_CONNECT", PATIENCE)
    source, target = tmp_path / "in.csv", tmp_path / "out.csv"
    source.write_bytes(content_of(table, "in.csv"))
    changing = after_first_unit(lambda: overwrite(source))
    with pytest.raises(InvalidInputError, match=TOLD.format("in.csv")):
        run_batch(
            source,
            target,
            tolerance=COARSE,
            block_size=BLOCK_BYTES,
            engine="dask",
            threads=1,
            progress=changing,
        )
    assert published(tmp_path) == {source.name}


@pytest.fixture
def changing_chunks(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], None]:
    """Let a file change once the first rows of any table have been read."""
    chunks, changed = InputTable.chunks, list[Path]()

    def arrange(path: Path) -> None:
        def changing(found: InputTable) -> Iterator[Chunk]:
            for chunk in chunks(found):
                yield chunk
                if not changed:
                    overwrite(path)
                    changed.append(path)

        monkeypatch.setattr(InputTable, "chunks", changing)

    return arrange


@pytest.mark.parametrize("rows", [ROWS, 9])
@pytest.mark.parametrize("name", KINDS)
def test_scenarios_of_a_file_that_changes_are_not_written(
    tmp_path: Path, table: pa.Table, name: str, rows: int, changing_chunks: Callable[[Path], None]
) -> None:
    source, target = tmp_path / name, tmp_path / "out.csv"
    source.write_bytes(content_of(table.slice(0, rows), name))
    changing_chunks(source)
    with pytest.raises(InvalidInputError, match=TOLD.format(name)):
        run_scenarios(source, target, scenarios_of([0.0]), tolerance=COARSE)
    assert published(tmp_path) == {source.name}


@pytest.mark.parametrize("changed", ["before.csv", "after.parquet"])
def test_an_explanation_of_a_file_that_changes_is_not_written(
    tmp_path: Path, table: pa.Table, changed: str, changing_chunks: Callable[[Path], None]
) -> None:
    places = [tmp_path / name for name in ("before.csv", "after.parquet")]
    for place in places:
        place.write_bytes(content_of(table.slice(0, 9), place.name))
    changing_chunks(tmp_path / changed)
    with pytest.raises(InvalidInputError, match=TOLD.format(changed)):
        run_explain(*places, tmp_path / "out.csv", tolerance=COARSE)
    assert not (tmp_path / "out.csv").exists()


def test_the_command_says_so_in_one_line_with_status_2(tmp_path: Path, table: pa.Table) -> None:
    source, target = tmp_path / "in.csv", tmp_path / "out.csv"
    source.write_bytes(content_of(table, "in.csv"))
    held = HeldWork(tmp_path / "held", first_unit=0)
    with held, held.started("batch", source, target, "--tolerance", "1e-3") as process:
        assert eventually(lambda: held.begun > 0)
        append(source)
        held.release()
        output, errors = process.communicate(timeout=PATIENCE)
    assert (process.returncode, output) == (2, "")
    assert errors == "pricing: the input changed while it was read: 'in.csv'; nothing was written\n"
    assert not target.exists()


def test_a_table_from_standard_input_is_a_copy_that_nobody_changes(
    tmp_path: Path, table: pa.Table, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, target = tmp_path / "in.csv", tmp_path / "out.csv"
    source.write_bytes(content_of(table, "in.csv"))
    first = after_first_unit(lambda: append(source))
    monkeypatch.setattr("app.commands.batch_command._progress", lambda **_: nullcontext(first))
    with source.open() as file:
        monkeypatch.setattr("sys.stdin", file)
        words = ["batch", "-", str(target), "--input-format", "csv", "--tolerance", "1e-3", "--quiet"]
        assert app(words, standalone_mode=False) == 0
    assert target.read_text().count("\n") == ROWS + 1
