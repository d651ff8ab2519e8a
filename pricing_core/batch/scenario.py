"""Scenarios: by how much spot, volatility and rate move, and how many days pass."""

from __future__ import annotations

import csv
import io
import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from numbers import Real
from typing import Any

from pricing_core.american.contracts.dates import DAYS_PER_YEAR
from pricing_core.american.contracts.json_text import parse_cell
from pricing_core.batch.locations import as_location, open_binary
from pricing_core.errors import InvalidInputError, Told
from pricing_core.plain_number import read_number

SHIFTS = ("spot_shift", "volatility_shift", "rate_shift", "days_forward")
MOST_SCENARIOS = 10_000
MOST_DAYS = 73_000.0  # 200 years, the longest life of an option
LARGEST_FILE = 1 << 24  # bytes of a file of scenarios


@dataclass(frozen=True, slots=True)
class Scenario:
    """One combination of shifts; all are 0 by default, which leaves the market as it is.

    Parameters
    ----------
    spot_shift : float
        Relative: -0.1 is 10 % down.
    volatility_shift, rate_shift : float
        Absolute, 0.01 is one point; a curve moves in parallel.
    days_forward : float
        Days that pass, 0 to 73,000.
    name : str
        Empty for one that is told by its shifts.

    Raises
    ------
    InvalidInputError
        A shift is no finite number, or time goes backwards.
    """

    spot_shift: float = 0.0
    volatility_shift: float = 0.0
    rate_shift: float = 0.0
    days_forward: float = 0.0
    name: str = ""

    def __post_init__(self) -> None:
        for shift in SHIFTS:
            value = getattr(self, shift)
            if not (isinstance(value, Real) and math.isfinite(value)) or isinstance(value, bool):
                raise InvalidInputError(shift, value, "a finite number")
            object.__setattr__(self, shift, float(value))
        if not 0.0 <= self.days_forward <= MOST_DAYS:
            raise InvalidInputError("days_forward", self.days_forward, f"a number from 0 to {MOST_DAYS:g}")

    @property
    def years_forward(self) -> float:
        """The days that pass, in years."""
        return self.days_forward / DAYS_PER_YEAR

    @property
    def is_unshifted(self) -> bool:
        """Whether all shifts are 0."""
        return not any(getattr(self, shift) for shift in SHIFTS)

    @property
    def label(self) -> str:
        """The name, or else the shifts that are not 0.

        Examples
        --------
        >>> Scenario(spot_shift=-0.1, days_forward=5).label, Scenario().label
        ('spot_shift=-0.1 days_forward=5', 'unshifted')
        """
        moved = [f"{shift}={value:.12g}" for shift in SHIFTS if (value := getattr(self, shift))]
        return self.name or " ".join(moved) or "unshifted"


def scenarios_of(
    spot_shifts: Sequence[float] | None = None,
    volatility_shifts: Sequence[float] | None = None,
    rate_shifts: Sequence[float] | None = None,
    days_forward: Sequence[float] | None = None,
) -> tuple[Scenario, ...]:
    """Return every combination of the shifts; a list that is not given is one unshifted value.

    Parameters
    ----------
    spot_shifts, volatility_shifts, rate_shifts, days_forward : sequence of float, optional
        Values of the fields of `Scenario` that are combined, in its units.

    Raises
    ------
    InvalidInputError
        A list is empty or holds something else than finite numbers, or there are more than 10,000 combinations.

    Examples
    --------
    >>> [scenario.label for scenario in scenarios_of([-0.1, 0.0], rate_shifts=[0.01])]
    ['spot_shift=-0.1 rate_shift=0.01', 'rate_shift=0.01']
    """
    lists = {
        "spot_shifts": spot_shifts,
        "volatility_shifts": volatility_shifts,
        "rate_shifts": rate_shifts,
        "days_forward": days_forward,
    }
    shifts = [(0.0,) if values is None else _values(name, values) for name, values in lists.items()]
    _check_count(math.prod(map(len, shifts)))
    return tuple(itertools.starmap(Scenario, itertools.product(*shifts)))


