"""The compiled solve of a schedule against the segments in Python, and what it refuses."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pricing_core import kernel
from pricing_core.american.book.resolution import Resolution
from pricing_core.american.contracts.schedule import Schedule, Segment
from pricing_core.american.engines.exercise_region import EMPTY_REGION
from pricing_core.american.engines.method_of_lines import MethodOfLines
from pricing_core.american.engines.method_of_lines.grid import Grid, SpotRange
from pricing_core.american.engines.method_of_lines.sweep import sweep_schedule, sweep_together
from pricing_core.american.engines.method_of_lines.sweep_problem import SweepRequest
from pricing_core.errors import NumericalError
from tests.problems.engines import solved
from tests.problems.needs_kernel import needs_kernel
from tests.problems.schedules import CONTRACTS

KINDS = (
    "put",
    "call",
    "put with two boundaries",
    "call with two boundaries",
    "european",
    "escrow",
    "next to no volatility",
    "no volatility",
    "down to zero",
    "uneven",
    "stretched",
    "short",
    "long",
    "negative rate",
)
SEEDS = 10
EXACT = 1e-11  # largest difference, as a share of the value's size


def random_segment(kind, rng):
    rate, dividend_yield = rng.uniform(0.0, 0.1), rng.choice([0.0, rng.uniform(0.0, 0.08)])
    volatility, duration = rng.uniform(0.08, 0.6), float(np.exp(rng.uniform(np.log(0.02), np.log(2.0))))
    sign = float(rng.choice([1.0, -1.0]))
    if kind in ("put", "call"):
        sign = 1.0 if kind == "put" else -1.0
    elif kind == "put with two boundaries":
        sign, rate = 1.0, -rng.uniform(0.002, 0.03)
        dividend_yield = rate - rng.uniform(0.002, 0.05)
    elif kind == "call with two boundaries":
        sign, dividend_yield = -1.0, -rng.uniform(0.002, 0.03)
        rate = dividend_yield - rng.uniform(0.002, 0.05)
    elif kind == "next to no volatility":
        volatility = float(np.exp(rng.uniform(np.log(1e-6), np.log(0.02))))
    elif kind == "no volatility":
        volatility = 0.0
    elif kind == "short":
        duration = float(np.exp(rng.uniform(np.log(1e-8), np.log(1e-3))))
    elif kind == "long":
        duration = rng.uniform(5.0, 30.0)
    elif kind == "negative rate":
        rate = -rng.uniform(0.0, 0.1)
    escrow = 100.0 * rng.uniform(0.001, 0.3) if kind == "escrow" else 0.0
    exercisable = kind != "european"
    return sign, Segment(
        0.0, duration, rate, dividend_yield, volatility, exercisable, exercisable, 0.0, 0.0, 0.0, escrow
    )


def random_schedule(kind, rng):
    """Return up to three segments, with dividends of both kinds and dates on which the holder may not exercise."""
    sign, first = random_segment(kind, rng)
    segments, start = [], 0.0
    for _ in range(int(rng.integers(1, 4))):
        amount = float(rng.choice([0.0, rng.uniform(0.1, 5.0), 60.0], p=[0.4, 0.5, 0.1]))
        segments.append(
            replace(
                first,
                start=start,
                end=start + first.end * rng.uniform(0.2, 1.0),
                volatility=first.volatility * rng.uniform(0.7, 1.3),
                exercisable=first.exercisable and rng.random() < 0.9,
                exercise_at_end=first.exercise_at_end and rng.random() < 0.9,
                fraction=float(rng.choice([0.0, rng.uniform(0.0, 0.1)])),
                amount=amount,
                due=amount,
            )
        )
        start = segments[-1].end
    return Schedule(sign > 0.0, 100.0, 100.0 * rng.uniform(0.8, 1.2), tuple(segments))


def random_grid(kind, segment, rng):
    spread = max(segment.volatility * math.sqrt(segment.duration), 0.02)
    reach = rng.uniform(3.0, 7.0) * spread + abs(segment.rate - segment.dividend_yield) * segment.duration
    high, shift = math.exp(min(reach, 20.0)), 0.5 * math.exp(-min(reach, 20.0))
    to_zero = kind == "down to zero" or rng.random() < 0.2
    span = SpotRange(0.0, high, shift, spread) if to_zero else SpotRange(2.0 * shift, high, 0.0, spread)
    stretching = rng.uniform(1.0, 6.0) if kind == "stretched" else float(rng.choice([0.0, 1.0]))
    nodes = span.grid(int(rng.integers(12, 120)), stretching).nodes
    if kind == "uneven":
        nodes[1:-1] += rng.uniform(-0.4, 0.4, nodes.size - 2) * np.minimum(
            np.diff(nodes)[1:], np.diff(nodes)[:-1]
        )
    return Grid(nodes)


def random_problem(kind, seed):
    rng = np.random.default_rng([KINDS.index(kind), seed])
    schedule = random_schedule(kind, rng)
    expiry = schedule.segments[-1].end
    widest = max(schedule.segments, key=lambda segment: segment.volatility)
    grid = random_grid(kind, replace(widest, start=0.0, end=expiry), rng)
    times = tuple(sorted(expiry * (1.0 - rng.uniform(0.0, 1.0, 4) ** 3)))
    resolution = Resolution(
        steps=int(rng.integers(4, 24)),
        time_mesh="square-root" if rng.random() < 0.7 else "uniform",
        scheme="implicit-euler" if seed % 2 else "sdirk2",
    )
    return schedule, grid, resolution, (0.0, *times, expiry)


def both(monkeypatch, schedule, grid, resolution, times):
    """Return the solve by the kernel and the one in Python."""
    request = SweepRequest(schedule, grid, resolution, times=times)
    found = sweep_schedule(request)
    with monkeypatch.context() as patch:
        patch.setattr(kernel, "sweep_schedules", None)
        return found, sweep_schedule(request)


@needs_kernel
@pytest.mark.parametrize("kind", KINDS)
def test_the_kernel_solves_schedules_as_the_segments_in_python_do(kind, monkeypatch):
    boundaries = 0
    for seed in range(SEEDS):
        problem = random_problem(kind, seed)
        found, expected = both(monkeypatch, *problem)
        size = max(1.0, float(np.abs(expected.values).max()))
        scale = np.maximum(problem[1].nodes, size)  # v is g + z, both of which are like s far out
        assert np.all(np.abs(found.values - expected.values) <= EXACT * scale), seed
        assert found.at_zero == pytest.approx(expected.at_zero, abs=EXACT * size)
        np.testing.assert_array_equal(found.contact, expected.contact, err_msg=f"{seed}")
        assert (found.steps, found.fitted) == (expected.steps, expected.fitted)
        assert found.residual == pytest.approx(expected.residual, rel=0.5, abs=1e-12 * size)
        pairs = zip((found.region, *found.regions), (expected.region, *expected.regions), strict=True)
        for mine, theirs in pairs:
            assert (mine.lower, mine.upper) == pytest.approx((theirs.lower, theirs.upper), rel=1e-6), seed
            boundaries += mine != EMPTY_REGION
    assert (boundaries > 0) == (kind != "european")


@needs_kernel
def test_a_sweep_has_the_same_bits_alone_and_beside_any_others():
    rng = np.random.default_rng(11)
    requests = []
    for seed in range(8):
        for kind in KINDS:
            schedule, grid, resolution, times = random_problem(kind, seed)
            # Few numbers of nodes, so that many share the lanes of one march.
            low, high = grid.nodes[[0, -1]].tolist()
            shift = 0.5 * high / 50.0 if low == 0.0 else 0.0
            grid = SpotRange(low, high, shift, 0.2).grid(int(rng.choice([16, 40])), 1.0)
            requests.append(SweepRequest(schedule, grid, resolution, times=times))
    requests += [replace(requests[0], grid=Grid(np.array([0.5, 0.8, 1.0, 1.1, 1.5])))]
    alone = [sweep_schedule(request) for request in requests]
    some = [*range(0, len(requests), 2)]
    for chosen in (range(len(requests)), rng.permutation(len(requests)).tolist(), some):
        found = sweep_together([requests[place] for place in chosen])
        for place, sweep in zip(chosen, found, strict=True):
            for part in ("values", "contact"):
                np.testing.assert_array_equal(getattr(sweep, part), getattr(alone[place], part))
            for part in ("at_zero", "region", "regions", "residual", "steps", "fitted"):
                assert getattr(sweep, part) == getattr(alone[place], part)


@needs_kernel
def test_a_sweep_that_fails_leaves_the_others_alone(monkeypatch):
    monkeypatch.setattr(
        "pricing_core.american.engines.method_of_lines.sweep.kernel_sweeps", lambda problem: True
    )
    segment = Segment(0.0, 4.0, -1.0, -1.0, 0.0, True, True, 0.0, 0.0, 0.0, 0.0)
    grid, resolution = Grid(np.linspace(0.5, 2.0, 16)), Resolution(8, 4, "uniform", "implicit-euler")
    singular = SweepRequest(Schedule(True, 100.0, 100.0, (segment,)), grid, resolution)
    regular = replace(
        singular, schedule=replace(singular.schedule, segments=(replace(segment, rate=0.05, volatility=0.2),))
    )
    found = sweep_together([singular if k % 3 == 0 else regular for k in range(12)])
    expected = sweep_schedule(regular)
    for k, sweep in enumerate(found):
        if k % 3 == 0:
            assert isinstance(sweep, NumericalError)
        else:
            np.testing.assert_array_equal(sweep.values, expected.values)


def arguments(**changes):
    """Return the kernel's arguments for a put of one segment."""
    given = {
        "nodes": np.linspace(0.5, 2.0, 16),
        "segments": np.array([[0.05, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0]]),
        "times": np.linspace(0.0, 1.0, 5),
        "first_time": np.array([0, 5]),
        "scheme": 1,
        "sign": 1.0,
        "watched": np.ones(1),
        "directions": np.zeros((0, 1, 2, 6)),
        "steps": np.zeros(0),
        "local": (np.zeros((1, 0, 0)), np.zeros((0, 0)), np.array([0, 0]), 0.0),
    }
    return given | changes


