"""The model "projected": -F(x) projected on what Hx >= h allows (11.39), for F(x) = matrix x + vector."""

from collections.abc import Mapping
from typing import Any

from app.commands.model_keys import MATRIX, VECTOR, Key, keys_for, object_of
from app.commands.models.labels import label_keys, labels_in
from app.commands.models.method import METHOD, method_in
from app.commands.models.times import SPAN_AND_TIMES, times_in
from app.commands.simulation import Simulation, of_model
from pricing_core.models import ProjectedSystem

AFFINE = {
    "matrix": MATRIX.described("n x n, by rows", required=True),
    "vector": VECTOR.described("n numbers", required=True),
}
CHOICES = {name: METHOD[name] for name in ("method", "max_events", "rtol", "atol")}  # h is a vector here
KEYS: Mapping[str, Key] = {
    "F": object_of(AFFINE).described("F(x) = matrix x + vector", required=True),
    "H": MATRIX.described("k x n, by rows", required=True),
    "h": VECTOR.described("k numbers", required=True),
    "x0": VECTOR.described("n numbers with H x0 >= h: the state at the start", required=True),
    **SPAN_AND_TIMES,
    **CHOICES,
    **label_keys({"x": "of the n states", "u": "of the k multipliers", "y": "of the k slacks"}),
}


def simulate(values: Mapping[str, Any]) -> Simulation:
    """Simulate the projected system of a model file.

    Parameters
    ----------
    values : mapping
        What `KEYS` read.
    """
    F = values["F"]
    with keys_for({"F[0]": "F.matrix", "F[1]": "F.vector"}):
        system = ProjectedSystem((F["matrix"], F["vector"]), values["H"], values["h"])
    method = method_in(values, CHOICES)
    run = system.simulate(values["x0"], values["t_span"], method=method, t_eval=times_in(values))
    return of_model(run, ("multiplier", "slack"), labels_in(values), elements="y", piece_names=None)
