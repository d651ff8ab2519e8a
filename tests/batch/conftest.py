"""Tables of contracts, and the files that a run leaves."""

import csv
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest

HEADER = ["id", "option_type", "spot", "strike", "expiry", "rate", "volatility"]
ROW = ["a", "put", "100", "100", "1", "0.05", "0.2"]


@pytest.fixture
def write_table(tmp_path: Path) -> Callable[..., Path]:
    """Write a CSV table from lists of cells."""

    def write(rows: Iterable[list[str]], header: list[str] = HEADER, name: str = "in.csv") -> Path:
        path = tmp_path / name
        with path.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([header, *rows])
        return path

    return write


@pytest.fixture
def row() -> Callable[..., list[str]]:
    """Return a sound row with some cells changed."""

    def changed(**cells: str) -> list[str]:
        return [cells.get(name, cell) for name, cell in zip(HEADER, ROW, strict=True)]

    return changed


@pytest.fixture
def read_table() -> Callable[[Path], list[dict[str, str]]]:
    """Read a CSV table as one dict per row."""

    def read(path: Path) -> list[dict[str, str]]:
        with path.open(newline="", encoding="utf-8") as file:
            return list(csv.DictReader(file, strict=True))

    return read
