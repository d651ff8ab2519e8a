import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pricing_core.errors import InvalidInputError, NonUniqueError
from pricing_core.lcs import EventDriven, TimeStepping, theorem_11_6
from pricing_core.models import RelaySystem
from tests.problems.nightly import nightly

FORMS = ("input-output", "dae")
both_forms = pytest.mark.parametrize("form", FORMS)


def steady(x):
    return pytest.approx(x, abs=1e-10)


def filippov(b: float = 2.0, scale: float = 1.0) -> RelaySystem:
    return RelaySystem(np.zeros((2, 2)), scale * np.array([[1, -b], [b, 1]]), np.eye(2))


def friction_oscillator(level: float) -> RelaySystem:
    """q'' = -q - level sgn q'."""
    return RelaySystem([[0, 1], [-1, 0]], [[0], [1]], [[0, 1]], lower=-level, upper=level)


def lagging_ramp() -> RelaySystem:
    """x' = r - sgn x, r' = c, c' = 0."""
    return RelaySystem([[0, 1, 0], [0, 0, 1], [0, 0, 0]], [[1], [0], [0]], [[1, 0, 0]])


@both_forms
def test_example_11_1_has_its_exact_values_and_ends_at_its_zeno_point(form):
    known = {1.0: (4 / 3, -2 / 3), 1.5: (-1 / 18, -17 / 18), 1.9: (-31 / 270, 23 / 270), 2.5: (0.0, 0.0)}
    run = filippov().simulate([3.0, 1.0], (0.0, 2.5), form=form, t_eval=list(known))
    assert run.x == steady(np.array(list(known.values())))
    assert run.events[-1].kind == "zeno"
    assert run.events[-1].time == pytest.approx(2.0, rel=1e-12)
    assert run.u[0] == steady([-1.0, 1.0])
    assert run.u[-1] == steady([0.0, 0.0])  # both slide
    assert run.y == steady(run.x)


@both_forms
@pytest.mark.parametrize(
    ("system", "start", "end"), [(filippov(26, 2), 3.0, 1.5), (filippov(-99, 5), 10.0, 2.0)]
)
def test_slow_spirals_reach_the_origin_when_they_should(system, start, end, form):
    """|x1| + |x2| falls at the constant rate 2 B11."""
    run = system.simulate([start, start], (0.0, 1.1 * end), form=form)
    assert run.events[-1].time == pytest.approx(end, rel=1e-11)
    assert run(1.05 * end) == steady([0.0, 0.0])


@both_forms
def test_two_relays_may_switch_at_once(form):
    run = RelaySystem(np.zeros((2, 2)), 2 * np.eye(2), np.eye(2)).simulate([1.0, -1.0], (0.0, 1.0), form=form)
    assert run.switches == ((pytest.approx(0.5, rel=1e-14), (2, 0), (1, 1)),)
    assert run([0.25, 0.5, 0.8]) == steady(np.array([[0.5, -0.5], [0.0, 0.0], [0.0, 0.0]]))


@both_forms
@pytest.mark.parametrize(("amplitude", "level"), [(5.3, 1.0), (2.9, 1.0), (-0.6, 0.25), (0.7, 1.0)])
def test_a_friction_oscillator_sticks_where_it_should(amplitude, level, form):
    """Each half swing turns about -+ level and is 2 level shorter than the last: after n of them |q| <= level."""
    size = abs(amplitude)
    n = max(0, math.ceil((size - level) / (2 * level)))
    stop = math.copysign(1.0, amplitude) * (-1) ** n * (size - 2 * n * level)
    run = friction_oscillator(level).simulate([amplitude, 0.0], (0.0, n * math.pi + 1.0), form=form)
    assert run.x[-1] == steady([stop, 0.0])
    assert run.u[-1] == steady([stop])  # friction holds the spring
    if n:
        assert run.switches[-1].time == pytest.approx(n * math.pi, rel=1e-12)
        assert run.switches[-1].after == (1,)


