"""Values that no argument takes for a number, an array or a function."""

from collections.abc import Callable
from decimal import Decimal
from typing import Any

import numpy as np
import pytest

WRONG = [
    "x",
    [[1], [1, 2]],
    pytest.param(10**400, id="401 digits"),
    pytest.param(10**5000, id="5001 digits"),
    1j,
    object(),
    Decimal("NaN"),
    np.datetime64("2020-01-01"),
]


def by_name(function: Callable[..., Any], *names: str) -> list[tuple[str, Callable[[Any], Any]]]:
    """Return each argument's name, with what gives the function a value for it."""
    return [(name, lambda value, name=name: function(**{name: value})) for name in names]
