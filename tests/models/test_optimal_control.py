"""The maximum principle, the closed forms, and what is refused."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from pricing_core.errors import InfeasibleError, InvalidInputError, NumericalError
from pricing_core.models import OptimalControl, StateConstrainedLQ
from tests.problems.control_problems import CONTROL_PROBLEMS, FORCE, INTEGRATOR, POSITION, ControlProblem

SOLUTIONS: dict[int, OptimalControl] = {}


def solution(known: ControlProblem) -> OptimalControl:
    """Return the solution of a problem that several tests look at, found once."""
    if id(known) not in SOLUTIONS:
        SOLUTIONS[id(known)] = known.problem.solve()
    return SOLUTIONS[id(known)]


every_problem = pytest.mark.parametrize("known", CONTROL_PROBLEMS, ids=lambda known: known.name)


@every_problem
def test_closed_forms_are_met_to_rounding(known: ControlProblem):
    answer = solution(known)
    assert answer.status == "solved"
    assert answer.cost == pytest.approx(known.cost, abs=1e-12)
    assert answer.switching_times == pytest.approx(known.switching_times, abs=1e-9)
    found = [(time, weights.item()) for time, weights in answer.multiplier_atoms]
    assert found == [pytest.approx(atom, abs=1e-9) for atom in known.atoms]


def test_on_its_boundary_arc_the_scalar_example_is_constant():
    answer = CONTROL_PROBLEMS[0].problem.solve()
    on = answer.t > answer.switching_times[0] + 1e-9
    for values, expected in ((answer.x, 1), (answer.control, 1), (answer.costate, 1), (answer.multiplier, 2)):
        assert values[on] == pytest.approx(expected, abs=1e-12)
    assert np.all(answer.multiplier[answer.t < answer.switching_times[0] - 1e-9] == 0.0)


def random_problem(seed: int) -> StateConstrainedLQ:
    """Return a problem of up to four states, with constraints of order 1 or 2 and slack at the start."""
    rng = np.random.default_rng(seed)
    n, m, k = rng.integers(1, 5), rng.integers(1, 3), rng.integers(1, 3)
    A, B, C = rng.normal(size=(n, n)), rng.normal(size=(n, m)), rng.normal(size=(k, n))
    if seed % 2 and m < n:
        C[:] = np.linalg.svd(B.T)[2][-1]
    root, x0 = rng.normal(size=(n, n)), 2.0 * rng.normal(size=n)
    bound = C @ x0 - rng.uniform(0.05, 2.0, size=k)
    return StateConstrainedLQ(A, B, C, root @ root.T, x0, float(rng.uniform(0.5, 4.0)), bound)


def solved_or_skipped(problem: StateConstrainedLQ) -> OptimalControl:
    try:
        answer = problem.solve()
    except NumericalError:
        assume(False)
    assume(answer.status == "solved")
    return answer


def check_maximum_principle(problem: StateConstrainedLQ, answer: OptimalControl) -> None:
    """(11.24) with its atoms: equations of motion, stationarity, signs, complementarity, jumps, the end."""
    n, z = problem.A.shape[0], np.hstack([answer.x, answer.costate])
    system = problem.to_lcs()
    size = 1.0 + np.max(np.abs(z))
    assert answer.x[0] == pytest.approx(problem.x0, abs=1e-9 * size)
    assert np.array_equal(answer.control, answer.costate @ problem.B)
    slack = answer.x @ problem.C.T - problem.bound
    assert np.min(slack) >= -1e-8 * size
    assert np.min(answer.multiplier, initial=0.0) >= -1e-8 * size
    assert np.max(np.abs(slack * answer.multiplier), initial=0.0) <= 1e-8 * size**2
    jumps = np.flatnonzero(np.diff(answer.t) == 0.0)
    atoms = dict(answer.multiplier_atoms)
    for j in jumps:
        atom = atoms.get(float(answer.t[j]), np.zeros(problem.C.shape[0]))
        assert np.all(atom >= -1e-8 * size)
        assert atom @ np.abs(slack[j]) <= 1e-8 * size**2
        step = np.concatenate([np.zeros(n), -problem.C.T @ atom])
        assert z[j + 1] - z[j] == pytest.approx(step, abs=1e-8 * size)
    last = atoms.get(problem.horizon, np.zeros(problem.C.shape[0]))
    assert answer.costate[-1] == pytest.approx(problem.C.T @ last, abs=1e-8 * size)
    assert last @ np.abs(slack[-1]) <= 1e-8 * size**2
    # z' = A z + B eta, integrated over every two samples
    rate = z @ system.A.T + answer.multiplier @ system.B.T
    for a, b in segments(answer):
        integral = simpson(answer.t[a:b], rate[a:b])
        assert np.diff(z[a:b:2], axis=0) == pytest.approx(integral, abs=1e-5 * size)


def segments(answer: OptimalControl) -> list[tuple[int, int]]:
    jumps = np.flatnonzero(np.diff(answer.t) == 0.0)
    return list(zip([0, *(jumps + 1)], [*(jumps + 1), answer.t.size], strict=True))


def simpson(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Integrate over each pair of equal intervals."""
    return (values[:-2:2] + 4.0 * values[1:-1:2] + values[2::2]) * np.diff(t)[::2, None] / 3.0


