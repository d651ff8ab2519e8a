"""Whatever a public function is given, it answers or raises an exception of this library, and help() is readable."""

import inspect
from contextlib import suppress
from types import FunctionType

import numpy as np
import pytest

from pricing_core import american, batch, lcp, lcs, max_plus, models
from pricing_core.errors import PricingCoreError

M = np.array([[2.0, 1.0], [1.0, 2.0]])
SYSTEM = lcs.LCS(-np.eye(2), np.eye(2), np.eye(2))
RELAY = models.RelaySystem([[0.0]], [[1.0]], [[1.0]])
BALL = models.MechanicalSystem([[1.0]], [[0.0]], [[0.0]], [[1.0]])
SENSIBLE = [
    M,
    [1.0, -2.0],
    (0.0, 1.0),
    1,
    2,
    0.5,
    True,
    "lemke",
    [M, M],
    SYSTEM,
    lcp.LCP(M, [-1.0, -1.0]),
    lcs.TimeStepping(step=0.1),
    max_plus.MaxPlusSystem([[1.0, 2.0], [0.0, 1.0]]),
    lambda x: x,
    lambda t, x: x,
]
WRONG = [
    None,
    "abc",
    "",
    b"x",
    object(),
    {"a": 1},
    set(),
    [],
    [[]],
    [[1], [1, 2]],
    float("nan"),
    float("inf"),
    -3,
    0,
    1j,
    10**400,
    1e308,
    int,
    (1, 0),
    ("a", "b"),
    np.array([np.nan, 1.0]),
    np.full((2, 2), np.inf),
    np.ma.masked_array(np.eye(2), mask=[[False, True], [False, False]]),
    np.array([object(), 1], dtype=object),
    np.array(["a", "b"]),
    np.zeros((0, 0)),
    np.zeros((2, 3)),
    np.zeros((2, 2, 2)),
    np.array(3.0),
    lambda *_: "x",
]
OBJECTS = [
    lcp.LCP(M, [-1.0, -1.0]),
    lcp.HorizontalLCP(M, M, [-1.0, 1.0]),
    lcs.simulate(SYSTEM, [1.0, -1.0], (0.0, 1.0)),
    lcs.transfer_matrix(SYSTEM),
    RELAY,
    models.PiecewiseLinearSystem([[0.0]], [[1.0]], [[1.0]], None, [models.saturation()]),
    models.saturation(),
    BALL,
    BALL.simulate([1.0], [0.0], (0.0, 1.0)),
    models.ProjectedSystem((np.eye(2), [1.0, 2.0]), np.eye(2), [0.0, 0.0]),
    models.ProjectedSystem(lambda x: x, constraints=lambda x: [1.0 - x @ x]),
    max_plus.MaxPlusSystem([[1.0, 2.0], [0.0, 1.0]]),
    models.DiodeCircuit().resistor("R", "a", "0", 1.0).diode("D", "a", "0").capacitor("C", "a", "0", 1.0),
]


def public(module):
    """Return the functions and classes that a module exports, and the methods of these classes, by name."""
    found = {}
    for name in module.__all__:
        value = getattr(module, name)
        if inspect.isclass(value) or inspect.isfunction(value):
            found[name] = value
        if inspect.isclass(value):
            members = inspect.getmembers(value, lambda member: isinstance(member, FunctionType))
            found |= {f"{name}.{key}": member for key, member in members if not key.startswith("_")}
    return found


PUBLIC = {
    f"{module.__name__}.{name}": value
    for module in (lcp, lcs, models, max_plus)
    for name, value in public(module).items()
}
CALLABLES = {
    name: value
    for name, value in PUBLIC.items()
    if inspect.isclass(value) or value.__qualname__ == value.__name__
}
METHODS = {
    f"{type(one).__name__}-{place}.{name}": member
    for place, one in enumerate(OBJECTS)
    for name in dir(one)
    if not name.startswith("_") and inspect.ismethod(member := getattr(one, name))
}


def arguments(function, rng):
    """Return arguments for a function, three of four of them of a kind that some function takes."""
    placed, named = [], {}
    for parameter in inspect.signature(function).parameters.values():
        pool = SENSIBLE if rng.random() < 0.75 else WRONG
        value = pool[rng.integers(len(pool))]
        if parameter.kind is parameter.VAR_POSITIONAL or parameter.kind is parameter.POSITIONAL_ONLY:
            placed.append(value)
        elif parameter.kind is parameter.VAR_KEYWORD:
            continue
        elif parameter.default is parameter.empty or rng.random() < 0.4:
            named[parameter.name] = value
    return placed, named


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", [*CALLABLES, *METHODS])
def test_any_arguments_give_an_answer_or_an_error_of_this_library(name):
    function = CALLABLES.get(name) or METHODS[name]
    rng = np.random.default_rng(sum(map(ord, name)))
    for _ in range(25):
        placed, named = arguments(function, rng)
        with suppress(PricingCoreError):
            function(*placed, **named)


SHOWN = PUBLIC | {
    f"{module.__name__}.{name}": getattr(module, name)
    for module in (american, batch)
    for name in module.__all__
    if callable(getattr(module, name))
}


@pytest.mark.parametrize("name", SHOWN)
def test_help_shows_no_private_type_and_no_address(name):
    shown = str(inspect.signature(SHOWN[name]))
    for unreadable in ("numpy._", " at 0x", "<object", "pricing_core."):
        assert unreadable not in shown
