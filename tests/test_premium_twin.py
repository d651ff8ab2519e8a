"""The compiled march of early exercise premiums against its NumPy twin."""

from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray

from pricing_core import premium_twin
from pricing_core.arrays import Vector
from pricing_core.premium_twin.march import LATER_STEPS, SECOND_STEP, STAGE
from tests.problems.twins import slow_on_the_twin

ROUNDING = 1e-12
# The last bits of ln(S/K) become 1e-16/spread in xi: at a spread of 0.01, 2e-12 in the derivatives.
DERIVATIVE_ROUNDING = 1e-11


@dataclass(frozen=True)
class Book:
    """Puts with a spot each, and how exactly they are wanted."""

    x: Vector
    rate: Vector
    dividend: Vector
    spread: Vector
    tolerance: Vector

    @property
    def puts(self) -> tuple[Vector, Vector, Vector]:
        return self.rate, self.dividend, self.spread

    def take(self, rows: NDArray[np.intp]) -> "Book":
        return Book(self.x[rows], *(column[rows] for column in self.puts), self.tolerance[rows])


def random_book(count: int, seed: int) -> Book:
    """Return puts of 5 % to 80 % volatility and a week to five years, for tolerances of 1e-3 to 1e-7."""
    random = np.random.default_rng(seed)
    expiry = random.uniform(0.02, 5.0, count)
    spread = random.uniform(0.05, 0.8, count) * np.sqrt(expiry)
    return Book(
        random.uniform(-2.0, 2.0, count) * np.maximum(spread, 0.1),
        random.uniform(0.002, 0.15, count) * expiry,
        random.uniform(-0.02, 0.15, count) * expiry,
        spread,
        10.0 ** random.uniform(-7.0, -3.0, count),
    )


def solve(
    implementation: ModuleType,
    book: Book,
    *,
    greeks: bool = False,
    first: NDArray[np.int64] | None = None,
    fewest: int = 4,
    most: int = 384,
    threads: int = 1,
):
    """Solve each put by itself, or the runs of spots that begin at `first`."""
    if first is None:
        first = np.arange(book.rate.size + 1)
    limits = np.full((book.x.size, 7), 1e-5) if greeks else None
    return implementation.solve_puts(book.x, *book.puts, first, book.tolerance, limits, fewest, most, threads)


@pytest.fixture
def compiled() -> ModuleType:
    return pytest.importorskip("pricing_core._kernels", reason="the compiled kernel is absent")


@pytest.fixture(params=["rust", "numpy"])
def implementation(request: pytest.FixtureRequest) -> ModuleType:
    if request.param == "numpy":
        return premium_twin
    return pytest.importorskip("pricing_core._kernels", reason="the compiled kernel is absent")


def assert_equal_but_for_rounding(found, expected) -> None:
    numbers, *flags = found
    twin_numbers, *twin_flags = expected
    for flag, twin_flag in zip(flags, twin_flags, strict=True):
        np.testing.assert_array_equal(flag, twin_flag)
    settled = flags[1]
    assert np.mean(settled) >= 0.95
    for row, name in ((0, "value"), (3, "European"), (7, "error")):
        np.testing.assert_allclose(
            numbers[row, settled], twin_numbers[row, settled], rtol=0.0, atol=ROUNDING, err_msg=name
        )
    np.testing.assert_allclose(
        numbers[:, settled], twin_numbers[:, settled], rtol=DERIVATIVE_ROUNDING, atol=DERIVATIVE_ROUNDING
    )


@pytest.mark.parametrize("greeks", [False, True])
@pytest.mark.parametrize("steps", [4, 6, 8, 12, 32])
def test_one_level_equals_that_of_the_twin(compiled: ModuleType, steps: int, greeks: bool) -> None:
    book = random_book(75, seed=steps)
    asked = {"greeks": greeks, "fewest": steps, "most": steps}
    assert_equal_but_for_rounding(solve(compiled, book, **asked), solve(premium_twin, book, **asked))


