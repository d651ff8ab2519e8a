from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from app.service.connection_ledger import ConnectionLedger
from app.service.errors import ClientLimitError, OverloadedError, ServiceError
from app.settings import Settings


@dataclass(eq=False)
class Connection:
    address: str
    opened: float
    reasons: list[ServiceError] = field(default_factory=list)

    @property
    def rank(self) -> tuple[bool, bool, float]:
        return True, False, self.opened

    def make_room(self, reason: ServiceError) -> None:
        self.reasons.append(reason)


@pytest.mark.parametrize(
    ("limits", "expected"),
    [
        ({"client_connections": 5, "max_connections": 1000}, ClientLimitError),
        ({"client_connections": 1000, "max_connections": 20}, OverloadedError),
    ],
)
def test_who_is_closed_for_another_is_told_whose_limit_it_was(
    limits: dict[str, int], expected: type[ServiceError]
) -> None:
    rng = np.random.default_rng(67)
    ledger = ConnectionLedger(Settings.model_validate(limits))
    addresses = [f"192.0.2.{number}" for number in rng.integers(1, 9, 400)]
    connections = [Connection(address, number) for number, address in enumerate(addresses)]
    for connection in connections:
        ledger.enter(connection)
    reasons = [reason for connection in connections for reason in connection.reasons]
    left = [connection for connection in connections if not connection.reasons]
    most = 20 if expected is OverloadedError else 5 * len(set(addresses))
    assert {type(reason) for reason in reasons} == {expected}
    assert (len(left), len(reasons)) == (most, len(connections) - most)


def test_the_log_has_one_line_a_second_that_counts_the_closed_ones(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    now = 0.0
    monkeypatch.setattr("app.service.connection_ledger.time", SimpleNamespace(monotonic=lambda: now))
    ledger = ConnectionLedger(Settings(max_connections=10))
    for number in range(100):
        now = number / 40.0
        ledger.enter(Connection("192.0.2.1", number))
    counts = [record.fields["closed"] for record in caplog.records]  # type: ignore[attr-defined]
    assert counts == [1, 40, 40]
