"""The README's lines for curl are run against a real server, and answered as they are printed there."""

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.app.service.server_process import Server, running
from tests.problems.eventually import PATIENCE
from tests.problems.needs_kernel import needs_kernel

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
SECTION = README.split("\n## Service\n")[1].split("\n## ")[0]
NUMBER = re.compile(r'"(\w+)": (-?\d+\.(\d+))\.\.\.')
COMMAND = re.compile(r"^    (curl .*?}')\n", re.DOTALL | re.MULTILINE)
pytestmark = [needs_kernel, pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not on PATH")]


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with running() as server:
        yield server


def check_numbers(printed: str, answer: dict[str, float]) -> None:
    """Accept what is printed up to its last digit, which is cut."""
    shown = NUMBER.findall(printed)
    assert shown
    for name, number, digits in shown:
        assert abs(answer[name] - float(number)) <= 10.0 ** -len(digits)


def test_the_line_for_curl_is_answered_as_printed(server: Server) -> None:
    (command,) = COMMAND.findall(SECTION)
    command = command.replace("localhost:8000", f"127.0.0.1:{server.port}")
    done = subprocess.run(
        ["bash", "-c", command], capture_output=True, text=True, check=True, timeout=PATIENCE
    )
    check_numbers(SECTION.split("}'\n")[1].split("\n\n")[0], json.loads(done.stdout))


def test_the_other_questions_are_answered_as_printed(server: Server) -> None:
    question = json.loads(SECTION.split("-d '")[1].split("'")[0])
    priced = {name: value for name, value in question.items() if name != "volatility"}
    status, _, answer = server.request("POST", "/v1/implied-volatility", priced | {"option_price": 6.09})
    assert status == 200
    check_numbers(SECTION.split("for 6.09 answers")[1].split("`")[1], answer)


@pytest.mark.parametrize("path", sorted(set(re.findall(r"`(?:POST |GET )?(/[a-z0-9/.-]+)`", SECTION))))
def test_every_address_that_is_named_is_there(server: Server, path: str) -> None:
    method = "POST" if path.startswith("/v1/") else "GET"
    description = server.request("GET", "/openapi.json")[2]["paths"]
    assert path in ("/docs", "/openapi.json") or method.lower() in description[path]
