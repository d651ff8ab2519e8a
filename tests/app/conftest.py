"""A client of the application, in process, and the question that most tests ask."""

from collections.abc import Iterator
from typing import Any

import pytest
from fastapi.testclient import TestClient

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
    with TestClient(create_app(Settings(workers=2))) as client:
        yield client
