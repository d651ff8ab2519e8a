"""The model "relay": x' = Ax + Bu, y = Cx + Du, u_i = -sgn y_i, or between other bounds (11.89)."""

from collections.abc import Mapping
from typing import Any

from app.commands.model_keys import VECTOR, Key, choice
from app.commands.models.inputs import NUMBER_OR_VECTOR
from app.commands.models.labels import label_keys, labels_in
from app.commands.models.method import METHOD, method_in
from app.commands.models.plant import PLANT
from app.commands.models.times import SPAN_AND_TIMES, times_in
from app.commands.simulation import Simulation, of_model
from pricing_core.models import RelaySystem

SYSTEM: Mapping[str, Key] = {
    **PLANT,
    "lower": NUMBER_OR_VECTOR.described("u_i where y_i > 0; -1 where missing"),
    "upper": NUMBER_OR_VECTOR.described("u_i where y_i < 0; 1 where missing"),
}
KEYS: Mapping[str, Key] = {
    **SYSTEM,
    "x0": VECTOR.described("n numbers: the state at the start", required=True),
    **SPAN_AND_TIMES,
    "form": choice("input-output", "dae").described(
        "which complementarity system is simulated; input-output where missing"
    ),
    **METHOD,
    **label_keys({"x": "of the n states", "u": "of the k relays' outputs", "y": "of their inputs"}),
}
PIECES = ("upper", "slides", "lower")


def simulate(values: Mapping[str, Any]) -> Simulation:
    """Simulate the relays of a model file.

    Parameters
    ----------
    values : mapping
        What `KEYS` read.
    """
    system = RelaySystem(**{name: values[name] for name in SYSTEM if name in values})
    run = system.simulate(
        values["x0"],
        values["t_span"],
        form=values.get("form", "input-output"),
        method=method_in(values),
        t_eval=times_in(values),
    )
    return of_model(run, ("relay output", "relay input"), labels_in(values), piece_names=PIECES)
