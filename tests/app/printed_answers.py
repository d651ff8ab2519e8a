"""Lines for curl and the answers printed below them, as pages of the documentation show them."""

import json
import re
import subprocess
from itertools import zip_longest
from pathlib import Path

from tests.app.service.server_process import Server

LINE_AND_ANSWER = re.compile(r"```sh\n([^`]*)```\n```json\n([^`]*)```")


def lines_and_answers(page: str) -> list[tuple[str, str]]:
    return LINE_AND_ANSWER.findall(page)


def check_answer(server: Server, line: str, printed: str, folder: Path | None = None) -> None:
    """Run a line in a folder, and compare what is answered with what is printed."""
    command = line.replace("localhost:8000", f"127.0.0.1:{server.port}")
    done = subprocess.run(
        ["bash", "-c", command], cwd=folder, capture_output=True, text=True, check=True, timeout=120
    )
    for answer, shown in zip_longest(done.stdout.splitlines(), printed.splitlines()):
        text = json.dumps(json.loads(answer))
        for part in _expressions(shown):
            assert re.search(part, text), (part, text)


def _expressions(printed: str) -> list[str]:
    """Return the parts of a printed answer, as expressions: cut numbers go on, and keys left out may be anything."""
    body = printed.strip()[1:-1]
    parts = [part for part in re.split(r", (?=\")", body.replace(", ...", "")) if part]
    return [re.escape(part).replace(r"\.\.\.", r"[\d.e-]*").replace(r"\ ", " ") for part in parts]
