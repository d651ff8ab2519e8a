"""The model "lcs": x' = Ax + Bu + f, y = Cx + Du + g, 0 <= y _|_ u >= 0 (11.69)."""

from collections.abc import Mapping
from typing import Any

from app.commands.model_keys import VECTOR, Key
from app.commands.models.inputs import INPUT
from app.commands.models.labels import label_keys, labels_in
from app.commands.models.method import METHOD, method_in
from app.commands.models.plant import PLANT
from app.commands.models.times import SPAN_AND_TIMES, times_in
from app.commands.simulation import Simulation, of_trajectory
from pricing_core.lcs import LCS
from pricing_core.lcs import simulate as simulate_lcs

SYSTEM: Mapping[str, Key] = {
    **PLANT,
    "f": INPUT.described("n numbers or an input that changes; zero where missing"),
    "g": INPUT.described("k numbers or an input that changes; zero where missing"),
}
KEYS: Mapping[str, Key] = {
    **SYSTEM,
    "x0": VECTOR.described("n numbers: the state at the start", required=True),
    **SPAN_AND_TIMES,
    **METHOD,
    **label_keys({"x": "of the n states", "u": "of the k multipliers", "y": "of the k slacks"}),
}


def simulate(values: Mapping[str, Any]) -> Simulation:
    """Simulate the system of a model file.

    Parameters
    ----------
    values : mapping
        What `KEYS` read.
    """
    system = LCS(**{name: values[name] for name in SYSTEM if name in values})
    trajectory = simulate_lcs(
        system, values["x0"], values["t_span"], method=method_in(values), t_eval=times_in(values)
    )
    return of_trajectory(trajectory, labels_in(values))