@both_forms
def test_sliding_begins_and_ends_exactly(form):
    """x' = t - sgn x from 3/8: on the surface from t = 1/2 on, off it from t = 1 on."""
    run = lagging_ramp().simulate([0.375, 0.0, 1.0], (0.0, 3.0), form=form, t_eval=[0.25, 0.75, 3.0])
    assert [(switch.before, switch.after) for switch in run.switches] == [((2,), (1,)), ((1,), (2,))]
    assert [switch.time for switch in run.switches] == pytest.approx([0.5, 1.0], rel=1e-12)
    assert run.u == steady(np.array([[-1.0], [-0.75], [-1.0]]))
    assert run.x[1:, 0] == steady([0.0, 2.0])


@pytest.mark.parametrize(
    ("mean", "bound", "end"), [(2.0, 1.0, math.pi / 4 - 1 / 3), (1.0, 2.0, 0.0)], ids=["crosses", "slides"]
)
@both_forms
def test_a_surface_is_crossed_or_slid_on(mean, bound, end, form):
    """x' = 3 where x < 0, x' = 1 or x' = -1 where x > 0."""
    system = RelaySystem([[0, mean], [0, 0]], [[1], [0]], [[1, 0]], lower=-bound, upper=bound)
    run = system.simulate([-1.0, 1.0], (0.0, math.pi / 4), form=form)
    assert run.x[-1, 0] == steady(end)
    assert run.events[0].time == pytest.approx(1 / 3, rel=1e-13)


@both_forms
def test_bounds_may_differ_from_relay_to_relay(form):
    """x1' = u1 in [-3, 1], x2' = u2 in [1, 2]: the second never slides."""
    system = RelaySystem(np.zeros((2, 2)), np.eye(2), np.eye(2), lower=[-3, 1], upper=[1, 2])
    run = system.simulate([1.5, -0.5], (0.0, 2.0), form=form)
    assert [switch.time for switch in run.switches] == pytest.approx([0.25, 0.5], rel=1e-13)
    assert [switch.after for switch in run.switches] == [(2, 2), (1, 2)]
    assert run.x[-1] == steady([0.0, 1.75])
    assert run.u[-1] == steady([0.0, 1.0])


@both_forms
def test_a_feedthrough_makes_the_relay_a_saturation(form):
    """y = x + u / 2, u = -sgn y: u = -sat(2 x)."""
    run = RelaySystem([[0]], [[1]], [[1]], [[0.5]]).simulate(
        [1.5], (0.0, 2.0), form=form, t_eval=[0.5, 1.0, 2.0]
    )
    assert run.x[:, 0] == steady([1.0, 0.5, 0.5 * math.exp(-2.0)])
    assert run.u[:, 0] == steady([-1.0, -1.0, -math.exp(-2.0)])
    assert run.y[:, 0] == steady([0.5, 0.0, 0.0])


@both_forms
def test_the_relay_with_the_wrong_sign_has_three_continuations(form):
    system = RelaySystem([[0]], [[-1]], [[1]])
    with pytest.raises(NonUniqueError, match="several continuations"):
        system.simulate([0.0], (0.0, 1.0), form=form)
    ends = {
        system.simulate([0.0], (0.0, 1.0), form=form, method=EventDriven(lambda t, x, modes, i=i: modes[i]))
        .x[-1]
        .item()
        for i in range(3)
    }
    assert ends == {-1.0, 0.0, 1.0}


@both_forms
@pytest.mark.parametrize(
    ("A", "B", "C", "on", "off"),
    [([[0]], [[1]], [[0]], [0.0], None), ([[0, 0], [0, -1]], [[1], [0]], [[0, 1]], [0.0, 0.0], [0.0, 1.0])],
    ids=["y = 0", "y unmoved"],
)
def test_a_relay_that_does_not_see_its_effect_may_give_anything_at_zero(A, B, C, on, off, form):
    """x1' = u for any u from -1 to 1 while y = 0; where y > 0 there is x1' = -1 alone."""
    system = RelaySystem(A, B, C)
    with pytest.raises(NonUniqueError, match="several continuations"):
        system.simulate(on, (0.0, 1.0), form=form)
    with pytest.raises(NonUniqueError, match="several continuations"):
        system.to_piecewise_linear().simulate(on, (0.0, 1.0))
    chosen = system.simulate(on, (0.0, 1.0), form=form, method=EventDriven("first"))
    assert abs(chosen.x[-1, 0]) == steady(1.0)
    if off is not None:
        assert system.simulate(off, (0.0, 1.0), form=form).x[-1] == steady([-1.0, math.exp(-1.0)])