@pytest.mark.parametrize("greeks", [False, True])
def test_refinement_equals_that_of_the_twin(compiled: ModuleType, greeks: bool) -> None:
    book = random_book(60, seed=1)
    found = solve(compiled, book, greeks=greeks)
    assert np.unique(found[3]).size >= 6
    assert_equal_but_for_rounding(found, solve(premium_twin, book, greeks=greeks))


@pytest.mark.parametrize("greeks", [False, True])
def test_runs_of_spots_equal_those_of_the_twin(compiled: ModuleType, greeks: bool) -> None:
    book, random = random_book(40, seed=2), np.random.default_rng(3)
    first = np.append(0, np.cumsum(random.integers(1, 50, 40)))
    spots = int(first[-1])
    runs = np.repeat(np.arange(40), np.diff(first))
    ladders = replace(
        book, x=random.uniform(-2.0, 2.0, spots) * book.spread[runs], tolerance=np.full(spots, 1e-5)
    )
    found = solve(compiled, ladders, greeks=greeks, first=first)
    assert_equal_but_for_rounding(found, solve(premium_twin, ladders, greeks=greeks, first=first))


@pytest.mark.parametrize("steps", [8, 32])
def test_boundaries_equal_those_of_the_twin(compiled: ModuleType, steps: int) -> None:
    book = random_book(75, seed=4)
    boundary, settled = compiled.march_boundaries(steps, *book.puts)
    expected, twin_settled = premium_twin.march_boundaries(steps, *book.puts)
    np.testing.assert_array_equal(settled, twin_settled)
    assert settled.mean() >= 0.95
    np.testing.assert_allclose(boundary[settled], expected[settled], rtol=0.0, atol=1e-11)


@slow_on_the_twin
@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("greeks", [False, True])
def test_a_row_does_not_depend_on_the_others(implementation: ModuleType, greeks: bool, threads: int) -> None:
    if implementation is premium_twin and threads > 1:
        pytest.skip("the twin has no threads")
    count = 1500 if implementation is not premium_twin else 20  # enough for each thread to have its share
    book = random_book(count, seed=10)
    together = solve(implementation, book, greeks=greeks)
    order = np.random.default_rng(11).permutation(count)
    shuffled = solve(implementation, book.take(order), greeks=greeks, threads=threads)
    for column, moved in zip(together, shuffled, strict=True):
        assert column[..., order].tobytes() == moved.tobytes()
    for row in (0, 7, 19):
        alone = solve(implementation, book.take(np.array([row])), greeks=greeks, threads=threads)
        for column, single in zip(together, alone, strict=True):
            assert column[..., row].tobytes() == single[..., 0].tobytes()


def test_spots_that_share_a_march_are_those_that_do_not(implementation: ModuleType) -> None:
    book = random_book(10, seed=5)
    x = np.linspace(-1.5, 1.5, 30)[:, None] * book.spread
    shared = replace(book, x=x.T.ravel(), tolerance=np.full(300, 1e-5))
    apart = Book(shared.x, *(np.repeat(column, 30) for column in book.puts), np.full(300, 1e-5))
    found = solve(implementation, shared, first=np.arange(0, 301, 30))
    for column, other in zip(found, solve(implementation, apart), strict=True):
        assert column.tobytes() == other.tobytes()


@pytest.mark.parametrize("column", ["x", "rate", "dividend", "spread"])
def test_a_row_that_is_not_finite_leaves_its_neighbours_alone(
    implementation: ModuleType, column: str
) -> None:
    sound = random_book(40, seed=12)
    number = np.where(np.arange(40) == 5, np.nan, getattr(sound, column))
    expected, found = solve(implementation, sound), solve(implementation, replace(sound, **{column: number}))
    assert not np.isfinite(found[0][0, 5]) or not found[2][5]
    for one, other in zip(expected, found, strict=True):
        assert np.delete(one, 5, axis=-1).tobytes() == np.delete(other, 5, axis=-1).tobytes()


