"""Parameters of tests that the nightly run alone takes."""

from collections.abc import Iterable
from typing import Any

import pytest


def nightly(values: Iterable[Any]) -> list[Any]:
    """Return the values of one parameter, marked for the nightly run."""
    return [pytest.param(value, marks=pytest.mark.nightly) for value in values]