def checked_scenarios(scenarios: Iterable[Scenario]) -> tuple[Scenario, ...]:
    """Return scenarios that can stand in one table.

    Raises
    ------
    InvalidInputError
        There is none, or more than 10,000, or two have one name.
    """
    found = tuple(scenarios)
    _check_count(len(found))
    names = [scenario.label for scenario in found]
    for place, name in enumerate(names):
        if name in names[:place]:
            raise InvalidInputError("scenarios", Told(f"two called {name!r}"), "called by different names")
    return found


def read_scenarios(location: str) -> tuple[Scenario, ...]:
    """Read a file of scenarios.

    Parameters
    ----------
    location : str
        A path or URL of a .csv file with the columns "name", "spot_shift", "volatility_shift", "rate_shift" and
        "days_forward", of which any may be missing, or of a .json file with a list of objects of these keys.

    Raises
    ------
    InvalidInputError
        It holds anything else.
    OSError
        It cannot be read.
    """
    place = as_location(location)
    with open_binary(place) as file:
        content = file.read(LARGEST_FILE + 1)
    if len(content) > LARGEST_FILE:
        raise InvalidInputError("scenarios", location, f"a file of at most {LARGEST_FILE >> 20} MiB")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InvalidInputError("scenarios", location, "a file of UTF-8 text") from None
    lowered = place.lower()
    if lowered.endswith(".json"):
        entries = parse_cell("scenarios", text, "a list of objects")
    elif lowered.endswith(".csv"):
        entries = _rows_of_csv(text, location)
    else:
        raise InvalidInputError("scenarios", location, "a .csv or .json file")
    if not isinstance(entries, list):
        raise InvalidInputError("scenarios", location, "a list of objects")
    return checked_scenarios(_scenario(number, entry) for number, entry in enumerate(entries, start=1))


def shift_columns(scenario: Scenario) -> dict[str, float]:
    """Return the shifts by the names of their columns."""
    return {name: value for name, value in asdict(scenario).items() if name in SHIFTS}


def _rows_of_csv(text: str, location: str) -> list[Mapping[str, Any]]:
    try:
        header, *rows = [row for row in csv.reader(io.StringIO(text, newline=""), strict=True) if row]
    except (csv.Error, ValueError) as error:
        raise InvalidInputError("scenarios", location, f"a CSV file with a header: {error}") from None
    names = [name.strip() for name in header]
    if len(set(names)) < len(names):
        raise InvalidInputError("scenarios", ", ".join(names), "columns of different names")
    for number, row in enumerate(rows, start=1):
        if len(row) != len(names):
            raise InvalidInputError(
                f"scenarios[{number}]", ",".join(row), f"a row of {len(names)} cells, as the header"
            )
    return [{name: cell for name, cell in zip(names, row, strict=True) if cell != ""} for row in rows]


def _scenario(number: int, entry: Any) -> Scenario:
    place = f"scenarios[{number}]"
    if not isinstance(entry, Mapping):
        raise InvalidInputError(place, entry, "an object")
    shifts: dict[str, float] = {}
    for name, value in entry.items():
        if name not in (*SHIFTS, "name"):
            raise InvalidInputError(place, name, f"described by name, {', '.join(SHIFTS)}")
        if name != "name":
            shifts[name] = read_number(f"{place}.{name}", value) if isinstance(value, str) else value
    name = entry.get("name", "")
    if not isinstance(name, str):
        raise InvalidInputError(f"{place}.name", name, "a text")
    return Scenario(**shifts, name=name)


def _values(name: str, values: Sequence[float]) -> tuple[float, ...]:
    try:
        found = tuple(values)
    except TypeError:
        raise InvalidInputError(name, values, "a list of numbers") from None
    if not found or isinstance(values, str):
        raise InvalidInputError(name, values, "a list of at least one number")
    return found


def _check_count(count: int) -> None:
    if not 1 <= count <= MOST_SCENARIOS:
        raise InvalidInputError("scenarios", Told(f"{count} scenarios"), f"1 to {MOST_SCENARIOS} of them")
