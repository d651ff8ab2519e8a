"""The compiled march of early exercise premiums: every row for itself, and what it refuses."""

import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from pricing_core import kernel
from pricing_core.arrays import Vector
from tests.problems.needs_kernel import needs_kernel

pytestmark = needs_kernel


@dataclass(frozen=True)
class Rows:
    """Puts with a spot each, and how exactly they are wanted."""

    x: Vector
    rate: Vector
    dividend: Vector
    spread: Vector
    tolerance: Vector

    @property
    def puts(self) -> tuple[Vector, Vector, Vector]:
        return self.rate, self.dividend, self.spread

    def take(self, rows: NDArray[np.intp]) -> "Rows":
        return Rows(self.x[rows], *(column[rows] for column in self.puts), self.tolerance[rows])


def random_book(count: int, seed: int) -> Rows:
    """Return puts of 5 % to 80 % volatility and a week to five years, for tolerances of 1e-3 to 1e-7."""
    random = np.random.default_rng(seed)
    expiry = random.uniform(0.02, 5.0, count)
    spread = random.uniform(0.05, 0.8, count) * np.sqrt(expiry)
    return Rows(
        random.uniform(-2.0, 2.0, count) * np.maximum(spread, 0.1),
        random.uniform(0.002, 0.15, count) * expiry,
        random.uniform(-0.02, 0.15, count) * expiry,
        spread,
        10.0 ** random.uniform(-7.0, -3.0, count),
    )


def solve(
    book: Rows,
    *,
    greeks: bool = False,
    first: NDArray[np.int64] | None = None,
    fewest: int = 4,
    most: int = 384,
    threads: int = 1,
    interrupt: Callable[[], bool] | None = None,
):
    """Solve each put by itself, or the runs of spots that begin at `first`; the last axis is that of the spots."""
    if first is None:
        first = np.arange(book.rate.size + 1)
    limits, step = (np.full((book.x.size, 7), 1e-5), 0.002) if greeks else (None, None)
    numbers, *flags = kernel.solve_puts(
        book.x, *book.puts, first, book.tolerance, limits, step, fewest, most, threads, interrupt
    )
    return numbers.T, *flags


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("greeks", [False, True])
def test_a_row_does_not_depend_on_the_others(greeks: bool, threads: int) -> None:
    count = 1500  # enough for each thread to have its share
    book = random_book(count, seed=10)
    together = solve(book, greeks=greeks)
    order = np.random.default_rng(11).permutation(count)
    shuffled = solve(book.take(order), greeks=greeks, threads=threads)
    for column, moved in zip(together, shuffled, strict=True):
        assert column[..., order].tobytes() == moved.tobytes()
    for row in (0, 7, 19):
        alone = solve(book.take(np.array([row])), greeks=greeks, threads=threads)
        for column, single in zip(together, alone, strict=True):
            assert column[..., row].tobytes() == single[..., 0].tobytes()


def test_spots_that_share_a_march_are_those_that_do_not() -> None:
    book = random_book(10, seed=5)
    x = np.linspace(-1.5, 1.5, 30)[:, None] * book.spread
    shared = replace(book, x=x.T.ravel(), tolerance=np.full(300, 1e-5))
    apart = Rows(shared.x, *(np.repeat(column, 30) for column in book.puts), np.full(300, 1e-5))
    found = solve(shared, first=np.arange(0, 301, 30))
    for column, other in zip(found, solve(apart), strict=True):
        assert column.tobytes() == other.tobytes()


@pytest.mark.parametrize("column", ["x", "rate", "dividend", "spread"])
def test_a_row_that_is_not_finite_leaves_its_neighbours_alone(column: str) -> None:
    sound = random_book(40, seed=12)
    number = np.where(np.arange(40) == 5, np.nan, getattr(sound, column))
    expected, found = solve(sound), solve(replace(sound, **{column: number}))
    assert not np.isfinite(found[0][0, 5]) or not found[2][5]
    for one, other in zip(expected, found, strict=True):
        assert np.delete(one, 5, axis=-1).tobytes() == np.delete(other, 5, axis=-1).tobytes()


def test_no_rows_make_empty_results() -> None:
    nothing = random_book(1, seed=13).take(np.zeros(0, dtype=np.intp))
    numbers, exercised, settled, steps = solve(nothing)
    assert (numbers.shape, exercised.shape, settled.shape, steps.shape) == ((10, 0), (0,), (0,), (0,))
    boundary, found = kernel.march_boundaries(8, *nothing.puts, None)
    assert (boundary.shape, found.shape) == ((0,), (0,))


