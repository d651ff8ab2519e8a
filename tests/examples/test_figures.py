"""The example that draws Figure 11.1, held against exact values; those of the other figures assert their numbers."""

import runpy
from pathlib import Path
from typing import Any

import numpy as np

from tests.problems.needs_kernel import needs_kernel

EXAMPLES = Path(__file__).parents[2] / "examples"


def load(name: str) -> dict[str, Any]:
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))


@needs_kernel
def test_figure_11_1_shows_the_values_of_the_pricing_engine() -> None:
    example = load("21_put_as_a_system")
    spots, values, true = example["put_values"]()
    assert np.max(np.abs(values - true)) < 0.02  # of a strike of 100
    assert np.all(values >= np.maximum(100.0 - spots, 0.0) - 1e-9)
    assert np.all(np.diff(values, axis=0) > -1e-6)  # worth more the longer it is to expiry
    assert len(example["draw"](spots, values).axes[0].get_lines()) == 5
