from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np
import pytest

from app.service.clients import network_of
from app.service.connection_ledger import (
    LONGEST_HOLD,
    MOST_CLIENTS,
    MOST_PIECES,
    PIECES_A_SECOND,
    ConnectionLedger,
)
from app.service.errors import ClientLimitError, OverloadedError, ServiceError
from app.settings import Settings


@dataclass(eq=False)
class Connection:
    address: str
    opened: float
    reasons: list[ServiceError] = field(default_factory=list)
    held: float = 0.0

    @property
    def rank(self) -> tuple[bool, bool, float]:
        return True, False, self.opened

    def make_room(self, reason: ServiceError) -> None:
        self.reasons.append(reason)

    def hold(self, seconds: float) -> None:
        self.held += seconds


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


def test_all_connections_of_a_client_are_held_where_they_were_parsed_more_than_allowed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = 0.0
    monkeypatch.setattr("app.service.connection_ledger.time", SimpleNamespace(monotonic=lambda: now))
    ledger = ConnectionLedger(Settings(trusted_proxies="192.0.2.128/25"))
    connections = [Connection(address, 0.0) for address in ("2001:db8::1", "2001:db8::2", "2001:db8:1::1")]
    for connection in connections:
        ledger.enter(connection)
    parsed = 0
    for _ in range(10_000):
        if now >= 10.0:
            break
        ledger.charge(connections[0], 1_000)
        parsed += 1_000
        one, other, neighbour = (connection.held for connection in connections)
        assert one == other
        assert neighbour == 0.0
        now = one
    assert 9.0 * PIECES_A_SECOND < parsed <= 10.0 * PIECES_A_SECOND + 2 * MOST_PIECES


def test_a_client_that_connects_anew_has_no_new_allowance_and_a_proxy_has_no_limit() -> None:
    ledger = ConnectionLedger(Settings(trusted_proxies="192.0.2.128/25"))
    for address in ("192.0.2.1", "192.0.2.200"):
        first, second = Connection(address, 0.0), Connection(address, 1.0)
        ledger.enter(first)
        ledger.charge(first, 10 * MOST_PIECES)
        ledger.leave(first)
        ledger.enter(second)
        ledger.charge(second, 1)
        assert (first.held > 0.0) == (second.held > 0.0) == (address == "192.0.2.1")


def test_what_a_client_in_debt_sends_on_new_connections_holds_up_those_alone() -> None:
    ledger = ConnectionLedger(Settings())
    first, second = Connection("192.0.2.1", 0.0), Connection("192.0.2.1", 1.0)
    ledger.enter(first)
    ledger.charge(first, 10 * MOST_PIECES)
    held = first.held
    ledger.enter(second)
    ledger.charge(second, 1)
    assert (first.held, second.held > 0.0) == (held, True)


def test_clients_that_are_held_together_wait_as_many_times_as_long_but_not_for_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now = 0.0
    monkeypatch.setattr("app.service.connection_ledger.time", SimpleNamespace(monotonic=lambda: now))
    ledger = ConnectionLedger(Settings())
    held = []
    for number in range(200):
        connection = Connection(f"192.0.2.{number}", 0.0)
        ledger.enter(connection)
        ledger.charge(connection, 2 * MOST_PIECES)
        held.append(connection.held)
    assert held[:3] == pytest.approx([held[0], 2.0 * held[0], 3.0 * held[0]])
    assert max(held) == LONGEST_HOLD
    now = 2.0 * LONGEST_HOLD
    late = Connection("198.51.100.1", 0.0)
    ledger.enter(late)
    ledger.charge(late, 2 * MOST_PIECES)
    assert late.held == held[0]  # the others wait no more


def test_of_clients_without_number_few_are_remembered() -> None:
    ledger = ConnectionLedger(Settings(trusted_proxies="192.0.2.128/25"))
    for number in range(MOST_CLIENTS + 100):
        connection = Connection(f"10.0.{number // 250}.{number % 250}", 0.0)
        ledger.enter(connection)
        ledger.charge(connection, 1)
        ledger.leave(connection)
    for remembered in (ledger._allowance, ledger._trusts, network_of):
        assert remembered.cache_info().currsize <= MOST_CLIENTS
    assert not ledger._open