def test_no_argument_is_modified_and_views_with_strides_are_read_right() -> None:
    book = random_book(25, seed=14)
    before = [part.copy() for part in (book.x, *book.puts, book.tolerance)]
    expected = solve(book)
    for part, copy in zip((book.x, *book.puts, book.tolerance), before, strict=True):
        np.testing.assert_array_equal(part, copy)
    spread_out = Rows(*(np.repeat(part, 3)[::3] for part in before))
    for column, other in zip(expected, solve(spread_out), strict=True):
        assert column.tobytes() == other.tobytes()


@pytest.mark.parametrize("short", ["x", "rate", "dividend", "spread", "tolerance"])
def test_columns_of_different_lengths_are_refused(short: str) -> None:
    book = random_book(5, seed=15)
    wrong = replace(book, **{short: getattr(book, short)[:4]})
    with pytest.raises(ValueError, match=r"length|first must"):
        solve(wrong, first=np.arange(6))
    if short in ("dividend", "spread"):
        with pytest.raises(ValueError, match="length"):
            kernel.march_boundaries(8, *wrong.puts, None)


@pytest.mark.parametrize(
    "first", [[0, 1, 2], [1, 2, 3, 5], [0, 2, 2, 5], [0, 3, 2, 5], [0, 1, 2, 6], [-1, 1, 2, 5]]
)
def test_runs_that_do_not_cover_the_spots_are_refused(first: list[int]) -> None:
    book = random_book(3, seed=16)
    spots = replace(book, x=np.zeros(5), tolerance=np.full(5, 1e-5))
    with pytest.raises(ValueError, match="first must"):
        solve(spots, first=np.array(first))


@pytest.mark.parametrize(("fewest", "most"), [(2, 8), (8, 4), (5, 8), (4, 400)])
def test_numbers_of_steps_out_of_range_are_refused(fewest: int, most: int) -> None:
    with pytest.raises(ValueError, match=r"steps is|fewest is"):
        solve(random_book(3, seed=17), fewest=fewest, most=most)


def test_limits_of_another_shape_are_refused() -> None:
    book = random_book(3, seed=18)
    with pytest.raises(ValueError, match="length"):
        kernel.solve_puts(
            book.x, *book.puts, np.arange(4), book.tolerance, np.zeros((2, 7)), None, 4, 384, 1, None
        )


@pytest.mark.parametrize("greeks", [False, True])
@pytest.mark.parametrize("threads", [1, 2])
def test_an_interrupt_ends_the_work_within_milliseconds(greeks: bool, threads: int) -> None:
    book = random_book(100_000, seed=13)
    asked: list[float] = []

    def interrupt() -> bool:
        asked.append(time.perf_counter())
        return len(asked) >= 4

    _, _, settled, _ = solve(book, greeks=greeks, threads=threads, interrupt=interrupt)
    ended = time.perf_counter()
    assert len(asked) == 4
    assert 0 < settled.sum() < settled.size
    assert (
        ended - asked[-1] < 0.1
    )  # a thousandth of the work that was left; milliseconds where the machine is idle
    told = solve(book, greeks=greeks, threads=threads, interrupt=lambda: True)
    # While the first thread asks, another one may march for some milliseconds.
    assert told[2].mean() <= (0.0 if threads == 1 else 0.05)


def test_one_extreme_row_asks_as_often() -> None:
    row = Rows(np.zeros(1), np.full(1, 8.0), np.zeros(1), np.full(1, 1.0), np.full(1, 1e-12))
    asked: list[float] = []

    def interrupt() -> bool:
        asked.append(time.perf_counter())
        return False

    start = time.perf_counter()
    solve(row, greeks=True, fewest=384, interrupt=interrupt)
    assert len(asked) >= (time.perf_counter() - start) / 0.05
    assert not solve(row, greeks=True, fewest=384, interrupt=lambda: True)[2].any()


def test_what_was_marched_before_an_interrupt_is_what_it_is_without_one() -> None:
    book = random_book(20_000, seed=14)
    whole = solve(book)
    for last in (2, 3):
        questions = iter([False] * last + [True])
        values, _, settled, steps = solve(book, interrupt=lambda asked=questions: next(asked, True))
        same = settled & (steps == whole[3])
        assert values[:, same].tobytes() == whole[0][:, same].tobytes()
        early = settled & (steps < whole[3])
        assert np.all(values[7, early] > book.tolerance[early])


