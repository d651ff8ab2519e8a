"""Seeds of random cases: a few in every run, the others in the nightly one."""

from typing import Any

import pytest


def seeds(every_run: int, in_all: int) -> list[Any]:
    """Return 0, 1, ..., of which the nightly run alone takes those from `every_run` on."""
    return [
        *range(every_run),
        *(pytest.param(n, marks=pytest.mark.nightly) for n in range(every_run, in_all)),
    ]
