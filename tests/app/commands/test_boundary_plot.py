import io
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.figure import Figure

from app.commands.boundary_plot import draw_boundary, limits_at_expiry
from pricing_core.american import (
    CashDividend,
    ExerciseBoundary,
    Market,
    Option,
    PiecewiseConstant,
    exercise_boundary,
)

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
        (PUT, Market(100.0, PiecewiseConstant([0.5, 1.0], [0.04, 0.05]), 0.2), []),
        (PUT, Market(100.0, PiecewiseConstant([1.0, 2.0], [0.05, 0.04]), 0.2, 0.1), [50.0]),
    ],
)
def test_the_limits_at_expiry_is_that_of_the_literature(
    option: Option, market: Market, limits: list[float]
) -> None:
    assert limits_at_expiry(option, market) == pytest.approx(limits)


@pytest.fixture
def figures(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """Keep the pictures that are drawn."""
    kept: list[Figure] = []

    def keep(figure: Figure, file: io.BytesIO, **_: object) -> None:
        kept.append(figure)
        file.write(b"drawn")

    monkeypatch.setattr(Figure, "savefig", keep)
    return kept


@pytest.mark.parametrize("exercise", ["american", "european"])
@pytest.mark.parametrize("option_type", ["put", "call"])
@pytest.mark.parametrize("dividend_yield", [0.0, 0.08])
def test_a_picture_has_labelled_axes_and_names_what_it_shows(
    figures: list[Figure], exercise: str, option_type: str, dividend_yield: float
) -> None:
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


def test_a_picture_of_an_option_with_events_names_them(figures: list[Figure]) -> None:
    time = np.array([0.0, 0.5, 1.0])
    found = ExerciseBoundary(time, 1.0 - time, np.array([80.0, np.nan, 100.0]), None, np.zeros(3), "none")
    curve = PiecewiseConstant([0.5, 1.0], [0.04, 0.05])
    market = Market(100.0, curve, 0.2, cash_dividends=[{"time": 0.5, "amount": 1.0}])  # type: ignore[arg-type]
    draw_boundary(found, PUT, market, io.BytesIO())
    labels = {text.get_text() for text in figures[0].legends[0].get_texts()}
    assert labels == {"exercise boundary", "exercise", "strike 100", "ex-date", "limit at expiry 100"}
    assert figures[0].axes[0].get_title().endswith("rate curve, yield 0, volatility 0.2, dividends")


@pytest.mark.parametrize("count", [1, 4, 20])
@pytest.mark.parametrize("option", [PUT, CALL])
def test_a_boundary_with_dividends_is_drawn_in_pieces_between_marked_ex_dates(
    figures: list[Figure], option: Option, count: int
) -> None:
    times = [(i + 0.5) / count for i in range(count)]
    market = Market(100.0, 0.05, 0.2, cash_dividends=[CashDividend(time, 1.0) for time in times])
    found = exercise_boundary(option, market, tolerance=1e-3)
    draw_boundary(found, option, market, io.BytesIO())
    axes = figures[0].axes[0]
    upright = [line.get_xdata()[0] for line in axes.get_lines() if list(line.get_ydata()) == [0, 1]]
    assert upright == pytest.approx(times)
    assert len(axes.texts) == (count if count <= 12 else 0)
    drawn = [line for line in axes.get_lines() if line.get_label() == "exercise boundary"]
    for line in drawn:
        x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        for start, end in pairwise(range(x.size)):
            if np.isfinite(y[start]) and np.isfinite(y[end]):  # no line crosses an ex-date
                assert not any(x[start] <= time < x[end] for time in times)
