"""The compiled collocation: every row for itself, and what it refuses."""

import numpy as np
import pytest

from pricing_core import kernel
from pricing_core.american.book.book import Book
from pricing_core.american.engines.multiplier_collocation.levels import pack
from tests.problems.needs_kernel import needs_kernel
from tests.problems.random_events import random_contracts
from tests.problems.schedules import CONTRACTS

pytestmark = needs_kernel
NO_TIMES = np.zeros(0)
STEP = 1e-3  # Step of the volatilities for values nearby.
TIMES = np.array([0.0, 0.05, 0.3, 0.375, 0.7, 1.0])


def arguments(contracts, level, times=NO_TIMES, tolerance=0.0):
    """Return what `solve_schedules` takes first: the contracts, their levels, tolerances and steps, and the times."""
    packed = pack(Book.of(contracts))
    count = len(contracts)
    first_time, every = np.arange(count + 1) * times.size, np.tile(times, count)
    levels, tolerances = np.full(count, level, dtype=np.int64), np.full(count, tolerance)
    steps = np.full(count, STEP)
    return packed.sign, packed.x, packed.first, packed.segments, levels, tolerances, steps, every, first_time


def solve(contracts, level, times=NO_TIMES, threads=1, tolerance=0.0):
    """Return numbers, boundaries and what settled."""
    given = arguments(contracts, level, times, tolerance)
    numbers, boundary, settled, _ = kernel.solve_schedules(*given, 0, threads, None)
    return numbers, boundary, settled


@pytest.mark.parametrize(("level", "tolerance"), [(1, 0.0), (3, 1e-7)])
@pytest.mark.parametrize("threads", [1, 3])
def test_a_row_does_not_depend_on_its_company_or_on_threads(threads, level, tolerance):
    contracts = list(CONTRACTS.values())
    together = solve(contracts, level, TIMES, threads, tolerance)
    for row, contract in enumerate(contracts):
        found, boundary, settled = solve([contract], level, TIMES, tolerance=tolerance)
        np.testing.assert_array_equal(found[:, 0], together[0][:, row])
        np.testing.assert_array_equal(boundary, together[1][TIMES.size * row : TIMES.size * (row + 1)])
        assert settled[0] == together[2][row]


def test_order_changes_no_bit():
    contracts = random_contracts(3, 300)
    found, _, settled = solve(contracts, 2, threads=2, tolerance=1e-6)
    order = np.random.default_rng(4).permutation(len(contracts))
    moved, _, moved_settled = solve([contracts[row] for row in order], 2, tolerance=1e-6)
    assert found[:, order].tobytes() == moved.tobytes()
    assert settled[order].tobytes() == moved_settled.tobytes()


@pytest.mark.parametrize("name", CONTRACTS)
def test_times_to_look_at_change_next_to_nothing(name):
    """A segment may be solved in other parts for their sake: by less than the level's accuracy."""
    for tolerance in (0.0, 1e-6):
        plain, _, _ = solve([CONTRACTS[name]], 2, tolerance=tolerance)
        watched, boundary, settled = solve([CONTRACTS[name]], 2, TIMES, tolerance=tolerance)
        assert settled.all()
        assert watched[0] == pytest.approx(plain[0], abs=1e-9)
        assert watched[1] == pytest.approx(plain[1], abs=1e-7)
        np.testing.assert_allclose(boundary[0], watched[3, 0], rtol=0.0, atol=1e-12)  # the boundary now


def test_what_does_not_fit_is_refused():
    good = (*arguments([CONTRACTS["put, curves"]], 1), 2, 1, None)
    for place, wrong in ((0, np.ones(2)), (2, np.array([0, 99])), (4, np.array([99]))):
        with pytest.raises(ValueError, match=r"length|first|level"):
            kernel.solve_schedules(*(wrong if k == place else part for k, part in enumerate(good)))


def test_no_argument_is_modified():
    given = arguments(list(CONTRACTS.values()), 1, tolerance=1e-5)
    before = [part.copy() for part in given]
    kernel.solve_schedules(*given, 2, 1, None)
    for part, copy in zip(given, before, strict=True):
        np.testing.assert_array_equal(part, copy)


def test_an_interrupt_ends_the_work_within_milliseconds():
    given = arguments(random_contracts(6, 4000), 4, tolerance=1e-8)
    asked = []

    def interrupt():
        asked.append(True)
        return len(asked) >= 3

    _, _, settled, gradient = kernel.solve_schedules(*given, 2, 2, interrupt)
    assert len(asked) == 3
    assert 0 < settled.sum() < settled.size
    assert np.isnan(gradient[given[2][:-1][~settled]]).all()

    def fails():
        raise RuntimeError("asked")

    with pytest.raises(RuntimeError, match="asked"):
        kernel.solve_schedules(*given, 2, 2, fails)
