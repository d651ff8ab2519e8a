"""docs/operations.md, held against the code: it names everything that is there, and nothing that is not."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from app.service.api_keys import LIMITS
from app.service.errors import HTTP_TYPES, PROBLEM_TYPES
from app.service.metrics import Metrics
from app.service.request_record import RequestRecord
from app.settings import PREFIX, Settings, settings_table
from tests.app.printed_answers import check_answer, lines_and_answers
from tests.app.service.server_process import running

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/operations.md").read_text()


def section(title: str) -> str:
    return PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0]


def named(text: str) -> list[str]:
    return re.findall(r"`([^`]+)`", text)


def first_cells(text: str) -> Iterable[str]:
    return (line.split("|")[1] for line in text.splitlines() if line.startswith("| `"))


def test_the_table_of_settings_is_that_of_the_class() -> None:
    written = PAGE.split("<!-- settings -->\n")[1].split("\n<!-- end of settings -->")[0]
    assert written == settings_table()


def test_every_setting_says_what_it_is_and_every_one_that_is_named_exists() -> None:
    assert all(field.description for field in Settings.model_fields.values())
    variables = {PREFIX + name.upper() for name in Settings.model_fields}
    assert set(re.findall(PREFIX + r"[A-Z_]*[A-Z]", PAGE)) <= variables


def test_the_limits_of_keys_are_those_that_are_read() -> None:
    assert [name.split("=")[0] for name in named("".join(first_cells(section("Keys"))))] == list(LIMITS)


@pytest.mark.skipif(shutil.which("curl") is None, reason="curl is not on PATH")
def test_the_lines_about_keys_make_one_that_is_let_in_and_what_has_none_is_not(tmp_path: Path) -> None:
    text = section("Keys")
    *making, serving = re.findall(r"```sh\n(.*?)```", text, re.DOTALL)[0].splitlines()
    variable, _, command = serving.partition(" ")
    assert command == "pricing serve --port 8000"
    programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for line in making:
        subprocess.run(["bash", "-c", line], cwd=tmp_path, env=os.environ | {"PATH": programs}, check=True)
    name, _, file = variable.partition("=")
    questions = lines_and_answers(text)
    assert len(questions) == 2
    with running(**{name: str(tmp_path / file)}) as server:
        for line, printed in questions:
            check_answer(server, line, printed, tmp_path)


def test_every_problem_is_explained_with_its_status() -> None:
    kinds = {(kind.name, kind.status) for kind in (*PROBLEM_TYPES.values(), *HTTP_TYPES.values())}
    rows = [
        line.split("|")[1:3]
        for line in section("At three in the morning").splitlines()
        if re.match(r"\| \d", line)
    ]
    assert {(name, int(status)) for status, names in rows for name in named(names)} == kinds


def test_every_metric_is_explained_and_no_other() -> None:
    metrics = Metrics()
    metrics.request_ended("/v1/price", 200, 0.1, RequestRecord("a", waited=0.1, problem="deadline"))
    families = re.findall(r"^# TYPE (pricing_\w+) (\w+)$", metrics.text().decode(), re.MULTILINE)
    real = {name for name, kind in families if not name.endswith("_created")}
    text = section("Metrics")
    assert set(named("".join(first_cells(text)))) == real
    mentioned = {name.removesuffix("_bucket") for name in re.findall(r"\bpricing_\w+", text)}
    assert mentioned <= real
    assert set(re.findall(r"`(process_\w+)`", text)) <= set(
        re.findall(r"^(process_\w+)", metrics.text().decode(), re.M)
    )


def test_every_key_of_a_request_s_line_is_explained_and_no_other(
    client: TestClient, question: dict[str, Any], caplog: pytest.LogCaptureFixture
) -> None:
    trace = {"traceparent": "00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01"}
    with caplog.at_level("INFO", logger="pricing.requests"):
        client.post("/v1/price", json=question | {"tolerance": 1e-8, "greeks": "extended"}, headers=trace)
        client.get("/nowhere")
    seen = {name for record in caplog.records if hasattr(record, "fields") for name in record.fields}
    explained = set(named("".join(first_cells(section("Log")))))
    assert explained == seen - {"path"}
    assert "`path`" in section("Log")


def test_every_file_that_is_named_exists() -> None:
    for name in named(PAGE) + re.findall(r"--file(?:name)? (\S+)", PAGE):
        if re.fullmatch(r"(deploy|docs|app|examples)/[\w./]*", name):
            assert (ROOT / name).exists(), name


def test_every_address_that_is_named_is_answered(client: TestClient) -> None:
    for name in {name.removeprefix("GET ") for name in named(PAGE)}:
        if re.fullmatch(r"/[a-z.]+", name):
            assert client.get(name).status_code == 200, name
