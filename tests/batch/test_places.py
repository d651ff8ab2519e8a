"""Tables in folders, behind URLs and in compressed files."""

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from benchmarks.problems.portfolios import everyday
from pricing_core.batch import run_batch
from pricing_core.errors import InvalidInputError

COARSE = 1e-3
TABLE = pa.table({name: pa.array(cells) for name, cells in everyday(20).columns().items()})


def test_an_object_store_gets_whole_objects_and_no_parts_stay(tmp_path: Path) -> None:
    memory = pytest.importorskip("fsspec").filesystem("memory")
    pq.write_table(TABLE, tmp_path / "in.parquet")
    memory.pipe_file("/places/in.parquet", (tmp_path / "in.parquet").read_bytes())
    run_batch((tmp_path / "in.parquet").as_uri(), tmp_path / "out.parquet", tolerance=COARSE)
    run_batch("memory://places/in.parquet", "memory://places/out.parquet", tolerance=COARSE)
    assert memory.cat_file("/places/out.parquet") == (tmp_path / "out.parquet").read_bytes()
    assert [name for name in memory.find("/places") if ".parts" in name] == []
    again = run_batch(
        "memory://places/in.parquet", "memory://places/out.parquet", tolerance=COARSE, resume=True
    )
    assert again.done_before


def test_a_missing_object_is_named_as_it_was_asked_for(tmp_path: Path) -> None:
    pytest.importorskip("fsspec")
    with pytest.raises(FileNotFoundError) as caught:
        run_batch("memory://places/none.parquet", tmp_path / "out.parquet")
    assert caught.value.filename == "memory://places/none.parquet"


def test_a_folder_gives_a_folder_with_the_same_partitions(tmp_path: Path) -> None:
    for kind in ("put", "call"):
        (tmp_path / "in" / f"option_type={kind}").mkdir(parents=True)
        pq.write_table(
            TABLE.drop_columns("option_type"), tmp_path / "in" / f"option_type={kind}" / "book.parquet"
        )
    assert run_batch(tmp_path / "in", tmp_path / "out", tolerance=COARSE).priced == 40
    names = [path.relative_to(tmp_path / "out").as_posix() for path in (tmp_path / "out").rglob("*.parquet")]
    assert sorted(names) == ["option_type=call/book.parquet", "option_type=put/book.parquet"]
    assert (tmp_path / "out" / "_SUCCESS").exists()
    found = pq.ParquetFile(tmp_path / "out" / names[0]).read()
    assert "option_type" not in found.schema.names
    assert found["spot"].to_pylist() == TABLE["spot"].to_pylist()


def test_a_folder_of_somebody_else_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "letters.txt").write_text("dear")
    pq.write_table(TABLE, tmp_path / "in" / "book.parquet")
    with pytest.raises(InvalidInputError, match="a new folder, or one that holds what a batch has written"):
        run_batch(tmp_path / "in", tmp_path / "mine", tolerance=COARSE)
    assert (tmp_path / "mine" / "letters.txt").read_text() == "dear"


def test_a_file_of_somebody_else_in_an_output_is_not_removed(tmp_path: Path) -> None:
    (tmp_path / "in").mkdir()
    pq.write_table(TABLE, tmp_path / "in" / "book.parquet")
    run_batch(tmp_path / "in", tmp_path / "out", tolerance=COARSE)
    run_batch(tmp_path / "in", tmp_path / "out", tolerance=COARSE)
    (tmp_path / "out" / "letters.txt").write_text("dear")
    with pytest.raises(InvalidInputError, match="and nothing else"):
        run_batch(tmp_path / "in", tmp_path / "out", tolerance=COARSE)
    assert (tmp_path / "out" / "letters.txt").read_text() == "dear"