def flat(value):
    """Return the entries of a tuple, or the one value."""
    return value if isinstance(value, tuple) else (value,)


def swept(given, interrupt=None):
    """Return what the kernel finds of one sweep."""
    found = kernel.sweep_schedules([tuple(given.values())], interrupt)
    return None if found is None else found[0]


@needs_kernel
def test_no_argument_is_modified_and_views_with_strides_will_do():
    variances = np.linspace(0.04, 0.1, 28).reshape(1, 2, 14)
    given = arguments(local=(variances, np.array([[0.4, 0.6]]), np.array([0, 1]), 0.2))

    def each(do, value):
        if isinstance(value, tuple):
            return tuple(each(do, entry) for entry in value)
        return do(value) if isinstance(value, np.ndarray) else value

    before = {name: each(np.copy, value) for name, value in given.items()}
    strided = {
        name: each(lambda array: np.repeat(array, 2, axis=0)[::2], value) for name, value in given.items()
    }
    np.testing.assert_array_equal(swept(given)[0], swept(strided)[0])
    for name, value in before.items():
        for old, new in zip(flat(value), flat(given[name]), strict=True):
            np.testing.assert_array_equal(old, new)


@needs_kernel
@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"nodes": np.linspace(0.5, 2.0, 4)}, "nodes has length"),
        ({"segments": np.zeros((1, 7))}, "segments must have the shape"),
        ({"segments": np.zeros((0, 9))}, "segments must have the shape"),
        ({"first_time": np.array([0, 4])}, "first_time must"),
        ({"scheme": 2}, "scheme must be 0 or 1"),
        ({"directions": np.zeros((1, 1, 2, 6))}, "directions must have the shape"),
        ({"directions": np.zeros((1, 2, 2, 6)), "steps": np.ones(1)}, "directions must have the shape"),
        ({"local": (np.zeros((1, 0, 0)), np.zeros((0, 0)), np.array([0, 2]), 0.0)}, "first_row must"),
        (
            {"local": (np.zeros((1, 1, 14)), np.ones((2, 1)), np.array([0, 2]), 0.0)},
            "weights must have no row",
        ),
        (
            {"local": (np.zeros((1, 1, 13)), np.ones((1, 1)), np.array([0, 1]), 0.0)},
            "weights must have no row",
        ),
        (
            {"local": (np.zeros((1, 2, 14)), np.ones((1, 1)), np.array([0, 1]), 0.0)},
            "weights must have no row",
        ),
    ],
)
def test_what_does_not_fit_is_refused(changes, told):
    with pytest.raises(ValueError, match=told):
        swept(arguments(**changes))


