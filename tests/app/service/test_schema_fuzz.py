"""Questions made from the OpenAPI description at random, to a real server: every answer is one that it describes."""

from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings

from tests.app.service.server_process import (
    Server,
    running,
)
from tests.app.service.test_openapi import CHAIN, ROUTES
from tests.problems.eventually import PATIENCE
from tests.problems.needs_kernel import needs_kernel

schemathesis = pytest.importorskip("schemathesis")
pytestmark = needs_kernel
# What the description cannot say is left out: which sound fields do not go together (positive_data_acceptance), and
# that a question may take too long (not_a_server_error counts 503 as an error).
CHECKS = (
    "status_code_conformance",
    "content_type_conformance",
    "response_headers_conformance",
    "response_schema_conformance",
    "negative_data_rejection",
    "unsupported_method",
)


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    with running(PRICING_DEADLINE_SECONDS="0.5", PRICING_BATCH_DEADLINE_SECONDS="0.5") as server:
        yield server


@pytest.fixture(scope="module")
def description(server: Server) -> Any:
    return schemathesis.openapi.from_url(f"http://127.0.0.1:{server.port}/openapi.json")


@pytest.mark.parametrize("mode", ["POSITIVE", "NEGATIVE"])
@pytest.mark.parametrize("path", [*ROUTES, CHAIN])
def test_every_answer_is_one_that_is_described(description: Any, path: str, mode: str) -> None:
    questions = description[path]["POST"].as_strategy(
        generation_mode=getattr(schemathesis.GenerationMode, mode)
    )

    @settings(max_examples=30, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
    @given(questions)
    def ask(case: Any) -> None:
        answer = case.call(timeout=PATIENCE)
        statuses.add(answer.status_code)
        assert answer.status_code != 500
        case.validate_response(answer, checks=schemathesis.checks.CHECKS.get_by_names(sorted(checks)))

    checks = set(CHECKS)
    if path in ("/v1/batch", CHAIN):  # a bad row has its status, and a batch without rows has no bad one
        checks.remove("negative_data_rejection")
    statuses: set[int] = set()
    ask()
    assert path != "/v1/price" or (200 in statuses) == (mode == "POSITIVE")
