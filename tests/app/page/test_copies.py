"""What the page copies runs, and finds the number that the page shows."""

import contextlib
import io
import json
import shutil
import subprocess
import sys
from typing import Any

import pytest

from tests.app.page.page import DIVIDENDS, PUT, Page

QUESTIONS: list[dict[str, Any]] = [
    PUT,
    PUT | {"cash_dividends": DIVIDENDS, "rate": {"times": [0.5, 1], "values": [0.03, 0.05]}},
    PUT | {"exercise": "bermudan", "exercise_times": [0.25, 0.5], "greeks": "none"},
]


def copied(page: Page, kind: str) -> str:
    page.click(f'[data-copy="{kind}"]')
    page.eventually(lambda: page.at("#copied").text != "", "a word on what was copied")
    return str(page.script("return document.getElementById('snippet').textContent"))


@pytest.mark.parametrize("question", QUESTIONS)
def test_python_code_finds_the_same_price(page: Page, question: dict[str, Any]) -> None:
    page.open(question)
    code = copied(page, "python").replace("print(price(", "print(repr(price(") + ".price)"
    code = code.replace(")).price)", ").price))")
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        exec(code, {})
    assert float(output.getvalue()) == page.price()


@pytest.mark.parametrize("question", QUESTIONS)
def test_the_command_finds_the_same_price(page: Page, question: dict[str, Any]) -> None:
    page.open(question)
    command = copied(page, "cli").replace("pricing ", f"{sys.executable} -m app ", 1) + " --json"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["price"] == page.price()


@pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not on PATH")
@pytest.mark.parametrize("question", QUESTIONS)
def test_curl_is_answered_with_the_same_price(page: Page, question: dict[str, Any]) -> None:
    page.open(question)
    done = subprocess.run(["bash", "-c", copied(page, "curl")], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout)["price"] == page.price()
