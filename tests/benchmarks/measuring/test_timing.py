import gc

import pytest

from benchmarks.measuring.timing import Task, least_seconds


def test_tasks_take_turns_and_every_call_comes_twice_in_a_row():
    order: list[str] = []
    one = Task(
        (lambda: order.append("a"), lambda: order.append("b")), prepare=lambda: order.append("prepare")
    )
    two = Task((lambda: order.append("c"),))
    seconds = least_seconds([one, two], turns=2)
    assert order == ["prepare", "a", "a", "b", "b", "c", "c"] * 2
    assert all(0.0 <= second < 1.0 for second in seconds)


def test_garbage_is_not_collected_in_between_and_is_again_afterwards():
    seen: list[bool] = []
    least_seconds([Task((lambda: seen.append(gc.isenabled()),))], turns=1)
    assert seen == [False, False]
    assert gc.isenabled()


def test_an_error_leaves_the_garbage_collection_on():
    def fail() -> None:
        raise ArithmeticError

    with pytest.raises(ArithmeticError):
        least_seconds([Task((fail,))], turns=1)
    assert gc.isenabled()
