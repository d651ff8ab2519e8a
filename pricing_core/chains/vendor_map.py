"""Which columns of a vendor's file are which canonical columns: one data file per vendor in `formats`."""

from __future__ import annotations

import functools
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any

from pricing_core.chains.cells import MONTH_FIRST
from pricing_core.errors import InvalidInputError

Names = Mapping[str, Sequence[str]]
GENERIC = "generic"


@dataclass(frozen=True, slots=True)
class VendorMap:
    """The columns in which one vendor ships quotes; names of columns are compared by `plain_name`.

    Parameters
    ----------
    name, title : str
    signatures : sequence of sequences of str
        A file that has all columns of one of them is this vendor's.
    columns : mapping of str to names
        The vendor's columns that may hold each canonical column, the best one first.
    call, put : mapping of str to names
        Where call and put share a row: what each of them has of its own.
    mean : mapping of str to lists of names
        Canonical columns that are the mean of several.
    scale : mapping of str to float
        What numbers are multiplied by in the file.
    zero_is_missing : sequence of str
        Canonical columns where a zero says that there is nothing.
    dates : str, optional
        "month/day/year" where dates are written so.
    """

    name: str
    title: str
    signatures: Sequence[Sequence[str]]
    columns: Names
    call: Names = field(default_factory=dict)
    put: Names = field(default_factory=dict)
    mean: Mapping[str, Sequence[Sequence[str]]] = field(default_factory=dict)
    scale: Mapping[str, float] = field(default_factory=dict)
    zero_is_missing: Sequence[str] = ()
    dates: str | None = None

    def __post_init__(self) -> None:
        if self.dates not in (None, MONTH_FIRST):
            raise InvalidInputError("dates", self.dates, f'"{MONTH_FIRST}", or left out')

    @property
    def is_wide(self) -> bool:
        """Whether call and put share a row."""
        return bool(self.call)

    def matches(self, names: Iterable[str]) -> bool:
        """Tell whether a file with these columns is this vendor's."""
        present = set(map(plain_name, names))
        return any(present.issuperset(map(plain_name, wanted)) for wanted in self.signatures)


def plain_name(name: str) -> str:
    """Return a name by which columns are compared.

    Examples
    --------
    >>> [plain_name(name) for name in (" [QUOTE_DATE]", "quoteDate", "details.strike_price")]
    ['quotedate', 'quotedate', 'details.strikeprice']
    """
    return re.sub(r"[^a-z0-9.]", "", name.lower())


@functools.cache
def vendor_maps() -> Mapping[str, VendorMap]:
    """Return all maps by name, read once."""
    folder = files("pricing_core.chains") / "formats"
    found = {}
    for file in sorted(folder.iterdir(), key=lambda entry: entry.name):
        name, dot, ending = file.name.rpartition(".")
        if dot and ending == "toml":
            content: dict[str, Any] = tomllib.loads(file.read_text("utf-8"))
            found[name] = VendorMap(name=name, **content)
    return found


def map_for(format_: str, names: Sequence[str]) -> VendorMap:
    """Return the map that is named, or with "auto" the one whose columns are there; else the generic one.

    Raises
    ------
    InvalidInputError
        There is no format of that name, or a file has the columns of several.
    """
    maps = vendor_maps()
    if format_ != "auto":
        if format_ not in maps:
            allowed = ", ".join(f'"{name}"' for name in ("auto", *maps))
            raise InvalidInputError("format", format_, f"one of {allowed}")
        return maps[format_]
    found = [map_ for map_ in maps.values() if map_.matches(names)]
    if len(found) > 1:
        raise InvalidInputError(
            "format",
            format_,
            f"stated: the columns are those of {' and of '.join(map_.name for map_ in found)}",
        )
    return found[0] if found else maps[GENERIC]
