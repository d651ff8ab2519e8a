"""docs/curl.md: every line is run, and answered as it is printed."""

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path

import pytest

from pricing_core import kernel_name
from tests.app.service.server_process import Server, running

PAGE = (Path(__file__).parents[2] / "docs/curl.md").read_text(encoding="utf-8")
LINES = re.findall(r"```sh\n(.*?)```\n```json\n(.*?)```", PAGE, re.DOTALL)

pytestmark = pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not on PATH")


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with running(PRICING_DEADLINE_SECONDS="120") as server:
        yield server


def pattern(printed: str) -> list[str]:
    """Return the parts of a printed answer, as expressions: cut numbers go on, and keys left out may be anything."""
    body = printed.strip()[1:-1]
    parts = [part for part in re.split(r", (?=\")", body.replace(", ...", "")) if part]
    return [re.escape(part).replace(r"\.\.\.", r"[\d.e-]*").replace(r"\ ", " ") for part in parts]


def test_every_block_is_a_line_and_its_answer() -> None:
    assert len(LINES) == PAGE.count("```sh") == 14


@pytest.mark.parametrize(("line", "printed"), LINES, ids=[str(i) for i in range(len(LINES))])
def test_every_line_is_answered_as_printed(server: Server, line: str, printed: str) -> None:
    command = line.replace("localhost:8000", f"127.0.0.1:{server.port}")
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True, timeout=120)
    if kernel_name() != "rust":
        printed = printed.replace('"rust"', f'"{kernel_name()}"')
    for answer, shown in zip_longest(done.stdout.splitlines(), printed.splitlines()):
        text = json.dumps(json.loads(answer))
        for part in pattern(shown):
            assert re.search(part, text), (part, text)
