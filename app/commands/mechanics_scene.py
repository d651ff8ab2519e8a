"""A mechanical system as an animation shows it: bodies where the file draws them, else coordinates on tracks."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from app.commands.animation import interpolated
from app.commands.mode_band import Band
from app.commands.simulation import Columns
from app.commands.simulation_plots import BAND_COLOURS, COLOURS, with_unit
from pricing_core.arrays import Matrix, Vector
from pricing_core.extras import needs_extra

with needs_extra("plot"):
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.patches import Polygon

TRACKS = 16  # shown, from the first on
ROUNDING = 1e-12  # share of a track's largest value below which an end is shown as zero
MARGIN = 0.08  # share of what is shown, around it


class TrackScene:
    """Every coordinate as a point on a track of its own, and the gap of every contact as one that closes."""

    def __init__(self, points: Vector, columns: Sequence[Columns], band: Band | None) -> None:
        self._points, self._band = points, band
        self._tracks = [
            (name, unit, kind.values[:, i], kind.symbol == "y")
            for kind in columns
            for i, (name, unit) in enumerate(
                zip(kind.names, kind.units or ("",) * len(kind.names), strict=True)
            )
        ][:TRACKS]

    def prepare(self, axes: Axes) -> None:
        """Draw a track for each with its range."""
        axes.set_axis_off()
        axes.set_xlim(-0.35, 1.1)
        axes.set_ylim(len(self._tracks) - 0.3, -0.7)
        for row, (name, unit, values, _) in enumerate(self._tracks):
            axes.plot([0.0, 1.0], [row, row], color="#9aa4ad", linewidth=1.5, zorder=1)
            axes.text(-0.05, row, with_unit(name, unit), ha="right", va="center", fontsize=9)
            for place, end in ((0.0, float(values.min())), (1.0, float(values.max()))):
                shown = end if abs(end) > ROUNDING * float(np.abs(values).max()) else 0.0
                axes.text(
                    place, row + 0.28, f"{shown:.3g}", ha="center", va="center", fontsize=8, color="#4d4d4d"
                )
        self._dots = axes.scatter(np.zeros(len(self._tracks)), np.arange(len(self._tracks)), s=150, zorder=3)

    def show(self, time: float) -> list[Artist]:
        """Move the points; those of closed contacts have the colour of their mode."""
        words = [] if self._band is None else self._band.words_at(time)
        places, colours, contact = [], [], 0
        for row, (_, _, values, is_gap) in enumerate(self._tracks):
            low, high = float(values.min()), float(values.max())
            value = interpolated(self._points, values, time)
            places.append(((value - low) / (high - low) if high > low else 0.0, row))
            colours.append("white" if is_gap else COLOURS[0])
            if is_gap and contact < len(words):
                word, contact = words[contact], contact + 1
                if word and self._band is not None:
                    colours[-1] = BAND_COLOURS[self._band.words.index(word)]
        self._dots.set_offsets(places)
        self._dots.set_facecolor(colours)
        self._dots.set_edgecolor("black")
        return [self._dots]


class BodyScene:
    """Boxes and discs that move with the coordinates, on a floor that may slope.

    Parameters
    ----------
    points : Vector, shape (m,)
    coordinates : mapping
        The coordinates by name, shape (m,) each.
    bodies : sequence of mapping
        "shape" with "width" and "height", or with "radius"; "at": the middle where the coordinates are zero; "x", "y"
        and "turn": names of coordinates that move it.
    slope : float
        Slope of the floor at height 0 in radians, downhill to the right where it is > 0.
    """

    def __init__(
        self,
        points: Vector,
        coordinates: Mapping[str, Vector],
        bodies: Sequence[Mapping[str, Any]],
        slope: float,
    ) -> None:
        self._points, self._slope, self._bodies = points, slope, bodies
        still = np.zeros(points.size)
        self._moves = [
            np.column_stack(
                [
                    body["at"][0] + coordinates.get(body.get("x", ""), still),
                    body["at"][1] + coordinates.get(body.get("y", ""), still),
                    coordinates.get(body.get("turn", ""), still),
                ]
            )
            for body in bodies
        ]

    def prepare(self, axes: Axes) -> None:
        """Draw the floor, and the bodies where they are at first."""
        axes.set_aspect("equal")
        axes.set_axis_off()
        reach = [_reach(body) for body in self._bodies]
        low = np.min(
            [move[:, :2].min(axis=0) - far for move, far in zip(self._moves, reach, strict=True)], axis=0
        )
        high = np.max(
            [move[:, :2].max(axis=0) + far for move, far in zip(self._moves, reach, strict=True)], axis=0
        )
        low[1] = min(low[1], 0.0)
        corners = self._turned(np.array([[x, y] for x in (low[0], high[0]) for y in (low[1], high[1])]))
        size = float(np.ptp(corners, axis=0).max())
        middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        half = 0.5 * np.ptp(corners, axis=0) + MARGIN * size
        axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
        axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
        ground = np.array(
            [
                [low[0] - size, 0.0],
                [high[0] + size, 0.0],
                [high[0] + size, -3 * size],
                [low[0] - size, -3 * size],
            ]
        )
        axes.add_patch(Polygon(self._turned(ground), facecolor="#e3e7eb", edgecolor="#4d4d4d", zorder=0))
        self._shapes = [
            Polygon(
                np.zeros((3, 2)),
                facecolor=COLOURS[i % len(COLOURS)],
                edgecolor="black",
                alpha=0.85,
                zorder=2,
            )
            for i in range(len(self._bodies))
        ]
        for shape in self._shapes:
            axes.add_patch(shape)
        self._marks = [axes.plot([], [], color="white", linewidth=1.6, zorder=3)[0] for _ in self._bodies]

    def show(self, time: float) -> list[Artist]:
        """Move the bodies."""
        for body, move, shape, mark in zip(self._bodies, self._moves, self._shapes, self._marks, strict=True):
            x, y, turn = (interpolated(self._points, column, time) for column in move.T)
            around = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
            outline, line = _outline(body)
            shape.set_xy(self._turned(outline @ around.T + (x, y)))
            mark.set_data(*self._turned(line @ around.T + (x, y)).T)
        return [*self._shapes, *self._marks]

    def _turned(self, places: Matrix) -> Matrix:
        c, s = math.cos(self._slope), math.sin(self._slope)
        return np.asarray(places @ np.array([[c, -s], [s, c]]))


def _reach(body: Mapping[str, Any]) -> Vector:
    if body["shape"] == "disc":
        return np.full(2, float(body["radius"]))
    return 0.5 * np.array([body["width"], body["height"]], dtype=np.float64)


def _outline(body: Mapping[str, Any]) -> tuple[Matrix, Matrix]:
    """Return the outline around the middle, and a line on it that shows how it turns."""
    if body["shape"] == "disc":
        radius, angles = float(body["radius"]), np.linspace(0.0, 2.0 * np.pi, 49)
        outline = radius * np.column_stack([np.cos(angles), np.sin(angles)])
        return outline, np.array([[0.0, 0.0], [0.0, 0.9 * radius]])
    half = _reach(body)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half
    return corners, np.array([[0.0, 0.0], [0.0, 0.8 * half[1]]])
