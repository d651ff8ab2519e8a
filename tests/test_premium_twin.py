"""The compiled march of early exercise premiums against its NumPy twin."""

from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray

from pricing_core import premium_twin
from pricing_core.arrays import Vector

ROUNDING = 1e-12
# The last bits of ln(S/K) become 1e-16/spread in xi: at a spread of 0.01, 2e-12 in the derivatives at fixed xi.
TANGENT_ROUNDING = 1e-11
BOUNDARY_ROUNDING = 1e-11
MESHES = np.array([(24, 0), (32, 0), (40, 0), (48, 1), (64, 1), (96, 2)])  # nodes, halvings


@dataclass(frozen=True)
class Book:
    """Puts with a spot each, and the arguments of the march that belong to them."""

    x: Vector
    rate: Vector
    dividend: Vector
    spread: Vector
    nodes: NDArray[np.int64]
    halvings: NDArray[np.int64]

    @property
    def puts(self) -> tuple[Vector, Vector, Vector]:
        return self.rate, self.dividend, self.spread

    @property
    def meshes(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        return self.nodes, self.halvings

    def take(self, rows: NDArray[np.intp]) -> "Book":
        return Book(*(column[rows] for column in (self.x, *self.puts, *self.meshes)))


def random_book(count: int, seed: int) -> Book:
    """Return puts of 5 % to 80 % volatility and a week to five years, their meshes mixed."""
    random = np.random.default_rng(seed)
    expiry = random.uniform(0.02, 5.0, count)
    spread = random.uniform(0.05, 0.8, count) * np.sqrt(expiry)
    nodes, halvings = MESHES[random.integers(len(MESHES), size=count)].T.copy()
    return Book(
        random.uniform(-2.0, 2.0, count) * np.maximum(spread, 0.1),
        random.uniform(0.002, 0.15, count) * expiry,
        random.uniform(-0.02, 0.15, count) * expiry,
        spread,
        nodes,
        halvings,
    )


def width(steps: int) -> float:
    return float(0.75 / np.sqrt(steps))


def values_of(implementation: ModuleType, book: Book, steps: int, tangents: bool = True, threads: int = 1):
    return implementation.premium_values(
        steps, width(steps), book.x, *book.puts, *book.meshes, tangents, threads
    )


def march_of(implementation: ModuleType, book: Book, steps: int, tangents: bool = True, threads: int = 1):
    return implementation.premium_march(steps, width(steps), *book.puts, *book.meshes, tangents, threads)


@pytest.fixture
def compiled() -> ModuleType:
    return pytest.importorskip("pricing_core._kernels", reason="the compiled kernel is absent")


@pytest.fixture(params=["rust", "numpy"])
def implementation(request: pytest.FixtureRequest) -> ModuleType:
    if request.param == "numpy":
        return premium_twin
    return pytest.importorskip("pricing_core._kernels", reason="the compiled kernel is absent")


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("tangents", [False, True])
@pytest.mark.parametrize("steps", [2, 3, 8, 24])
def test_values_equal_those_of_the_twin(
    compiled: ModuleType, steps: int, tangents: bool, threads: int
) -> None:
    book = random_book(75, seed=steps)
    values, boundary, settled = values_of(compiled, book, steps, tangents, threads)
    expected, twin_boundary, twin_settled = values_of(premium_twin, book, steps, tangents)
    np.testing.assert_array_equal(settled, twin_settled)
    assert np.count_nonzero(settled) >= 70
    values, expected = values[settled], expected[settled]
    np.testing.assert_allclose(values[:, [0, 1, 3]], expected[:, [0, 1, 3]], rtol=0.0, atol=ROUNDING)
    np.testing.assert_allclose(values, expected, rtol=TANGENT_ROUNDING, atol=TANGENT_ROUNDING)
    np.testing.assert_allclose(boundary[settled], twin_boundary[settled], rtol=0.0, atol=BOUNDARY_ROUNDING)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("tangents", [False, True])
@pytest.mark.parametrize("steps", [2, 16])
def test_profiles_equal_those_of_the_twin(
    compiled: ModuleType, steps: int, tangents: bool, threads: int
) -> None:
    book = random_book(75, seed=100 + steps)
    profiles, frame, boundary, settled = march_of(compiled, book, steps, tangents, threads)
    expected, twin_frame, twin_boundary, twin_settled = march_of(premium_twin, book, steps, tangents)
    assert profiles.shape == expected.shape == (75, 4 if tangents else 1, book.nodes.max() + 1)
    np.testing.assert_array_equal(settled, twin_settled)
    np.testing.assert_allclose(profiles[settled, 0], expected[settled, 0], rtol=0.0, atol=ROUNDING)
    np.testing.assert_allclose(
        profiles[settled], expected[settled], rtol=TANGENT_ROUNDING, atol=TANGENT_ROUNDING
    )
    np.testing.assert_allclose(boundary[settled], twin_boundary[settled], rtol=0.0, atol=BOUNDARY_ROUNDING)
    # xi is ln(S/K) divided by the spread, and so is its rounding.
    np.testing.assert_allclose(
        (frame * book.spread)[settled], (twin_frame * book.spread)[settled], rtol=0.0, atol=BOUNDARY_ROUNDING
    )


@pytest.mark.parametrize("tangents", [False, True])
def test_profiles_are_read_as_the_twin_reads_them(compiled: ModuleType, tangents: bool) -> None:
    book, random = random_book(30, seed=7), np.random.default_rng(8)
    marched = march_of(premium_twin, book, 8, tangents)
    row = random.integers(30, size=203)
    x = random.uniform(-3.0, 3.0, 203)
    arguments = (width(8), *book.puts, *book.meshes, *marched[:3], row, x)
    found, expected = (each.profile_values(*arguments) for each in (compiled, premium_twin))
    readable = marched[3][row]
    np.testing.assert_allclose(
        found[readable], expected[readable], rtol=TANGENT_ROUNDING, atol=TANGENT_ROUNDING
    )


def test_values_are_the_profiles_read_at_the_spots(implementation: ModuleType) -> None:
    book = random_book(40, seed=9)
    values, boundary, settled = values_of(implementation, book, 8)
    profiles, frame, marched_boundary, _ = march_of(implementation, book, 8)
    read = implementation.profile_values(
        width(8), *book.puts, *book.meshes, profiles, frame, marched_boundary, np.arange(40), book.x
    )
    np.testing.assert_array_equal(boundary, marched_boundary)
    np.testing.assert_allclose(read[settled], values[settled], rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("tangents", [False, True])
def test_a_row_does_not_depend_on_the_others(
    implementation: ModuleType, tangents: bool, threads: int
) -> None:
    book = random_book(60, seed=10)
    together = values_of(implementation, book, 6, tangents)
    order = np.random.default_rng(11).permutation(60)
    shuffled = values_of(implementation, book.take(order), 6, tangents, threads)
    for column, moved in zip(together, shuffled, strict=True):
        assert column[order].tobytes() == moved.tobytes()
    for row in (0, 17, 59):
        alone = values_of(implementation, book.take(np.array([row])), 6, tangents, threads)
        for column, single in zip(together, alone, strict=True):
            assert column[row].tobytes() == single[0].tobytes()


def test_a_row_that_is_not_settled_leaves_its_neighbours_alone(implementation: ModuleType) -> None:
    book = random_book(40, seed=12)
    meshes = {"nodes": np.full(40, 32), "halvings": np.zeros(40, dtype=np.int64)}  # one group
    sound = replace(book, **meshes)
    bad = replace(sound, rate=np.where(np.arange(40) == 5, np.nan, book.rate))
    expected, found = values_of(implementation, sound, 6), values_of(implementation, bad, 6)
    assert not found[2][5]
    for column, other in zip(expected, found, strict=True):
        assert np.delete(column, 5, axis=0).tobytes() == np.delete(other, 5, axis=0).tobytes()


def test_no_rows_make_empty_results(implementation: ModuleType) -> None:
    nothing = random_book(1, seed=13).take(np.zeros(0, dtype=np.intp))
    values, boundary, settled = values_of(implementation, nothing, 4)
    assert (values.shape, boundary.shape, settled.shape) == ((0, 7), (0,), (0,))
    profiles, *_ = march_of(implementation, nothing, 4)
    assert profiles.shape[:2] == (0, 4)


def test_no_argument_is_modified_and_views_with_strides_are_read_right(implementation: ModuleType) -> None:
    book = random_book(25, seed=14)
    before = [part.copy() for part in (book.x, *book.puts, *book.meshes)]
    expected = values_of(implementation, book, 4)
    for part, copy in zip((book.x, *book.puts, *book.meshes), before, strict=True):
        np.testing.assert_array_equal(part, copy)
    spread_out = Book(*(np.repeat(part, 3)[::3] for part in before))
    for column, other in zip(expected, values_of(implementation, spread_out, 4), strict=True):
        assert column.tobytes() == other.tobytes()


@pytest.mark.parametrize("short", ["x", "rate", "dividend", "spread", "nodes", "halvings"])
def test_columns_of_different_lengths_are_refused(compiled: ModuleType, short: str) -> None:
    book = random_book(5, seed=15)
    wrong = replace(book, **{short: getattr(book, short)[:4]})
    with pytest.raises(ValueError, match="length"):
        values_of(compiled, wrong, 4)
    if short != "x":
        with pytest.raises(ValueError, match="length"):
            march_of(compiled, wrong, 4)


@pytest.mark.parametrize(
    ("field", "steps", "columns"),
    [
        ("steps", 0, {}),
        ("steps", 1, {}),
        ("nodes", 4, {"nodes": np.array([24, 24, 5])}),
        ("nodes", 4, {"nodes": np.array([24, 24, -1])}),
        ("nodes", 4, {"nodes": np.array([24, 24, 2**20 + 1])}),
        ("halvings", 4, {"halvings": np.array([0, 0, -1])}),
        ("halvings", 4, {"halvings": np.array([0, 0, 41])}),
    ],
)
def test_meshes_out_of_range_are_refused(compiled: ModuleType, field, steps, columns) -> None:
    book = replace(random_book(3, seed=16), **columns)
    with pytest.raises(ValueError, match=f"{field} is"):
        compiled.premium_values(steps, 0.2, book.x, *book.puts, *book.meshes, True, 1)
    with pytest.raises(ValueError, match=f"{field} is"):
        compiled.premium_march(steps, 0.2, *book.puts, *book.meshes, True, 1)


@pytest.mark.parametrize(
    ("match", "change"),
    [
        ("row must", {"row": np.array([0, 3])}),
        ("row must", {"row": np.array([-1, 0])}),
        ("row must", {"row": np.array([0])}),
        ("length", {"frame": np.zeros(2)}),
        ("length", {"boundary": np.zeros(4)}),
        ("length", {"profiles": np.zeros((2, 4, 97))}),
        ("shape", {"profiles": np.zeros((3, 2, 97))}),
        ("shape", {"profiles": np.zeros((3, 4, 24))}),
    ],
)
def test_profiles_that_do_not_fit_are_refused(compiled: ModuleType, match: str, change: dict) -> None:
    book = random_book(3, seed=17)
    profiles, frame, boundary, _ = march_of(premium_twin, book, 4)
    parts = {"profiles": profiles, "frame": frame, "boundary": boundary, "row": np.array([0, 2])} | change
    with pytest.raises(ValueError, match=match):
        compiled.profile_values(width(4), *book.puts, *book.meshes, *parts.values(), np.zeros(2))
