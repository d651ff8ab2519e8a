"""The example prints what the circuit does."""

import math
import re
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp, trapezoid

EXAMPLE = Path(__file__).parents[3] / "examples" / "rectifier.py"
PERIOD = 0.02


def test_the_rectifier_prints_its_output_and_ripple(monkeypatch, capsys, tmp_path):
    """C v' = max(0, |17 sin| - v)/R - v/100, integrated by an ordinary solver."""

    def slope(t: float, v: list[float]) -> list[float]:
        charge = max(0.0, abs(17.0 * math.sin(100.0 * math.pi * t)) - v[0]) / 0.5
        return [(charge - v[0] / 100.0) / 1e-3]

    t = np.linspace(0.18, 0.2, 4001)
    settled = solve_ivp(slope, (0.0, 0.2), [0.0], t_eval=t, max_step=1e-4, rtol=1e-9, atol=1e-11).y[0]
    monkeypatch.setattr(sys, "argv", ["rectifier.py", str(tmp_path)])
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    printed = capsys.readouterr().out
    mean, ripple = (float(number) for number in re.findall(r"([\d.]+) V", printed))
    assert (mean, ripple) == (16.1029, 1.3098)
    assert ripple == pytest.approx(np.ptp(settled), abs=1e-4)
    assert mean == pytest.approx(trapezoid(settled, t) / PERIOD, abs=1e-4)
    assert (tmp_path / "rectifier.png").stat().st_size > 10_000
