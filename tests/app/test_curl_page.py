"""docs/curl.md: every line is run, and answered as it is printed."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from pricing_core import kernel_name
from tests.app.printed_answers import check_answer, lines_and_answers
from tests.app.service.server_process import Server, running

PAGE = (Path(__file__).parents[2] / "docs/curl.md").read_text(encoding="utf-8")
LINES = lines_and_answers(PAGE)

pytestmark = pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not on PATH")


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with running() as server:
        yield server


def test_every_block_is_a_line_and_its_answer() -> None:
    assert len(LINES) == PAGE.count("```sh") == 14


@pytest.mark.parametrize(("line", "printed"), LINES, ids=[str(i) for i in range(len(LINES))])
def test_every_line_is_answered_as_printed(server: Server, line: str, printed: str) -> None:
    check_answer(server, line, printed.replace('"rust"', f'"{kernel_name()}"'))