def test_the_two_forms_are_different_systems_and_the_dae_holds():
    system = filippov()
    assert not np.array_equal(system.to_lcs().D, system.to_lcs("dae").D)
    dae = system.to_dae()
    run = system.simulate([3.0, 1.0], (0.0, 1.9), form="dae")
    w, z = dae.pairs(run.lcs.u, run.lcs.y)
    assert w @ dae.M.T == steady(z @ dae.N.T + run.x @ dae.C.T + dae.g)  # (11.30)
    assert z[:, :2] + z[:, 2:] == steady(np.ones((len(z), 2)))
    assert min(w.min(), z.min()) > -1e-12
    assert np.abs(w * z).max() < 1e-12


def test_well_posedness_is_decided_on_the_relays_own_transfer_matrix():
    report = filippov().well_posedness()
    assert (report.verdict, report.theorems["11.6"]) == ("well-posed", "holds")
    assert report.basis.startswith("theorem 11.6")
    unclear = RelaySystem(np.zeros((2, 2)), [[1, -3], [-2, 1]], np.eye(2)).well_posedness()
    assert unclear.theorems["11.6"] == "silent"
    assert unclear.verdict == "ill-posed"
    assert unclear.witness.tolist() == [0.0, 0.0]


def test_other_bounds_do_not_change_the_theorem():
    report = RelaySystem([[-1]], [[1]], [[1]], lower=0.5, upper=2.0).well_posedness()
    assert (report.verdict, report.theorems["11.6"]) == ("well-posed", "holds")


@both_forms
def test_a_double_integrator_is_driven_to_and_fro(form):
    """x'' = -sgn x from (1, 0): relative degree 2, the period 4 sqrt 2."""
    system = RelaySystem([[0, 1], [0, 0]], [[0], [1]], [[1, 0]])
    period = 4 * math.sqrt(2.0)
    run = system.simulate([1.0, 0.0], (0.0, 12.0), form=form, t_eval=[period / 2, period, 2 * period])
    assert run.x == steady(np.array([[-1.0, 0.0], [1.0, 0.0], [1.0, 0.0]]))
    assert [switch.time / period for switch in run.switches] == pytest.approx(
        [0.25, 0.75, 1.25, 1.75], rel=1e-12
    )


@both_forms
def test_a_refined_run_is_in_the_relays_own_variables(form):
    run = lagging_ramp().simulate([0.375, 0.0, 1.0], (0.0, 3.0), form=form, t_eval=[3.0]).refined(300)
    assert run.t.size >= 300
    slides = (run.t > 0.51) & (run.t < 0.99)
    assert run.u[slides, 0] == steady(-run.t[slides])
    assert run.y == steady(run.x[:, :1])


@both_forms
def test_time_stepping_agrees(form):
    times = np.linspace(0.0, 3.0, 13)
    system = RelaySystem([[-0.2, 1.0], [-1.0, -0.3]], [[0.5], [1.0]], [[1.0, 0.5]])
    exact = system.simulate([2.0, 1.0], (0.0, 3.0), form=form, t_eval=times)
    method = TimeStepping(step=1e-3)
    stepped = system.simulate([2.0, 1.0], (0.0, 3.0), form=form, method=method, t_eval=times)
    assert stepped.x == pytest.approx(exact.x, abs=5e-3)
    assert np.all(np.abs(stepped.u) <= 1.0 + 1e-9)


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 3))
def test_random_well_posed_relays_keep_the_relay_law_in_both_forms(seed, k):
    rng = np.random.default_rng(seed)
    N = rng.normal(size=(k, k))
    B = N @ N.T + 0.1 * np.eye(k) + (N - N.T)  # positive definite: a P-matrix
    A = rng.normal(size=(k, k)) - 2.0 * np.eye(k)
    lower, upper = -rng.uniform(0.2, 2.0, k), rng.uniform(0.2, 2.0, k)
    system = RelaySystem(A, B, np.eye(k), lower=lower, upper=upper)
    assert theorem_11_6(A, B, np.eye(k)).status == "holds"
    x0, times = rng.normal(size=k), np.linspace(0.0, 2.0, 41)
    runs = [system.simulate(x0, (0.0, 2.0), form=form, t_eval=times) for form in FORMS]
    assert runs[0].x == pytest.approx(runs[1].x, abs=1e-8)
    for run in runs:
        assert np.all((run.u >= lower - 1e-9) & (run.u <= upper + 1e-9))
        assert run.y == pytest.approx(run.x, abs=1e-9)
        assert np.where(run.y > 1e-9, run.u - lower, 0.0) == pytest.approx(0.0 * run.u, abs=1e-9)
        assert np.where(run.y < -1e-9, upper - run.u, 0.0) == pytest.approx(0.0 * run.u, abs=1e-9)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"lower": 1.0}, r"lower\[0\] = 1.0: must be less than upper\[0\] = 1"),
        ({"lower": [-1, -1, -1]}, "lower"),
        ({"upper": math.inf}, "upper"),
        ({"C": [[1.0]]}, "C"),
    ],
)
def test_bad_input_is_named(arguments, message):
    plain = {"A": np.zeros((2, 2)), "B": np.eye(2), "C": np.eye(2)}
    with pytest.raises(InvalidInputError, match=message):
        RelaySystem(**{**plain, **arguments})


