"""The model "piecewise-linear": x' = Ax + Bu, y = Cx + Du, (y_i, u_i) on the graph of characteristic i (11.34)."""

from collections.abc import Mapping
from typing import Any

from app.model_keys import NUMBER, VECTOR, Key, choice
from app.models.characteristics import CHARACTERISTICS
from app.models.inputs import ON_NONUNIQUE
from app.models.plant import PLANT
from app.models.times import SPAN_AND_TIMES, times_in
from app.simulation import Simulation, of_model
from pricing_core.models import PiecewiseLinearSystem

METHOD: Mapping[str, Key] = {
    "method": choice("event-driven", "time-stepping").described("event-driven where missing"),
    "on_nonunique": ON_NONUNIQUE,
    "h": NUMBER.described("constant step of time stepping"),
}
KEYS: Mapping[str, Key] = {
    **PLANT,
    "characteristics": CHARACTERISTICS.described("k of them, each a polyline in (y, u)", required=True),
    "x0": VECTOR.described("n numbers: the state at the start", required=True),
    **SPAN_AND_TIMES,
    **METHOD,
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
    options = {name: values[name] for name in METHOD if name in values}
    run = system.simulate(values["x0"], values["t_span"], t_eval=times_in(values), **options)
    return of_model(run, ("value u", "argument y"))
