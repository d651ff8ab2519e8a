"""The manifest of a run: its input, parameters and versions. They decide whether an earlier run's parts are used."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import pyarrow as pa

from pricing_core.american.pricing_settings import PricingSettings
from pricing_core.batch.unit import Counts, sum_of
from pricing_core.errors import InvalidInputError, Told
from pricing_core.kernel import instruction_set
from pricing_core.version import ENGINE_VERSION

MANIFEST = "manifest.json"
PART = ".arrow"  # ending of the names of parts
Identity = Mapping[str, Any]

# What a user calls the entries of an identity that are no arguments.
WORDS = {
    "output": "the format of the output",
    "engine": "the version of the engine",
    "instructions": "the instruction set of the processor",
    "pyarrow": "the version of pyarrow",
}


def identity_of(
    digests: Mapping[str, str], settings: PricingSettings, output: str, block_size: int | None
) -> Identity:
    """Return everything on which the numbers of the output depend.

    Parameters
    ----------
    digests : mapping of str to str
        SHA-256 of each table by its name within the input, of the only one by "".
    output : str
        Format of the output.
    block_size : int or None
        As `run_batch` was given it.
    """
    whole = hashlib.sha256(json.dumps(dict(digests), sort_keys=True).encode()).hexdigest()
    return {
        "input": digests[""] if list(digests) == [""] else whole,
        **asdict(settings),
        "output": output,
        "block_size": block_size,
        "engine": ENGINE_VERSION,
        "instructions": instruction_set(),
        "pyarrow": pa.__version__,
    }


def part_names(identity: Identity) -> str:
    """Return the beginning of the names of a run's parts, so that parts of different runs never meet."""
    return hashlib.sha256(json.dumps(identity, sort_keys=True).encode()).hexdigest()[:12]


@dataclass(frozen=True, slots=True)
class Manifest:
    """The manifest of a run, kept in its folder and later beside its output.

    Parameters
    ----------
    identity : mapping
    state : {"running", "complete"}
    units : sequence of Counts
        The counts of the units in order; there are none while the run goes on, for the parts hold them then.
    sizes : mapping of str to int
        Bytes of each file of the output by its name within it, of the only one by "".
    """

    identity: Identity
    state: str = "running"
    units: Sequence[Counts] = ()
    sizes: Mapping[str, int] = field(default_factory=dict)

    def as_bytes(self) -> bytes:
        """Return the manifest as JSON."""
        content = {
            "state": self.state,
            "identity": dict(self.identity),
            "counts": sum_of(self.units).as_json(),
            "units": [counts.as_json() for counts in self.units],
            "sizes": dict(self.sizes),
        }
        return json.dumps(content, indent=1).encode()

    @classmethod
    def of_bytes(cls, content: bytes) -> Manifest | None:
        """Return the manifest that the bytes hold; None where they hold none."""
        try:
            values = json.loads(content)
            units = [Counts.of_json(counts) for counts in values["units"]]
            return cls(values["identity"], values["state"], units, values["sizes"])
        except (ValueError, KeyError, TypeError):
            return None


def check_same_run(before: Identity, now: Identity, folder: str) -> None:
    """Accept parts of a run with the same input, parameters and versions.

    Raises
    ------
    InvalidInputError
        Something differs; the message says what.
    """
    names = [name for name in {**before, **now} if before.get(name) != now.get(name)]
    if not names:
        return
    differences = "; ".join(_difference(name, before.get(name), now.get(name)) for name in names)
    allowed = (
        f"asked for with the input, parameters and versions of the run begun in {folder}, but {differences}: "
        "state those again to go on from its parts, or leave out --resume to discard them and start afresh"
    )
    raise InvalidInputError("resume", Told("True"), allowed)


def _difference(name: str, before: object, now: object) -> str:
    if name == "input":
        return "the input has changed"
    return f"{WORDS.get(name, name)} was {before} and is {now}"
