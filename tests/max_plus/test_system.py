"""Systems: implicit and explicit, of higher order, composed, fast and late; each against the recursion itself."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pricing_core.errors import InvalidInputError, NumericalError
from pricing_core.max_plus import (
    ImplicitSystem,
    MaxPlusSystem,
    cycle_time,
    eigenvalue,
    exact,
    feedback,
    just_in_time,
    latency,
    parallel,
    series,
    simulate,
    sparse,
    throughput,
)
from tests.problems.max_plus_problems import KNOWN, E

DUTCH = KNOWN[3]
seeds = st.integers(0, 2**32 - 1)


def random_matrix(random, rows, columns, density=0.6):
    return np.where(random.random((rows, columns)) < density, random.integers(-3, 9, (rows, columns)), E)


def random_system(random, n, m, p, direct=False):
    D = random_matrix(random, p, m) if direct else None
    return MaxPlusSystem(
        random_matrix(random, n, n), random_matrix(random, n, m), random_matrix(random, p, n), D
    )


def max_plus_by_hand(A, x):
    return np.array([max(a + b for a, b in zip(row, x, strict=True)) for row in A])


def outputs(system, u):
    """Run from epsilon and return y(0) ... y(K) for u(0) ... u(K)."""
    x, y = np.full(len(system.A), E), []
    for row in u:
        y.append(np.maximum(max_plus_by_hand(system.C, x), max_plus_by_hand(system.D, row)))
        x = np.maximum(max_plus_by_hand(system.A, x), max_plus_by_hand(system.B, row))
    return np.array(y)


@pytest.mark.parametrize("known", [k for k in KNOWN if k.orbit], ids=str)
@pytest.mark.parametrize("storage", [np.array, exact, sparse])
def test_the_orbits_of_the_literature(known, storage):
    found = simulate(storage(known.A), known.orbit[0], len(known.orbit) - 1)
    np.testing.assert_array_equal(found.x, known.orbit)
    assert found.y is None


def test_the_dutch_railroad_runs_every_quarter_of_an_hour():
    """cmlib, sdf_railroad: throughput 1/4."""
    system = MaxPlusSystem(DUTCH.A, [[E], [E], [2.0], [2.0]], [[E, 2.0, 4.0, E]])
    np.testing.assert_array_equal(throughput(system), [0.25])


@given(seeds, st.integers(1, 3), st.integers(1, 3))
@settings(max_examples=60, deadline=None)
def test_an_implicit_system_of_higher_order_keeps_its_recursion(seed, n, order):
    random = np.random.default_rng(seed)
    A = [np.where(np.tri(n, k=-1) > 0, random_matrix(random, n, n), E)]
    A += [random_matrix(random, n, n) for _ in range(order)]
    B, C = random_matrix(random, n, 2), random_matrix(random, 1, n)
    system = ImplicitSystem(A, B, C).explicit()
    past, u = random.integers(0, 9, (order, n)).astype(float), random.integers(0, 30, (6, 2)).astype(float)
    found = simulate(system.A, past[::-1].ravel(), 6, system.B, u, system.C)
    rows = list(past)
    for k in range(6):
        x = found.x[k + 1, :n]
        expected = np.maximum(max_plus_by_hand(A[0], x), max_plus_by_hand(B, u[k]))
        for m in range(order):
            expected = np.maximum(expected, max_plus_by_hand(A[m + 1], rows[-1 - m]))
        np.testing.assert_array_equal(x, expected)
        np.testing.assert_array_equal(found.y[k + 1], max_plus_by_hand(C, x))
        rows.append(x)


def test_events_that_wait_for_themselves_are_named():
    A0 = [[E, 1.0, E], [-0.5, E, E], [E, 3.0, E]]
    with pytest.raises(NumericalError, match="circuit bus -> train -> bus of A0 has a positive weight"):
        ImplicitSystem([A0, np.zeros((3, 3))], names=["bus", "train", "ferry"]).explicit()


@given(seeds)
@settings(max_examples=50, deadline=None)
def test_composed_systems_do_what_their_parts_do_together(seed):
    random = np.random.default_rng(seed)
    first, second = random_system(random, 2, 2, 3, True), random_system(random, 3, 3, 2, True)
    other = random_system(random, 3, 2, 3, True)
    u = random.integers(0, 30, (7, 2)).astype(float)
    np.testing.assert_array_equal(outputs(series(first, second), u), outputs(second, outputs(first, u)))
    np.testing.assert_array_equal(
        outputs(parallel(first, other), u), np.maximum(outputs(first, u), outputs(other, u))
    )


@given(seeds)
@settings(max_examples=50, deadline=None)
def test_a_loop_makes_the_inputs_wait_for_the_outputs(seed):
    random = np.random.default_rng(seed)
    system, K = random_system(random, 3, 2, 2, True), random_matrix(random, 2, 2) - 20.0
    closed = feedback(system, K)
    v = random.integers(0, 30, (7, 2)).astype(float)
    y = outputs(closed, v)
    u = np.array([np.maximum(one, max_plus_by_hand(K, seen)) for one, seen in zip(v, y, strict=True)])
    np.testing.assert_array_equal(outputs(system, u), y)


def test_a_loop_without_delay_is_named():
    system = MaxPlusSystem([[1.0]], [[0.0]], [[0.0]], [[2.0]])
    with pytest.raises(NumericalError, match="circuit 0 -> 0 of the inputs"):
        feedback(system, [[1.0]])


@given(seeds)
@settings(max_examples=60, deadline=None)
def test_the_latency_is_what_a_periodic_input_ends_with(seed):
    random = np.random.default_rng(seed)
    system = random_system(random, 3, 2, 2, True)
    period = float(np.ceil(max(*cycle_time(system.A), 0.0))) + 1.0
    k = np.arange(40)[:, None]
    found = latency(system, period)
    for j in range(2):
        u = np.where(np.arange(2) == j, k * period, E)
        y = outputs(system, u) - k * period
        np.testing.assert_array_equal(y[-1], found[:, j])
        assert (y <= found[:, j]).all()


def test_behind_a_slower_system_the_latency_is_top():
    np.testing.assert_array_equal(latency(MaxPlusSystem([[2.0]], [[3.0]]), 1.0), [[np.inf]])
    with pytest.raises(NumericalError, match="no circuit"):
        latency(MaxPlusSystem([[E]], [[3.0]]))


@given(seeds)
@settings(max_examples=60, deadline=None)
def test_just_in_time_keeps_the_reference_and_no_input_could_be_later(seed):
    random = np.random.default_rng(seed)
    system = random_system(random, 3, 2, 2)
    reference = random.integers(10, 60, (6, 2)).astype(float)
    found = just_in_time(system, reference)
    assert (found.y <= reference).all()
    for k, j in np.ndindex(found.u.shape):
        if np.isfinite(found.u[k, j]):
            later = np.where(found.u == np.inf, 1e6, found.u)
            later[k, j] += 1.0
            y = outputs(system, np.vstack([later, np.full((1, 2), E)]))
            assert (y > reference).any()


def test_exact_systems_stay_exact():
    third = Fraction(1, 3)
    system = ImplicitSystem([exact([[E, E], [third, E]]), exact([[third, E], [E, third]])]).explicit()
    assert eigenvalue(system.A) == third
    assert simulate(system.A, exact([0, 0]), 3).x[3].tolist() == [1, Fraction(4, 3)]


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda: MaxPlusSystem([[1.0, 2.0]]), "A"),
        (lambda: MaxPlusSystem([[1.0]], [[1.0], [2.0]]), "B"),
        (lambda: MaxPlusSystem([[1.0]], C=[[1.0, 2.0]]), "C"),
        (lambda: MaxPlusSystem([[1.0]], D=[[1.0, 2.0]]), "D"),
        (lambda: MaxPlusSystem([[np.inf]]), "A"),
        (lambda: ImplicitSystem([[[1.0]]]), "A"),
        (lambda: ImplicitSystem([[[1.0]], [[1.0, 2.0]]]), "A[1]"),
        (lambda: simulate([[1.0]], [1.0, 2.0], 3), "x0"),
        (lambda: simulate([[1.0]], [np.inf], 3), "x0"),
        (lambda: simulate([[1.0]], [1.0], -1), "steps"),
        (lambda: simulate([[1.0]], [1.0], 2, B=[[1.0]]), "u"),
        (lambda: simulate([[1.0]], [1.0], 2, B=[[1.0]], u=[[1.0]]), "u"),
        (lambda: simulate([[1.0]], [1.0], 2, B=[[1.0], [1.0]], u=[[1.0], [1.0]]), "B"),
        (lambda: simulate([[1.0]], [1.0], 2, C=[[1.0, 1.0]]), "C"),
        (lambda: series(MaxPlusSystem([[1.0]]), MaxPlusSystem([[1.0]], [[1.0, 1.0]])), "second"),
        (lambda: parallel(MaxPlusSystem([[1.0]]), MaxPlusSystem([[1.0]], [[1.0, 1.0]])), "second"),
        (lambda: feedback(MaxPlusSystem([[1.0]]), [[1.0, 1.0]]), "K"),
        (lambda: just_in_time(MaxPlusSystem([[1.0]]), [[1.0]]), "reference"),
        (lambda: just_in_time(MaxPlusSystem([[1.0]], D=[[1.0]]), [[1.0], [2.0]]), "system"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(call, field):
    with pytest.raises(InvalidInputError) as caught:
        call()
    assert caught.value.field == field


def test_no_steps_give_the_start_alone():
    found = simulate([[1.0]], [5.0], 0, B=[[1.0]], u=np.zeros((0, 1)), C=[[2.0]])
    np.testing.assert_array_equal(found.x, [[5.0]])
    np.testing.assert_array_equal(found.y, [[7.0]])


THIRD = exact([[Fraction(1, 3)]])


@pytest.mark.parametrize("first", [THIRD, [[0.5]]])
@pytest.mark.parametrize("second", [THIRD, [[0.25]]])
def test_floats_win_over_exact_numbers_wherever_both_meet(first, second):
    one, other = MaxPlusSystem(first, first), MaxPlusSystem(second, second)
    kind = np.dtype(object) if first is THIRD and second is THIRD else np.dtype(np.float64)
    a, b = (THIRD[0, 0] if A is THIRD else Fraction(A[0][0]) for A in (first, second))
    found = [
        (series(one, other).A, [[a, E], [b, b]]),
        (parallel(one, other).A, [[a, E], [E, b]]),
        (feedback(other, first).A, [[max(b, a + b)]]),
        (MaxPlusSystem(first, second).B, [[b]]),
        (ImplicitSystem([-np.abs(first), second], second).explicit().B, [[b]]),
        (simulate(first, second[0], 2).x, [[b], [a + b], [2 * a + b]]),
        (simulate(first, first[0], 1, B=second, u=second).x, [[a], [max(2 * a, 2 * b)]]),
        (latency(one, second[0][0]), [[np.inf if a > b else a - b]]),
    ]
    for values, expected in found:
        assert values.dtype == kind
        np.testing.assert_allclose(values.astype(float), np.array(expected, dtype=float), rtol=1e-15)


def test_a_whole_period_keeps_an_exact_system_exact():
    assert latency(MaxPlusSystem(THIRD, THIRD), 2).tolist() == [[Fraction(-5, 3)]]


@pytest.mark.parametrize("period", [np.inf, -np.inf, np.nan, "x", True])
def test_what_is_no_period_is_refused(period):
    with pytest.raises(InvalidInputError) as caught:
        latency(MaxPlusSystem([[1.0]], [[0.0]]), period)
    assert caught.value.field == "period"


@given(seeds)
@settings(max_examples=50, deadline=None)
def test_at_its_own_pace_no_system_falls_behind_by_rounding(seed):
    a, b = 1e6 + np.random.default_rng(seed).random(2)
    found = latency(MaxPlusSystem([[E, a], [b, E]], [[0.0], [0.0]]))
    half = (a - b) / 2
    np.testing.assert_allclose(found, [[max(half, 0.0)], [max(-half, 0.0)]] - (a + b) / 2, rtol=1e-15)


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda: series(None, MaxPlusSystem([[1.0]])), "first"),
        (lambda: parallel(MaxPlusSystem([[1.0]]), [[1.0]]), "second"),
        (lambda: feedback(5, [[1.0]]), "system"),
        (lambda: latency([[1.0]]), "system"),
        (lambda: throughput("x"), "system"),
        (lambda: just_in_time(None, [[1.0], [2.0]]), "system"),
        (lambda: ImplicitSystem(5), "A"),
        (lambda: ImplicitSystem(np.array(5.0)), "A"),
        (lambda: ImplicitSystem([[[E]], [[1.0]]], names=["a", "b"]), "names"),
    ],
)
def test_what_is_no_system_is_refused_by_name(call, field):
    with pytest.raises(InvalidInputError) as caught:
        call()
    assert caught.value.field == field
