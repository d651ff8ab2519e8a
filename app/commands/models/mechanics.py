"""The model "mechanics": M q'' + D q' + K q = F^T u + force, 0 <= y = F q + offset _|_ u >= 0 (11.85)-(11.87)."""

from collections.abc import Mapping
from typing import Any

from app.commands.model_keys import MATRIX, NUMBER, VECTOR, Key
from app.commands.models.inputs import INPUT
from app.commands.models.method import METHOD, method_in
from app.commands.models.times import SPAN_AND_TIMES, times_in
from app.commands.simulation import CURVE_POINTS, Columns, Modes, Samples, Simulation, numbered, of_samples
from pricing_core.lcs import Trajectory
from pricing_core.models import MechanicalSystem

SYSTEM: Mapping[str, Key] = {
    "mass": MATRIX.described("n x n, by rows, symmetric and positive definite", required=True),
    "damping": MATRIX.described("n x n, by rows; zero where missing"),
    "stiffness": MATRIX.described("n x n, by rows; zero where missing"),
    "F": MATRIX.described("k x n, by rows", required=True),
    "force": INPUT.described("n numbers or an input that changes; zero where missing"),
    "offset": VECTOR.described("k numbers; zero where missing"),
    "restitution": NUMBER.described("from 0, where missing, to 1"),
}
KEYS: Mapping[str, Key] = {
    **SYSTEM,
    "q0": VECTOR.described("n numbers: the position at the start", required=True),
    "v0": VECTOR.described("n numbers: the velocity at the start", required=True),
    **SPAN_AND_TIMES,
    **METHOD,
}


def simulate(values: Mapping[str, Any]) -> Simulation:
    """Simulate the mechanical system of a model file.

    Parameters
    ----------
    values : mapping
        What `KEYS` read.
    """
    given = {name: values[name] for name in SYSTEM if name in values}
    n = len(given["mass"])
    at_rest = {name: [[0] * n] * n for name in ("damping", "stiffness")}
    run = MechanicalSystem(**at_rest | given).simulate(
        values["q0"], values["v0"], values["t_span"], method=method_in(values), t_eval=times_in(values)
    )
    states = numbered("q", n) + numbered("v", n)
    modes = Modes(numbered("y", run.y.shape[1]))
    return of_samples(run, _samples(run), _samples(run.refined(CURVE_POINTS)), states, modes)


def _samples(run: Trajectory) -> Samples:
    n, k = run.x.shape[1] // 2, run.u.shape[1]
    return Samples(
        "t",
        run.t,
        (
            Columns("q", "position", numbered("q", n), run.x[:, :n]),
            Columns("v", "velocity", numbered("v", n), run.x[:, n:]),
            Columns("u", "contact force", numbered("u", k), run.u),
            Columns("y", "gap", numbered("y", k), run.y),
        ),
    )
