"""The compiled collocation against its NumPy twin, and both against themselves in parts."""

import numpy as np
import pytest

from pricing_core import collocation_twin, kernel
from pricing_core.american.events.packed_schedules import pack
from tests.problems.schedules import SCHEDULES

NO_TIMES = np.zeros(0)


def solve(module, schedules, level, times=NO_TIMES, threads=1, tolerance=0.0):
    book = pack(schedules)
    count = len(schedules)
    first_time = np.arange(count + 1) * times.size
    every = np.tile(times, count)
    levels = np.full(count, level, dtype=np.int64)
    tolerances = np.full(count, tolerance)
    return module.solve_schedules(
        book.sign, book.x, book.first, book.stretches, levels, tolerances, every, first_time, threads
    )


@pytest.mark.skipif(kernel.kernel_name() != "rust", reason="there is no compiled kernel")
@pytest.mark.parametrize(("level", "tolerance"), [(1, 0.0), (3, 0.0), (1, 1e-5), (3, 1e-7)])
@pytest.mark.parametrize("name", SCHEDULES)
def test_the_compiled_collocation_is_that_of_the_twin(name, level, tolerance):
    times = np.array([0.0, 0.05, 0.3, 0.375, 0.7, 1.0])
    book = [SCHEDULES[name]], level, times
    found, boundary, settled = solve(kernel, *book, tolerance=tolerance)
    wanted, at_times, twin_settled = solve(collocation_twin, *book, tolerance=tolerance)
    assert settled.all()
    assert twin_settled.all()
    np.testing.assert_allclose(found[:3], wanted[:3], rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(found[5], wanted[5], rtol=1e-3, atol=1e-10)
    np.testing.assert_allclose(found[3], wanted[3], rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(boundary, at_times, rtol=0.0, atol=1e-6)


def test_a_row_does_not_depend_on_its_company_or_on_threads():
    schedules = list(SCHEDULES.values())
    together, _, _ = solve(kernel, schedules, 1, threads=3)
    for row, schedule in enumerate(schedules[:4]):
        alone, _, _ = solve(kernel, [schedule], 1)
        np.testing.assert_array_equal(alone[:, 0], together[:, row])


@pytest.mark.skipif(kernel.kernel_name() != "rust", reason="the twin takes what it is given")
def test_the_compiled_kernel_refuses_what_does_not_fit():
    book = pack([SCHEDULES["put, curves"]])
    good = (
        book.sign,
        book.x,
        book.first,
        book.stretches,
        np.array([1]),
        np.zeros(1),
        NO_TIMES,
        np.zeros(2, dtype=np.int64),
        1,
    )
    for place, wrong in ((0, np.ones(2)), (2, np.array([0, 99])), (4, np.array([99]))):
        with pytest.raises(ValueError, match=r"length|first|level"):
            kernel.solve_schedules(*(wrong if k == place else part for k, part in enumerate(good)))