def test_what_an_interrupt_raises_is_raised() -> None:
    book = random_book(50, seed=15)

    def fails() -> bool:
        raise RuntimeError("asked")

    with pytest.raises(RuntimeError, match="asked"):
        solve(book, interrupt=fails)
    with pytest.raises(RuntimeError, match="asked"):
        kernel.march_boundaries(64, *book.puts, fails)


def test_a_signal_ends_the_work() -> None:
    book = random_book(200_000, seed=16)

    def handler(number: int, frame: object) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, handler)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.02)
        with pytest.raises(KeyboardInterrupt):
            solve(replace(book, tolerance=np.full(book.x.size, 1e-7)), greeks=True)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.nightly
def test_second_derivatives_are_those_of_the_first_ones() -> None:
    count = 100
    book = random_book(count, seed=18)
    book = replace(book, tolerance=np.full(count, 1e-6))
    numbers, exercised, settled, _ = solve(book, greeks=True)
    exact = replace(book, tolerance=np.full(count, 1e-9))

    def difference(name: str, of: int) -> Vector:
        number = getattr(book, name)
        h = 0.01 * (number if name == "spread" else np.maximum(np.abs(number), 0.05))
        ups, downs = (
            [solve(replace(exact, **{name: number + k * h}), greeks=True)[0][of] for k in (s, 2 * s)]
            for s in (1, -1)
        )
        return (8.0 * (ups[0] - downs[0]) - (ups[1] - downs[1])) / (12.0 * h)

    # Away from the boundary: there differences would straddle it.
    held = settled & ~exercised & (book.x > numbers[8] + 0.2 * book.spread) & (book.rate > 0.02)
    assert held.sum() > count / 3
    for row, name, of, unit in (
        (15, "rate", 1, book.spread),
        (16, "dividend", 1, book.spread),
        (17, "spread", 1, np.ones(count)),
        (18, "spread", 6, np.ones(count)),
    ):
        off = unit * np.abs(numbers[row] - difference(name, of))
        assert np.quantile(off[held], 0.9) < 1e-4
        assert np.median(off[held]) < 5e-6


def option_columns(count: int) -> list[NDArray[np.generic]]:
    """Return what `price_options` takes, up to the tolerances."""
    random = np.random.default_rng(19)
    ranges = ((60.0, 150.0), (80.0, 120.0), (0.1, 2.0), (0.01, 0.1), (0.0, 0.1), (0.1, 0.5), (1e-6, 1e-4))
    return [random.random(count) < 0.5, *(random.uniform(*ends, count) for ends in ranges)]


@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("greeks", [0, 1, 2])
def test_options_are_priced_row_by_row(greeks: int, shared: bool) -> None:
    columns = option_columns(300)
    named, *flags = kernel.price_options(*columns, greeks, shared, 2, None)
    assert all(np.isfinite(column).all() for column in named.values())
    for row in (0, 150, 299):
        alone = [column[row : row + 1] for column in columns]
        one, *its_flags = kernel.price_options(*alone, greeks, shared, 1, None)
        for name, column in named.items():
            assert column[row : row + 1].tobytes() == one[name].tobytes()
        assert [flag[row] for flag in flags] == [flag[0] for flag in its_flags]


def test_options_that_differ_in_spot_and_strike_alone_share_a_march_whatever_their_order() -> None:
    columns = option_columns(60)
    for column in (columns[0], *columns[3:]):
        column[:] = np.tile(column[:3], 20)  # three kinds of contracts, in turn
    order = np.random.default_rng(20).permutation(60)
    apart, *_ = kernel.price_options(*columns, 1, False, 1, None)
    shared, *_ = kernel.price_options(*(column[order] for column in columns), 1, True, 1, None)
    for name in ("value", "european", "delta", "vega", "boundary"):
        np.testing.assert_allclose(shared[name], apart[name][order], rtol=1e-4, atol=2e-3, err_msg=name)


def test_columns_of_options_of_different_lengths_and_unknown_greeks_are_refused() -> None:
    for short in range(8):
        columns = option_columns(5)
        columns[short] = columns[short][:4]
        with pytest.raises(ValueError, match="length"):
            kernel.price_options(*columns, 1, False, 1, None)
    with pytest.raises(ValueError, match="greeks must be 0, 1 or 2"):
        kernel.price_options(*option_columns(5), 3, False, 1, None)
