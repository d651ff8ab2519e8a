"""Each method says what it cannot do: options, matrices outside its class, limits."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.sparse import csr_array

from pricing_core.errors import (
    InfeasibleError,
    InvalidInputError,
    IterationLimitError,
    NumericalError,
    RayTerminationError,
)
from pricing_core.lcp import (
    LCP,
    enumerate_solutions,
    scaled_residual,
    solve,
    solve_brennan_schwartz,
    solve_double_sweep,
    solve_lemke,
    solve_murty,
    solve_policy_iteration,
    solve_psor,
)
from pricing_core.lcp.tridiagonal import as_tridiagonal
from pricing_core.linalg import Tridiagonal
from tests.problems.lcp_problems import KnownProblem, fathi, murty_exponential, of_class

ONE = LCP([[1.0]], [-1.0])
KOSTREVA = LCP([[1, 2, 0], [0, 1, 2], [2, 0, 1]], [-1, -1, -1])
TWO_RUNS = [problem for problem in of_class("tridiagonal") if "one run" not in problem.classes]


@pytest.mark.parametrize(
    "options",
    [{"relaxation": 0.0}, {"relaxation": 2.0}, {"tolerance": -1.0}, {"max_sweeps": 0}, {"start": [1.0, 2.0]}],
)
def test_projected_sor_refuses_options_out_of_range(options: dict[str, object]) -> None:
    with pytest.raises(InvalidInputError, match=next(iter(options))):
        solve_psor(ONE, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize("storage", [np.array, csr_array])
def test_projected_sor_needs_a_positive_diagonal(storage: type) -> None:
    for diagonal in (0.0, -1.0):
        with pytest.raises(InvalidInputError, match="positive diagonal"):
            solve_psor(LCP(storage([[1.0, 0.0], [0.0, diagonal]]), [1.0, 1.0]))
    with pytest.raises(InvalidInputError, match="positive diagonal"):
        solve_psor(LCP(Tridiagonal([0.0], [1.0, 0.0], [0.0]), [1.0, 1.0]))


def test_projected_sor_that_is_stopped_or_diverges_reports_its_residual() -> None:
    with pytest.raises(IterationLimitError, match=r"residual of \d.*after 2 sweeps.*relaxation"):
        solve_psor(LCP(fathi(6), -np.ones(6)), max_sweeps=2)
    growing = Tridiagonal([-3.0], [1.0, 1.0], [-3.0])
    for M in (growing, growing.dense(), csr_array(growing.dense())):
        with pytest.raises(IterationLimitError):
            solve_psor(LCP(M, [-1.0, -1.0]), max_sweeps=2000)


def test_projected_sor_starts_where_it_is_told() -> None:
    problem = LCP(fathi(4), -np.ones(4))
    found = solve_psor(problem, relaxation=1.5)
    assert solve_psor(problem, relaxation=1.5, start=found.z).iterations < found.iterations


@pytest.mark.parametrize("covering", [[1.0, 0.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0], [np.nan, 1.0, 1.0]])
def test_lemke_needs_a_positive_covering_vector(covering: list[float]) -> None:
    with pytest.raises(InvalidInputError, match="covering"):
        solve_lemke(KOSTREVA, covering=covering)


def test_lemke_follows_another_path_for_another_covering_vector() -> None:
    problem = LCP([[1.0, 2.0], [2.0, 1.0]], [-1.0, -1.0])
    np.testing.assert_allclose(solve_lemke(problem, covering=[1.0, 2.0]).z, [1.0, 0.0])
    np.testing.assert_allclose(solve_lemke(problem, covering=[2.0, 1.0]).z, [0.0, 1.0])


def test_limits_on_pivots_are_kept() -> None:
    with pytest.raises(IterationLimitError, match="max_pivots"):
        solve_lemke(LCP(fathi(6), -np.ones(6)), covering=np.ones(6), max_pivots=10)
    with pytest.raises(IterationLimitError, match="max_pivots"):
        solve_murty(LCP(murty_exponential(6), -np.ones(6)), max_pivots=10)
    with pytest.raises(IterationLimitError, match="max_iterations"):
        solve_policy_iteration(LCP([[2.0, -1.0], [-1.0, 2.0]], [0.0, -3.0]), max_iterations=1)
    with pytest.raises(IterationLimitError, match="max_nodes"):
        enumerate_solutions(KOSTREVA, max_nodes=2)


@pytest.mark.parametrize("n", [3, 6, 8])
def test_lexicographic_lemke_takes_2_to_the_n_pivots_on_the_problem_of_fathi(n: int) -> None:
    # Every ratio ties at every pivot, so one wrong comparison leaves the path; 2**n is its length in rational
    # arithmetic.
    problem = LCP(fathi(n), -np.ones(n))
    assert solve_lemke(problem, covering=np.ones(n)).iterations == 2**n


def test_policy_iteration_that_cycles_is_stopped() -> None:
    # A P-matrix, but no M-matrix: the basic sets go round although there is exactly one solution.
    problem = LCP([[1, 2, -2], [0, 1, -1], [1, 0, 1]], [1, 2, -3])
    with pytest.raises(IterationLimitError, match="came back"):
        solve_policy_iteration(problem)
    np.testing.assert_allclose(solve_murty(problem).z, [5 / 3, 0.0, 4 / 3], atol=1e-14)


@pytest.mark.parametrize("M", [[[1.0, -1.0], [-1.0, 1.0]], csr_array([[1.0, -1.0], [-1.0, 1.0]])])
def test_a_singular_principal_submatrix_is_named(M: object) -> None:
    for method in (solve_policy_iteration, solve_murty):
        with pytest.raises(NumericalError, match="singular"):
            method(LCP(M, [-1.0, -1.0]))
    with pytest.raises(NumericalError, match="singular"):
        solve_policy_iteration(LCP(Tridiagonal([-1.0], [1.0, 1.0], [-1.0]), [-1.0, -1.0]))


def test_policy_iteration_starts_from_a_basic_set_or_a_point() -> None:
    problem = LCP(Tridiagonal([-1.0, -1.0], [2.0, 2.0, 2.0], [-1.0, -1.0]), [-2.0, 5.0, -4.0])
    solution = solve_policy_iteration(problem)
    for start in (solution.z > 0.0, solution.z, solution.z.tolist()):
        assert solve_policy_iteration(problem, start=start).iterations == 1
    far = solve_policy_iteration(problem, start=[False, True, False])
    assert far.iterations > 1
    np.testing.assert_allclose(far.z, solution.z)
    for wrong in ([True, False], [1.0, 2.0], [np.nan, 1.0, 1.0]):
        with pytest.raises(InvalidInputError, match="start"):
            solve_policy_iteration(problem, start=wrong)


@pytest.mark.parametrize("problem", TWO_RUNS, ids=str)
def test_direct_solvers_refuse_several_contact_runs_and_the_front_door_goes_on(problem: KnownProblem) -> None:
    for contact in ("first", "last"):
        with pytest.raises(NumericalError, match="double sweep"):
            solve_brennan_schwartz(problem.lcp, contact=contact)
    with pytest.raises(NumericalError, match="policy iteration"):
        solve_double_sweep(problem.lcp)
    assert solve(problem.lcp).method == "policy-iteration"


def test_the_front_door_names_the_direct_solver_that_answered() -> None:
    methods = {problem.name: solve(problem.lcp).method for problem in of_class("tridiagonal")}
    assert methods["string, contact first"] == "brennan-schwartz"
    assert methods["string, contact last"] == "brennan-schwartz"
    assert methods["string, contact in the middle"] == "double-sweep"
    assert methods["string, two contacts"] == "policy-iteration"


def test_direct_solvers_refuse_other_matrices() -> None:
    for solver in (solve_brennan_schwartz, solve_double_sweep):
        with pytest.raises(InvalidInputError, match="tridiagonal"):
            solver(KOSTREVA)
        with pytest.raises(NumericalError, match="no M-matrix"):
            solver(LCP(Tridiagonal([-1.0], [1.0, 1.0], [-1.0]), [-1.0, -1.0]))
    with pytest.raises(InvalidInputError, match="contact"):
        solve_brennan_schwartz(ONE, contact="middle")  # type: ignore[arg-type]
    assert as_tridiagonal(LCP(np.zeros((0, 0)), [])) is None


def test_enumeration_refuses_more_than_twenty_unknowns() -> None:
    with pytest.raises(InvalidInputError, match="order 21"):
        enumerate_solutions(LCP(np.eye(21), np.ones(21)))


@pytest.mark.parametrize("options", [{"method": "simplex"}, {"tolerance": 0.0}, {"tolerance": 1.0}])
def test_the_front_door_refuses_options_out_of_range(options: dict[str, object]) -> None:
    with pytest.raises(InvalidInputError, match=next(iter(options))):
        solve(ONE, **options)  # type: ignore[arg-type]


def test_a_singular_submatrix_does_not_pass_for_a_solution_far_out() -> None:
    # Rows and columns 0, 1, 3 have determinant 0, which elimination in floating point turns into 1e-16, and z
    # into 1e16; relative to |M| |z| the residual of that point is small. There is no solution.
    M = [[2, -1, 3, 1], [-3, -1, -2, 1], [-1, 2, 2, 3], [-3, -3, 3, 3]]
    problem = LCP(M, [-2, 0, -2, -2])
    with pytest.raises(NumericalError):
        solve_policy_iteration(problem)
    with pytest.raises(InfeasibleError):
        solve(problem)


def widely_scaled() -> LCP:
    """Powers of two that span a factor 1e13 after equilibration."""

    def p(exponent: int) -> float:
        return 2.0**exponent

    M = [
        [p(63), p(64), -p(-35), p(-41), p(-20)],
        [0, 8192, -p(-88), -p(-93), p(-73)],
        [-4, 8, 0, -p(-102), 0],
        [16384, 0, 0, -p(-91), p(-70)],
        [0, 0, p(-41), 0, -p(-26)],
    ]
    return LCP(M, [0, -p(-35), 0, -p(-32), -8192])


@pytest.mark.parametrize("method", ["auto", "exact", "enumeration"])
def test_widely_scaled_data_are_solved_in_exact_arithmetic(method: str) -> None:
    problem = widely_scaled()
    solution = [2.0**-46, 2.0**-46, 22517998136852480, 288230376151711744, 137438953472]
    # In exact arithmetic z = solution > 0 and M z + q = 0.
    rows = zip(problem.dense().tolist(), problem.q.tolist(), strict=True)
    assert [
        sum(Fraction(m) * Fraction(z) for m, z in zip(row, solution, strict=True)) + Fraction(q)
        for row, q in rows
    ] == [0] * 5
    found = solve(problem, method=method)  # type: ignore[arg-type]
    assert scaled_residual(problem, found.z) <= 1e-14


def test_a_certificate_proves_infeasibility_whatever_the_scales() -> None:
    # w_1 = -1 - z_1 < 0, and the equilibrated q spans a factor 1e6.
    with pytest.raises(InfeasibleError, match="combination"):
        solve(LCP([[1.0, 1.0], [0.0, -1.0]], [-1e6, -1.0]), method="enumeration")


@pytest.mark.parametrize("d", [0.1, 1e-9, 1e-200])
@pytest.mark.parametrize("method", ["auto", "exact", "enumeration"])
def test_an_enumeration_in_exact_arithmetic_proves_at_any_scale(d: float, method: str) -> None:
    # w_0 = z_1 - d >= 0 needs z_1 > 0, where w_1 = 1 > 0: no solution for any d > 0.
    with pytest.raises(InfeasibleError, match="complete enumeration"):
        solve(LCP([[0.0, 1.0], [0.0, 0.0]], [-d, 1.0]), method=method)  # type: ignore[arg-type]


def test_an_answer_that_misses_the_tolerance_is_not_returned() -> None:
    random = np.random.default_rng(1)
    A = random.normal(size=(8, 8))
    with pytest.raises(NumericalError, match="scaled residual"):
        solve(LCP(A @ A.T, random.normal(size=8)), tolerance=1e-30)


def test_a_large_sparse_problem_outside_every_class_is_declined() -> None:
    n = 3001
    M = csr_array((np.ones(n), (np.arange(n), (np.arange(n) + 5) % n)), shape=(n, n))
    with pytest.raises(NumericalError, match="3001"):
        solve(LCP(M, -np.ones(n)))


def test_a_start_that_solves_the_problem_is_the_answer_and_any_other_is_ignored():
    problem = LCP([[2.0, 1.0], [1.0, 2.0]], [-4.0, 1.0])
    right, wrong = np.array([True, False]), np.array([False, True])
    assert solve(problem, start=right).method == "start"
    assert solve(problem, start=wrong).method == "lemke"
    assert solve(problem, start=right).z.tolist() == solve(problem, start=wrong).z.tolist() == [2.0, 0.0]
    with pytest.raises(InvalidInputError, match="start"):
        solve(problem, start=np.array([True]))


@pytest.mark.parametrize(
    "options",
    [
        {"tolerance": "a"},
        {"tolerance": None},
        {"start": "ab"},
        {"start": [1.0]},
        {"start": [np.nan, 0.0]},
        {"start": [[True, False]]},
        {"start": [1j, 0.0]},
        {"method": 5},
        {"method": ["lemke"]},
    ],
)
def test_the_front_door_names_an_option_of_the_wrong_kind(options: dict[str, object]) -> None:
    problem = LCP([[2.0, 1.0], [1.0, 2.0]], [-4.0, 1.0])
    with pytest.raises(InvalidInputError, match=next(iter(options))):
        solve(problem, **options)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "start", [[True, False], [2, 0], [2.0, 0.0], (2.0, 0.0), np.array([2, 0]), [1.5, 0.0]]
)
def test_a_start_may_be_any_sequence_of_numbers_or_truth_values(start: object) -> None:
    problem = LCP([[2.0, 1.0], [1.0, 2.0]], [-4.0, 1.0])
    assert solve(problem, start=start).z.tolist() == [2.0, 0.0]  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("call", "field"),
    [
        (lambda: solve_lemke(ONE, max_pivots=2.5), "max_pivots"),
        (lambda: solve_lemke(ONE, max_pivots="many"), "max_pivots"),
        (lambda: solve_lemke(ONE, tolerance="a"), "tolerance"),
        (lambda: solve_murty(ONE, max_pivots=-1), "max_pivots"),
        (lambda: solve_policy_iteration(ONE, max_iterations=1.5), "max_iterations"),
        (lambda: solve_psor(ONE, relaxation="a"), "relaxation"),
        (lambda: solve_psor(ONE, max_sweeps=1.5), "max_sweeps"),
        (lambda: solve_psor(ONE, tolerance=None), "tolerance"),
        (lambda: enumerate_solutions(ONE, max_nodes=0.5), "max_nodes"),
        (lambda: LCP(np.ma.array([[1.0]], mask=[[True]]), [1.0]), "M"),
        (lambda: LCP([[1.0]], np.ma.array([1.0], mask=[True])), "q"),
    ],
)
def test_options_and_data_of_the_wrong_kind_are_named(call, field):
    with pytest.raises(InvalidInputError) as caught:
        call()
    assert caught.value.field == field


def test_a_masked_array_without_masked_entries_is_an_array() -> None:
    assert solve(LCP(np.ma.array([[1.0]]), np.ma.array([-1.0]))).z.tolist() == [1.0]


def test_what_was_tried_is_said_where_nothing_is_proved() -> None:
    n = 62
    M = np.zeros((n, n))
    M[0, 1], M[1, 0], M[0, 0] = 1.0, 0.0, 0.0
    q = np.ones(n)
    q[0] = -1.0  # w_0 = z_1 - 1 >= 0 needs z_1 > 0, where w_1 = 1 > 0
    with pytest.raises(
        RayTerminationError, match=r"proves nothing.*tried without success: .*lemke.*murty"
    ) as caught:
        solve(LCP(M, q))
    assert not isinstance(caught.value, InfeasibleError)
