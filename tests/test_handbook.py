"""The handbook of complementarity systems is complete, its examples run, and what it names is there."""

import doctest
import importlib
import re
from pathlib import Path
from typing import get_type_hints

import pytest

from tests.problems.needs_kernel import needs_kernel

ROOT = Path(__file__).parents[1]
PAGES = sorted((ROOT / "docs" / "handbook").glob("*.md"))
TEXT = "\n".join(page.read_text(encoding="utf-8") for page in PAGES if page.stem != "index")
# What the chapter numbers: J. M. Schumacher, "Between Mathematical Programming and Systems Theory: Linear
# Complementarity Systems", chapter 11.
NUMBERED = [
    *(f"(11.{k})" for k in range(1, 95)),
    *(f"Theorem 11.{k}" for k in range(1, 7)),
    *(f"Example 11.{k}" for k in range(1, 4)),
    *(f"{kind} 11.{k}" for kind in ("Definition", "Figure") for k in (1, 2)),
]


def test_every_numbered_item_has_one_row() -> None:
    assert sorted(re.findall(r"^\| (\(11\.\d+\)|\w+ 11\.\d) \|", TEXT, re.MULTILINE)) == sorted(NUMBERED)


@needs_kernel
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_examples_of_a_page_run(page: Path) -> None:
    source = page.read_text(encoding="utf-8").replace("```", "")
    test = doctest.DocTestParser().get_doctest(source, {}, page.stem, str(page), 0)
    assert test.examples or page.stem == "index"
    printed: list[str] = []
    failed, _ = doctest.DocTestRunner(verbose=False).run(test, out=printed.append)
    assert failed == 0, "".join(printed)


@pytest.mark.parametrize("name", sorted(set(re.findall(r"\{py:obj\}`~([\w.]+)`", TEXT))))
def test_every_name_is_public(name: str) -> None:
    module, _, member = name.rpartition(".")
    assert member in importlib.import_module(module).__all__


@pytest.mark.parametrize(
    ("member", "name"), sorted(set(re.findall(r"`(\w+)` of \{py:obj\}`~([\w.]+)`", TEXT)))
)
def test_every_member_is_there(member: str, name: str) -> None:
    module, _, kind = name.rpartition(".")
    of = getattr(importlib.import_module(module), kind)
    if not isinstance(of, type):  # a function stands for what it returns
        of = get_type_hints(of)["return"]
    assert hasattr(of, member) or member in get_type_hints(of)


@pytest.mark.parametrize("path", sorted(set(re.findall(r"`((?:tests|examples)/[\w./]+)`", TEXT))))
def test_every_test_and_example_is_there(path: str) -> None:
    assert (ROOT / path).exists()
