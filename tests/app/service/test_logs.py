import json
import logging
import warnings
from collections.abc import Iterator

import numpy as np
import pytest

from app.service.logs import configure_logging


@pytest.fixture(autouse=True)
def _logging_as_before() -> Iterator[None]:
    root = logging.getLogger()
    before = root.handlers[:], root.level
    yield
    logging.captureWarnings(False)
    root.handlers[:] = before[0]
    root.setLevel(before[1])


def test_a_warning_is_a_json_line_like_any_other(capfd: pytest.CaptureFixture[str]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        configure_logging("INFO")
        np.exp(np.float64(1e4))
    logging.getLogger().handlers[0].flush()
    (line,) = [json.loads(line) for line in capfd.readouterr().err.splitlines()]
    assert (line["logger"], line["level"]) == ("py.warnings", "WARNING")
    assert "overflow encountered in exp" in line["message"]