def test_no_rows_make_empty_results(implementation: ModuleType) -> None:
    nothing = random_book(1, seed=13).take(np.zeros(0, dtype=np.intp))
    numbers, exercised, settled, steps = solve(implementation, nothing)
    assert (numbers.shape, exercised.shape, settled.shape, steps.shape) == ((9, 0), (0,), (0,), (0,))
    boundary, found = implementation.march_boundaries(8, *nothing.puts)
    assert (boundary.shape, found.shape) == ((0,), (0,))


def test_no_argument_is_modified_and_views_with_strides_are_read_right(implementation: ModuleType) -> None:
    book = random_book(25, seed=14)
    before = [part.copy() for part in (book.x, *book.puts, book.tolerance)]
    expected = solve(implementation, book)
    for part, copy in zip((book.x, *book.puts, book.tolerance), before, strict=True):
        np.testing.assert_array_equal(part, copy)
    spread_out = Book(*(np.repeat(part, 3)[::3] for part in before))
    for column, other in zip(expected, solve(implementation, spread_out), strict=True):
        assert column.tobytes() == other.tobytes()


@pytest.mark.parametrize("short", ["x", "rate", "dividend", "spread", "tolerance"])
def test_columns_of_different_lengths_are_refused(compiled: ModuleType, short: str) -> None:
    book = random_book(5, seed=15)
    wrong = replace(book, **{short: getattr(book, short)[:4]})
    with pytest.raises(ValueError, match=r"length|first must"):
        solve(compiled, wrong, first=np.arange(6))
    if short in ("dividend", "spread"):
        with pytest.raises(ValueError, match="length"):
            compiled.march_boundaries(8, *wrong.puts)


@pytest.mark.parametrize(
    "first", [[0, 1, 2], [1, 2, 3, 5], [0, 2, 2, 5], [0, 3, 2, 5], [0, 1, 2, 6], [-1, 1, 2, 5]]
)
def test_runs_that_do_not_cover_the_spots_are_refused(compiled: ModuleType, first: list[int]) -> None:
    book = random_book(3, seed=16)
    spots = replace(book, x=np.zeros(5), tolerance=np.full(5, 1e-5))
    with pytest.raises(ValueError, match="first must"):
        solve(compiled, spots, first=np.array(first))


@pytest.mark.parametrize(("fewest", "most"), [(2, 8), (8, 4), (5, 8), (4, 400)])
def test_numbers_of_steps_out_of_range_are_refused(compiled: ModuleType, fewest: int, most: int) -> None:
    with pytest.raises(ValueError, match=r"steps is|fewest is"):
        solve(compiled, random_book(3, seed=17), fewest=fewest, most=most)


def test_limits_of_another_shape_are_refused(compiled: ModuleType) -> None:
    book = random_book(3, seed=18)
    with pytest.raises(ValueError, match="length"):
        compiled.solve_puts(book.x, *book.puts, np.arange(4), book.tolerance, np.zeros((2, 7)), 4, 384, 1)


@pytest.mark.parametrize(("method", "explicit"), [(SECOND_STEP, False), (LATER_STEPS, True)])
def test_the_runge_kutta_methods_fulfil_their_order_conditions(method, explicit):
    matrix = np.zeros((4, 4))
    for i, weights in enumerate(method.implicit, start=1):
        matrix[i, 0] = method.explicit[i - 1]
        matrix[i, 1:i] = STAGE * np.array(weights)
        matrix[i, i] = STAGE
    c, b = np.array([0.0, *method.times]), matrix[3]
    assert c[3] == 1.0
    np.testing.assert_allclose([b.sum(), b @ c, b @ c**2], [1.0, 1.0 / 2.0, 1.0 / 3.0], rtol=1e-13)
    np.testing.assert_allclose(b @ (matrix @ c), 1.0 / 6.0, rtol=1e-13)
    np.testing.assert_allclose(matrix.sum(axis=1), c, rtol=1e-13, atol=1e-15)
    if explicit:  # every stage is of order two
        np.testing.assert_allclose(matrix @ c, c**2 / 2.0, rtol=1e-13, atol=1e-15)
    far = -1e9
    stability = 1.0 + far * b @ np.linalg.solve(np.eye(4) - far * matrix, np.ones(4))
    assert abs(stability) < 1e-6  # L-stable
