import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pricing_core.lcs import LCS, PiecewiseConstant, rational_complementarity, well_posedness
from tests.problems.lcs_systems import (
    bridge,
    coupled_integrators,
    filtered_bridge,
    integrators,
    oscillator,
    random_system,
    two_carts,
    two_integrators,
)

GYRATOR = LCS([[-1]], [[0, 0]], [[0], [0]], [[0, -1], [1, 0]])

# name, system, verdict, status of 11.1 ... 11.5, passive, unique input, largest multiplicity
KNOWN = [
    ("bridge", bridge(), "well-posed", "fails silent silent silent silent", True, True, 1),
    ("filtered bridge", filtered_bridge(), "well-posed", "fails silent silent silent fails", True, False, 1),
    ("s/(s^2+1)", oscillator(), "well-posed", "holds holds holds holds holds", True, True, 1),
    ("-s/(s^2+1)", oscillator(-1), "ill-posed", "holds fails silent silent fails", False, None, None),
    ("1/s^2", integrators(2), "well-posed", "holds silent holds holds holds", False, True, 1),
    ("1/s^3", integrators(3), "well-posed", "holds silent holds holds holds", False, True, 1),
    (
        "coupled integrators",
        coupled_integrators(),
        "well-posed",
        "holds silent holds holds holds",
        False,
        True,
        1,
    ),
    ("two carts", two_carts(), "well-posed", "holds silent holds holds holds", False, True, 1),
    (
        "B = (1 2; 2 1)",
        two_integrators([[1, 2], [2, 1]]),
        "ill-posed",
        "holds silent silent silent fails",
        False,
        False,
        None,
    ),
    ("gyrator", GYRATOR, "well-posed", "fails silent silent silent fails", True, False, 1),
    (
        "no input",
        LCS([[0]], [[0]], [[1]]),
        "ill-posed",
        "fails silent silent silent fails",
        False,
        None,
        None,
    ),
    (
        "no output",
        LCS([[0]], [[1]], [[0]]),
        "ill-posed",
        "fails silent silent silent fails",
        False,
        False,
        None,
    ),
    (
        "diode",
        LCS([[-1]], [[1]], [[1]], [[1]]),
        "well-posed",
        "holds silent holds holds holds",
        True,
        True,
        0,
    ),
]


@pytest.mark.parametrize(
    ("system", "verdict", "theorems", "passive", "unique", "multiplicity"),
    [row[1:] for row in KNOWN],
    ids=[row[0] for row in KNOWN],
)
def test_reports_of_known_systems(system, verdict, theorems, passive, unique, multiplicity):
    report = well_posedness(system)
    assert report.verdict == verdict
    assert dict(report.theorems) == dict(
        zip(("11.1", "11.2", "11.3", "11.4", "11.5", "11.6"), [*theorems.split(), "silent"], strict=True)
    )
    assert (report.passive, report.input_unique, report.max_multiplicity) == (passive, unique, multiplicity)
    assert set(report.reasons) == set(report.theorems)
    assert report.totally_invertible == (report.theorems["11.1"] == "holds")
    assert (report.witness is None) == (verdict != "ill-posed")


def test_singular_modes_of_the_bridges():
    """{1, 2} and {3, 4}; with the filter {2} and {1, 3, 4}, counted from 1 (closed form)."""
    assert well_posedness(bridge()).singular_modes == ((0, 1), (2, 3))
    assert well_posedness(filtered_bridge()).singular_modes == ((1,), (0, 2, 3))


def test_the_degenerate_case_is_named():
    assert "degenerate" in well_posedness(integrators(2)).reasons["11.2"]


def test_the_negative_oscillator_has_no_way_on_and_two_ways_on():
    """From (0, -1) none, from (0, 1) two (Schumacher, theorem 11.2)."""
    report = well_posedness(oscillator(-1))
    assert report.witness.tolist() == [0.0, -1.0]
    assert report.counterexample.kind == "no solution"
    assert rational_complementarity(oscillator(-1), [0, 1]).solution_sets == ((), (0,))


def test_the_first_known_witness_of_two_integrators_that_help_each_other():
    report = well_posedness(two_integrators([[1, 2], [2, 1]]))
    assert report.counterexample.kind == "several solutions"
    assert set(report.counterexample.solution_sets) == {(0,), (1,), (0, 1)}


def test_a_passive_system_with_an_unattainable_offset_has_no_solution():
    """y = g = -1 < 0 whatever x and u."""
    report = well_posedness(LCS([[-1]], [[0]], [[0]], g=[-1]))
    assert report.verdict == "ill-posed"
    assert report.counterexample.kind == "no solution"
    attainable = well_posedness(LCS([[-1]], [[1]], [[1]], g=[-1]))
    assert attainable.verdict == "well-posed"


def test_an_offset_that_turns_bad_later_is_seen():
    g = PiecewiseConstant([1.0, 2.0], [[1.0], [-1.0]])
    report = well_posedness(LCS([[-1]], [[0]], [[0]], g=g))
    assert report.verdict == "ill-posed"


def test_a_gyrator_is_passive_and_no_p_matrix():
    report = well_posedness(GYRATOR)
    assert report.passive
    assert report.p_matrix_for_large_s is False


def test_continuity_of_passive_systems():
    """Section 11.2.1; a skew D is nonsingular and passive, but D + D^T = 0 does not make the state continuous."""
    assert well_posedness(LCS([[-1]], [[1]], [[1]], [[1]])).continuity == "always"
    assert well_posedness(LCS([[-1]], [[1]], [[1]])).continuity == "where C x0 + g >= 0"
    assert well_posedness(LCS([[-1]], [[1, 0]], [[1], [0]], [[0, -1], [1, 0]])).continuity is None
    assert well_posedness(two_carts()).continuity is None


def test_a_positive_definite_leading_matrix_settles_systems_with_many_pairs():
    n = 20
    report = well_posedness(LCS(-np.eye(n), np.eye(n), np.eye(n)))
    assert (report.verdict, report.theorems["11.3"]) == ("well-posed", "holds")
    assert (report.totally_invertible, report.singular_modes, report.p_matrix_for_large_s) == (
        True,
        None,
        True,
    )


def test_systems_out_of_reach_are_unknown():
    n = 14
    M = np.eye(n) - 3 * np.eye(n, k=1)
    assert well_posedness(LCS(np.zeros((n, n)), M, np.eye(n))).verdict == "well-posed"  # triangular
    M[-1, 0] = 1.0
    report = well_posedness(LCS(np.zeros((n, n)), M, np.eye(n)))
    assert (report.verdict, report.totally_invertible, report.p_matrix_for_large_s) == ("unknown", None, None)


@given(st.integers(0, 10**6), st.integers(1, 3), st.integers(1, 3), st.booleans())
@settings(max_examples=40, deadline=None)
def test_verdicts_agree_with_solution_sets(seed, n, k, feedthrough):
    rng = np.random.default_rng(seed)
    system = random_system(rng, n, k, feedthrough=feedthrough)
    report = well_posedness(system)
    for _ in range(5):
        found = rational_complementarity(system, rng.integers(-3, 4, n))
        if report.verdict == "well-posed":
            assert found.solution_sets
            assert found.unique_state
        if report.input_unique:
            assert found.unique_input
    if report.verdict == "ill-posed":
        shown = rational_complementarity(system, report.witness)
        assert shown.solution_sets == report.counterexample.solution_sets
        assert not (shown.solution_sets and shown.unique_state)
