"""Values of the wrong kind are refused by the name of their argument, wherever it is taken."""

from fractions import Fraction

import numpy as np
import pytest

from pricing_core.errors import InvalidInputError
from pricing_core.lcs import (
    LCS,
    EventDriven,
    Exosystem,
    PiecewiseConstant,
    SemiExplicitSystem,
    TimeStepping,
    mode_geometry,
    piecewise_linear,
    rational_complementarity,
    simulate,
    simulate_nonlinear,
    sine,
    transfer_matrix,
    well_posedness,
)
from pricing_core.lcs.relay_criteria import has_guaranteed_direction
from tests.problems.bad_values import WRONG, by_name

SYSTEM = LCS([[-1.0]], [[1.0]], [[1.0]])
FALLING = {"f": lambda x, u: u - 1.0, "h": lambda x, u: x, "pairs": 1}
RUN = simulate(SYSTEM, [1.0], (0.0, 1.0))
STEPPED = simulate(SYSTEM, [1.0], (0.0, 1.0), method=TimeStepping(step=0.5))


def lcs(**given):
    return LCS(**{"A": [[0]], "B": [[1]], "C": [[1]], **given})


def run(**given):
    return simulate(**{"system": SYSTEM, "x0": [1.0], "t_span": (0.0, 1.0), **given})


def nonlinear(**given):
    return simulate_nonlinear(
        **{"system": SemiExplicitSystem(**FALLING), "x0": [1.0], "t_span": (0, 1), **given}
    )


TAKEN = [
    *by_name(lcs, "A", "B", "C", "D", "f", "g"),
    *by_name(run, "x0", "t_span", "method", "t_eval", "interrupt"),
    *by_name(EventDriven, "on_nonunique", "rebound"),
    *by_name(TimeStepping, "scheme", "step", "tolerance", "absolute_tolerance", "lcp_method", "multipliers"),
    ("theta", lambda value: TimeStepping("theta", value)),
    *by_name(nonlinear, "x0", "t_span", "method", "t_eval", "interrupt"),
    *by_name(lambda **given: SemiExplicitSystem(**{**FALLING, **given}), "f", "h", "pairs", "f_jacobian"),
    ("f", lambda value: nonlinear(system=SemiExplicitSystem(**{**FALLING, "f": lambda x, u: value}))),
    *by_name(lambda **given: PiecewiseConstant(**{"times": [1], "values": [1], **given}), "times", "values"),
    *by_name(lambda **given: piecewise_linear(**{"times": [1], "values": [1], **given}), "times", "values"),
    *by_name(
        lambda **given: Exosystem(**{"generator": [[0]], "output": [[1]], "states": [1], **given}),
        "generator",
        "output",
        "states",
        "times",
    ),
    *by_name(lambda **given: sine(**{"amplitude": 1, "frequency": 1, **given}), "amplitude", "frequency"),
    *by_name(lambda **given: sine(1, 1, **given), "phase", "offset"),
    ("t", PiecewiseConstant([1], [1]).after),
    ("t", sine(1, 1).before),
    ("t", RUN),
    ("t", STEPPED),
    ("count", RUN.refined),
    ("mode", lambda value: mode_geometry(SYSTEM, value)),
    ("rank_tolerance", lambda value: mode_geometry(SYSTEM, [0], exact=False, rank_tolerance=value)),
    ("x0", lambda value: rational_complementarity(SYSTEM, value)),
    ("x", lambda value: has_guaranteed_direction([[0]], [[1]], [[1]], None, value)),
    ("mode", transfer_matrix(SYSTEM).submatrix),
]


@pytest.mark.parametrize(("field", "take"), TAKEN, ids=[f"{i} {field}" for i, (field, _) in enumerate(TAKEN)])
@pytest.mark.parametrize("value", WRONG)
def test_a_value_of_the_wrong_kind_is_refused_by_name(field, take, value):
    with pytest.raises(InvalidInputError, match=rf"^{field}\b.* must be "):
        take(value)


@pytest.mark.parametrize("s", ["1j", None, True, pytest.param(10**400, id="401 digits"), np.nan, [1.0]])
def test_a_transfer_matrix_is_evaluated_at_numbers_alone(s):
    with pytest.raises(InvalidInputError, match=r"s = .* number"):
        transfer_matrix(SYSTEM)(s)
    assert (
        transfer_matrix(SYSTEM)(np.float32(1.0)).item() == transfer_matrix(SYSTEM)(Fraction(1)).item() == 0.5
    )


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int64, np.int8])
def test_numpy_numbers_are_taken_as_those_of_python(kind):
    one, third = kind(1), Fraction(1, 3)
    mixed = LCS([[-one, third], [0, -1]], [[one], [0]], [[one, 0]], f=[third, one])
    plain = LCS([[-1, third], [0, -1]], [[1], [0]], [[1, 0]], f=[third, 1])
    span = (kind(0), kind(2))
    found = simulate(mixed, [one, kind(3)], span, t_eval=[one], method=EventDriven(max_events=np.int64(9)))
    assert np.array_equal(found.x, simulate(plain, [1, 3], (0, 2), t_eval=[1]).x)
    assert well_posedness(mixed).verdict == well_posedness(plain).verdict
    assert run(method=TimeStepping(step=one)).t.tolist() == [0.0, 1.0]


def test_the_smallest_numbers_are_numbers():
    assert simulate(SYSTEM, [1e-320], (0.0, 1.0)).status == "finished"
    assert simulate(lcs(A=[[-1e-320]]), [1.0], (0.0, 1.0)).x[-1, 0] == pytest.approx(1.0, rel=1e-15)
    assert simulate(SYSTEM, [1.0], (0.0, 1e-320)).x[-1, 0] == pytest.approx(1.0, rel=1e-15)
