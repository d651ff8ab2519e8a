"""What concerns every test."""

from functools import partial
from importlib import import_module

import pytest

from pricing_core import kernel_name
from pricing_core.american.engines.solve import solve_in_chunks
from tests.problems.engine_with_errors import EngineWithErrors


@pytest.fixture
def engine_with_errors(monkeypatch):
    """Let one engine answer every price that knows the errors of some Greeks and not of others."""
    engines = (EngineWithErrors(),)
    single, many = (import_module(f"pricing_core.american.{name}") for name in ("price", "price_many"))
    monkeypatch.setattr(single, "ENGINES", engines)
    monkeypatch.setattr(many, "solve_in_chunks", partial(solve_in_chunks, engines=engines))


def pytest_terminal_summary(terminalreporter):
    """Say in the summary which tests were skipped for want of a compiled kernel."""
    if kernel_name() == "rust":
        return
    skipped = [
        report for report in terminalreporter.stats.get("skipped", ()) if "compiled" in str(report.longrepr)
    ]
    terminalreporter.write_line(f"no compiled kernel: {len(skipped)} tests of the compiled engines skipped")