@every_problem
def test_known_solutions_satisfy_the_maximum_principle(known: ControlProblem):
    check_maximum_principle(known.problem, solution(known))


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(0, 10_000))
def test_the_maximum_principle_holds(seed: int):
    problem = random_problem(seed)
    check_maximum_principle(problem, solved_or_skipped(problem))


@pytest.mark.parametrize(
    ("seed", "junctions"),
    [
        (20094, 2),  # leaves its arc just before the horizon, order 1
        (20059, 2),  # the same, order 2, where collocation sees contact up to the horizon
        (20178, 5),  # one constraint hands over to another and back
    ],
)
def test_structures_that_the_first_guess_misses_are_repaired(seed: int, junctions: int):
    problem = random_problem(seed)
    answer = problem.solve()
    assert (answer.status, answer.switching_times.size) == ("solved", junctions)
    check_maximum_principle(problem, answer)


def problem_near_its_bound(seed: int) -> StateConstrainedLQ:
    """Return a problem with one bound of which the start is close to or far from, with states of 0.1 to 10."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    m = int(rng.integers(1, n + 1))
    A, B, C = rng.normal(size=(n, n)), rng.normal(size=(n, m)), np.zeros((1, n))
    C[0, rng.integers(n)] = rng.choice([-1, 1])
    if seed % 2:
        C = rng.normal(size=(1, n))
    horizon, size = float(rng.uniform(0.5, 5)), 10 ** rng.uniform(-1, 1)
    x0 = size * rng.normal(size=n)
    bound = C @ x0 - size * rng.uniform(0.01, 2) * rng.choice([1, 0.1, 0.01])
    return StateConstrainedLQ(A, B, C, np.eye(n), x0, horizon, bound)


@pytest.mark.parametrize(
    ("seed", "junctions"),
    [
        (116, 1),  # the junction comes after 1e-5 of the horizon
        (187, 2),  # the same, and an arc that ends before the horizon
        (257, 0),  # no contact, where an interior-point method leaves masses
        (388, 1),  # the costate is 1e8 times the state at the start
        (743, 2),  # C B = 0.02: on the arc the state moves sixty times as fast as off it
        (927, 2),  # leaves its arc and comes back at the horizon
    ],
)
def test_hard_problems_are_solved(seed: int, junctions: int):
    problem = problem_near_its_bound(seed)
    answer = problem.solve()
    assert (answer.status, answer.switching_times.size) == ("solved", junctions)
    check_maximum_principle(problem, answer)


def test_feasible_controls_of_size_1e7_do_not_pass_for_infeasible():
    problem = problem_near_its_bound(113)
    answer = problem.solve()
    slack = answer.x @ problem.C.T - problem.bound
    assert np.min(slack) >= -1e-13 * np.max(np.abs(answer.x))
    assert answer.cost == pytest.approx(problem.solve(intervals=400).cost, rel=0.05)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(0, 10_000))
def test_the_cost_is_half_of_what_the_multipliers_say(seed: int):
    """(lambda^T x)' = x^T Q x + u^T u - eta^T C x, and C x = bound wherever eta is not zero."""
    problem = random_problem(seed)
    answer = solved_or_skipped(problem)
    forces = answer.multiplier @ problem.bound
    total = sum(weights @ problem.bound for _, weights in answer.multiplier_atoms)
    for a, b in segments(answer):
        total += np.sum(simpson(answer.t[a:b], forces[a:b, None]))
    dual = 0.5 * (total - answer.costate[0] @ answer.x[0])
    assert answer.cost == pytest.approx(dual, rel=1e-6, abs=1e-6)