@needs_kernel
@pytest.mark.parametrize("exercisable", [True, False])
def test_a_singular_matrix_is_told(exercisable, monkeypatch):
    # Without volatility and drift 1 - h L = 1 + h r in every row: 0 for h = 1 and r = -1.
    segment = Segment(0.0, 1.0, -1.0, -1.0, 0.0, exercisable, exercisable, 0.0, 0.0, 0.0, 0.0)
    columns = np.array([[-1.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, exercisable, exercisable]])
    singular = arguments(
        segments=columns,
        scheme=0,
        times=np.array([0.0, 1.0]),
        first_time=np.array([0, 2]),
    )
    assert swept(singular) is None
    monkeypatch.setattr(
        "pricing_core.american.engines.method_of_lines.sweep.kernel_sweeps", lambda problem: True
    )
    schedule, grid = (
        Schedule(True, 100.0, 100.0, (replace(segment, end=4.0),)),
        Grid(np.linspace(0.5, 2.0, 16)),
    )
    with pytest.raises(NumericalError, match="take more time steps"):
        sweep_schedule(SweepRequest(schedule, grid, Resolution(8, 4, "uniform", "implicit-euler")))


@needs_kernel
def test_the_interrupt_is_asked_before_the_kernel_and_inside():
    schedule, grid, resolution, _ = random_problem("put", 0)
    assert sweep_schedule(SweepRequest(schedule, grid, resolution), lambda: True) is None
    asked = []

    def interrupt():
        asked.append(None)
        return len(asked) == 3

    fine = SpotRange(0.3, 3.0, 0.0, 0.3).grid(4000, 0.0)
    request = SweepRequest(schedule, fine, replace(resolution, steps=20_000))
    assert sweep_schedule(request, interrupt) is None
    assert len(asked) == 3


