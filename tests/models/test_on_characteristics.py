"""What is reported of relays and characteristics: points on them, and the pieces that these points are on."""

import numpy as np
import pytest

from pricing_core.models import (
    Characteristic,
    PiecewiseLinearSystem,
    RelaySystem,
    ideal_diode,
    relay_step,
    saturation,
)
from tests.problems.nightly import nightly


def dependent_relays(seed):
    """Return relays in symmetric directions, more of them than states or equal ones, and a start in integers."""
    rng = np.random.default_rng(seed)
    k, n = int(rng.integers(1, 4)), int(rng.integers(1, 4))
    C = rng.integers(-2, 3, (k, n)).astype(float)
    C[-1] = C[0] if rng.random() < 0.5 else C[-1]
    lower, upper = -rng.integers(1, 4, k).astype(float), rng.integers(1, 4, k).astype(float)
    A = rng.integers(-2, 2, (n, n)).astype(float)
    scale = 10.0 ** rng.integers(-6, 7)  # of the inputs
    relays = RelaySystem(A, C.T / scale, C, lower=scale * lower, upper=scale * upper)
    return relays, rng.integers(-2, 3, n).astype(float)


def runs(relays, x0):
    yield relays.simulate(x0, (0.0, 2.0))
    yield relays.simulate(x0, (0.0, 2.0), form="dae")
    yield relays.to_piecewise_linear().simulate(x0, (0.0, 2.0))


@pytest.mark.parametrize("seed", [*range(8), *nightly(range(8, 40))])
def test_the_three_forms_of_relays_report_the_same_where_their_outputs_are_not_unique(seed):
    relays, x0 = dependent_relays(seed)
    found = list(runs(relays, x0))
    size = np.abs(relays.upper).max()
    for run in found:
        assert run.unique
        before_the_end = [switch for switch in run.switches if switch.time < 2.0]
        told = [switch for switch in found[0].switches if switch.time < 2.0]
        assert [switch[1:] for switch in before_the_end] == [switch[1:] for switch in told]
        assert [switch.time for switch in before_the_end] == pytest.approx([switch.time for switch in told])
    times = np.linspace(0.013, 1.987, 41)
    ends = [each.refined(200) for each in found]
    for run in ends:
        for i in range(relays.shape[1]):
            told = np.interp(times, ends[0].t, ends[0].u[:, i])
            assert np.median(np.abs(np.interp(times, run.t, run.u[:, i]) - told)) <= 1e-9 * size


