import io

import numpy as np
import pytest
from matplotlib.figure import Figure

from app.plots import draw_boundary, limits_at_expiry
from pricing_core.american import Market, Option, exercise_boundary

PUT, CALL = Option("put", 100.0, 1.0), Option("call", 100.0, 1.0)


@pytest.mark.parametrize(
    ("option", "market", "limits"),
    [
        (PUT, Market(100.0, 0.05, 0.2, 0.0), [100.0]),
        (PUT, Market(100.0, 0.05, 0.2, 0.1), [50.0]),
        (PUT, Market(100.0, 0.0, 0.2, 0.1), []),
        (PUT, Market(100.0, -0.01, 0.2, -0.02), [100.0, 50.0]),
        (CALL, Market(100.0, 0.05, 0.2, 0.0), []),
        (CALL, Market(100.0, 0.06, 0.2, 0.03), [200.0]),
        (CALL, Market(100.0, 0.02, 0.2, 0.03), [100.0]),
        (Option("put", 100.0, 1.0, "european"), Market(100.0, 0.05, 0.2), []),
        (Option("put", 100.0, 0.0), Market(100.0, 0.05, 0.2), []),
    ],
)
def test_the_limits_at_expiry_is_that_of_the_literature(
    option: Option, market: Market, limits: list[float]
) -> None:
    assert limits_at_expiry(option, market) == pytest.approx(limits)


@pytest.mark.parametrize("exercise", ["american", "european"])
@pytest.mark.parametrize("option_type", ["put", "call"])
@pytest.mark.parametrize("dividend_yield", [0.0, 0.08])
def test_a_picture_has_labelled_axes_and_names_what_it_shows(
    monkeypatch: pytest.MonkeyPatch, exercise: str, option_type: str, dividend_yield: float
) -> None:
    figures: list[Figure] = []

    def keep(figure: Figure, file: io.BytesIO, **_: object) -> None:
        figures.append(figure)
        file.write(b"drawn")

    monkeypatch.setattr(Figure, "savefig", keep)
    option = Option(option_type, 100.0, 1.0, exercise)  # type: ignore[arg-type]
    market = Market(100.0, 0.05, 0.2, dividend_yield)
    found = exercise_boundary(option, market, [0.0, 0.25, 0.5, 0.75], tolerance=1e-3)
    file = io.BytesIO()
    draw_boundary(found, option, market, file)
    axes = figures[0].axes[0]
    labels = [text.get_text() for text in figures[0].legends[0].get_texts()]
    assert file.getvalue() == b"drawn"
    assert "years" in axes.get_xlabel()
    assert "money" in axes.get_ylabel()
    assert "strike 100" in labels
    assert ("exercise boundary" in labels) == bool(np.isfinite(found.boundary).any())
    bottom, top = axes.get_ylim()
    assert bottom < 100.0 < top
