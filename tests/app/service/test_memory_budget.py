import pytest

from app.service.errors import BodyTooLargeError, ClientLimitError, OverloadedError
from app.service.memory_budget import HeldMemory, MemoryBudget


def test_one_client_holds_one_largest_body_and_all_together_two() -> None:
    budget = MemoryBudget(100)
    first, second, third = (HeldMemory(budget, client) for client in ("a", "b", "c"))
    with pytest.raises(BodyTooLargeError):
        first.take(101)
    first.take(100)
    with pytest.raises(BodyTooLargeError):  # whatever others do: to try again later is of no use
        first.take(1)
    with pytest.raises(ClientLimitError):
        HeldMemory(budget, "a").take(1)
    second.take(99)
    with pytest.raises(OverloadedError):
        third.take(2)
    third.take(1)
    assert budget.held == 200
    first.give_back(40)
    second.take(1)
    third.take(39)
    for one in (first, second, third):
        one.release()
    assert budget.held == 0
    assert not budget._held
