"""The compiled flow to an event, and the signs that select modes, against their NumPy twin and what is known."""

from types import ModuleType

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import polynomial
from scipy.linalg import expm

from pricing_core import mode_twin
from pricing_core.arrays import Matrix, Vector

SHARE = 1e-11


@pytest.fixture(params=["rust", "numpy"], scope="module")
def implementation(request: pytest.FixtureRequest) -> ModuleType:
    if request.param == "numpy":
        return mode_twin
    return pytest.importorskip("pricing_core._kernels", reason="the compiled kernel is absent")


def columns(*polynomials: list[float]) -> tuple[Matrix, Matrix, Vector]:
    """Return R, C and c with these polynomials of time as outputs: c are their derivatives over factorials."""
    d = max(map(len, polynomials))
    rate = np.diag(np.arange(1.0, d), 1)
    blocks = len(polynomials)
    outputs = np.kron(np.eye(blocks), np.eye(1, d))
    c = np.concatenate([np.pad(p, (0, d - len(p))) for p in polynomials])
    return np.kron(np.eye(blocks), rate), outputs, c


def crossing(kernel: ModuleType, *polynomials: list[float], end: float = 1.0) -> tuple[float, list[int]]:
    """Return the first crossing; an output is negative below minus 1e-11."""
    rate, outputs, c = columns(*polynomials)
    place, crossed, *_ = kernel.taylor_step(rate, outputs, c, np.abs(c), end, SHARE)
    return place, list(crossed)


@given(st.lists(st.floats(0.05, 1.5), min_size=1, max_size=5, unique=True))
@settings(max_examples=100, deadline=None)
def test_the_first_of_several_zeros_is_found(implementation: ModuleType, roots: list[float]) -> None:
    places = np.sort(roots)
    if np.any(np.diff(places) < 0.02):
        return
    coefficients = polynomial.polyfromroots(places)
    if places.size % 2:
        coefficients = -coefficients  # positive before the first
    place, crossed = crossing(implementation, coefficients.tolist())
    if places[0] < 0.999:
        assert (crossed, place) == ([0], pytest.approx(places[0], abs=1e-9))
    elif places[0] > 1.0:
        assert (crossed, place) == ([], 1.0)


@pytest.mark.parametrize("depth", [1e-10, 1e-7, 1e-3])
def test_a_short_dip_is_seen(implementation: ModuleType, depth: float) -> None:
    place, _ = crossing(implementation, [0.25 - depth, -1.0, 1.0])  # (s - 1/2)**2 - depth
    assert place == pytest.approx(0.5 - np.sqrt(depth), rel=1e-6)


def test_a_touch_is_no_crossing_and_is_told(implementation: ModuleType) -> None:
    rate, outputs, c = columns([0.25, -1.0, 1.0])
    for end, touches in ((1.0, True), (0.4, False)):
        place, crossed, *_, may_touch = implementation.taylor_step(rate, outputs, c, np.abs(c), end, SHARE)
        assert (place, list(crossed), may_touch) == (end, [], touches)


def test_a_start_on_zero_is_a_crossing_only_where_it_falls(implementation: ModuleType) -> None:
    assert crossing(implementation, [0.0, 1.0]) == (1.0, [])
    assert crossing(implementation, [-1e-17, 0.0, 1.0]) == (1.0, [])
    assert crossing(implementation, [0.0, -1.0]) == (0.0, [0])
    assert crossing(implementation, [-1e-17, 1.0, -2.0])[0] == pytest.approx(0.5)


def test_a_bounce_below_the_tolerance_ends_where_it_comes_down(implementation: ModuleType) -> None:
    """From -1e-16 it rises to 2.5e-15, comes down at 1e-7, and falls below minus its tolerance much later.

    That is flat beside terms of size 1 that cancel, and not without them.
    """
    bounce, one = [-1e-16, 1e-7, -1.0], [1.0, 0.0, 0.0]
    rate, _, c = columns(bounce, one, one)
    for weight, flat in ((1.0, True), (0.0, False)):
        outputs = np.kron([[1.0, weight, -weight]], [[1.0, 0.0, 0.0]])
        place, crossed, _, _, *low, _ = implementation.taylor_step(rate, outputs, c, np.abs(c), 1.0, SHARE)
        assert (list(crossed), place) == ([0], pytest.approx(1e-7, rel=1e-1))
        assert low == [flat, False]


def test_outputs_that_cross_together_are_told_together(implementation: ModuleType) -> None:
    assert crossing(implementation, [0.5, -1.0], [1.0, -2.0], [1.0]) == (0.5, [0, 1])


def test_what_happens_behind_the_end_is_not_seen(implementation: ModuleType) -> None:
    assert crossing(implementation, [0.5, -1.0], end=0.49) == (0.49, [])


