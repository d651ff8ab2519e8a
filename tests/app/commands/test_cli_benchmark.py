"""`pricing benchmark`, with made-up benchmarks in place of those that take a while."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from app.commands import benchmark_command
from benchmarks.reporting.report import Report, Section

NAMES = (
    "engine-frontier",
    "lcs-work-precision",
    "max-plus",
    "complementarity",
    "cost-scaling",
    "batch",
    "cluster",
    "service",
    "service-attack",
)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, bool]]:
    """Put made-up benchmarks in place, and collect (name, quick) of those that are run."""
    runs: list[tuple[str, bool]] = []

    def load(module: str) -> Any:
        name = {module: name for name, module in benchmark_command.MODULES.items()}[module]

        def run(*, quick: bool) -> Report:
            runs.append((name, quick))
            return Report(name, "Made up", "Why?", (Section("Only", "one"),), {"quick": quick})

        return SimpleNamespace(run=run)

    monkeypatch.setattr(benchmark_command, "import_module", load)
    return runs


def test_without_a_name_all_benchmarks_run_and_their_reports_are_named(
    pricing: Any, asked: list[tuple[str, bool]], tmp_path: Path
) -> None:
    folder = tmp_path / "new" / "folder"
    status, output, errors = pricing("benchmark", "--quick", "--output", str(folder))
    assert (status, errors) == (0, "")
    assert asked == [(name, True) for name in NAMES]
    assert output == "".join(f"{name}: {folder}/{name}.html (0 s)\n" for name in NAMES)
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        f"{name}.{ending}" for name in NAMES for ending in ("html", "json", "md")
    )


def test_a_named_benchmark_runs_once_and_in_full(
    pricing: Any, asked: list[tuple[str, bool]], tmp_path: Path
) -> None:
    status, *_ = pricing("benchmark", "max-plus", "max-plus", "--output", str(tmp_path))
    assert (status, asked) == (0, [("max-plus", False)])


def test_an_unknown_name_ends_with_one_line_before_anything_runs(
    pricing: Any, asked: list[tuple[str, bool]], tmp_path: Path
) -> None:
    folder = tmp_path / "new"
    status, output, errors = pricing("benchmark", "max-plus", "fastest", "--output", str(folder))
    assert (status, output, asked) == (2, "", [])
    known = ", ".join(NAMES)
    assert errors == f"pricing: benchmark = 'fastest': must be one of {known}\n"
    assert not folder.exists()


@pytest.mark.parametrize("arguments", [("benchmark",), ("benchmark", "--output"), ("benchmark", "--fast")])
def test_a_misused_option_ends_with_one_line(pricing: Any, arguments: tuple[str, ...]) -> None:
    status, output, errors = pricing(*arguments)
    assert (status, output, errors.count("\n")) == (2, "", 1)


def test_a_folder_that_cannot_be_written_is_seen_before_anything_runs(
    pricing: Any, asked: list[tuple[str, bool]], tmp_path: Path
) -> None:
    occupied = tmp_path / "file"
    occupied.write_text("mine")
    for folder in (occupied, occupied / "below"):
        status, output, errors = pricing("benchmark", "--output", str(folder))
        assert (status, output, errors.count("\n"), asked) == (2, "", 1, [])
    assert occupied.read_text() == "mine"


def test_an_interrupt_keeps_the_reports_that_are_there(
    pricing: Any, asked: list[tuple[str, bool]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    load = benchmark_command.import_module

    def interrupted(*, quick: bool) -> Report:
        raise KeyboardInterrupt

    def load_one(module: str) -> Any:
        return load(module) if module.endswith("engine_frontier") else SimpleNamespace(run=interrupted)

    monkeypatch.setattr(benchmark_command, "import_module", load_one)
    status, output, errors = pricing("benchmark", "--output", str(tmp_path))
    assert status == 130
    assert output.startswith("engine-frontier: ")
    assert errors == "pricing: interrupted; the reports named so far are complete\n"
    assert not list(tmp_path.glob("*lcs-work-precision*"))


def test_the_command_is_there_without_matplotlib_or_the_benchmarks_being_imported() -> None:
    code = (
        "import sys, app.cli; "
        "sys.exit(any(name.split('.')[0] in ('matplotlib', 'benchmarks') for name in sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False, timeout=60).returncode == 0


@pytest.mark.parametrize("module", benchmark_command.MODULES.values())
def test_every_name_leads_to_a_benchmark(module: str) -> None:
    assert callable(import_module(module).run)
