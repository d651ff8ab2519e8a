"""A client of the application and the console entry point, in process, and the question that most tests ask."""

import json
import subprocess
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from app.cli import main
from app.main import create_app
from app.settings import Settings
from tests.app.held_work import HeldWork


@pytest.fixture
def question() -> dict[str, Any]:
    return {
        "option_type": "put",
        "spot": 100.0,
        "strike": 100.0,
        "expiry": 1.0,
        "rate": 0.05,
        "volatility": 0.2,
        "tolerance": 1e-4,
    }


@pytest.fixture
def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give up no cheap question for the processor time that it takes, which a slow machine needs more of."""
    for module in ("lanes", "cheap_lane"):
        monkeypatch.setattr(f"app.service.work.{module}.INLINE_SECONDS", 60.0)


@pytest.fixture
def waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait for work that ends late, so that the answer is its own, however short the deadline is."""
    monkeypatch.setattr("app.service.work.lanes.LATE_SHARE", 1e9)


@pytest.fixture
def held(tmp_path: Path) -> HeldWork:
    """Work that a test holds, in a server or a command that is started with it."""
    return HeldWork(tmp_path / "held")


@pytest.fixture
def client(unhurried: None) -> Iterator[TestClient]:
    settings = Settings(slots=2, deadline_seconds=3_600.0, batch_deadline_seconds=3_600.0)
    with TestClient(create_app(settings)) as client:
        yield client


@pytest.fixture
def pricing(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Any:
    """Run the console entry point; return status, standard output, standard error."""

    def run_here(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["pricing", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        output = capsys.readouterr()
        return int(ended.value.code or 0), output.out, output.err

    return run_here


@pytest.fixture
def completed(pricing: Any) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Run the console entry point in this process, and return what a process of its own would end with."""

    def run_here(*arguments: object) -> subprocess.CompletedProcess[str]:
        with warnings.catch_warnings():
            warnings.simplefilter("default", UserWarning)  # as outside of the tests, where they are no errors
            status, output, errors = pricing(*arguments)
        return subprocess.CompletedProcess(["pricing", *map(str, arguments)], status, output, errors)

    return run_here


@pytest.fixture
def simulate(pricing: Any, tmp_path: Path) -> Any:
    """Write a model file, and run it."""

    def run_model(model: object, *arguments: object) -> tuple[int, str, str]:
        path = tmp_path / "system.json"
        path.write_text(model if isinstance(model, str) else json.dumps(model), encoding="utf-8")
        status, output, errors = pricing("simulate", path, *arguments)
        return status, output, errors.replace(str(path), "system.json")

    return run_model
