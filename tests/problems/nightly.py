"""Parameters of tests that the nightly run alone takes."""

from collections.abc import Iterable
from typing import Any

import pytest


def nightly(values: Iterable[Any]) -> list[Any]:
    """Return the values of one parameter, marked for the nightly run."""
    return [pytest.param(value, marks=pytest.mark.nightly) for value in values]


def nightly_rows(rows: Iterable[tuple[Any, ...]]) -> list[Any]:
    """Return the values of several parameters, a tuple for each test, marked for the nightly run."""
    return [pytest.param(*row, marks=pytest.mark.nightly) for row in rows]
