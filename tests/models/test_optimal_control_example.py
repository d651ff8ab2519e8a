"""The example runs, draws, and prints its headline numbers."""

import runpy
from pathlib import Path

import pytest

from tests.problems.control_problems import lowered_cart

EXAMPLE = Path(__file__).parents[2] / "examples" / "optimal_control.py"


def test_the_example_prints_its_numbers(capsys: pytest.CaptureFixture[str]):
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    printed = capsys.readouterr().out
    assert printed.startswith("cost 13.521466835  (solved")
    assert "reaches the floor at 1.954759358" in printed
    assert "an atom of 2.889872101 at 1.954759358" in printed
    assert (EXAMPLE.parent / "out" / "optimal_control.png").read_bytes().startswith(b"\x89PNG")


def test_the_numbers_are_those_of_the_closed_form():
    known = lowered_cart(sigma=2.8898721012, junction=1.9547593576, T=4.0)
    assert known.problem.x0 == pytest.approx([2.0, 0.0], abs=1e-9)
    assert known.cost == pytest.approx(13.521466835, abs=1e-8)
