"""The model "piecewise-linear": x' = Ax + Bu, y = Cx + Du, (y_i, u_i) on the graph of characteristic i (11.34)."""

from collections.abc import Mapping
from typing import Any

from app.commands.model_keys import VECTOR, Key
from app.commands.models.characteristics import CHARACTERISTICS
from app.commands.models.labels import label_keys, labels_in
from app.commands.models.method import METHOD, method_in
from app.commands.models.plant import PLANT
from app.commands.models.times import SPAN_AND_TIMES, times_in
from app.commands.simulation import Simulation, of_model
from pricing_core.models import PiecewiseLinearSystem

KEYS: Mapping[str, Key] = {
    **PLANT,
    "characteristics": CHARACTERISTICS.described("k of them, each a polyline in (y, u)", required=True),
    "x0": VECTOR.described("n numbers: the state at the start", required=True),
    **SPAN_AND_TIMES,
    **METHOD,
    **label_keys(
        {"x": "of the n states", "u": "of the k characteristics' values", "y": "of their arguments"}
    ),
}


def simulate(values: Mapping[str, Any]) -> Simulation:
    """Simulate the piecewise linear system of a model file.

    Parameters
    ----------
    values : mapping
        What `KEYS` read.
    """
    system = PiecewiseLinearSystem(
        values["A"], values["B"], values["C"], values.get("D"), values["characteristics"]
    )
    run = system.simulate(values["x0"], values["t_span"], method=method_in(values), t_eval=times_in(values))
    return of_model(run, ("value u", "argument y"), labels_in(values))
