"""A client of the application and the console entry point, in process, and the question that most tests ask."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from app.cli import main
from app.main import create_app
from app.settings import Settings


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
def client() -> Iterator[TestClient]:
    with TestClient(create_app(Settings(slots=2))) as client:
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
def simulate(pricing: Any, tmp_path: Path) -> Any:
    """Write a model file, and run it."""

    def run_model(model: object, *arguments: object) -> tuple[int, str, str]:
        path = tmp_path / "system.json"
        path.write_text(model if isinstance(model, str) else json.dumps(model), encoding="utf-8")
        status, output, errors = pricing("simulate", path, *arguments)
        return status, output, errors.replace(str(path), "system.json")

    return run_model
