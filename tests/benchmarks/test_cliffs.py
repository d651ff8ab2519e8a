import pytest

from benchmarks.cliffs import BOOKS, book, contract, sweep
from benchmarks.problems.random_contracts import flat, rows_of


def test_a_sweep_has_a_line_for_each_value(capsys: pytest.CaptureFixture[str]) -> None:
    sweep("rate", (0.01, 0.02), lambda rate: contract("put", rate=rate))
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[2:]] == ["0.01", "0.02"]


def test_a_book_has_its_times_statuses_and_methods(capsys: pytest.CaptureFixture[str]) -> None:
    book("flat", rows_of(flat, 2))
    title, price, greeks, shares, slowest = capsys.readouterr().out.splitlines()[1:]
    assert title.startswith("flat, 2 contracts")
    assert price.startswith("price alone")
    assert greeks.startswith("all Greeks")
    assert shares == "  ok 100%; premium-march 100%"
    assert "spot" in slowest


def test_books_are_the_same_at_every_call() -> None:
    for kind in BOOKS.values():
        assert rows_of(kind, 2) == rows_of(kind, 2)