def exact_cost(problem: StateConstrainedLQ, control: np.ndarray, per: int = 8) -> tuple[float, float]:
    """Return cost and least slack of a piecewise constant control: exact flow, Simpson's rule within pieces."""
    n, m = problem.B.shape
    h = problem.horizon / (len(control) * per)
    block = expm(h * np.block([[problem.A, problem.B], [np.zeros((m, n + m))]]))[:n]
    x, states, cost = problem.x0, [problem.x0], 0.0
    weights = np.array([1.0, *([4.0, 2.0] * (per // 2))[:-1], 1.0]) * h / 3.0
    for u in control:
        piece = [x]
        for _ in range(per):
            x = block @ np.concatenate([x, u])
            piece.append(x)
        states += piece[1:]
        terms = [v @ problem.Q @ v + u @ u for v in piece]
        cost += 0.5 * float(weights @ terms)
    return cost, float(np.min(np.array(states) @ problem.C.T - problem.bound))


@every_problem
@settings(max_examples=8, deadline=None, derandomize=True)
@given(st.integers(0, 10_000))
def test_no_feasible_control_is_cheaper(known: ControlProblem, seed: int):
    """The optimum, disturbed and pushed away from the constraint, costs more unless it leaves it."""
    problem, answer = known.problem, solution(known)
    rng = np.random.default_rng(seed)
    middles = (np.arange(400) + 0.5) * problem.horizon / 400
    control = np.interp(middles, answer.t, answer.control[:, 0])
    push = 10.0 ** rng.uniform(-4, 0)
    phases = rng.uniform(0, 6, size=3)
    wave = sum(np.sin((k + 1) * middles + phases[k]) / (k + 1) for k in range(3))
    disturbed = control + push * (rng.uniform(0, 1.5) + rng.normal() * 0.3 * wave)
    cost, slack = exact_cost(problem, disturbed[:, None])
    assert cost >= answer.cost - 1e-9 or slack < 0.0


def test_some_disturbed_controls_are_feasible():
    problem, answer = CONTROL_PROBLEMS[0].problem, CONTROL_PROBLEMS[0].problem.solve()
    middles = (np.arange(400) + 0.5) * problem.horizon / 400
    control = np.interp(middles, answer.t, answer.control[:, 0])
    cost, slack = exact_cost(problem, control[:, None] + 1e-3)
    assert slack > 0.0
    assert answer.cost < cost < answer.cost + 1e-2


def test_without_contact_the_answer_is_the_riccati_one():
    answer = StateConstrainedLQ([[0]], [[1]], [[1]], [[1]], [1], 2.0, [-5]).solve()
    assert answer.cost == pytest.approx(0.5 * np.tanh(2.0), rel=1e-12)  # P = tanh(T - t)
    assert answer.multiplier_atoms == ()
    assert answer.switching_times.size == 0


def test_contact_is_held_from_a_start_on_the_bound():
    answer = StateConstrainedLQ([[-1]], [[1]], [[1]], [[1]], [1], 2.0, [1]).solve()
    assert answer.status == "solved"
    assert answer.x == pytest.approx(1.0, abs=1e-12)
    assert answer.cost == pytest.approx(2.0, rel=1e-12)


def test_simultaneous_contacts_of_two_equal_parts():
    A, one = -np.eye(2), np.eye(2)
    answer = StateConstrainedLQ(A, one, one, one, [2, 2], 3.0, [1, 1]).solve()
    assert answer.status == "solved"
    assert answer.cost == pytest.approx(2 * CONTROL_PROBLEMS[0].cost, rel=1e-12)


def test_the_time_unit_does_not_matter():
    slow = CONTROL_PROBLEMS[0].problem
    speed = 1e4
    fast = StateConstrainedLQ(
        speed * slow.A, speed * slow.B, slow.C, speed**2 * slow.Q / speed**2, slow.x0, 3.0 / speed, [1]
    ).solve()
    assert fast.status == "solved"
    assert fast.cost * speed == pytest.approx(CONTROL_PROBLEMS[0].cost, rel=1e-9)


@pytest.mark.parametrize("unit", [1e-8, 1e8])
def test_the_unit_of_the_state_does_not_matter(unit: float):
    answer = StateConstrainedLQ([[-1]], [[1]], [[1]], [[1]], [2 * unit], 3.0, [unit]).solve()
    assert answer.status == "solved"
    assert answer.cost == pytest.approx(CONTROL_PROBLEMS[0].cost * unit**2, rel=1e-9)


@pytest.mark.parametrize("unit", [1e-40, 1e40])
def test_the_unit_of_the_constraint_does_not_matter(unit: float):
    known = CONTROL_PROBLEMS[0]
    answer = StateConstrainedLQ([[-1]], [[1]], [[unit]], [[1]], [2], 3.0, [unit]).solve()
    assert answer.status == "solved"
    assert answer.cost == pytest.approx(known.cost, rel=1e-12)
    ((time, weights),) = answer.multiplier_atoms
    assert (time, weights.item() * unit) == pytest.approx(known.atoms[0], rel=1e-9)
    assert answer.multiplier[-2:] * unit == pytest.approx(2.0, rel=1e-9)


def test_a_start_on_the_bound_that_leaves_it_at_once_has_no_contact():
    """x'' = u from rest at 1 towards 0 with x <= 1, which holds in any case."""
    free = StateConstrainedLQ(INTEGRATOR, FORCE, np.zeros((0, 2)), np.eye(2), [1, 0], 4.0).solve()
    answer = StateConstrainedLQ(INTEGRATOR, FORCE, [[-1, 0]], np.eye(2), [1, 0], 4.0, [-1]).solve()
    assert answer.cost == pytest.approx(free.cost, rel=1e-12)
    assert (answer.arcs, answer.multiplier_atoms, answer.switching_times.size) == (((),), (), 0)


@pytest.mark.parametrize("intervals", [8, 50, 1000])
def test_rest_on_the_bound_is_one_arc_however_fine_the_collocation(intervals: int):
    known = CONTROL_PROBLEMS[4]
    answer = known.problem.solve(intervals=intervals)
    assert (answer.arcs, answer.multiplier_atoms) == (((0,),), ())
    assert answer.multiplier == pytest.approx(1.0, abs=1e-12)


def test_without_constraints_there_is_nothing_to_switch():
    answer = StateConstrainedLQ([[0]], [[1]], np.zeros((0, 1)), [[1]], [1], 2.0).solve()
    assert answer.cost == pytest.approx(0.5 * np.tanh(2.0), rel=1e-12)


def test_accumulating_touch_points_leave_the_answer_to_collocation():
    chain = StateConstrainedLQ(
        np.eye(3, k=1), [[0], [0], [1]], [[1, 0, 0]], np.diag([1.0, 0, 0]), [1, -1, 0], 8.0, [0.2]
    )
    assert chain.constraint_orders == (3,)
    answer = chain.solve()
    assert answer.status == "structure not resolved"
    finer = chain.solve(intervals=400)
    assert answer.cost == pytest.approx(finer.cost, rel=1e-3)
    assert np.min(answer.x[:, 0]) >= 0.2 - 1e-6


@pytest.mark.parametrize("seed", range(12))
def test_no_control_is_the_optimum_where_it_costs_nothing(seed):
    """Q = 0, and constraints that the motion without control keeps, or touches from the start on: u = 0."""
    rng = np.random.default_rng(seed)
    n, m, k = rng.integers(1, 4), rng.integers(1, 3), rng.integers(1, 4)
    A, B, C = rng.normal(size=(n, n)), rng.normal(size=(n, m)), rng.normal(size=(k, n))
    x0, horizon = rng.normal(size=n), float(rng.uniform(0.5, 2.0))
    free = np.array([expm(A * t) @ x0 for t in np.linspace(0.0, horizon, 400)]) @ C.T
    bound = free.min(axis=0) - rng.choice([0.01, 1.0], size=k)
    answer = StateConstrainedLQ(A, B, C, np.zeros((n, n)), x0, horizon, bound).solve()
    assert answer.status == "solved"
    assert answer.cost < 1e-20
    assert np.abs(answer.control).max() < 1e-10
    assert not answer.multiplier_atoms


@pytest.mark.parametrize("seed", range(16))
def test_what_is_answered_keeps_the_constraints(seed):
    """Integers make some states uncontrollable and some constraints contradict: an answer, or an error that says so."""
    rng = np.random.default_rng(seed)
    n, m, k = rng.integers(1, 4), rng.integers(1, 3), rng.integers(1, 4)
    A, B, C = rng.integers(-1, 2, (n, n)), rng.integers(0, 2, (n, m)), rng.integers(-1, 2, (k, n))
    x0 = rng.integers(-2, 3, n)
    bound = C @ x0 - rng.choice([0.1, 1.0], size=k)
    problem = StateConstrainedLQ(A, B, C, np.eye(n), x0, float(rng.uniform(0.5, 3.0)), bound)
    try:
        answer = problem.solve(intervals=50)
    except NumericalError:
        return
    sizes = np.abs(C) @ np.abs(x0) + np.abs(bound) + 1.0
    assert (answer.x @ C.T - bound >= -1e-5 * sizes).all()


def test_infeasible_problems_come_with_a_proof():
    with pytest.raises(InfeasibleError, match=r"no control keeps C x >= bound up to horizon = 3: proved"):
        StateConstrainedLQ([[-1, 0], [0, 0]], [[0], [1]], [[1, 0]], np.eye(2), [2, 0], 3.0, [1]).solve()


def test_constraints_that_leave_one_control():
    """x1' = x2 with x2 held between 1/2 and 1/2: u = 0."""
    held = StateConstrainedLQ(
        INTEGRATOR, FORCE, [[0, -1], [1, 0], [0, 1]], np.eye(2), [0, 0.5], 8.0, [-0.5, 0, 0.5]
    )
    answer = held.solve()
    assert answer.status == "structure not resolved"  # the two active constraints depend on one another
    assert answer.cost == pytest.approx(0.5 * (8.0 * 0.25 + 8.0**3 / 12.0), rel=1e-3)


def test_constraints_that_contradict_one_another_say_how_large_a_control_would_be():
    """x2' = x1 - x2 stays above 0.9 only where x1 does not stay below 0.1."""
    contrary = StateConstrainedLQ(
        [[0, 0], [1, -1]], [[1], [0]], [[-1, 0], [0, 1]], np.eye(2), [0, 1], 3.0, [-0.1, 0.9]
    )
    with pytest.raises(NumericalError, match=r"any control that does has int u\^T u dt >= [1-9]"):
        contrary.solve()


SCALAR = {"A": [[-1]], "B": [[1]], "C": [[1]], "Q": [[1]], "x0": [2], "horizon": 3.0, "bound": [1]}


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("A", {"A": [[1, 2]]}),
        ("A", {"A": [[float("nan")]]}),
        ("B", {"B": [[1], [2]]}),
        ("C", {"C": [[1, 2]]}),
        ("Q", {"Q": [[1, 0], [0, 1]]}),
        ("Q", {"Q": [[-1]]}),
        ("x0", {"x0": [2, 3]}),
        ("x0", {"x0": [0.5]}),
        ("x0", {"x0": [1e300]}),
        ("A", {"A": [[1e300]]}),
        ("Q", {"Q": [[1e300]]}),
        ("bound", {"bound": [1, 2]}),
        ("horizon", {"horizon": 0.0}),
        ("horizon", {"horizon": -1.0}),
        ("horizon", {"horizon": float("inf")}),
        ("horizon", {"horizon": "long"}),
        ("horizon", {"horizon": 1e300}),
        ("A", {"A": np.zeros((0, 0))}),
    ],
)
def test_bad_input_is_refused_by_name(field: str, change: dict[str, object]):
    with pytest.raises(InvalidInputError) as caught:
        StateConstrainedLQ(**{**SCALAR, **change})
    assert caught.value.field == field


def test_an_asymmetric_weight_is_refused():
    with pytest.raises(InvalidInputError, match="symmetric"):
        StateConstrainedLQ(INTEGRATOR, FORCE, POSITION, [[1, 1], [0, 1]], [1, 0], 1.0)


def test_a_start_that_must_leave_at_once_is_refused():
    with pytest.raises(InvalidInputError, match="derivative 1 of the vanishing slack 0 is -1"):
        StateConstrainedLQ(INTEGRATOR, FORCE, POSITION, np.eye(2), [0, -1], 1.0)


@pytest.mark.parametrize("intervals", [7, 20_001, 50.0])
def test_the_number_of_intervals_is_bounded(intervals: float):
    with pytest.raises(InvalidInputError, match="intervals"):
        StateConstrainedLQ(**SCALAR).solve(intervals=intervals)
