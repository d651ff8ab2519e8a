"""Model files of `pricing simulate`: the models by name, and how a file is read.

A model is one module of `models` with two names. `KEYS` are the keys of its file beside "model", each with its reader
and schema (`model_keys`); a model that may be stated in several forms has `FORMS` in their place, the keys of each by
its title. `simulate(values) -> Simulation` takes what the keys read, builds the library's object and runs it. A new
model is such a module and one line of `MODULES`: reading, errors, table, CSV, JSON, picture and schema then come by
themselves. Models whose library returns a `Trajectory` end with `of_trajectory`, those with a `ModelTrajectory` with
`of_model`; others make a `Simulation` of their own. `models.inputs`, `models.labels`, `models.method`, `models.plant`
and `models.times` hold keys that several models share.
"""

from collections.abc import Mapping
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, cast

from app.commands.model_keys import Key, choice, keys_for, object_schema, read_object
from app.commands.models.method import KEYS_OF_FIELDS
from app.commands.simulation import Simulation
from pricing_core.american.contracts.json_text import JSONTextError, parse_json
from pricing_core.errors import MissingInputError, enumerated

MODULES = {
    "lcs": "app.commands.models.lcs",
    "relay": "app.commands.models.relay",
    "piecewise-linear": "app.commands.models.piecewise_linear",
    "projected": "app.commands.models.projected",
    "mechanics": "app.commands.models.mechanics",
    "circuit": "app.commands.models.circuit",
    "optimal-control": "app.commands.models.optimal_control",
    "max-plus": "app.commands.models.max_plus",
}
NETLISTS = (".cir", ".net", ".sp")
FORMATS = (
    'a model is JSON, with a netlist as the text "netlist" in it; a netlist alone ends in .cir, .net or .sp'
)
TITLE = "A model for `pricing simulate`"


class Model(Protocol):
    """The names that a module of a model defines."""

    KEYS: Mapping[str, Key]

    def simulate(self, values: Mapping[str, Any]) -> Simulation:
        """Run the model."""
        ...


class ModelFileError(ValueError):
    """The file is not one JSON value."""


def simulate_file(path: Path) -> Simulation:
    """Read a model file, or the netlist of a circuit, and run it.

    Raises
    ------
    ModelFileError, InvalidInputError
        The file is not JSON, or not a model; one sentence names the key, the value and what is allowed.
    NumericalError
        The library cannot go on.
    OSError
        The file cannot be read.
    """
    if path.suffix.lower() in NETLISTS:
        from app.commands.models.circuit import simulate_netlist  # noqa: PLC0415

        return replace(simulate_netlist(path), model="circuit")
    try:
        content = parse_json(path.read_bytes().decode("utf-8-sig"))
    except UnicodeError:
        raise ModelFileError(f"{path} is not UTF-8 text") from None
    except JSONTextError as fault:
        hint = "" if path.suffix.lower() == ".json" else f": {FORMATS}"
        raise ModelFileError(f"{path} {fault}{hint}") from None
    if not isinstance(content, dict):
        raise ModelFileError(f"{path} must hold one JSON object")
    return simulate_model(content)


def simulate_model(content: Mapping[str, Any]) -> Simulation:
    """Run a model whose file is parsed; see `simulate_file`.

    Where a model has several forms, that one is read which knows the most of the keys, then which lacks the fewest.

    Examples
    --------
    >>> run = simulate_model({"model": "max-plus", "A": [[3, 7], [2, 4]], "x0": [1, 0], "steps": 2})
    >>> run.headline, run.samples.columns[0].values.tolist()
    ('2 steps, cycle time 4.5', [[1.0, 0.0], [7.0, 4.0], [11.0, 9.0]])
    """
    if "model" not in content:
        raise MissingInputError("model", f"give one of {enumerated([*MODULES], 'or')}")
    name = choice(*MODULES).read("model", content["model"])
    model = _model(name)
    keys = max(_forms(name, model).values(), key=lambda form: _likeness(form, content))
    values = read_object("", content, keys)
    with keys_for(KEYS_OF_FIELDS):
        return replace(model.simulate(values), model=name)


def _likeness(form: Mapping[str, Key], content: Mapping[str, Any]) -> tuple[int, int]:
    lacking = sum(key.required and name not in content for name, key in form.items())
    return len(form.keys() & content.keys()), -lacking


def schema() -> dict[str, Any]:
    """Return the JSON Schema of model files."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": TITLE,
        "oneOf": [_schema(name, _model(name)) for name in MODULES],
    }


def _model(name: str) -> Model:
    return cast(Model, import_module(MODULES[name]))


def _forms(name: str, model: Model) -> dict[str, dict[str, Key]]:
    """Return the keys of each form of a model by its title."""
    forms: Mapping[str, Mapping[str, Key]] = getattr(model, "FORMS", None) or {name: model.KEYS}
    kind = {"model": choice(name).described("which equations these are", required=True)}
    return {title: {**kind, **keys} for title, keys in forms.items()}


def _schema(name: str, model: Model) -> dict[str, Any]:
    forms = [{**object_schema(keys), "title": title} for title, keys in _forms(name, model).items()]
    return forms[0] if len(forms) == 1 else {"title": name, "oneOf": forms}