@needs_kernel
def test_an_error_of_the_interrupt_reaches_the_caller():
    def interrupt():
        raise KeyError("asked")

    given = arguments(nodes=np.linspace(0.5, 2.0, 4000), times=np.linspace(0.0, 1.0, 20_000))
    with pytest.raises(KeyError, match="asked"):
        swept(given | {"first_time": np.array([0, 20_000])}, interrupt)


@pytest.mark.parametrize(
    ("resolution", "lcp_method", "rate"),
    [
        (Resolution(scheme="crank-nicolson"), "tridiagonal", 0.05),
        (Resolution(time_mesh="adaptive"), "tridiagonal", 0.05),
        (Resolution(), "policy", 0.05),
        (Resolution(), "psor", 0.05),
        (Resolution(), "lemke", 0.05),
        (Resolution(scheme="implicit-euler"), "tridiagonal", -20.0),  # 1 + h rate < 0
    ],
)
def test_what_the_kernel_does_not_solve_is_left_to_the_stages(resolution, lcp_method, rate, monkeypatch):
    segment = Segment(0.0, 1.0, rate, 0.0, 0.2, True, True, 0.0, 0.0, 0.0, 0.0)
    schedule, grid = Schedule(True, 100.0, 100.0, (segment,)), SpotRange(0.3, 3.0, 0.0, 0.3).grid(32, 0.0)

    def refuse(*_):
        raise AssertionError("the kernel was called")

    monkeypatch.setattr(kernel, "sweep_schedules", refuse)
    run = sweep_schedule(SweepRequest(schedule, grid, replace(resolution, steps=8), lcp_method, (0.0, 0.5)))
    assert run.steps >= 8
    assert run.values.size == grid.nodes.size
    assert run.regions[0] == run.region


@needs_kernel
@pytest.mark.parametrize("scheme", ["sdirk2", "implicit-euler"])
@pytest.mark.parametrize(
    "name", ["put, half the spot", "put, escrowed", "call, curves", "put, monthly dates"]
)
def test_whole_schedules_are_solved_as_by_the_stages(name, scheme, monkeypatch):
    engine = MethodOfLines(scheme)
    found = solved(engine, CONTRACTS[name], tolerance=1e-4)
    monkeypatch.setattr(kernel, "sweep_schedules", None)
    expected = solved(engine, CONTRACTS[name], tolerance=1e-4)
    for part in ("value", "error", "delta", "gamma", "european", "boundary"):
        np.testing.assert_allclose(
            getattr(found, part), getattr(expected, part), rtol=1e-9, atol=1e-9, err_msg=part
        )
    assert (found.solves.item(), found.steps.item()) == (expected.solves.item(), expected.steps.item())