@pytest.mark.parametrize("seed", range(60))
def test_both_end_a_random_step_where_the_exponential_does(implementation: ModuleType, seed: int) -> None:
    """At every scale of the outputs: c is exp(R place) c, no output is negative before, what crosses is behind."""
    rng = np.random.default_rng(seed)
    d, k = int(rng.integers(1, 8)), int(rng.integers(1, 6))
    rate = rng.normal(size=(d, d)) * (rng.random((d, d)) < rng.choice([0.3, 1.0]))
    rate *= 2.0 / max(1.0, float(np.abs(rate).sum(axis=0).max()))
    c = rng.normal(size=d)
    outputs = rng.normal(size=(k, d)) * 10.0 ** rng.uniform(-12.0, 12.0, (k, 1))
    outputs *= np.sign(outputs @ c)[:, None]
    arguments = (rate, outputs, c, np.abs(c), 1.0, SHARE)
    place, crossed, end, sizes, *flags = implementation.taylor_step(*arguments)
    assert end == pytest.approx(expm(rate * place) @ c, rel=1e-12, abs=1e-13)
    for earlier in np.linspace(0.0, place, 40):
        c_then = expm(rate * earlier) @ c
        assert (outputs @ c_then >= -2e-11 * (np.abs(outputs) @ np.maximum(np.abs(c), sizes))).all()
    if crossed:
        assert outputs[crossed] @ end == pytest.approx(
            0.0, abs=1e-12 * float((np.abs(outputs) @ sizes).max())
        )
        assert (outputs[crossed] @ (expm(rate * min(place + 1e-6, 1.1)) @ c) < 0.0).all()
    twin = mode_twin.taylor_step(*arguments)
    assert (place, crossed) == (pytest.approx(twin[0], rel=1e-11), list(twin[1]))
    assert flags == list(twin[4:])
    assert sizes == pytest.approx(twin[3], rel=1e-11)


@pytest.mark.parametrize("seed", range(60))
def test_both_tell_the_same_signs(implementation: ModuleType, seed: int) -> None:
    """Integers, so that zeros are zeros: the sign is that of the first derivative that is not zero."""
    rng = np.random.default_rng(seed)
    d, k, N = (int(rng.integers(1, high)) for high in (6, 5, 7))
    rate = rng.integers(-1, 2, (d, d)) * (rng.random((d, d)) < 0.4) * 1.0
    outputs = rng.integers(-1, 2, (k, d)) * (rng.random((k, d)) < 0.5) * 1.0
    c = rng.integers(-2, 3, d) * 1.0
    orders = min(d, 4) + 1
    derivatives = np.array([outputs @ np.linalg.matrix_power(rate, order) for order in range(orders)])
    wanted = np.zeros(k)
    for order in range(d + 1):
        wanted = np.where(wanted == 0.0, np.sign(outputs @ np.linalg.matrix_power(rate, order) @ c), wanted)
    found = implementation.initial_signs(derivatives, rate, c, np.abs(c), SHARE, 1e-9)
    np.testing.assert_array_equal(found, wanted)
    impulses = rng.integers(-1, 2, (int(rng.integers(0, 4)), k, N)) * 1.0
    z = rng.integers(-1, 2, N) * 1.0
    leading = np.zeros(k)
    for values in impulses @ z:
        leading = np.where(leading == 0.0, np.sign(values), leading)
    np.testing.assert_array_equal(implementation.leading_signs(impulses, z, np.abs(z), SHARE), leading)
    matrix = rng.normal(size=(d, N))
    entered, sizes = implementation.enter_mode(matrix, z, np.abs(z))
    assert entered == pytest.approx(matrix @ z, abs=1e-12)
    assert sizes == pytest.approx(np.abs(matrix) @ np.abs(z))


def test_what_is_rounding_has_no_sign(implementation: ModuleType) -> None:
    zero, sizes = implementation.enter_mode(np.array([[1.0, -1.0]]), np.array([0.1 + 0.2, 0.3]), np.ones(2))
    assert (zero.tolist(), sizes.tolist()) == ([0.0], [2.0])
    fall = np.array([[0.0, 1.0], [0.0, 0.0]])
    for height, slope, sign in ((1e-12, -1.0, -1.0), (1e-10, -1.0, 1.0), (0.0, 1e-10, 0.0), (0.0, 1e-8, 1.0)):
        found = implementation.initial_signs(
            np.array([[[1.0, 0.0]]]), fall, np.array([height, slope]), np.ones(2), SHARE, 1e-9
        )
        assert found.tolist() == [sign]


def test_a_state_that_overflows_ends_the_step(implementation: ModuleType) -> None:
    rate = np.full((2, 2), 1e300)
    place, crossed, _, sizes, *_ = implementation.taylor_step(
        rate, np.eye(2), np.full(2, 1e300), np.full(2, 1e300), 1.0, SHARE
    )
    assert (place, list(crossed)) == (1.0, [])
    assert not np.isfinite(sizes).all()
