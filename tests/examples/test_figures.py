"""The examples that draw the figures of the chapter: their numbers, and that a picture is written."""

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.problems.needs_kernel import needs_kernel

EXAMPLES = Path(__file__).parents[2] / "examples"
PNG = b"\x89PNG\r\n\x1a\n"


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


def test_figure_11_2_reaches_the_origin_at_half_the_sum_of_the_distances() -> None:
    example = load("19_filippov")
    runs = example["solutions"]()
    for start, run in zip(example["STARTS"], runs, strict=True):
        (limit,) = (event for event in run.events if event.kind == "zeno")
        assert limit.time == pytest.approx(np.abs(start).sum() / 2, abs=1e-12)
        assert limit.x_after.tolist() == [0.0, 0.0]
    assert runs[0](1.0) == pytest.approx([4 / 3, -2 / 3], abs=1e-12)


def test_example_11_3_ends_elsewhere_by_the_order_of_the_contacts() -> None:
    example = load("18_two_carts")
    wall_first, carts_first, both = (
        [event for event in run.events if event.kind == "jump" and event.time < 0.1]
        for run in example["solutions"]()
    )
    near = 10 * example["APART"]
    assert wall_first[-1].x_after == pytest.approx([0.0, 0.0, 0.5, 0.5], abs=near)
    assert carts_first[-1].x_after == pytest.approx([0.0, 0.0, 0.0, -0.5], abs=near)
    assert both[-1].x_after == pytest.approx([0.0, 0.0, 0.0, 0.0], abs=1e-12)
    assert [event.order_sensitive for event in (*wall_first, *carts_first, *both)] == [
        *(False for _ in (*wall_first, *carts_first)),
        True,
    ]


@pytest.mark.parametrize("name", ["19_filippov", "18_two_carts"])
def test_a_picture_is_written(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    example = load(name)
    monkeypatch.setitem(example["main"].__globals__, "OUT", tmp_path)
    example["main"]()
    assert (tmp_path / f"{name}.png").read_bytes().startswith(PNG)
