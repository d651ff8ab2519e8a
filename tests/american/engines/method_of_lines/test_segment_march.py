"""The compiled march over a segment against the stages in Python, and what it refuses."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from pricing_core import kernel
from pricing_core.american.book.resolution import Resolution
from pricing_core.american.contracts.schedule import Segment
from pricing_core.american.engines.method_of_lines import MethodOfLines, segment_march
from pricing_core.american.engines.method_of_lines.boundary_cell import BoundaryCellStage, region_in_cells
from pricing_core.american.engines.method_of_lines.grid import Grid, SpotRange
from pricing_core.american.engines.method_of_lines.segment_form import SegmentForm
from pricing_core.american.engines.method_of_lines.segment_march import _no_tangents, march_segment
from pricing_core.american.engines.method_of_lines.stage import (
    TridiagonalStage,
    UnconstrainedStage,
    start_state,
)
from pricing_core.american.engines.method_of_lines.time_mesh import graded_mesh
from pricing_core.errors import NumericalError
from pricing_core.stepping import FixedStep, ImplicitEuler, Sdirk2, integrate
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
SEEDS = 24
EXACT = 1e-11  # largest difference, as a share of the value's size
METHODS = {0: ImplicitEuler, 1: Sdirk2}


@dataclass(frozen=True)
class Case:
    """A segment with values at its end, and the times to march over."""

    form: SegmentForm
    values: np.ndarray
    times: np.ndarray


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


def discretise(segment, grid, sign, values):
    return SegmentForm.discretise(segment, grid, sign=sign, strike=100.0, values=values, watched=(1.0,))


def random_values(sign, segment, grid, rng):
    """Return a payoff, one that the holder holds to get, or what a European march makes of a payoff."""
    s, escrow = grid.nodes, segment.escrow / 100.0
    exercised = sign * (1.0 - escrow - s)
    payoff = np.maximum(sign * (1.0 - s), 0.0)
    kind = rng.choice(["payoff", "shifted", "smooth"])
    if kind == "shifted":
        payoff = np.maximum(sign * (1.0 - np.maximum(s - rng.uniform(0.0, 0.1), 0.0)), 0.0)
    if kind == "smooth":
        held = replace(segment, exercisable=False, volatility=0.3, end=0.2, start=0.0)
        form = discretise(held, grid, sign, payoff)
        run = integrate(
            ImplicitEuler(UnconstrainedStage(form)),
            start_state(form, payoff),
            (0.0, 0.2),
            controller=FixedStep(0.02),
        )
        payoff = form.everywhere(run.states[-1].value, 0.2)
    return np.maximum(payoff, exercised) if segment.exercisable else payoff


def random_case(kind, seed):
    rng = np.random.default_rng([KINDS.index(kind), seed])
    sign, segment = random_segment(kind, rng)
    grid = random_grid(kind, segment, rng)
    values = random_values(sign, segment, grid, rng)
    form = discretise(segment, grid, sign, values)
    mesh = "square-root" if rng.random() < 0.7 else "uniform"
    return Case(form, values, graded_mesh(mesh, segment.duration, int(rng.integers(4, 24))))


def marched_in_python(case, scheme):
    """Return the states and the exercise regions after every step."""
    form = case.form
    stage = (
        BoundaryCellStage(TridiagonalStage(form)) if form.segment.exercisable else UnconstrainedStage(form)
    )
    run = integrate(
        METHODS[scheme](stage),
        start_state(form, case.values),
        (0.0, float(case.times[-1])),
        controller=FixedStep(),
        stop_times=case.times[1:].tolist(),
    )
    regions = np.array([[r.lower, r.upper] for r in (region_in_cells(s, form) for s in run.states[1:])])
    return run.states, regions


def marched_by_kernel(case, scheme, *, values=None, contact=None, times=None):
    form, operator = case.form, case.form.operator
    return kernel.march_segment(
        form.grid.nodes,
        operator.lower,
        operator.diagonal,
        operator.upper,
        case.values if values is None else values,
        start_state(form, case.values).contact if contact is None else contact,
        case.times if times is None else times,
        scheme,
        form.sign,
        form.escrow,
        form.segment.rate,
        form.segment.dividend_yield,
        form.segment.exercisable,
        form.lines,
        *form.contact_at_ends().tolist(),
        *_no_tangents(form.grid.interior.size),
    )


@needs_kernel
@pytest.mark.parametrize("kind", KINDS)
def test_the_kernel_marches_as_the_stages_in_python_do(kind):
    boundaries = 0
    for seed in range(SEEDS):
        case, scheme = random_case(kind, seed), seed % 2
        states, regions = marched_in_python(case, scheme)
        values, slack, contact, multiplier, residual, found, _ = marched_by_kernel(case, scheme)
        last, size = states[-1], max(1.0, float(np.abs(states[-1].value).max()))
        expected = case.form.everywhere(last.value, case.form.segment.duration)
        scale = np.maximum(case.form.grid.nodes, size)  # v is g + z, both of which are like s far out
        assert np.all(np.abs(values - expected) <= EXACT * scale), seed
        np.testing.assert_array_equal(contact, last.contact, err_msg=f"{seed}")
        h = float(np.diff(case.times)[-1])
        assert np.all(np.abs(multiplier - last.multiplier) <= EXACT / min(h, 0.01) * scale[1:-1]), seed
        if case.form.segment.exercisable:
            assert np.all(np.abs(slack - last.slack) <= EXACT * scale[1:-1]), seed
        assert residual == pytest.approx(max(state.residual for state in states), rel=0.5, abs=1e-12 * size)
        np.testing.assert_array_equal(np.isinf(found), np.isinf(regions), err_msg=f"{seed}")
        np.testing.assert_allclose(found, regions, rtol=1e-6, err_msg=f"{seed}")
        boundaries += int(np.isfinite(found).sum())
    assert (boundaries > 0) == (kind != "european")


@pytest.mark.parametrize(
    ("kind", "one_sided"), [("put", True), ("call", True), ("put with two boundaries", False)]
)
def test_the_segments_need_both_ways_to_solve_a_stage(kind, one_sided):
    ends = [random_case(kind, seed).form.contact_at_ends() for seed in range(SEEDS)]
    assert any((left != right) == one_sided for left, right in ends)


@needs_kernel
@pytest.mark.parametrize("kind", KINDS)
def test_portions_give_bit_for_bit_what_the_whole_gives(kind):
    case = random_case(kind, 0)
    whole = marched_by_kernel(case, 1)
    first = marched_by_kernel(case, 1, times=case.times[:3])
    rest = marched_by_kernel(case, 1, values=first[0], contact=first[2], times=case.times[2:])
    for part in (0, 1, 2, 3):
        np.testing.assert_array_equal(whole[part], rest[part])
    assert whole[4] == max(first[4], rest[4])
    np.testing.assert_array_equal(whole[5], np.concatenate([first[5], rest[5]]))


@needs_kernel
def test_no_argument_is_modified_and_views_with_strides_will_do():
    case = random_case("put", 1)
    values, contact = np.repeat(case.values, 2)[::2], np.zeros(case.values.size - 2, dtype=np.bool_)
    before = values.copy()
    found = marched_by_kernel(case, 1, values=values, contact=contact)
    np.testing.assert_array_equal(found[0], marched_by_kernel(case, 1, contact=contact)[0])
    np.testing.assert_array_equal(values, before)
    assert not contact.any()


@needs_kernel
def test_what_does_not_fit_is_refused():
    case = random_case("put", 0)
    with pytest.raises(ValueError, match="values has length"):
        marched_by_kernel(case, 1, values=case.values[1:])
    with pytest.raises(ValueError, match="contact has length"):
        marched_by_kernel(case, 1, contact=np.zeros(3, dtype=np.bool_))
    with pytest.raises(ValueError, match="scheme must be 0 or 1"):
        marched_by_kernel(case, 2)
    lined = replace(case, form=replace(case.form, lines=np.zeros((2, 3))))
    with pytest.raises(ValueError, match=r"lines must have the shape \(2, 2\)"):
        marched_by_kernel(lined, 1)


@needs_kernel
@pytest.mark.parametrize("exercisable", [True, False])
def test_a_singular_matrix_is_told(exercisable):
    # 1 - h L = 0 in every row.
    case = random_case("put", 0)
    form = replace(case.form, segment=replace(case.form.segment, exercisable=exercisable))
    nothing, one = np.zeros(case.values.size - 2), np.ones(case.values.size - 2)
    form = replace(form, operator=replace(form.operator, lower=nothing, diagonal=one, upper=nothing))
    with pytest.raises(ZeroDivisionError, match="pivot"):
        marched_by_kernel(Case(form, case.values, case.times), 0, times=np.array([0.0, 1.0]))
    resolution = Resolution(scheme="implicit-euler", time_mesh="uniform")
    lasting = replace(form, segment=replace(form.segment, end=4.0))
    with pytest.raises(NumericalError, match="take more time steps"):
        march_segment(lasting, case.values, 4, resolution)


@needs_kernel
@pytest.mark.parametrize("kind", ["put", "call with two boundaries", "european", "escrow"])
@pytest.mark.parametrize("time_mesh", ["square-root", "uniform"])
def test_a_long_march_with_times_to_look_at_is_that_of_the_stages(kind, time_mesh, monkeypatch):
    case, resolution = random_case(kind, 3), Resolution(time_mesh=time_mesh)
    duration = case.form.segment.duration
    wanted = (duration, 0.713 * duration, 0.34 * duration, 1e-4 * duration)
    found = march_segment(case.form, case.values, 150, resolution, wanted=wanted)
    monkeypatch.setattr(kernel, "march_segment", None)
    expected = march_segment(case.form, case.values, 150, resolution, wanted=wanted)
    assert np.all(np.abs(found.values - expected.values) <= EXACT * np.maximum(case.form.grid.nodes, 1.0))
    np.testing.assert_array_equal(found.contact, expected.contact)
    assert found.steps == expected.steps >= 152
    for mine, theirs in zip(
        (found.region, *found.regions), (expected.region, *expected.regions), strict=True
    ):
        assert (mine.lower, mine.upper) == pytest.approx((theirs.lower, theirs.upper), rel=1e-8)
    assert found.regions[0] == found.region
    assert found.residual == pytest.approx(expected.residual, abs=1e-13)


@needs_kernel
def test_the_interrupt_is_asked_before_every_portion(monkeypatch):
    case, asked = random_case("put", 0), []
    monkeypatch.setattr(segment_march, "PORTION", 64 * case.form.grid.nodes.size)

    def interrupt():
        asked.append(None)
        return len(asked) == 4

    assert march_segment(case.form, case.values, 192, Resolution(), interrupt=interrupt) is not None
    assert len(asked) == 3
    assert march_segment(case.form, case.values, 192, Resolution(), interrupt=interrupt) is None


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
def test_what_the_kernel_does_not_march_is_left_to_the_stages(resolution, lcp_method, rate, monkeypatch):
    case = random_case("put", 0)
    segment = replace(case.form.segment, end=1.0, rate=rate)
    form = discretise(segment, case.form.grid, 1.0, case.values)

    def refuse(*_):
        raise AssertionError("the kernel was called")

    monkeypatch.setattr(kernel, "march_segment", refuse)
    run = march_segment(form, case.values, 8, resolution, lcp_method=lcp_method, wanted=(0.5, 1.0))
    assert run.steps >= 8
    assert run.values.size == case.values.size
    assert run.regions[1] == run.region


@needs_kernel
@pytest.mark.parametrize("scheme", ["sdirk2", "implicit-euler"])
@pytest.mark.parametrize(
    "name", ["put, half the spot", "put, escrowed", "call, curves", "put, monthly dates"]
)
def test_whole_schedules_are_solved_as_by_the_stages(name, scheme, monkeypatch):
    engine = MethodOfLines(scheme)
    found = solved(engine, CONTRACTS[name], tolerance=1e-4)
    monkeypatch.setattr(kernel, "march_segment", None)
    expected = solved(engine, CONTRACTS[name], tolerance=1e-4)
    for part in ("value", "error", "delta", "gamma", "european", "boundary"):
        np.testing.assert_allclose(
            getattr(found, part), getattr(expected, part), rtol=1e-9, atol=1e-9, err_msg=part
        )
    assert (found.solves.item(), found.steps.item()) == (expected.solves.item(), expected.steps.item())
