"""Model files of `pricing simulate`: the models by name, and how a file is read.

A model is one module with two names. `KEYS` are the keys of its file beside "model", each with its reader and schema
(`app.model_keys`). `simulate(values) -> Simulation` takes what the keys read, builds the library's object and runs it.
A new model is such a module and one line of `MODULES`: reading, errors, table, CSV, JSON, picture and schema then come
by themselves; a model whose keys depend on each other may have a `SCHEMA` of its own. Models whose library returns a
`Trajectory` end with `of_trajectory`, those with a `ModelTrajectory` with `of_model`; others make a `Simulation` of
their own. `app.models.inputs`, `app.models.method`, `app.models.plant` and `app.models.times` hold keys that several
models share.
"""

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, cast

from app.model_keys import Key, choice, object_schema, read_object
from app.models.method import named_as_in_files
from app.simulation import Simulation
from pricing_core.american.contracts.json_text import JSONTextError, parse_json
from pricing_core.errors import InvalidInputError, Told

MODULES = {
    "lcs": "app.models.lcs",
    "relay": "app.models.relay",
    "piecewise-linear": "app.models.piecewise_linear",
    "projected": "app.models.projected",
    "mechanics": "app.models.mechanics",
    "circuit": "app.models.circuit",
    "optimal-control": "app.models.optimal_control",
    "max-plus": "app.models.max_plus",
}
TITLE = "A model for `pricing simulate`"


class Model(Protocol):
    """What a module of a model has."""

    KEYS: Mapping[str, Key]

    def simulate(self, values: Mapping[str, Any]) -> Simulation:
        """Run the model."""
        ...


class ModelFileError(ValueError):
    """The file is not one JSON value."""


def simulate_file(path: Path) -> Simulation:
    """Read a model file and run it.

    Raises
    ------
    ModelFileError, InvalidInputError
        The file is not JSON, or not a model; one sentence names the key, the value and what is allowed.
    NumericalError
        The library cannot go on.
    OSError
        The file cannot be read.
    """
    try:
        content = parse_json(path.read_bytes().decode("utf-8-sig"))
    except UnicodeError:
        raise ModelFileError(f"{path} is not UTF-8 text") from None
    except JSONTextError as fault:
        raise ModelFileError(f"{path} {fault}") from None
    if not isinstance(content, dict):
        raise ModelFileError(f"{path} must hold one JSON object")
    if "model" not in content:
        raise InvalidInputError("model", Told("missing"), "one of " + ", ".join(MODULES))
    name = choice(*MODULES).read("model", content["model"])
    model = _model(name)
    values = read_object("", content, _keys(name, model))
    with named_as_in_files():
        return model.simulate(values)


def schema() -> dict[str, Any]:
    """Return the JSON Schema of model files."""
    models = {name: _model(name) for name in MODULES}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": TITLE,
        "oneOf": [
            {**getattr(model, "SCHEMA", object_schema(_keys(name, model))), "title": name}
            for name, model in models.items()
        ],
    }


def _model(name: str) -> Model:
    return cast(Model, import_module(MODULES[name]))


def _keys(name: str, model: Model) -> dict[str, Key]:
    return {"model": choice(name).described("which equations these are", required=True), **model.KEYS}
