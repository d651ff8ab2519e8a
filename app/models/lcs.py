"""The model "lcs": x' = Ax + Bu + f, y = Cx + Du + g, 0 <= y _|_ u >= 0 (11.69)."""

from collections.abc import Mapping
from typing import Any, get_args

from app.model_keys import INTEGER, NUMBER, VECTOR, Key, choice
from app.models.inputs import INPUT, NUMBER_OR_VECTOR, ON_NONUNIQUE
from app.models.plant import PLANT
from app.models.times import SPAN_AND_TIMES, times_in
from app.simulation import Simulation, of_trajectory
from pricing_core.lcp import Method
from pricing_core.lcs import LCS
from pricing_core.lcs import simulate as simulate_lcs

SYSTEM: Mapping[str, Key] = {
    **PLANT,
    "f": INPUT.described("n numbers or an input that changes; zero where missing"),
    "g": INPUT.described("k numbers or an input that changes; zero where missing"),
}
METHOD: Mapping[str, Key] = {
    "method": choice("event-driven", "time-stepping").described("event-driven where missing"),
    "on_nonunique": ON_NONUNIQUE,
    "max_events": INTEGER.described("of an event-driven run"),
    "scheme": choice("auto", "implicit-euler", "sdirk2", "theta").described("of time stepping"),
    "theta": NUMBER.described("implicit weight of the scheme theta"),
    "h": NUMBER.described("constant step of time stepping"),
    "rtol": NUMBER.described("relative tolerance of time stepping"),
    "atol": NUMBER_OR_VECTOR.described("absolute tolerance of time stepping"),
    "lcp_method": choice(*get_args(Method)).described("of time stepping"),
    "multipliers": choice("any", "least-norm").described("of time stepping, where they are not unique"),
}
KEYS: Mapping[str, Key] = {
    **SYSTEM,
    "x0": VECTOR.described("n numbers: the state at the start", required=True),
    **SPAN_AND_TIMES,
    **METHOD,
}


def simulate(values: Mapping[str, Any]) -> Simulation:
    """Simulate the system of a model file.

    Parameters
    ----------
    values : mapping
        What `KEYS` read.
    """
    system = LCS(**{name: values[name] for name in SYSTEM if name in values})
    options = {name: values[name] for name in METHOD if name in values}
    trajectory = simulate_lcs(system, values["x0"], values["t_span"], t_eval=times_in(values), **options)
    return of_trajectory(trajectory)