def test_an_unknown_form_is_refused():
    with pytest.raises(InvalidInputError, match=r"form = 'diagonal'.*input-output"):
        filippov().simulate([1.0, 1.0], (0.0, 1.0), form="diagonal")


@pytest.mark.parametrize("k", [1, 2, 3, 7, *nightly((6, 9, 12))])
def test_relays_that_drive_away_from_zero_are_not_simulated_from_there(k):
    """x' = sgn x in each of k independent relays: -1, 0 and 1 go on from 0; elsewhere one does."""
    relays = RelaySystem(np.zeros((k, k)), -np.eye(k), np.eye(k))
    with pytest.raises(NonUniqueError):
        relays.simulate(np.zeros(k), (0, 1))
    assert relays.simulate(np.ones(k), (0, 1)).x[-1] == pytest.approx(np.full(k, 2.0))
    report = relays.well_posedness()
    assert report.verdict == "ill-posed"
    assert report.witness.tolist() == [0.0] * k


@pytest.mark.parametrize("seed", range(8))
def test_many_relays_in_symmetric_directions_have_one_state(seed):
    """x' = Ax - B sgn(B^T x), B of any rank, other bounds for every relay: the motion does not depend on the form."""
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(1, 4)), int(rng.integers(2, 13))
    B = rng.integers(-2, 3, (n, k))
    relays = RelaySystem(rng.integers(-2, 3, (n, n)), B, B.T, upper=rng.integers(1, 4, k))
    assert relays.has_unique_state()
    assert relays.well_posedness().verdict == "well-posed"


@pytest.mark.parametrize("seed", [*range(5), *nightly(range(5, 12))])
def test_what_has_slid_to_rest_does_not_switch_at_the_end_of_the_interval(seed):
    """Relays that all see one combination c x of a damped state hold c x at zero from the first time it vanishes."""
    rng = np.random.default_rng(seed)
    n, k = int(rng.integers(1, 4)), int(rng.integers(1, 5))
    S, c = rng.normal(size=(n, n)), rng.normal(size=n)
    C = np.outer(10.0 ** rng.uniform(-1.0, 1.0, k), c) if seed % 2 else np.tile(c, (k, 1))
    system = RelaySystem(S - S.T - rng.uniform(0.1, 5.0) * np.eye(n), np.tile(c, (k, 1)).T, C)
    x0 = rng.normal(size=n) * 10.0 ** rng.uniform(-3.0, 3.0)
    for end in 10.0 ** rng.uniform(-1.0, 2.0, 8):
        switches = system.simulate(x0, (0.0, end)).switches
        assert all(switch.time < end * (1.0 - 1e-9) for switch in switches)


def test_two_relays_at_rest_do_not_switch_at_the_end_of_the_interval():
    system = RelaySystem([[-1.0]], [[1.0, 1.0]], [[1.0], [1.0]])
    for end in (*np.linspace(0.5, 2.5, 41), *(math.log(1.5) + 10.0 ** -np.arange(2.0, 9.0))):
        (switch,) = system.simulate([1.0], (0.0, end)).switches
        assert switch.time == pytest.approx(math.log(1.5), abs=1e-14)