@pytest.mark.parametrize("seed", [*range(8), *nightly(range(8, 40))])
def test_the_pieces_of_relays_are_those_of_the_reported_outputs(seed):
    relays, x0 = dependent_relays(seed)
    for run in runs(relays, x0):
        fine = run.refined(300)
        assert np.all((fine.u >= relays.lower) & (fine.u <= relays.upper))
        starts = [event.time for event in run.events]
        for event, (_, after) in zip(run.events, run.pieces, strict=True):
            later = [t for t in starts if t > event.time]
            end = min(later, default=2.0)
            if end - event.time < 1e-9:
                continue
            rows = (fine.t > event.time + 1e-3 * (end - event.time)) & (
                fine.t < end - 1e-3 * (end - event.time)
            )
            for i, piece in enumerate(after):
                u, y = fine.u[rows, i], fine.y[rows, i]
                assert piece == 1 or np.all(u == (relays.upper if piece == 0 else relays.lower)[i])
                assert np.all(np.abs(y) <= 1e-9) if piece == 1 else np.all(y * (piece - 1) >= -1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_outputs_that_are_not_unique_are_the_least_with_the_same_rate(seed):
    relays, x0 = dependent_relays(seed)
    fine = relays.simulate(x0, (0.0, 2.0)).refined(60)
    rng = np.random.default_rng(seed)
    slides = np.abs(fine.y) <= 1e-10
    for u, free in zip(fine.u, slides, strict=True):
        for _ in range(5):
            change = np.where(free, rng.normal(size=u.size), 0.0)
            kept = np.linalg.svd(relays.B[:, free])[2][np.linalg.matrix_rank(relays.B[:, free]) :]
            change[free] = kept.T @ (kept @ change[free])
            size = np.abs(change).max()
            if size == 0.0:
                continue
            other = u + 0.05 * relays.upper.max() / size * change
            if np.all((other >= relays.lower) & (other <= relays.upper)):
                assert np.linalg.norm(other) >= (1.0 - 1e-12) * np.linalg.norm(u)


@pytest.mark.parametrize("seed", range(25))
def test_a_saturated_input_is_its_limit_however_large_the_states_become(seed):
    """One state grows by e^30 and more; the inputs are held by curves that fall, as the plant is passive."""
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(2, 5)), int(rng.integers(1, 3))
    A = rng.normal(size=(n, n))
    A[0, 0] += 11.0
    C, N = rng.normal(size=(k, n)), rng.normal(size=(k, k))
    limits = rng.uniform(0.2, 2.0, k)
    curves = [saturation(rng.uniform(0.5, 2.0), limit) for limit in limits]
    falling = [Characteristic(curve.points * [1.0, -1.0]) for curve in curves]
    D = 0.3 * N @ N.T + (N - N.T)
    run = PiecewiseLinearSystem(A, C.T, C, D, falling).simulate(rng.normal(size=n), (0.0, 3.0))
    assert np.abs(run.y).max() > 1e9
    for i, curve in enumerate(falling):
        beyond = np.abs(run.y[:, i]) > 2.0 * np.abs(curve.points[:, 0]).max()
        assert np.array_equal(np.abs(run.u[beyond, i]), np.full(beyond.sum(), limits[i]))
        assert np.all(run.u[beyond, i] * run.y[beyond, i] < 0.0)


def test_a_pass_through_states_with_several_continuations_is_not_called_unique():
    """y = x1 + 2 sat(y) has three solutions where |x1| <= 1: the run stays on its branch until that ends."""
    system = PiecewiseLinearSystem([[0, 1], [0, 0]], [[0.1], [0]], [[1, 0]], [[2.0]], [saturation()])
    run = system.simulate([-3.0, 1.0], (0.0, 6.0))
    assert run.unique is None
    assert [(switch.before, switch.after) for switch in run.switches] == [((0,), (2,))]


@pytest.mark.parametrize("seed", range(30))
def test_a_run_is_called_unique_only_where_no_start_on_it_has_other_continuations(seed):
    rng = np.random.default_rng(seed)
    system = PiecewiseLinearSystem(
        rng.integers(-1, 2, (2, 2)), rng.integers(-1, 2, (2, 1)), rng.integers(-1, 2, (1, 2)),
        rng.integers(-2, 3, (1, 1)), [saturation()],
    )  # fmt: skip
    try:
        run = system.simulate(rng.integers(-2, 3, 2), (0.0, 2.0))
    except ArithmeticError:
        return
    if run.unique:
        for t in np.linspace(0.05, 1.95, 7):
            again = system.simulate(run(t), (t, 2.0))
            assert again.x[-1] == pytest.approx(run.x[-1], abs=1e-7)


def test_a_relay_that_acts_on_nothing_gives_least_and_slides():
    run = RelaySystem([[-1.0]], [[0.0]], [[0.0]], lower=-3.0, upper=5.0).simulate([1.0], (0.0, 1.0))
    assert not run.u.any()
    assert not run.switches


def test_the_vertical_piece_counts_where_a_curve_stays_at_its_corner():
    """x' = 1 - u, a relay from 1 to -1 at rest: u = 1 is the corner of its vertical piece; a diode at y = u = 0 too."""
    relay = PiecewiseLinearSystem([[0, 1], [0, 0]], [[-1], [0]], [[-1, 0]], None, [relay_step()])
    run = relay.simulate([-1.0, 1.0], (0.0, 3.0))
    assert run.u[-1].tolist() == [1.0]
    diode = PiecewiseLinearSystem([[-1]], [[1]], [[1]], None, [ideal_diode()]).simulate([0.0], (0.0, 1.0))
    assert diode.u.tolist() == [[0.0]] * len(diode.t)
