"""What concerns every test."""

import gc
import os

# Set before NumPy is imported. The matrices of the tests are small, and the threads of several processes that share the
# processors would spend most of their time waiting for each other: on a busy machine tests take five times as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import pytest
from hypothesis import settings

from pricing_core import kernel_name
from tests.problems.engine_with_errors import EngineWithErrors

# A slow machine is no fault of an example.
settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")


@pytest.fixture
def engine_with_errors(monkeypatch):
    """Let one engine answer every price that knows the errors of some Greeks and not of others."""
    monkeypatch.setattr("pricing_core.american.method.ENGINES", (EngineWithErrors(),))


def pytest_collection_finish():
    """Spare the garbage collector what stands for thirteen thousand tests: it would visit all of it each time."""
    gc.freeze()


def pytest_terminal_summary(terminalreporter):
    """Say in the summary which tests were skipped for want of a compiled kernel."""
    if kernel_name() == "rust":
        return
    skipped = [
        report for report in terminalreporter.stats.get("skipped", ()) if "compiled" in str(report.longrepr)
    ]
    terminalreporter.write_line(f"no compiled kernel: {len(skipped)} tests of the compiled engines skipped")
